"""Rules from facts to a drive file: every number a choice with its reason, without a trial.

With V the largest phase voltage, i the current at the rated point on the curve of maximum torque per ampere, and d the
half-widths of tolerance, what the model does not know of a sample's voltage is taken as one share of V,

    kappa^2 = LEAST_SHARE^2 + (DEAD_SHARE sqrt(3) / 2 dead_time / T)^2
              + 4 / (3 V^2) ((a d_R R i)^2 + (SEEN_SHARE d_psi omega_e psi_m)^2 + (SEEN_SHARE d_L omega_e L_q i)^2),

and (kappa V T)^2 is a flux linkage's process noise. The load torque is a random walk that goes LOAD_STEPS times as far
as steps of the rated torque once in ``step_every``; the two set how fast the filter follows a load step, and the speed
regulator stays well below that (:func:`filter_bandwidth`). The shares were chosen by Monte Carlo over the motors of
``tests/data/facts`` (``python -m benchmarks.design``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, get_args

from model.drives.load import parse_drive
from model.rating import mtpa_currents, rating
from model.schema import Bandwidth, Current, DriveError, Speed, Torque, Variance, Voltage
from runtime.design.facts import Facts
from runtime.recorded.units import RPM
from runtime.system.errors import UserError

#: Share of V that the averages over a sample and the modulator leave unknown, whatever the motor.
LEAST_SHARE = 2e-3
#: Share of the dead time's voltage that its compensation leaves, and of what magnet and inductance within tolerance
#: take at rated speed: the filter sees the back-EMF itself, and Q for all of it would be far too much at low speed.
DEAD_SHARE, SEEN_SHARE = 0.5, 0.3
#: Share of the resistance's tolerance that stays in Q where the resistance is adapted.
ADAPTED_SHARE = 0.6
#: The resistance is adapted where its tolerance takes more than this share of the back-EMF at a tenth of rated speed.
HURTING_SHARE = 0.2
#: An adaptive resistance goes through its tolerance in this time, s.
ADAPTIVE_TIME = 1.0
#: Variance of the load torque's walk, in steps of the rated torque.
LOAD_STEPS = 5.0
#: Variances of the speed and the angle a sample that no other noise explains: of the largest acceleration; rad^2.
SPEED_SHARE, ANGLE_NOISE = 0.01, 1e-8
#: The speed regulator's bandwidth is at most this share of the current regulators' and of the filter's own.
SPEED_TO_CURRENT, SPEED_TO_FILTER = 0.1, 1 / 4.5
#: The current regulators' bandwidth times T, at most; voltage is left for so many times their largest step.
CURRENT_TURN, VOLTAGE_STEPS = 0.15, 3.0
#: Dead-time compensation fades below so many sigmas of the current sensor and this share of the largest current.
FADING_SIGMAS, FADING_SHARE = 6.0, 0.02
#: Largest relative difference of L_d and L_q that counts as none.
ROUND = 0.02
#: Largest electrical turn in a sample, rad, and largest T R / L, at which these rules are known to run.
TURN, DECAY = 0.33, 0.17


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

    @property
    def kind(self) -> str:
        """The filter that is generated."""
        return str(self.sections["filter"]["kinds"].value[0])

    def tables(self) -> dict[str, Any]:
        """The drive file's tables as tomllib would read them."""
        plain = {name: {key: c.value for key, c in section.items()} for name, section in self.sections.items()}
        return {"name": self.name, **plain}


@dataclass(frozen=True)
class RatedPoint:
    """The rated point: currents (A), the speed at which its torque takes the whole voltage (rad/s), largest torque."""

    i_d: float
    i_q: float
    base_speed: float
    largest_torque: float

    @property
    def current(self) -> float:
        """Amplitude, A."""
        return math.hypot(self.i_d, self.i_q)


def design(facts: Facts) -> Design:
    """The drive file that suits the facts.

    Parameters
    ----------
    facts : Facts

    Raises
    ------
    UserError
        Facts that no drive file can hold, such as a magnet flux out of its range; one line.
    """
    point = rated_point(facts)
    sections = {
        "motor": _motor(facts),
        "model": _model(facts, point),
        "filter": _filter(facts, point),
        "rated": _rated(facts),
        "operating_box": _box(facts, point),
        "control": _control(facts, point),
    }
    return Design(facts.name, sections, remarks(facts, point))


def rated_point(f: Facts) -> RatedPoint:
    """Currents, voltage and torque limits at the rated point, as the drive file's own rating has them.

    Parameters
    ----------
    f : Facts

    Raises
    ------
    UserError
        Motor data that no drive file can hold.
    """
    plain = {"initial_covariance": [1.0] * 5, "process_noise": [1.0] * 5, "measurement_noise": [1.0] * 2}
    tables = {
        "name": f.name,
        "motor": {key: choice.value for key, choice in _motor(f).items()},
        "model": {"machine": "salient", "mechanics": "load_torque", "discretization": "exact", "sample_time": f.T},
        "filter": {"kinds": ["ckf"], **plain},
        "rated": {key: choice.value for key, choice in _rated(f).items()},
        "operating_box": _limits(f),
        "control": {"dc_link": f.dc_link, "max_current": f.max_current},
    }
    try:
        drive = parse_drive(tables, f.name)
    except DriveError as error:
        raise UserError(f"these facts make a drive file that is refused: {error}") from None
    rated = rating(drive)
    i_d, i_q = mtpa_currents(drive, rated.current)
    return RatedPoint(i_d, i_q, rated.base_speed, rated.largest_torque)


def is_salient(f: Facts) -> bool:
    """Whether L_d and L_q differ by more than can be left out.

    Parameters
    ----------
    f : Facts
    """
    return abs(f.L_q - f.L_d) > ROUND * max(f.L_d, f.L_q)


def resistance_hurts(f: Facts, point: RatedPoint) -> bool:
    """Whether what is unknown of R i rivals the back-EMF at a tenth of rated speed, so that R must be adapted.

    Parameters
    ----------
    f : Facts
    point : RatedPoint
    """
    active_flux = f.psi_m + (f.L_d - f.L_q) * point.i_d
    return f.d_R * f.R * point.current > HURTING_SHARE * 0.1 * f.omega_e * active_flux


def unknown_share(f: Facts, point: RatedPoint) -> float:
    """kappa: what is unknown of a sample's voltage, of the largest one.

    Parameters
    ----------
    f : Facts
    point : RatedPoint
    """
    kept = ADAPTED_SHARE if resistance_hurts(f, point) else 1.0
    parts = (
        kept * f.d_R * f.R * point.current,
        SEEN_SHARE * f.d_psi * f.omega_e * f.psi_m,
        SEEN_SHARE * f.d_L * f.omega_e * f.L_q * point.current,
    )
    dead = DEAD_SHARE * 0.5 * math.sqrt(3) * f.dead_time / f.T
    return math.sqrt(LEAST_SHARE**2 + dead**2 + 4 / (3 * f.voltage**2) * sum(part * part for part in parts))


def filter_bandwidth(f: Facts, point: RatedPoint) -> float:
    """How fast the filter follows a load step, rad/s: (q / r)^(1/4), as of any filter of a double integrator.

    r is the density of what is unknown of the speed by way of the back-EMF, q that of the acceleration's random walk.

    Parameters
    ----------
    f : Facts
    point : RatedPoint
    """
    r = (unknown_share(f, point) * f.voltage / f.psi_m) ** 2 * f.T
    q = LOAD_STEPS * f.torque**2 / f.step_every * (f.p / f.J) ** 2
    return float((q / r) ** 0.25)


def fading_current(f: Facts) -> float:
    """The current below which dead-time compensation fades, A: there the sign of a measured current is none.

    Parameters
    ----------
    f : Facts
    """
    return float(_rounded(max(FADING_SIGMAS * f.sigma, FADING_SHARE * f.max_current), Current))


def remarks(f: Facts, point: RatedPoint) -> list[str]:
    """What the facts say against each other, or against the sample time: one line each.

    Parameters
    ----------
    f : Facts
    point : RatedPoint
    """
    lines = []
    if point.current > f.max_current:
        lines.append(
            f"rated.torque of {f.torque:g} N m takes {point.current:.3g} A, more than rated.max_current, "
            f"{f.max_current:g} A."
        )
    if f.speed > point.base_speed:
        lines.append(
            f"with rated torque a DC link of {f.dc_link:g} V is used up at {point.base_speed * RPM:.0f} r/min; the "
            f"rated speed of {f.speed * RPM:.0f} r/min is out of reach."
        )
    if f.max_current > f.range:
        lines.append(f"sensor.range of {f.range:g} A does not cover rated.max_current, {f.max_current:g} A.")
    decay = f.T * f.R / min(f.L_d, f.L_q)
    if f.omega_e * f.T > TURN or decay > DECAY:
        shorter = f.T * min(TURN / (f.omega_e * f.T), DECAY / decay)
        lines.append(
            f"a sample of {f.T * 1e6:.3g} us is long: {math.degrees(f.omega_e * f.T):.0f} degrees electrical at rated "
            f"speed, T R / L = {decay:.2f}. Up to {shorter * 1e6:.2g} us is tried ground; the trial says what holds."
        )
    if f.dead_time:
        lines.append(
            f"tried with the controller's dead-time compensation on: gain dead_share = {f.dead_time / f.T:.3g}, "
            f"dead_current = {fading_current(f):g} A; the firmware sets them (docs/design.md)."
        )
    return lines


def _motor(f: Facts) -> Section:
    L = 0.5 * (f.L_d + f.L_q)
    L_d, L_q = (f.L_d, f.L_q) if is_salient(f) else (L, L)
    known = f"H, known within {f.d_L:.0%}"
    return {
        "stator_resistance": Choice(_stated(f.R), f"ohm of a phase, known within {f.d_R:.0%}"),
        "inductance_d": Choice(
            _stated(L_d), known if is_salient(f) else f"{known}; L_d and L_q count as one up to {ROUND:.0%}"
        ),
        "inductance_q": Choice(_stated(L_q), known),
        "magnet_flux": Choice(_stated(f.psi_m), f"Wb, known within {f.d_psi:.0%}"),
        "pole_pairs": Choice(f.p, "as stated"),
        "inertia": Choice(_stated(f.J), f"kg m^2, known within {f.d_J:.0%}"),
        "friction": Choice(f.D, "N m s / rad"),
    }


def _model(f: Facts, point: RatedPoint) -> Section:
    decay = f.T * f.R / min(f.L_d, f.L_q)
    machine = (
        Choice("salient_flux", "the axes differ; flux linkages as states lock where currents as states settle wrong")
        if is_salient(f)
        else Choice("surface", f"L_d and L_q are equal within {ROUND:.0%}")
    )
    adaptive = (
        Choice(
            ["stator_resistance"],
            f"{f.d_R:.0%} of R i is more than {HURTING_SHARE:.0%} of the back-EMF at a tenth of rated speed",
        )
        if resistance_hurts(f, point)
        else Choice([], "none: what the tolerances leave unknown is in process_noise")
    )
    return {
        "machine": machine,
        "mechanics": Choice("load_torque", "the inertia is known: the load is a state, and Q of omega can be small"),
        "discretization": Choice("exact", f"T R / L = {decay:.2g}; Euler's method would bias the angle"),
        "sample_time": Choice(f.T, f"s; {math.degrees(f.omega_e * f.T):.2g} degrees electrical at rated speed"),
        "adaptive": adaptive,
        "adaptive_time": Choice(ADAPTIVE_TIME, "s, in which an adaptive state goes back where nothing is learnt"),
    }


def _filter(f: Facts, point: RatedPoint) -> Section:
    kappa, s2, salient = unknown_share(f, point), f.sigma**2, is_salient(f)
    q_psi = (kappa * f.voltage * f.T) ** 2
    electrical = q_psi if salient else q_psi / (0.5 * (f.L_d + f.L_q)) ** 2
    torque_walk = LOAD_STEPS * f.torque**2 * f.T / f.step_every
    speed_walk = (SPEED_SHARE * point.largest_torque * f.T / f.J) ** 2
    q = [electrical, electrical, speed_walk, ANGLE_NOISE, torque_walk]
    p0 = [*_electrical_start(f), (0.002 * f.speed) ** 2, max(f.angle**2 / 3, 1e-6), (0.1 * f.torque) ** 2]
    units = ["Wb^2" if salient else "A^2"] * 2 + ["(rad/s)^2", "rad^2", "(N m)^2"]
    if resistance_hurts(f, point):
        p0.append((f.d_R * f.R) ** 2 / 3)
        q.append(p0[-1] * 2 * f.T / ADAPTIVE_TIME)
        units.append("ohm^2")
    angle = "anywhere" if f.angle >= math.pi else f"within {math.degrees(f.angle):.0f} degrees"
    single = (
        "one pass; its points see the currents bend with the angle" if salient else "h is linear: an ICKF is the same"
    )
    order = {}
    if salient:  # as cheap as it gets: few columns of the root bend
        adaptive = _model(f, point)["adaptive"].value
        states = ["theta", "omega", *adaptive, "psi_alpha", "psi_beta", "load_torque"]
        order["root_order"] = Choice(states, "the angle first: a quarter cheaper, as good")
    return {
        "kinds": Choice(["ckf"], single),
        **order,
        "initial_covariance": Choice(
            _rounded(p0, Variance), f"{', '.join(units)}: at rest without current, the angle {angle}"
        ),
        "process_noise": Choice(
            _rounded(q, Variance),
            f"a sample: {kappa:.1%} of {f.voltage:.3g} V is unknown, the load steps every {f.step_every:g} s",
        ),
        "measurement_noise": Choice(
            _rounded([s2, 5 * s2 / 3], Variance),
            f"A^2: {f.sigma:.3g} A rms on phases a and b, rounding in it; (1 + 4) / 3 of it on beta",
        ),
    }


def _electrical_start(f: Facts) -> list[float]:
    """P_0 of the electrical states: no current flows; a flux linkage also turns with the angle, even within +-a."""
    least = 4 * f.sigma**2
    if not is_salient(f):
        return [least, least]
    a = max(f.angle, 1e-3)
    alpha = 1.5 - 2 * math.sin(a) / a + math.sin(2 * a) / (4 * a)  # mean of (1 - cos)^2
    beta = 0.5 - math.sin(2 * a) / (4 * a)  # mean of sin^2
    return [f.L_q**2 * least + f.psi_m**2 * max(part, 0.0) for part in (alpha, beta)]


def _rated(f: Facts) -> Section:
    return {
        "speed": Choice(_stated(f.speed), f"rad/s: {f.speed * RPM:.6g} r/min"),
        "torque": Choice(_stated(f.torque), "N m"),
    }


def _limits(f: Facts) -> dict[str, float]:
    return {"current": _rounded(2.5 * f.max_current, Current), "voltage": _rounded(1.5 * f.dc_link, Voltage)}


def _box(f: Facts, point: RatedPoint) -> Section:
    limits = _limits(f)
    return {
        "current": Choice(limits["current"], "A, 2.5 times the largest"),
        "voltage": Choice(limits["voltage"], "V, 1.5 times the DC link"),
        "speed": Choice(_rounded(2 * f.speed, Speed), "rad/s, twice the rated speed"),
        "load_torque": Choice(_rounded(2 * point.largest_torque, Torque), "N m, twice what the largest current makes"),
    }


def _control(f: Facts, point: RatedPoint) -> Section:
    currents = {
        f"{CURRENT_TURN:g} / T": CURRENT_TURN / f.T,
        "what the voltage can drive": VOLTAGE_STEPS * f.voltage / (max(f.L_d, f.L_q) * f.max_current),
    }
    current = _rounded(min(currents.values()), Bandwidth)
    speeds = {
        "a tenth of the currents'": SPEED_TO_CURRENT * current,
        "what the largest torque can do": point.largest_torque / (0.2 * f.J * f.speed),
        "what the filter can follow": SPEED_TO_FILTER * filter_bandwidth(f, point),
    }
    return {
        "dc_link": Choice(f.dc_link, "V"),
        "max_current": Choice(f.max_current, "A, peak of a phase"),
        "current_bandwidth": Choice(current, f"rad/s: {min(currents, key=lambda k: currents[k])}"),
        "speed_bandwidth": Choice(
            _rounded(min(speeds.values()), Bandwidth), f"rad/s: {min(speeds, key=lambda k: speeds[k])}"
        ),
    }


def _stated(value: float) -> float:
    """Six digits of a fact: as stated, without what a conversion adds behind them."""
    return float(f"{value:.6g}")


def _rounded(value: Any, quantity: Any) -> Any:
    """Three digits, as more would claim what no rule knows; within what the drive file accepts of such a quantity."""
    if isinstance(value, list):
        return [_rounded(entry, quantity) for entry in value]
    bounds = get_args(quantity)[1].metadata
    (low,), (high,) = ([getattr(b, end) for b in bounds if hasattr(b, end)] for end in ("ge", "le"))
    return float(min(high, max(low, float(f"{value:.3g}"))))
