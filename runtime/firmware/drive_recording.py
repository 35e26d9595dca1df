"""The inputs of a whole drive: every transition of its modes, then a start from power-up.

Most transitions come after thousands of interrupts, or after a fault. So each has a piece of its own, before which the
supervisor's memory is set to where one interrupt leads to it: counts stand at their ends, those that end nowhere at the
largest number they may reach, which an int of 16 bits must hold. What is left is the drive in the closed loop, from an
angle at which the filter does not begin.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import ModuleType

import numpy as np

from model.supervisor.table import MODES
from runtime.drive.scenario import Scenario
from runtime.drive.simulation import Conditions, Run, Simulator
from runtime.estimator.folder import GeneratedFolder
from runtime.firmware.recording import LOAD_AT, Recording, Segment, checked, phases_and_commands
from runtime.folders.stated import stated_drive
from runtime.proof.own_trajectory import motion_of
from runtime.recorded.units import RPM

#: Interrupts of a piece: the transition, and what comes of it.
PIECE = 6
#: Where the rotor of the start is, rad electrical.
ANGLE = 2.0
#: Counts of which the interrupt makes one more: they stand one before their limit, others at it.
COUNTED = ("since", "quiet", "rejected", "diverged", "excess", "open", "content")
#: rad: how far the angle turned, and should have by the speed.
AGREE, DIFFER = (1.2, 1.2), (1.2, -1.2)
#: rad/s: no motor turns so fast; and A^2: variances of the sensors by which the filter keeps what it begins with.
BEYOND, NOISE = 2e5, 1e9
#: Shares of the largest current: reads as zero, tells that the rotor turns, trips.
NONE, TELLS, TRIPS = 0.01, 0.5, 2.0
#: Of the drive file's DC link, by turns: all torque is allowed, some, and some that brakes.
LINKS = (1.0, 0.6, 1.2)


@dataclass(frozen=True)
class Case:
    """The memory before an interrupt, and its current.

    Attributes
    ----------
    mode : str or int
        A name, or a number that is none.
    current : float
        In phase a, of the largest.
    ends : mapping
        Count -> name of the limit at which it stands.
    given : mapping
        Other words of the supervisor.
    tuned : mapping
        Words of the filter.
    """

    mode: str | int
    current: float = NONE
    ends: Mapping[str, str] = field(default_factory=dict)
    given: Mapping[str, float] = field(default_factory=dict)
    tuned: Mapping[str, float] = field(default_factory=dict)


def _turned(turning: tuple[float, float]) -> dict[str, float]:
    return {f"turning[{k}]": angle for k, angle in enumerate(turning)}


def _lost(mode: str) -> tuple[Case, ...]:
    """What stops torque in any mode that has it: a current, no current, a covariance that is absurd after one step."""
    return (
        Case(mode, TRIPS, {"excess": "MAX_EXCESS"}),
        Case(mode, math.nan, {"rejected": "MAX_REJECTED"}),
        Case(mode, tuned={"Q[0]": 3e38}),
    )


#: One for each transition, and more: counts at the largest number they may reach, and a mode that is none.
CASES = (
    Case("RESTING", ends={"failures": "MAX_FAILURES"}),
    Case("RESTING", ends={"quiet": "REST_SAMPLES"}),
    Case("RESTING", TELLS, {"since": "RESTLESS_SAMPLES"}),
    Case("RESTING", TELLS, {"since": "MOST_SAMPLES"}),
    Case("PROBING", TRIPS),
    Case("PROBING", TELLS),
    Case("PROBING", TELLS, given={"readings": 1, "first[0]": 0.6, "first[1]": -0.8, "probe[1]": 2}),
    Case("PROBING", TELLS, given={"readings": 1, "first[0]": 0.8, "first[1]": 0.6, "probe[1]": 2}),
    Case("PROBING", TELLS, given={"readings": 1, "first[0]": 1.0, "first[1]": 0.05, "probe[1]": 2}),
    Case("PROBING", ends={"since": "PROBE_SAMPLES"}),
    Case(
        "WAITING",
        ends={"readings": "MAX_READINGS"},
        given={"guess[2]": -20.0, "guess[3]": 3.1, "spread[0]": 100.0, "spread[1]": 0.01},
    ),
    Case("WAITING", ends={"since": "GAP_SAMPLES"}),
    Case("WAITING", TELLS, {"since": "WAIT_SAMPLES"}),
    Case("CATCHING", TRIPS, {"excess": "MAX_EXCESS"}),
    Case("CATCHING", ends={"since": "SETTLE_SAMPLES"}),
    Case("CATCHING", ends={"since": "TWICE_SETTLE_SAMPLES"}, given=_turned(DIFFER)),
    Case("CATCHING", ends={"since": "TWICE_SETTLE_SAMPLES", "content": "LOCKED_SAMPLES"}, given=_turned(AGREE)),
    Case("CATCHING", ends={"since": "CATCH_SAMPLES"}, given={"mirrored": 1}),
    Case("ALIGNING", TRIPS),
    Case("ALIGNING", 0.8, {"calm": "CALM_SAMPLES"}, given={"aligning": 2.0}),
    Case("ALIGNING", 0.5, given={"aligning": 0.5, "axis[0]": 0.6, "axis[1]": -0.8, "axis[2]": 2.0}),
    Case("ALIGNING", ends={"since": "ALIGN_SAMPLES"}),
    *_lost("STARTING"),
    Case("STARTING", ends={"windows": "MAX_WINDOWS"}),
    Case("STARTING", ends={"since": "LOCKED_SAMPLES"}, given={"rival.nis": -1e3}),
    Case("STARTING", ends={"good": "GOOD_WINDOWS"}, given=_turned(AGREE)),
    Case("STARTING", given=_turned(AGREE)),
    Case("STARTING", given=_turned(DIFFER)),
    Case("STARTING", ends={"since": "WINDOW_SAMPLES"}),
    *_lost("RUNNING"),
    Case("RUNNING", given={"eased": 0.5}),
    Case("RUNNING", ends={"open": "MAX_OPEN"}, given={"silent[1]": 4.0}),
    Case("RUNNING", tuned={"x_0[2]": BEYOND, "R[0]": NOISE, "R[1]": NOISE}),
    Case("RUNNING", ends={"diverged": "MAX_DIVERGED"}, tuned={"nis_max": -1.0}),
    Case("RUNNING", ends={"since": "LOCKED_SAMPLES"}, given=_turned(DIFFER)),
    Case("RUNNING", ends={"since": "LOCKED_SAMPLES", "steady": "STEADY_WINDOWS"}, given={"failures": 3}),
    Case("FAULT", given={"acknowledged": 1}),
    Case("FAULT", ends={"since": "MOST_SAMPLES"}),
    Case(len(MODES)),
)


def drive_recording(folder: GeneratedFolder, steps: int) -> Recording:
    """Every transition in a piece of its own, then a start from power-up; of few steps the first pieces alone.

    Parameters
    ----------
    folder : GeneratedFolder
        One with drives.
    steps : int
        Interrupts in all.
    """
    pieces, left = [], steps
    for piece in _pieces(folder):
        pieces.append(Segment(piece.inputs[:left], piece.fields, piece.option))
        left -= len(pieces[-1].inputs)
    start = phases_and_commands(folder, _started(folder, left))[:left] if left else np.zeros((0, 4))
    return checked([*pieces, Segment(start, option=1)], steps)


def _pieces(folder: GeneratedFolder) -> Iterator[Segment]:
    """The cases of the modes that the drive has, with and without a sample of delay by turns."""
    module = folder.module
    control = folder.manifest["parameters"]["control"]
    speed = 0.5 * folder.manifest["parameters"]["operating_box"]["speed"]
    cases = [case for case in CASES if case.mode in module.MODES or isinstance(case.mode, int)]
    for number, case in enumerate(cases):
        inputs = np.tile([0.0, 0.0, speed, control["dc_link"]], (PIECE, 1))
        inputs[:, :2] = NONE * control["max_current"] * np.array([1.0, -0.5])
        inputs[:, 3] *= LINKS[number % len(LINKS)]
        inputs[0, :2] = case.current * control["max_current"] * np.array([1.0, -0.5])
        yield Segment(inputs, _fields(case, module), option=number % 2)


def _fields(case: Case, module: ModuleType) -> dict[str, float]:
    """Words of the drive's struct: the mode with what it allows, and a controller that has regulated."""
    named = {mode.name: mode for mode in MODES}.get(str(case.mode))
    place = case.mode if isinstance(case.mode, int) else module.MODES.index(case.mode)
    words: dict[str, float] = {"mode": place, "turning[2]": module.DEFAULTS["x_0"][3]}
    if named is not None:
        words |= {name: int(getattr(named, name)) for name in ("inverter", "runs", "torque", "rivals", "aligns")}
    words |= {name: getattr(module, limit) - (name in COUNTED) for name, limit in case.ends.items()}
    words |= case.given
    supervisor, own = module.new_supervisor(np.float32), module.new_filter(np.float32)
    regulated = {"integrator[1]": 0.5, "integrator[2]": -0.25, "v_acting[0]": 3.0, "v_queued[1]": -2.0}
    return {
        **{f"supervisor.{name}": value for name, value in words.items() if hasattr(supervisor, _first(name))},
        **{f"control.{name}": value for name, value in regulated.items()},
        **{f"control.filter.{name}": value for name, value in case.tuned.items() if hasattr(own, _first(name))},
    }


def _first(word: str) -> str:
    """The field of a struct in which a word is."""
    return word.partition(".")[0].partition("[")[0]


def _started(folder: GeneratedFolder, steps: int) -> Run:
    """The drive from power-up, with a sample of delay."""
    motion, kind = motion_of(stated_drive(folder)), "ickf" if "ickf" in folder.kinds else folder.kinds[0]
    duration = max(steps, 100) * folder.module.SAMPLE_TIME
    task = Scenario("started", motion.speed * RPM, motion.ramp, motion.load, LOAD_AT, duration)
    return Simulator(folder, kind).run(task, Conditions(theta=ANGLE, delay=1, supervised=True))
