"""What facts amount to, by themselves and against each other: the rated point, and what is unknown of the voltage.

With V the largest phase voltage, what no fact says of a sample's voltage is taken as one share of V,

    kappa^2 = LEAST_SHARE^2 + (DEAD_SHARE sqrt(3) / 2 dead_time / T)^2;

it is process noise. Motor data within their tolerances are the filter's own to doubt ([tolerance] of the drive file).
How fast the filter follows is told from both together at the rated point, i the current on the curve of maximum torque
per ampere and d the half-widths,

    kappa^2 + 4 / (3 V^2) ((a d_R R i)^2 + (SEEN_SHARE d_psi omega_e psi_m)^2 + (SEEN_SHARE d_L omega_e L_q i)^2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, get_args

from model.drives.load import parse_drive
from model.loop.injection import RIPPLE
from model.rating import mtpa_currents, rating
from model.schema import Current, DriveError, SlowTime, Voltage
from runtime.design.facts import Facts
from runtime.recorded.units import RPM
from runtime.system.errors import UserError

#: Share of V that the averages over a sample and the modulator leave unknown, whatever the motor.
LEAST_SHARE = 2e-3
#: Share of the dead time's voltage that its compensation leaves, and of what magnet and inductance within tolerance
#: take at rated speed: the filter sees the back-EMF itself.
DEAD_SHARE, SEEN_SHARE = 0.8, 0.3
#: Half-width of the dead time, relative: what a driver's data sheet leaves open.
DEAD_TOLERANCE = 0.2
#: Electrical turn, at rated speed, for which a wrong datum's volts stay alike in the stator frame, rad, and samples for
#: which a leg without a sign does: of a round rotor, and of a salient one, whose angle hangs on its inductances more.
ALIKE_TURN = {False: 0.5, True: 0.7}
UNSURE_SAMPLES = {False: 4.0, True: 0.5}
#: A wrong psi_m is hidden by so many deviations of what averages and modulator leave unknown.
HIDING_SIGMAS = 6.0
#: Share of the resistance's tolerance that stays unknown where the resistance is adapted.
ADAPTED_SHARE = 0.6
#: The resistance is adapted where its tolerance takes more than this share of the back-EMF at a tenth of rated speed.
HURTING_SHARE = 0.05
#: An adaptive resistance goes through its tolerance in so many run-ups with rated torque, at least in this time, s.
RUN_UPS, LEAST_TIME = 20.0, 0.3
#: Largest gain of the loop from torque over a wrong inductance to the speed estimate and back.
INDUCTANCE_GAIN = 0.5
#: Variance of the load torque's walk, in steps of the rated torque.
LOAD_STEPS = 5.0
#: The sign of a leg's current fades below so many sigmas of its sensor, and below what the voltage that dead time takes
#: drives through the inductance in so many samples: in the model, and in the controller's compensation.
FADING_SIGMAS, FADING_SAMPLES, COMPENSATION_SAMPLES = 3.0, 1.0, 0.6
#: In the model of a salient machine it fades below this share of the ripple that its square wave may make, too.
FADING_RIPPLE = 2.0 / 3.0
#: Largest relative difference of L_d and L_q that counts as none.
ROUND = 0.02
#: Largest electrical turn in a sample, rad, and largest T R / L, at which these rules are known to run.
TURN, DECAY = 0.33, 0.17


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
        "motor": motor_data(f),
        "model": {"machine": "salient", "mechanics": "load_torque", "discretization": "exact", "sample_time": f.T},
        "filter": {"kinds": ["ckf"], **plain},
        "rated": {"speed": stated(f.speed), "torque": stated(f.torque)},
        "operating_box": limits(f),
        "control": {"dc_link": f.dc_link, "max_current": f.max_current},
    }
    try:
        drive = parse_drive(tables, f.name)
    except DriveError as error:
        raise UserError(f"these facts make a drive file that is refused: {error}") from None
    rated = rating(drive)
    i_d, i_q = mtpa_currents(drive, rated.current)
    return RatedPoint(i_d, i_q, rated.base_speed, rated.largest_torque)


def usable_current(f: Facts, point: RatedPoint) -> float:
    """The largest current that the voltage can still turn at rated speed, A: omega_e L_q i_q takes all of it.

    On the curve of maximum torque per ampere. Of a reluctance machine more locks the current regulators into the
    voltage limit during the run-up, where the field is weakened in place of torque.

    Parameters
    ----------
    f : Facts
    point : RatedPoint
        Its own current is always granted.
    """
    i_q = f.voltage / (f.omega_e * f.L_q)
    r = (f.L_q - f.L_d) / f.psi_m
    i_d = -2 * r * i_q**2 / (1 + math.sqrt(1 + (2 * r * i_q) ** 2))
    return min(f.max_current, max(stated(math.hypot(i_d, i_q)), point.current, 1e-3))


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
    return f.d_R * f.R * point.current > HURTING_SHARE * 0.1 * f.omega_e * active_flux(f, point)


def active_flux(f: Facts, point: RatedPoint) -> float:
    """The flux linkage that makes torque and back-EMF at the rated point, reluctance in it, Wb.

    Parameters
    ----------
    f : Facts
    point : RatedPoint
    """
    return f.psi_m + (f.L_d - f.L_q) * point.i_d


def doubted_flux(f: Facts) -> float:
    """Half-width, relative, by which the filter doubts psi_m: less than stated where other noise hides it anyway.

    HIDING_SIGMAS deviations w of LEAST_SHARE V hide a back-EMF that is off by b: the share b^2 / (b^2 + w^2) of b is
    left, a tenth of half a percent and nearly all of five. To doubt all of half a percent made a filter twice as far
    off in a load step as one tuned for exact data; so it is 1.3 times at most.

    Parameters
    ----------
    f : Facts
    """
    off, hidden = f.d_psi * f.omega_e * f.psi_m, HIDING_SIGMAS * LEAST_SHARE * f.voltage
    return f.d_psi * off**2 / (off**2 + hidden**2)


def unsaid_share(f: Facts) -> float:
    """kappa: what no fact says of a sample's voltage, of the largest one.

    Parameters
    ----------
    f : Facts
    """
    return math.hypot(LEAST_SHARE, DEAD_SHARE * 0.5 * math.sqrt(3) * f.dead_time / f.T)


def unknown_share(f: Facts, point: RatedPoint) -> float:
    """What is unknown of a sample's voltage, tolerances at the rated point with it, of the largest one.

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
    return math.sqrt(unsaid_share(f) ** 2 + 4 / (3 * f.voltage**2) * sum(part * part for part in parts))


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


def adaptive_time(f: Facts) -> float:
    """Time in which a resistance that is adapted goes through its tolerance, s.

    Longer than a start, in which little is seen of it; where starts are quick, load steps are, and an estimate that one
    of them misled must have gone back before the next.

    Parameters
    ----------
    f : Facts
    """
    return float(rounded(max(LEAST_TIME, RUN_UPS * f.J * f.speed / f.torque), SlowTime))


def inductance_bandwidth(f: Facts, point: RatedPoint) -> float:
    """Speed-loop bandwidth up to which a wrong inductance leaves the loop stable, rad/s.

    An inductance d_L L_q too large in the model takes a change of torque for one of speed, against it: as fast as the
    filter follows (w) it reads d_L L_q w / (1.5 p^2 psi^2) rad/s less speed per N m, psi the active flux, and the
    regulator answers with 2 J times its bandwidth. The product of the two stays below INDUCTANCE_GAIN.

    Parameters
    ----------
    f : Facts
    point : RatedPoint
    """
    misread = f.d_L * f.L_q * filter_bandwidth(f, point) / (1.5 * (f.p * active_flux(f, point)) ** 2)
    return INDUCTANCE_GAIN / (2 * f.J * misread) if misread else math.inf


def fading_current(f: Facts, samples: float = FADING_SAMPLES) -> float:
    """The current below which the sign of a leg's current fades, A.

    A sign from a current that the voltage of the dead time turns around within the sample would make the model's own
    step unstable; one that fades at more leaves a loss that a filter takes for resistance.

    Parameters
    ----------
    f : Facts
    samples : float, optional
        In which that voltage drives the current; COMPENSATION_SAMPLES in the controller.
    """
    driven = samples * f.dc_link * f.dead_time / min(f.L_d, f.L_q)  # V_d T / L
    return float(rounded(max(FADING_SIGMAS * f.sigma, driven), Current))


def model_fading(f: Facts, point: RatedPoint) -> float:
    """The current below which the sign of a leg's current fades in the model, A.

    A salient rotor's square wave turns a current smaller than its ripple around in every sample: the leg loses by the
    mean, and the sign of what is sampled, at the ripple's ends, is as wrong as it is whole. ``traction_70kw`` at rest
    under small loads, R and L off: 11.0 degrees at worst with 6 A, 8.6 with 8 A and 8.3 with 12.4 A, the whole ripple;
    in a load step at half of rated speed, where there is no wave, 5.5, 5.7 and 7.8 (95 % of the draws). Of the
    controller's compensation there is none of it: as wide as 7.5 A it costs 11.7 degrees there, and gains nothing.

    Parameters
    ----------
    f : Facts
    point : RatedPoint
        The ripple is a share of its current.
    """
    ripple = RIPPLE * point.current if is_salient(f) else 0.0
    return max(fading_current(f), float(rounded(FADING_RIPPLE * ripple, Current)))


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
            f"rated speed of {f.speed * RPM:.0f} r/min takes field weakening: the trial says what it reaches."
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
    return lines


def motor_data(f: Facts) -> dict[str, Any]:
    """The drive file's ``[motor]``: one inductance where the rotor counts as round.

    Parameters
    ----------
    f : Facts
    """
    L = 0.5 * (f.L_d + f.L_q)
    L_d, L_q = (f.L_d, f.L_q) if is_salient(f) else (L, L)
    return {
        "stator_resistance": stated(f.R),
        "inductance_d": stated(L_d),
        "inductance_q": stated(L_q),
        "magnet_flux": stated(f.psi_m),
        "pole_pairs": f.p,
        "inertia": stated(f.J),
        "friction": f.D,
    }


def limits(f: Facts) -> dict[str, float]:
    """Current (A) and voltage (V) of the operating box.

    Parameters
    ----------
    f : Facts
    """
    return {"current": rounded(2.5 * f.max_current, Current), "voltage": rounded(1.5 * f.dc_link, Voltage)}


def stated(value: float) -> float:
    """Six digits of a fact: as stated, without what a conversion adds behind them.

    Parameters
    ----------
    value : float
    """
    return float(f"{value:.6g}")


def rounded(value: Any, quantity: Any) -> Any:
    """Three digits, as more would claim what no rule knows; within what the drive file accepts of such a quantity.

    Parameters
    ----------
    value : float or list of float
    quantity : type
        An annotated quantity of :mod:`model.schema`.
    """
    if isinstance(value, list):
        return [rounded(entry, quantity) for entry in value]
    bounds = get_args(quantity)[1].metadata
    (low,), (high,) = ([getattr(b, end) for b in bounds if hasattr(b, end)] for end in ("ge", "le"))
    return float(min(high, max(low, float(f"{value:.3g}"))))
