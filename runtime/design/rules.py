"""Rules from facts to a drive file: every number a choice with its reason, without a trial.

With V the largest phase voltage, i the current at the rated point on the curve of maximum torque per ampere, and d the
half-widths of tolerance, all that the model does not know of the voltage is one share of V,

    kappa^2 = KAPPA_0^2 + (sqrt(3) / 2 dead_time / T)^2
              + 4 / (3 V^2) ((d_R R i)^2 + (d_psi omega_e psi_m)^2 + (d_L omega_e L_q i)^2),

and a sample's process noise of a flux linkage is (kappa V T)^2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from runtime.design.facts import Facts

#: Share of V that the averages over a sample and the modulator leave unknown, whatever the motor.
KAPPA_0 = 2e-3
#: Largest relative difference of L_d and L_q that counts as none.
ROUND = 0.02
#: Largest electrical turn in a sample, rad, and largest T R / L, at which the designs of this module were tried.
TURN, DECAY = 0.33, 0.17
#: Cycles a second of the F28335.
CLOCK = 150e6


@dataclass(frozen=True)
class Choice:
    """A value of the drive file and why it is that."""

    value: Any
    reason: str


Section = dict[str, Choice]


@dataclass(frozen=True)
class Design:
    """A drive file as choices, by section and key, and what the facts themselves give rise to remark."""

    name: str
    sections: dict[str, Section]
    remarks: list[str] = field(default_factory=list)

    def tables(self) -> dict[str, Any]:
        """The drive file's tables as tomllib would read them."""
        plain = {name: {key: c.value for key, c in section.items()} for name, section in self.sections.items()}
        return {"name": self.name, **plain}


@dataclass(frozen=True)
class RatedPoint:
    """What the rules need to know of the rated point: currents (A), largest torque (N m), voltage share kappa."""

    i_d: float
    i_q: float
    largest_torque: float
    kappa: float

    @property
    def current(self) -> float:
        """Amplitude, A."""
        return math.hypot(self.i_d, self.i_q)


def design(facts: Facts) -> Design:
    """The drive file that suits the facts.

    Parameters
    ----------
    facts : Facts

    Returns
    -------
    Design
    """
    point = rated_point(facts)
    salient = is_salient(facts)
    sections = {
        "motor": _motor(facts, salient),
        "model": _model(facts, point, salient),
        "filter": _filter(facts, point, salient),
        "operating_box": _box(facts, point),
        "control": _control(facts, point),
    }
    return Design(facts.name, sections, remarks(facts, point))


def is_salient(f: Facts) -> bool:
    """Whether L_d and L_q differ by more than can be left out."""
    return abs(f.L_q - f.L_d) > ROUND * max(f.L_d, f.L_q)


def mtpa(f: Facts, current: float) -> tuple[float, float, float]:
    """i_d, i_q (A) and torque (N m) of a current amplitude on the curve of maximum torque per ampere."""
    r = (f.L_q - f.L_d) / f.psi_m * current
    share = 2 * r / (1 + math.sqrt(1 + 8 * r * r))
    i_d, i_q = -share * current, math.sqrt(1 - share * share) * current
    return i_d, i_q, 1.5 * f.p * (f.psi_m + (f.L_d - f.L_q) * i_d) * i_q


def rated_point(f: Facts) -> RatedPoint:
    """Currents at rated torque, and what is unknown of the voltage there."""
    low, high = 0.0, f.torque / (1.5 * f.p * f.psi_m)
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if mtpa(f, middle)[2] < f.torque else (low, middle)
    i_d, i_q, _ = mtpa(f, high)
    kR = ADAPTED if resistance_hurts(f, high) else 1.0
    parts = (kR * f.d_R * f.R * high, K_PSI * f.d_psi * f.omega_e * f.psi_m, K_L * f.d_L * f.omega_e * f.L_q * high)
    kappa = math.sqrt(
        KAPPA_0**2
        + (K_DEAD * 0.5 * math.sqrt(3) * f.dead_time / f.T) ** 2
        + 4 / (3 * f.voltage**2) * sum(part * part for part in parts)
    )
    return RatedPoint(i_d, i_q, mtpa(f, f.max_current)[2], kappa)


K_PSI = K_L = 0.3
ADAPTED = 0.6
HURTS = 0.2
SLOW = 1.0
KQW=0.01
KQL=5.0
A_S=10.0
K_DEAD=0.5
A_W=4.5

def resistance_hurts(f, current):
    active = f.psi_m + (f.L_d - f.L_q) * mtpa(f, current)[0]
    return f.d_R * f.R * current / (0.1 * active * f.omega_e) > HURTS


def remarks(f: Facts, point: RatedPoint) -> list[str]:
    """What the facts say against each other, or against the sample time: one line each."""
    lines = []
    if point.current > f.max_current:
        lines.append(
            f"rated.torque = {f.torque:g} N m takes {point.current:.3g} A; rated.max_current is {f.max_current:g} A."
        )
    L = min(f.L_d, f.L_q)
    v_d = f.R * point.i_d - f.omega_e * f.L_q * point.i_q
    v_q = f.R * point.i_q + f.omega_e * (f.psi_m + f.L_d * point.i_d)
    if math.hypot(v_d, v_q) > f.voltage:
        lines.append(
            f"rated speed with rated torque takes {math.hypot(v_d, v_q):.3g} V; a DC link of {f.dc_link:g} V gives "
            f"{f.voltage:.3g} V. The drive will not reach it."
        )
    if f.max_current > f.range:
        lines.append(f"sensor.range = {f.range:g} A does not cover rated.max_current = {f.max_current:g} A.")
    if f.omega_e * f.T > TURN or f.T * f.R / L > DECAY:
        shorter = min(TURN / f.omega_e, DECAY * L / f.R)
        lines.append(
            f"the sample time of {f.T * 1e6:.3g} us is long: {math.degrees(f.omega_e * f.T):.0f} degrees electrical a "
            f"sample at rated speed, T R / L = {f.T * f.R / L:.2f}. {shorter * 1e6:.2g} us or less is tried ground."
        )
    return lines


def _motor(f: Facts, salient: bool) -> Section:
    same = "as stated" if salient else f"one inductance: the axes differ by less than {ROUND:.0%}"
    L = 0.5 * (f.L_d + f.L_q)
    return {
        "stator_resistance": Choice(f.R, f"ohm, known within {f.d_R:.0%}"),
        "inductance_d": Choice(f.L_d if salient else L, f"H, {same}"),
        "inductance_q": Choice(f.L_q if salient else L, f"H, known within {f.d_L:.0%}"),
        "magnet_flux": Choice(f.psi_m, f"Wb, known within {f.d_psi:.0%}"),
        "pole_pairs": Choice(f.p, "as stated"),
        "inertia": Choice(f.J, f"kg m^2, known within {f.d_J:.0%}"),
        "friction": Choice(f.D, "N m s / rad"),
    }


def _model(f: Facts, point: RatedPoint, salient: bool) -> Section:
    machine = (
        Choice("salient_flux", "L_d and L_q differ; flux linkages as states lock where current states settle wrong")
        if salient
        else Choice("surface", f"L_d and L_q are equal within {ROUND:.0%}")
    )
    return {
        "machine": machine,
        "mechanics": Choice("load_torque", "inertia is known, so the load is a state and need not hide in Q of omega"),
        "discretization": Choice("exact", f"T R / L = {f.T * f.R / min(f.L_d, f.L_q):.2g}; Euler would lag by half a sample"),
        "sample_time": Choice(f.T, "s, as stated"),
        "adaptive": Choice(["stator_resistance"] if resistance_hurts(f, point.current) else [], "none: the tolerances are in Q"),
    }


def _filter(f: Facts, point: RatedPoint, salient: bool) -> Section:
    q_psi = (point.kappa * f.voltage * f.T) ** 2
    L = 0.5 * (f.L_d + f.L_q)
    flux = q_psi if salient else q_psi / L**2
    unit = "Wb^2" if salient else "A^2"
    q = [flux, flux, (KQW * point.largest_torque * f.T / f.J) ** 2, 1e-8, KQL * f.torque**2 * f.T / f.step_every]
    s2 = f.sigma**2
    p0_theta = f.angle**2 / 3
    p0 = [*_electrical_start(f, salient), (0.002 * f.speed) ** 2, max(p0_theta, 1e-6), (0.1 * f.torque) ** 2]
    if resistance_hurts(f, point.current):
        p0 += [(f.d_R * f.R)**2 / 3]
        q += [p0[-1] * 2 * f.T / SLOW]
    return {
        "kinds": Choice(["ckf"], "h is linear: an ICKF would be the same filter" if not salient else "one pass"),
        "gain": Choice("cubature", "of the CKF"),
        "initial_covariance": Choice(p0, f"{unit}, {unit}, (rad/s)^2, rad^2, (N m)^2: at rest, angle within {math.degrees(f.angle):.0f} degrees"),
        "process_noise": Choice(q, f"a sample; {point.kappa:.2%} of {f.voltage:.3g} V is unknown"),
        "measurement_noise": Choice([s2, 5 * s2 / 3], f"A^2: {f.sigma:.3g} A rms on phases a and b, (1 + 4) / 3 of it on beta"),
    }


def _electrical_start(f: Facts, salient: bool) -> list[float]:
    """P_0 of the electrical states: no current flows; a flux linkage also turns with the unknown angle."""
    least = 4 * f.sigma**2
    if not salient:
        return [least, least]
    a = max(f.angle, 1e-3)
    beta = 0.5 - math.sin(2 * a) / (4 * a)  # mean of sin^2 over +-a
    alpha = 1.5 - 2 * math.sin(a) / a + math.sin(2 * a) / (4 * a)  # mean of (1 - cos)^2
    return [f.L_q**2 * least + f.psi_m**2 * part for part in (alpha, beta)]


def _box(f: Facts, point: RatedPoint) -> Section:
    return {
        "current": Choice(2.5 * f.max_current, "A, 2.5 times the largest"),
        "voltage": Choice(1.5 * f.dc_link, "V, 1.5 times the DC link"),
        "speed": Choice(2 * f.speed, "rad/s, twice the rated speed"),
        "load_torque": Choice(2 * point.largest_torque, "N m, twice the largest torque"),
    }


def _control(f: Facts, point: RatedPoint) -> Section:
    current = min(0.15 / f.T, 3 * f.voltage / (max(f.L_d, f.L_q) * f.max_current))
    w0 = (KQL*f.torque**2/f.step_every*(f.p/f.J)**2/((point.kappa*f.voltage/f.psi_m)**2*f.T))**.25
    speed = min(w0/A_W, current / A_S, point.largest_torque / (0.2 * f.J * f.speed))
    return {
        "dc_link": Choice(f.dc_link, "V"),
        "max_current": Choice(f.max_current, "A"),
        "current_bandwidth": Choice(current, "rad/s: 0.15 / T, or what the voltage can drive"),
        "speed_bandwidth": Choice(speed, "rad/s: a tenth of it, or what the torque can"),
    }
