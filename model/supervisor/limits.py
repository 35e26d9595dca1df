"""The numbers that the modes' guards ask for: times as samples, shares of the drive's own data, variances."""

from __future__ import annotations

import math

from model.alignment import align_time, aligns, calm_time
from model.machines.state_space import StateSpaceModel
from model.rating import allowed_torque
from model.schema import Drive, DriveError
from model.supervisor.words import Limit

#: s. Lost is who is blind for so long, or diverged: a fault of some 50 ms is ridden through, and torque is cut where
#: the angle no longer turns as the speed says.
BLIND_TIME, DIVERGED_TIME = 2e-3, 100e-3
#: s: so long a phase is silent before it is open; as long as what is ridden through, which a stuck sensor may be.
OPEN_TIME = 100e-3
#: s. Currents must read zero for REST, and do so before RESTLESS is over: windings are without current long before, and
#: a rotor that its load drives so fast that diodes conduct does not slow down by itself; zero voltage is tried for
#: PROBE; the current of a first reading has WAIT to die out; the filter has CATCH to lock, of which its angle may jump
#: for SETTLE, and must be content for LOCKED. Attempts are forgotten after STEADY of running.
REST_TIME, RESTLESS_TIME, PROBE_TIME, WAIT_TIME, CATCH_TIME, SETTLE_TIME = 2e-3, 0.5, 2e-3, 2e-3, 10e-3, 1e-3
LOCKED_TIME, STEADY_TIME = 3e-3, 100e-3
#: s, and time constants of the d axis: in the longer of these the torque comes of a rotor that was caught. So long the
#: current regulators take to make up for what inductances off by tolerance leave of omega_e L i.
EASE_TIME, EASE_WINDINGS = 10e-3, 3.0
#: s, rad electrical at the operating box's speed: two readings are so far apart, at most. Less than half a turn, so
#: that the way that the current turned is the rotor's.
GAP_TIME, GAP_TURN = 0.5e-3, 1.2
#: Sine of the angle between two readings from which on it tells the direction: three sigmas of noise; and so many are
#: taken at most. Rotors that turn just fast enough to be read turn so far by the fifth.
LEAST_SINE, MAX_READINGS = 0.1, 8
#: Samples in a row beyond the trip current; attempts in a row that failed, and such of a drive without a rival: it
#: finds its angle by attempts.
MAX_EXCESS, MAX_FAILURES, MAX_FAILURES_ALONE = 3, 10, 20
#: Shares of the maximum current: what reads as zero, what shows where the back-EMF points, what is too much. Of the
#: operating box's speed: what may be unknown, and what half a turn leaves open.
ZERO_CURRENT, PROBE_CURRENT, TRIP_CURRENT, UNKNOWN_SPEED, MIRROR_SPEED = 0.05, 0.1, 1.5, 0.5, 0.25
#: rad^2: what the probe leaves open of the angle, and what a start does.
UNKNOWN_ANGLE, START_ANGLE = 0.01, 0.09
#: rad: what a jolt may turn the angle by, beside half of what the speed says: while it is looked for, and in a window.
CATCH_JOLT, RUN_JOLT = 0.1, 0.3
#: rad: so far the rotor turns while a healthy phase carries no current: a third of that, as the others carry twice what
#: reads as zero. Of the operating box's speed: beyond what field weakening reaches.
SILENT_TURN, MOST_SPEED = 3.0, 3.0
#: Share of a turn without any current by which a phase is less silent. With a phase open the others carry a current
#: over half of a turn or more (`ipmsm_flux`, 0.49, the least); pulses of torque at a crawl were 0.06 of it.
FORGOTTEN_TURN = 0.1
#: Share of their variance that adaptive states keep meanwhile.
HELD = 1e-3
#: Of a start: share of the largest current; s, least window; rad, what ends one, and what is motion enough to judge by;
#: good windows that must have gone before, and windows at most.
START_SHARE, WINDOW_TIME, WINDOW_TURN, LEAST_TURN, GOOD_WINDOWS, MAX_WINDOWS = 0.8, 20e-3, 1.0, 0.5, 1, 20
#: Of the speed that a start goes for at least: a reference within this asks for no motion.
STILL_SHARE = 0.01
#: By so much less must the rival's mean of the normalised innovation squared be; what a load of the largest torque
#: adds: a filter that is half a turn off takes the torque that its rotor does not follow for a load.
PREFERENCE, LOAD_PENALTY = 0.05, 0.3
#: A drive has room for a second filter from this sample time on, s, where it does not say so itself.
ROOM_FOR_TWO = 50e-6
#: An int of 16 bits counts no further.
MOST_SAMPLES = 32000


def has_rival(drive: Drive) -> bool:
    """Whether a second filter runs beside the first while the angle is unknown.

    Parameters
    ----------
    drive : Drive
        Its ``[start]`` says so, or its sample time.
    """
    if aligns(drive):
        return False
    if drive.start is None or drive.start.filters is None:
        known = drive.start is not None and drive.start.angle != "unknown"
        return not known and drive.model.sample_time >= ROOM_FOR_TWO
    return drive.start.filters == 2


def start_share(drive: Drive) -> float:
    """The share of its largest current that a drive starts with.

    With a filter half a turn off a motor makes the torque psi_m i_q - (L_q - L_d) |i_d| i_q backwards. Where both parts
    are alike nothing turns and nothing is told: so reluctance may take half of the magnet's, which it does at the
    current psi_m / |L_q - L_d| on the curve of maximum torque per ampere.

    Parameters
    ----------
    drive : Drive
    """
    m = drive.motor
    difference = abs(m.inductance_q - m.inductance_d)
    if difference == 0.0:
        return START_SHARE
    return min(START_SHARE, m.magnet_flux / difference / drive.control.max_current)


def window_time(drive: Drive) -> float:
    """How long a window of a start may last, s: the rotor's time for an electrical radian, from rest, without load.

    Parameters
    ----------
    drive : Drive
    """
    torque = allowed_torque(drive, start_share(drive) * drive.control.max_current)
    return max(WINDOW_TIME, math.sqrt(2.0 * drive.motor.inertia / (drive.motor.pole_pairs * torque)))


def start_speed(drive: Drive) -> float:
    """The speed that a start goes for at least, rad/s: a window then has motion enough, so that it tells the angle.

    Parameters
    ----------
    drive : Drive
    """
    return WINDOW_TURN / (drive.motor.pole_pairs * window_time(drive))


def unseen_speed(drive: Drive) -> float:
    """The speed whose back-EMF makes no readable current within PROBE_TIME, rad/s.

    Parameters
    ----------
    drive : Drive
    """
    m = drive.motor
    current = PROBE_CURRENT * drive.control.max_current
    grown = 1.0 - math.exp(-m.stator_resistance * PROBE_TIME / m.inductance_q)
    return current * m.stator_resistance / (grown * m.magnet_flux * m.pole_pairs)


def _samples(drive: Drive, name: str, time: float, meaning: str, times: int = 1) -> Limit:
    count = max(1, round(time / drive.model.sample_time))
    return Limit(name, times * min(MOST_SAMPLES // times, count), meaning)


def limits(drive: Drive, model: StateSpaceModel, rivals: bool) -> tuple[Limit, ...]:
    """All numbers of the table.

    Parameters
    ----------
    drive : Drive
        Its sample time (s), largest current (A), operating box and magnet.
    model : StateSpaceModel
        Which states there are.
    rivals : bool
        There is a second filter.
    """
    names = [state.name for state in model.states]
    flux = Limit("FLUX_SQUARED", drive.motor.magnet_flux**2, "Wb^2: psi_m^2")
    held = Limit("HELD", HELD, "of P_0: motor data that are states are not learnt while the rotor is looked for")
    return (
        *_times(drive, rivals),
        *_currents(drive),
        *(_starts(drive, "load_torque" in names) if rivals else ()),
        *(_alignment(drive) if aligns(drive) else ()),
        *((flux,) if model.states[0].unit == "Wb" else ()),
        *((held,) if model.adaptive.states else ()),
        Limit("PI", math.pi, "half a turn"),
    )


def _times(drive: Drive, rivals: bool) -> tuple[Limit, ...]:
    gap = min(GAP_TIME, GAP_TURN / (drive.motor.pole_pairs * drive.operating_box.speed))

    def samples(name: str, time: float, meaning: str, times: int = 1) -> Limit:
        return _samples(drive, name, time, meaning, times)

    windings = drive.motor.inductance_d / drive.motor.stator_resistance
    ease = samples("EASE", max(EASE_TIME, EASE_WINDINGS * windings), "")
    return (
        samples("MAX_REJECTED", BLIND_TIME, "inputs rejected in a row: no estimate is left"),
        samples("MAX_DIVERGED", DIVERGED_TIME, "steps in a row with PMSM_DIVERGED: less is ridden through"),
        samples("MAX_OPEN", OPEN_TIME, "steps in a row with a phase that is silent: a stuck sensor is ridden through"),
        Limit("MAX_EXCESS", MAX_EXCESS, "samples in a row beyond the trip current"),
        Limit(
            "MAX_FAILURES",
            MAX_FAILURES if rivals or aligns(drive) else MAX_FAILURES_ALONE,
            "attempts in a row that fail end in FAULT",
        ),
        samples("REST_SAMPLES", REST_TIME, "so long both currents must read zero before the inverter is enabled"),
        samples("RESTLESS_SAMPLES", RESTLESS_TIME, "and if they do not for so long, something is wrong"),
        samples("PROBE_SAMPLES", PROBE_TIME, "without a current from zero voltage for so long the rotor stands"),
        samples("GAP_SAMPLES", gap, "at least, from one reading to the next: the rotor turns less than half a turn"),
        Limit("MAX_READINGS", MAX_READINGS, "of a current: then the reference says which way the rotor turns"),
        samples("WAIT_SAMPLES", WAIT_TIME, "so long the current of a reading may take to die out"),
        samples("SETTLE_SAMPLES", SETTLE_TIME, "so long the angle may jump; then it must turn as the speed says"),
        samples("TWICE_SETTLE_SAMPLES", SETTLE_TIME, "or the guess is turned round", times=2),
        samples("CATCH_SAMPLES", CATCH_TIME, "so long the filter may take to lock"),
        samples("LOCKED_SAMPLES", LOCKED_TIME, "so long content, or a rival the better one; a window of RUNNING"),
        Limit("STEADY_WINDOWS", round(STEADY_TIME / LOCKED_TIME), "of RUNNING, after which failures are forgotten"),
        Limit("EASE", 1.0 / ease.value, "of the largest current a sample: the torque of a rotor that was caught"),
        Limit("MOST_SAMPLES", MOST_SAMPLES, "an int of 16 bits counts no further"),
    )


def _currents(drive: Drive) -> tuple[Limit, ...]:
    speed = drive.operating_box.speed

    def squared(name: str, share: float, meaning: str) -> Limit:
        value = (share * drive.control.max_current) ** 2
        return Limit(name, value, f"({share:g} of the largest current)^2, A^2: {meaning}")

    return (
        squared("ZERO_SQUARED", ZERO_CURRENT, "reads as zero; above noise and offset of the sensors"),
        squared("PROBE_SQUARED", PROBE_CURRENT, "tells where the back-EMF points"),
        squared("TRIP_SQUARED", TRIP_CURRENT, "no torque needs so much; beside the hardware's trip"),
        Limit("LEAST_SINE", LEAST_SINE, "of the angle between two readings: it tells the direction"),
        Limit("CATCH_JOLT_SQUARED", CATCH_JOLT**2, "rad^2: so far off may the angle be, beside half of what is stated"),
        Limit("RUN_JOLT_SQUARED", RUN_JOLT**2, "rad^2: the same in a window of RUNNING, where a jolt may come"),
        Limit("SILENT_TURN_SQUARED", SILENT_TURN**2, "rad^2: without a current in one phase alone it is open"),
        Limit("FORGOTTEN_TURN", FORGOTTEN_TURN, "of a turn without any current: so much less silent is a phase"),
        Limit("OPEN_SPEED_SQUARED", start_speed(drive) ** 2, "(rad/s)^2: from here on a phase may be found open"),
        Limit("MOST_SPEED_SQUARED", (MOST_SPEED * speed) ** 2, "(rad/s)^2: no motor turns faster; thrice the box's"),
        Limit("UNKNOWN_SPEED", (UNKNOWN_SPEED * speed) ** 2, "(rad/s)^2: of a rotor that turns"),
        Limit("UNKNOWN_ANGLE", UNKNOWN_ANGLE, "rad^2: what the probe leaves open"),
    )


def _starts(drive: Drive, load: bool) -> tuple[Limit, ...]:
    torque = allowed_torque(drive, start_share(drive) * drive.control.max_current)
    penalty = Limit("LOAD_PENALTY", LOAD_PENALTY / torque**2, "1/(N m)^2: what a load adds to a filter's score")
    speed = start_speed(drive)
    return (
        _samples(drive, "WINDOW_SAMPLES", window_time(drive), "of STARTING at most: the rotor's time for a radian"),
        Limit("WINDOW_TURN_SQUARED", WINDOW_TURN**2, "rad^2: a window is over that has turned so far"),
        Limit("LEAST_TURN_SQUARED", LEAST_TURN**2, "rad^2: motion enough to judge by"),
        Limit("GOOD_WINDOWS", GOOD_WINDOWS, "must have gone before the one that ends a start"),
        Limit("MAX_WINDOWS", MAX_WINDOWS, "of STARTING, before the drive gives up"),
        Limit("PREFERENCE", PREFERENCE, "the rival must expect the currents better by so much"),
        *((penalty,) if load else ()),
        Limit("REST_SPEED", unseen_speed(drive) ** 2, "(rad/s)^2: of a rotor that made no current"),
        Limit("MIRROR_SPEED", (MIRROR_SPEED * drive.operating_box.speed) ** 2, "(rad/s)^2: of half a turn on"),
        Limit("START_ANGLE", START_ANGLE, "rad^2: about each of the filters' guesses"),
        Limit("HALF_PI", math.pi / 2, "a quarter of a turn"),
        Limit("START_SPEED", speed, "rad/s: STARTING goes for no less: WINDOW_TURN in the longest window"),
        Limit("START_SPEED_SQUARED", speed**2, "(rad/s)^2"),
        Limit("STILL_SQUARED", (STILL_SHARE * speed) ** 2, "(rad/s)^2: a reference within this asks for no motion"),
    )


def _alignment(drive: Drive) -> tuple[Limit, ...]:
    longest = align_time(drive)
    if longest > MOST_SAMPLES * drive.model.sample_time:
        raise DriveError(
            f"drive '{drive.name}': an alignment may take {longest:.3g} s, {longest / drive.model.sample_time:.3g} "
            f"samples, and an int of 16 bits counts to {MOST_SAMPLES}. A larger start.align_current is faster."
        )
    return (
        _samples(drive, "CALM_SAMPLES", calm_time(drive), "of a current along the axis alone: half a swing"),
        _samples(drive, "ALIGN_SAMPLES", longest, "so long an alignment may take"),
        Limit("REST_SPEED", unseen_speed(drive) ** 2, "(rad/s)^2: of a rotor that made no current"),
        Limit("START_ANGLE", START_ANGLE, "rad^2: about the axis, from which a load turns the rotor"),
    )
