"""SymPy's own statement of the motor: F and H derived a second time, and compared with CasADi's."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import sympy as sp

from codegen.render.equations import equations, slopes, with_roots
from model.inverter import takes_voltage
from model.machines.base import Parameters
from model.machines.state_space import build
from model.schema import Drive
from model.to_sympy import to_sympy
from runtime.proof.identity import identical, is_derivative
from runtime.proof.result import Link, Row

R, L_d, L_q, psi_m, p, J, D, T = sp.symbols("R L_d L_q psi_m p J D T", real=True)
omega, theta, T_L, v_alpha, v_beta = sp.symbols("omega theta load_torque v_alpha v_beta", real=True)
#: Motor data that may be states: what stands for them then.
SLOW = {word: sp.Symbol(word, real=True) for word in ("magnet_flux", "stator_resistance", "dead_time_voltage")}
#: Motor data by which flux linkages become currents.
LINKED = {"L_d": L_d, "L_q": L_q, "psi_m": psi_m}
#: The inverter: what a leg loses, V, and the currents below which it loses less and
#: below which that says little, A; the direction in which it does.
V_d, I_0, I_1 = sp.symbols("V_d I_0 I_1", real=True)
g_alpha, g_beta = sp.symbols("g_alpha g_beta", real=True)
#: Stands for the square root of 3, which no field of numbers modulo a prime need have; it is nowhere squared.
ROOT_3 = sp.Symbol("root_3", real=True)


@dataclass(frozen=True)
class Second:
    """The motor in complex phasors, written here from the paper: not a translation of the model's code.

    ``psi`` and ``r`` are magnet flux and resistance as the equations see them: letters, or states.
    """

    machine: str
    exact: bool
    psi: sp.Expr
    r: sp.Expr

    def advance(self, z: sp.Expr, v: sp.Expr) -> sp.Expr:
        """The electrical state one sample later.

        Parameters
        ----------
        z : sp.Expr
        v : sp.Expr
            Voltage, V.
        """
        return {"surface": self._surface, "salient": self._salient, "salient_flux": self._flux}[self.machine](z, v)

    def current(self, z: sp.Expr, angle: sp.Expr) -> sp.Expr:
        """The measured currents. Of flux linkages: magnet and inductances act in the rotor frame.

        Parameters
        ----------
        z : sp.Expr
        angle : sp.Expr
            Electrical angle, rad.
        """
        if self.machine != "salient_flux":
            return z
        rotor = _seen_from(z, angle)
        return ((sp.re(rotor) - self.psi) / L_d + sp.I * sp.im(rotor) / L_q) * sp.exp(sp.I * angle)

    def torque(self, z: sp.Expr, angle: sp.Expr) -> sp.Expr:
        """1.5 p Im(conj(psi) i), psi whatever of the flux linkage makes torque with the current.

        Parameters
        ----------
        z : sp.Expr
        angle : sp.Expr
            Electrical angle, rad.
        """
        if self.machine == "salient_flux":
            flux, i = sp.expand_complex(z), self.current(z, angle)
        elif self.machine == "salient":
            i = _seen_from(z, angle)
            flux = self.psi + L_d * sp.re(i) + sp.I * L_q * sp.im(i)
        else:
            flux, i = sp.expand_complex(self.psi * sp.exp(sp.I * angle)), z
        return sp.Rational(3, 2) * p * sp.im(sp.expand_complex(sp.conjugate(flux) * i))

    @property
    def middle(self) -> sp.Expr:
        """The angle in the middle of the interval."""
        return theta + p * omega * T / 2

    def _surface(self, z: sp.Expr, v: sp.Expr) -> sp.Expr:
        e = sp.I * p * omega * self.psi  # back-EMF in the rotor frame
        if not self.exact:
            return z + T / L_d * (v - self.r * z - e * sp.exp(sp.I * theta))
        steady = (v - (self.r - R) * z - e * sp.exp(sp.I * self.middle)) / R
        return _relax(z, steady, L_d)

    def _salient(self, z: sp.Expr, v: sp.Expr) -> sp.Expr:
        angle = self.middle if self.exact else theta
        i, u = _seen_from(z, angle), _seen_from(v, angle)
        w_e, i_d, i_q = p * omega, sp.re(i), sp.im(i)
        # flux linkage seen from the rotor L_d i_d + psi_m + j L_q i_q; the part L_d i_d + j L_q i_q of an inductance
        # that turns against the current's frame induces j w_e (L_d i_d + j L_q i_q) - diag(L_d, L_q) j w_e i.
        swap = sp.I * w_e * (L_d * i_d + sp.I * L_q * i_q)
        swap -= L_d * sp.re(sp.I * w_e * i) + sp.I * L_q * sp.im(sp.I * w_e * i)
        e = sp.I * w_e * self.psi
        if not self.exact:
            rest = sp.expand_complex(u - self.r * i - swap - e)
            return (i + T * (sp.re(rest) / L_d + sp.I * sp.im(rest) / L_q)) * sp.exp(sp.I * angle)
        left = sp.expand_complex(u - e - (self.r - R) * i)
        coupling = w_e * (L_d - L_q)
        d_half = _relax(i_d, (sp.re(left) - coupling * i_q) / R, L_d, T / 2)
        q_half = _relax(i_q, (sp.im(left) - coupling * i_d) / R, L_q, T / 2)
        d = _relax(i_d, (sp.re(left) - coupling * q_half) / R, L_d)
        q = _relax(i_q, (sp.im(left) - coupling * d_half) / R, L_q)
        return (d + sp.I * q) * sp.exp(sp.I * angle)

    def _flux(self, z: sp.Expr, v: sp.Expr) -> sp.Expr:
        if not self.exact:
            return z + T * (v - self.r * self.current(z, theta))
        flux, u = _seen_from(z, self.middle), _seen_from(v, self.middle)
        drop = (self.r - R) * (sp.re(flux) - self.psi) / L_d, (self.r - R) * sp.im(flux) / L_q
        d = _relax(sp.re(flux), self.psi + L_d / R * (sp.re(u) - drop[0]), L_d)
        q = _relax(sp.im(flux), L_q / R * (sp.im(u) - drop[1]), L_q)
        # The magnet turns by p omega T meanwhile. The winding's share of q, psi_q less the magnet's, starts psi_m
        # p omega T / 2 higher, meets the back-EMF, and the magnet is as much ahead at the end.
        half_turn = self.psi * p * omega * T / 2
        a = sp.exp(-T * R / L_q)
        q += a * half_turn - (1 - a) * L_q / R * self.psi * p * omega + half_turn
        return (d + sp.I * q) * sp.exp(sp.I * self.middle)


def second_statement(
    machine: str, discretization: str, mechanics: str, adaptive: Sequence[str] = (), return_rate: float = 0.0
) -> tuple[sp.Matrix, sp.Matrix, sp.Matrix]:
    """States, f and h.

    Parameters
    ----------
    machine : {"surface", "salient", "salient_flux"}
    discretization : {"euler", "exact"}
    mechanics : {"constant_speed", "load_torque"}
    adaptive : sequence of str, optional
        Data that are states: "magnet_flux", "stator_resistance", "dead_time_voltage".
    return_rate : float, optional
        Share of the way back to the motor's datum that such a state goes in a sample.

    Returns
    -------
    tuple of three Matrix
        Columns of n, n and 2 entries: eq. 7 for f, eq. 5 for h.
    """
    exact = discretization == "exact"
    letter = "psi" if machine == "salient_flux" else "i"
    a, b = sp.symbols(f"{letter}_alpha {letter}_beta", real=True)
    z, v = a + sp.I * b, v_alpha + sp.I * v_beta
    if "dead_time_voltage" in adaptive:  # then f is given the voltage commanded
        v -= SLOW["dead_time_voltage"] * (g_alpha + sp.I * g_beta)
    known = {"magnet_flux": psi_m, "stator_resistance": R} | {word: SLOW[word] for word in adaptive}
    motor = Second(machine, exact, known["magnet_flux"], known["stator_resistance"])
    z_next = motor.advance(z, v)
    decay = sp.exp(-T * D / J) if exact else 1 - T * D / J
    omega_next = decay * omega
    states = [a, b, omega, theta]
    if mechanics == "load_torque":
        at, angle = ((z + z_next) / 2, motor.middle) if exact else (z, theta)
        omega_next += ((1 - decay) / D if exact else T / J) * (motor.torque(at, angle) - T_L)
        states.append(T_L)
    if not exact:
        turned = T * omega
    elif mechanics == "load_torque":
        turned = T * (omega + omega_next) / 2
    else:  # friction alone takes speed: J domega = -D omega dt
        turned = (omega - omega_next) * J / D
    states += [SLOW[word] for word in adaptive]
    own = {"magnet_flux": psi_m, "stator_resistance": R, "dead_time_voltage": V_d}
    slow = [SLOW[word] + (own[word] - SLOW[word]) * sp.Rational(return_rate) for word in adaptive]
    load = [T_L] if mechanics == "load_torque" else []
    f = sp.Matrix([*_parts(z_next), omega_next, theta + p * turned, *load, *slow])
    return sp.Matrix(states), f, sp.Matrix(_parts(motor.current(z, theta)))


def second_inverter(i: sp.Matrix) -> tuple[sp.Matrix, sp.Expr]:
    """The direction in which the voltage falls short, in units of V_d: each of three legs against its own current.

    And how unsure it is: sqrt(1 - |3/4 g|^2).

    Parameters
    ----------
    i : Matrix, (2, 1)
        Stator current, A.
    """
    half, high = sp.Rational(1, 2), ROOT_3 / 2
    legs = [sp.Matrix([1, 0]), sp.Matrix([-half, high]), sp.Matrix([-half, -high])]
    against = [sp.Max(-1, sp.Min(1, leg.dot(i) / I_0)) for leg in legs]
    g = sp.Rational(2, 3) * sum((share * leg for share, leg in zip(against, legs, strict=True)), sp.zeros(2, 1))
    apart = sum((against[k] - against[k - 1]) ** 2 for k in range(3))  # |g|^2 of these is two ninths of it
    return g, sp.sqrt(sp.Max(0, 1 - apart / 8))


def _inverter_rows(drive: Drive) -> list[Row]:
    """What the model makes of a commanded voltage: u - V_d g; of an estimated V_d what does not show."""
    model = build(drive, Parameters.symbolic())
    applied = model.applied(ca.vertsplit(model.x), ca.vertsplit(model.u))[0]
    i = to_sympy(model.h)
    g, unsure = second_inverter(i)
    shown, off = sp.Integer(1), V_d
    if "dead_time_voltage" in drive.model.adaptive:
        shown = sp.Max(0, sp.Min(1, i.dot(i) / I_1**2 - 1))
        off = SLOW["dead_time_voltage"] * (1 - shown)
    wanted = {"g": [*(shown * g), unsure][: len(applied.get("g", ()))], "v": sp.Matrix([v_alpha, v_beta]) - off * g}
    roots = {math.sqrt(3) / 2: ROOT_3 / 2, 1 / math.sqrt(3): ROOT_3 / 3}
    rows = []
    for name, ours in applied.items():
        pairs = zip(with_roots(to_sympy(ca.vertcat(*ours)), roots), wanted[name], strict=True)
        different = sum(not (identical(a, b) if k < 2 else identical(a**2, b**2)) for k, (a, b) in enumerate(pairs))
        rows.append(Row("-", name, "entries that differ", float(different), 0.0, len(ours)))
    return rows


def _way(name: str, exact: bool) -> tuple[sp.Expr, sp.Expr]:
    """Which way the voltage that arrives moves: V_d the way it acts, the rest of a loss on the rotor's axes."""
    angle = theta + p * omega * T / 2 if exact else theta
    ways = {
        "V_d": (-g_alpha, -g_beta),
        "loss_along": (sp.cos(angle), sp.sin(angle)),
        "loss_across": (-sp.sin(angle), sp.cos(angle)),
    }
    return ways.get(name, (sp.Integer(0), sp.Integer(0)))


def _lacking(drive: Drive, letter: sp.Symbol, h: sp.Matrix, states: int) -> list[sp.Expr]:
    """What a sample lacks where a datum by which flux linkages become currents is wrong, per unit of it.

    The currents are what they are: the flux linkage that the datum gives them induces j omega_e psi and makes torque,
    which speeds up the rotor as any torque does.
    """
    a, b = sp.symbols("given_alpha given_beta", real=True)
    i = _seen_from(a + sp.I * b, theta)
    magnet = SLOW["magnet_flux"] if "magnet_flux" in drive.model.adaptive else psi_m
    flux = L_d * sp.re(i) + magnet + sp.I * L_q * sp.im(i)
    induced = _parts(-sp.I * p * omega * T * flux * sp.exp(sp.I * theta))
    torque = sp.Rational(3, 2) * p * sp.im(sp.expand_complex(sp.conjugate(flux) * i))
    speed, turn = sp.Integer(0), sp.Integer(0)
    if drive.model.mechanics == "load_torque":
        exact = drive.model.discretization == "exact"
        speed = torque * ((1 - sp.exp(-T * D / J)) / D if exact else T / J)
        turn = p * T / 2 * speed if exact else turn
    rows = [*induced, speed, turn, *[sp.Integer(0)] * (states - 4)]
    return [sp.diff(row, letter).subs({a: h[0], b: h[1]}, simultaneous=True) for row in rows]


def _seen_from(z: sp.Expr, angle: sp.Expr) -> sp.Expr:
    """A phasor in a frame turned by ``angle``."""
    return sp.expand_complex(z * sp.exp(-sp.I * angle))


def _relax(start: sp.Expr, steady: sp.Expr, L: sp.Expr, t: sp.Expr = T) -> sp.Expr:
    return steady + (start - steady) * sp.exp(-t * R / L)


def _parts(z: sp.Expr) -> list[sp.Expr]:
    return list(sp.expand_complex(z).as_real_imag())


def compare_derivations(drive: Drive) -> Link:
    """Entry by entry, the two derivations must be the same function.

    Parameters
    ----------
    drive : Drive
        Its machine is a shipped one.
    """
    x, f, h = second_statement(
        drive.model.machine,
        drive.model.discretization,
        drive.model.mechanics,
        drive.model.adaptive,
        drive.model.return_rate,
    )
    ours = equations(drive)
    rows = []
    for name, equation, mine, theirs in (("f", "7", f, ours.f), ("h", "5", h, ours.h)):
        different = sum(not identical(a, b) for a, b in zip(mine, theirs, strict=True))
        rows.append(Row(equation, name, "entries that differ", float(different), 0.0, len(mine)))
    for name, equation, mine, theirs in (("F", "df/dx", f, ours.F), ("H", "dh/dx", h, ours.H)):
        pairs = [(theirs[i, k], mine[i], letter) for i in range(len(mine)) for k, letter in enumerate(x)]
        different = sum(not is_derivative(*pair) for pair in pairs)
        rows.append(Row(equation, name, "entries that differ", float(different), 0.0, len(pairs)))
    if takes_voltage(drive):
        rows += _inverter_rows(drive)
    for name, slope in slopes(drive).items():
        if drive.model.machine == "salient_flux" and name in LINKED:
            lacking = _lacking(drive, LINKED[name], h, len(x))
            different = sum(not identical(a, b) for a, b in zip(slope, lacking, strict=True))
            rows.append(Row(f"d/d{name}", "G", "entries that differ", float(different), 0.0, len(x)))
            continue
        volts, way = sp.Symbol(name, real=True), _way(name, drive.model.discretization == "exact")
        arriving = {v_alpha: v_alpha + volts * way[0], v_beta: v_beta + volts * way[1]}
        moved = f.subs(arriving, simultaneous=True)
        pairs = [(entry.subs(arriving, simultaneous=True), moved[i], volts) for i, entry in enumerate(slope)]
        different = sum(not is_derivative(*pair) for pair in pairs)
        rows.append(Row(f"df/d{name}", "G", "entries that differ", float(different), 0.0, len(pairs)))
    return Link("model", "CasADi = SymPy, symbolically", drive.name, "f, h, F, H", "-", "all values", tuple(rows))
