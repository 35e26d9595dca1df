"""SymPy's own statement of the motor: F and H derived a second time, and compared with CasADi's."""

from __future__ import annotations

import sympy as sp

from codegen.equations import equations
from model.drive import Drive
from runtime.proof.result import Link, Row

R, L_d, L_q, psi_m, p, J, D, T = sp.symbols("R L_d L_q psi_m p J D T", real=True)
omega, theta, T_L, v_alpha, v_beta = sp.symbols("omega theta load_torque v_alpha v_beta", real=True)


def second_statement(machine: str, discretization: str, mechanics: str) -> tuple[sp.Matrix, sp.Matrix, sp.Matrix]:
    """States, f and h, written here from the paper in complex phasors: not a translation of the model's code."""
    exact = discretization == "exact"
    letter = {"surface": "i", "salient_flux": "psi"}[machine]
    a, b = sp.symbols(f"{letter}_alpha {letter}_beta", real=True)
    z, v = a + sp.I * b, v_alpha + sp.I * v_beta
    middle = theta + p * omega * T / 2
    z_next = (_surface if machine == "surface" else _salient_flux)(z, v, exact, middle)
    current = z if machine == "surface" else _current(z, theta)
    decay = sp.exp(-T * D / J) if exact else 1 - T * D / J
    omega_next = decay * omega
    states = [a, b, omega, theta]
    if mechanics == "load_torque":
        at, angle = ((z + z_next) / 2, middle) if exact else (z, theta)
        omega_next += T / J * ((1 + decay) / 2 if exact else 1) * (_torque(machine, at, angle) - T_L)
        states.append(T_L)
    advance = T * p * ((omega + omega_next) / 2 if exact else omega)
    f = sp.Matrix([*_parts(z_next), omega_next, theta + advance, *states[4:]])
    return sp.Matrix(states), f, sp.Matrix(_parts(current))


def _surface(z: sp.Expr, v: sp.Expr, exact: bool, middle: sp.Expr) -> sp.Expr:
    e = sp.I * p * omega * psi_m  # back-EMF in the rotor frame
    if not exact:
        return z + T / L_d * (v - R * z - e * sp.exp(sp.I * theta))
    steady = (v - e * sp.exp(sp.I * middle)) / R
    return steady + (z - steady) * sp.exp(-T * R / L_d)


def _salient_flux(z: sp.Expr, v: sp.Expr, exact: bool, middle: sp.Expr) -> sp.Expr:
    if not exact:
        return z + T * (v - R * _current(z, theta))
    rotor_z, rotor_v = (sp.expand_complex(q * sp.exp(-sp.I * middle)) for q in (z, v))
    d = _relax(sp.re(rotor_z), psi_m + L_d / R * sp.re(rotor_v), L_d)
    q = _relax(sp.im(rotor_z), L_q / R * sp.im(rotor_v), L_q)
    return (d + sp.I * q) * sp.exp(sp.I * middle)


def _torque(machine: str, z: sp.Expr, angle: sp.Expr) -> sp.Expr:
    """1.5 p Im(conj(psi) i); for the surface machine the magnet's flux alone makes torque."""
    psi, i = (psi_m * sp.exp(sp.I * angle), z) if machine == "surface" else (z, _current(z, angle))
    return sp.Rational(3, 2) * p * sp.im(sp.expand_complex(sp.conjugate(sp.expand_complex(psi)) * i))


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
    x, f, h = second_statement(drive.model.machine, drive.model.discretization, drive.model.mechanics)
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
