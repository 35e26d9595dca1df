"""SymPy's own statement of the motor: F and H derived a second time, and compared with CasADi's."""

from __future__ import annotations

import sympy as sp

from codegen.equations import equations
from model.drive import Drive
from runtime.proof.result import Link, Row

R, L_d, L_q, psi_m, p, J, D, T = sp.symbols("R L_d L_q psi_m p J D T", real=True)
omega, theta, v_alpha, v_beta = sp.symbols("omega theta v_alpha v_beta", real=True)


def second_statement(machine: str, discretization: str) -> tuple[sp.Matrix, sp.Matrix, sp.Matrix]:
    """States, f and h, written here from the paper in complex phasors: not a translation of the model's code."""
    if machine == "surface":
        a, b = sp.symbols("i_alpha i_beta", real=True)
        z, v = a + sp.I * b, v_alpha + sp.I * v_beta
        e = sp.I * p * omega * psi_m  # back-EMF in the rotor frame
        if discretization == "euler":
            z_next = z + T / L_d * (v - R * z - e * sp.exp(sp.I * theta))
        else:
            steady = (v - e * sp.exp(sp.I * (theta + p * omega * T / 2))) / R
            z_next = steady + (z - steady) * sp.exp(-T * R / L_d)
        current = z
    elif machine == "salient_flux":
        a, b = sp.symbols("psi_alpha psi_beta", real=True)
        z, v = a + sp.I * b, v_alpha + sp.I * v_beta
        current = _current(z, theta)
        if discretization == "euler":
            z_next = z + T * (v - R * current)
        else:
            middle = theta + p * omega * T / 2
            rotor_z, rotor_v = (sp.expand_complex(q * sp.exp(-sp.I * middle)) for q in (z, v))
            d = _relax(sp.re(rotor_z), psi_m + L_d / R * sp.re(rotor_v), L_d)
            q = _relax(sp.im(rotor_z), L_q / R * sp.im(rotor_v), L_q)
            z_next = (d + sp.I * q) * sp.exp(sp.I * middle)
    else:
        raise KeyError(machine)
    decay = 1 - T * D / J if discretization == "euler" else sp.exp(-T * D / J)
    advance = T * p * omega if discretization == "euler" else T * p * (omega + decay * omega) / 2
    f = sp.Matrix([*_parts(z_next), decay * omega, theta + advance])
    return sp.Matrix([a, b, omega, theta]), f, sp.Matrix(_parts(current))


def _current(psi: sp.Expr, angle: sp.Expr) -> sp.Expr:
    """Magnet and inductances act in the rotor frame."""
    rotor = sp.expand_complex(psi * sp.exp(-sp.I * angle))
    return ((sp.re(rotor) - psi_m) / L_d + sp.I * sp.im(rotor) / L_q) * sp.exp(sp.I * angle)


def _relax(start: sp.Expr, steady: sp.Expr, L: sp.Expr) -> sp.Expr:
    return steady + (start - steady) * sp.exp(-T * R / L)


def _parts(z: sp.Expr) -> list[sp.Expr]:
    return list(sp.expand_complex(z).as_real_imag())


def compare_derivations(drive: Drive) -> Link:
    """Entry by entry, the difference of the two derivations must simplify to zero."""
    x, f, h = second_statement(drive.model.machine, drive.model.discretization)
    ours = equations(drive)
    rows = []
    for name, equation, mine, theirs in (
        ("f", "7", f, ours.f),
        ("h", "5", h, ours.h),
        ("F", "df/dx", f.jacobian(x), ours.F),
        ("H", "dh/dx", h.jacobian(x), ours.H),
    ):
        different = sum(not _is_zero(a - b) for a, b in zip(mine, theirs, strict=True))
        rows.append(Row(equation, name, "entries that differ", float(different), 0.0, len(mine)))
    return Link("model", "CasADi = SymPy, symbolically", drive.name, "f, h, F, H", "-", "all values", tuple(rows))


def _is_zero(expression: sp.Expr) -> bool:
    """Exact: expand to polynomials in sines, cosines and exponentials, with cos^2 = 1 - sin^2."""
    expanded = sp.expand(expression)
    angles = {item.args[0] for item in expanded.atoms(sp.sin, sp.cos)}
    for angle in angles:
        expanded = sp.expand(expanded.subs(sp.cos(angle) ** 2, 1 - sp.sin(angle) ** 2))
    return bool(expanded == 0 or sp.simplify(expanded) == 0)
