"""Rules from facts to a drive file: every number a choice with its reason, without a trial.

kappa V is what is unknown of a sample's voltage (:mod:`runtime.design.known`), and (kappa V T)^2 a flux linkage's
process noise. The load torque is a random walk that goes LOAD_STEPS times as far as steps of the rated torque once in
``step_every``; the two set how fast the filter follows a load step, and the speed regulator stays well below that. The
shares were chosen by Monte Carlo over the motors of ``tests/data/facts`` (``python -m benchmarks.design``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

from model.drives.states import most_angle_variance
from model.schema import Bandwidth, HalfWidth, ShortTime, Speed, Torque, Variance
from runtime.design.facts import Facts
from runtime.design.known import (
    ALIKE_TURN,
    COMPENSATION_SAMPLES,
    DEAD_TOLERANCE,
    FADING_SAMPLES,
    FADING_SIGMAS,
    HURTING_SHARE,
    LOAD_STEPS,
    ROUND,
    RUN_UPS,
    UNSURE_SAMPLES,
    RatedPoint,
    adaptive_time,
    doubted_flux,
    fading_current,
    filter_bandwidth,
    inductance_bandwidth,
    is_salient,
    limits,
    model_fading,
    motor_data,
    rated_point,
    remarks,
    resistance_hurts,
    rounded,
    stated,
    unsaid_share,
    usable_current,
)
from runtime.recorded.units import RPM

#: Variances of the speed and the angle a sample that no other noise explains: of the largest acceleration; rad^2.
SPEED_SHARE, ANGLE_NOISE = 0.01, 1e-8
#: The speed regulator's bandwidth is at most this share of the current regulators' and of the filter's own.
SPEED_TO_CURRENT, SPEED_TO_FILTER = 0.1, 1 / 4.5
#: The current regulators' bandwidth times T, at most; voltage is left for so many times their largest step.
CURRENT_TURN, VOLTAGE_STEPS = 0.15, 3.0


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
    point, box = rated_point(facts), limits(facts)
    said, usable = remarks(facts, point), usable_current(facts, point)
    if usable < facts.max_current:
        said.append(
            f"currents up to {usable:.3g} A instead of {facts.max_current:g} A: more takes the whole voltage at rated "
            "speed, which the run-up with it would meet."
        )
        facts = replace(facts, max_current=usable)
        point = rated_point(facts)
    sections = {
        "motor": _motor(facts),
        "model": _model(facts, point),
        "filter": _filter(facts, point),
        "rated": _rated(facts),
        "operating_box": _box(facts, point, box),
        "control": _control(facts, point),
        **({"inverter": _inverter(facts, point)} if facts.dead_time else {}),
        "tolerance": _tolerance(facts, point),
    }
    return Design(facts.name, sections, said)


def _motor(f: Facts) -> Section:
    known = f"H, known within {f.d_L:.0%}"
    reasons = {
        "stator_resistance": f"ohm of a phase, known within {f.d_R:.0%}",
        "inductance_d": known if is_salient(f) else f"{known}; L_d and L_q count as one up to {ROUND:.0%}",
        "inductance_q": known,
        "magnet_flux": f"Wb, known within {f.d_psi:.0%}",
        "pole_pairs": "as stated",
        "inertia": f"kg m^2, known within {f.d_J:.0%}",
        "friction": "N m s / rad",
    }
    return {key: Choice(value, reasons[key]) for key, value in motor_data(f).items()}


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
        else Choice([], "none: [tolerance] says how far the data may be off")
    )
    return {
        "machine": machine,
        "mechanics": Choice("load_torque", "the inertia is known: the load is a state, and Q of omega can be small"),
        "discretization": Choice("exact", f"T R / L = {decay:.2g}; Euler's method would bias the angle"),
        "sample_time": Choice(f.T, f"s; {math.degrees(f.omega_e * f.T):.2g} degrees electrical at rated speed"),
        "adaptive": adaptive,
        "adaptive_time": Choice(
            adaptive_time(f), f"s, {RUN_UPS:g} run-ups or more; an adaptive state goes back in it if nothing is learnt"
        ),
    }


def _filter(f: Facts, point: RatedPoint) -> Section:
    kappa, s2, salient = unsaid_share(f), f.sigma**2, is_salient(f)
    q_psi = (kappa * f.voltage * f.T) ** 2
    electrical = q_psi if salient else q_psi / (0.5 * (f.L_d + f.L_q)) ** 2
    torque_walk = LOAD_STEPS * f.torque**2 * f.T / f.step_every
    speed_walk = (SPEED_SHARE * point.largest_torque * f.T / f.J) ** 2
    q = [electrical, electrical, speed_walk, ANGLE_NOISE, torque_walk]
    p0 = [*_electrical_start(f), (0.002 * f.speed) ** 2, max(f.angle**2 / 3, 1e-6), (0.1 * f.torque) ** 2]
    units = ["Wb^2" if salient else "A^2"] * 2 + ["(rad/s)^2", "rad^2", "(N m)^2"]
    if resistance_hurts(f, point):
        p0.append((f.d_R * f.R) ** 2 / 3)
        q.append(p0[-1] * 2 * f.T / adaptive_time(f))
        units.append("ohm^2")
    p0[3] = min(p0[3], 0.99 * most_angle_variance(len(p0), ["ckf"]))  # three digits of it are still accepted
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
            rounded(p0, Variance), f"{', '.join(units)}: at rest without current, the angle {angle}"
        ),
        "process_noise": Choice(
            rounded(q, Variance),
            f"a sample: no fact says {kappa:.1%} of {f.voltage:.3g} V, the load steps every {f.step_every:g} s",
        ),
        "measurement_noise": Choice(
            rounded([s2, 5 * s2 / 3], Variance),
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
        "speed": Choice(stated(f.speed), f"rad/s: {f.speed * RPM:.6g} r/min"),
        "torque": Choice(stated(f.torque), "N m"),
    }


def _box(f: Facts, point: RatedPoint, inside: dict[str, float]) -> Section:
    return {
        "current": Choice(inside["current"], "A, 2.5 times the largest"),
        "voltage": Choice(inside["voltage"], "V, 1.5 times the DC link"),
        "speed": Choice(rounded(2 * f.speed, Speed), "rad/s, twice the rated speed"),
        "load_torque": Choice(rounded(2 * point.largest_torque, Torque), "N m, twice what the largest current makes"),
    }


def _control(f: Facts, point: RatedPoint) -> Section:
    currents = {
        f"{CURRENT_TURN:g} / T": CURRENT_TURN / f.T,
        "what the voltage can drive": VOLTAGE_STEPS * f.voltage / (max(f.L_d, f.L_q) * f.max_current),
    }
    current = rounded(min(currents.values()), Bandwidth)
    speeds = {
        "a tenth of the currents'": SPEED_TO_CURRENT * current,
        "what the largest torque can do": point.largest_torque / (0.2 * f.J * f.speed),
        "what the filter can follow": SPEED_TO_FILTER * filter_bandwidth(f, point),
        f"what an inductance within {f.d_L:.0%} leaves stable": inductance_bandwidth(f, point),
    }
    return {
        "dc_link": Choice(f.dc_link, "V"),
        "max_current": Choice(f.max_current, "A, peak of a phase"),
        "current_bandwidth": Choice(current, f"rad/s: {min(currents, key=lambda k: currents[k])}"),
        "speed_bandwidth": Choice(
            rounded(min(speeds.values()), Bandwidth), f"rad/s: {min(speeds, key=lambda k: speeds[k])}"
        ),
    }


def _tolerance(f: Facts, point: RatedPoint) -> Section:
    held = "the state is held within: what else is taken for R i stays small"
    dead = {
        "dead_time": Choice(DEAD_TOLERANCE, "what a driver's data sheet leaves open"),
        "unsure_samples": Choice(
            UNSURE_SAMPLES[is_salient(f)], "a leg without a sign of its current keeps what it takes"
        ),
    }
    turn = ALIKE_TURN[is_salient(f)]
    alike = rounded(turn / f.omega_e, ShortTime)
    doubted = rounded(doubted_flux(f), HalfWidth)
    seen = f"of {f.d_psi:g}, what noise of the voltage does not hide"
    return {
        "stator_resistance": Choice(f.d_R, held if resistance_hurts(f, point) else "as stated"),
        "inductance": Choice(f.d_L, "as stated"),
        "magnet_flux": Choice(doubted, seen),
        **(dead if f.dead_time else {}),
        "correlation_time": Choice(alike, f"s, a turn of {turn:g} rad at rated speed: then volts point elsewhere"),
    }


def _inverter(f: Facts, point: RatedPoint) -> Section:
    way = f"more of {FADING_SIGMAS:g} sigmas and what V_d drives through L in"
    fading = Choice(fading_current(f), f"A, the {way} {FADING_SAMPLES:g} sample")
    if model_fading(f, point) > fading.value:
        fading = Choice(model_fading(f, point), "A, two thirds of the ripple: within it the sign is that of the mean")
    return {
        "dead_time": Choice(f.dead_time, f"s, {f.dead_time / f.T:.1%} of a sample; model and controller have it"),
        "switching_frequency": Choice(stated(1 / f.T), "Hz, one period a sample"),
        "fading_current": fading,
        "compensation_current": Choice(
            fading_current(f, COMPENSATION_SAMPLES), f"A, the {way} {COMPENSATION_SAMPLES:g} samples"
        ),
    }
