"""Starts of a drive: from rest at an unknown angle, from a rotor that turns, and a reversal under load.

Every run has a motor, an angle, a load and noise of its own, drawn from its number alone: run 7 of a drive is the same
whatever else was asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.alignment import align_time, aligns
from model.rating import rating
from model.schema import Drive
from model.supervisor.limits import window_time
from runtime.drive.scenario import LATE, REACHED, Scenario
from runtime.estimator.folder import GeneratedFolder
from runtime.faults.loop import FAULT, FaultyLoop, FaultyRun, FoundMotor
from runtime.faults.survey import ANGLE_BAND
from runtime.folders.stated import stated_drive
from runtime.recorded.units import RPM
from runtime.system.files import write_facts
from runtime.system.verdicts import all_hold

Array = NDArray[Any]
Progress = Callable[[str], None]

#: s: a start goes on so long, and its reference takes at least so long to the rated speed.
START_TIME, START_RAMP = 0.3, 0.05
#: Of rated torque: the load that a rotor has which is aligned first, so that the current holds it near its axis.
ALIGNED_LOAD_SHARE = 0.3
#: So many windows of a start every drive has until it is judged: as the slowest shipped one has in START_TIME.
START_WINDOWS = 11
#: Shares: of rated torque that a load may have, of rated speed that a rotor may turn with, of turning rotors that are
#: wanted to go on in their own direction, of the magnet flux that it may be off.
LOAD_SHARE, TURNING_SHARE, ONWARD_SHARE, MAGNET_SHARE = 0.5, 1.5, 0.7, 0.05
#: A reversal, s: it begins at the rated speed, not before so long, takes so long, and is watched so long after it.
REVERSAL_FROM, REVERSAL_TIME, REVERSAL_REST = 0.3, 1.0, 0.2
#: s: in such a time the load of a reversal comes.
LOAD_RISE = 0.02
#: Runs between two reports of progress.
TOLD_EVERY = 50


@dataclass(frozen=True)
class Reversal(Scenario):
    """To a speed, and from ``turn_at`` (s) on through zero to the same speed the other way."""

    turn_at: float = REVERSAL_FROM

    def speed_reference(self, t: Array) -> Array:
        """Mechanical rad/s at the times t.

        Parameters
        ----------
        t : ndarray
            Time, s.
        """
        return np.asarray(super().speed_reference(t) * np.clip(1 - 2 * (t - self.turn_at) / REVERSAL_TIME, -1.0, 1.0))

    def load_torque(self, t: Array) -> Array:
        """N m at the times t.

        Parameters
        ----------
        t : ndarray
            Time, s.
        """
        return np.asarray(self.load * np.clip((t - self.load_at) / LOAD_RISE, 0.0, 1.0))


@dataclass(frozen=True)
class Attempt:
    """What one run is to master.

    ``least``: true speed along the reference that it must have at the end, rad/s; minus infinity: any. ``since`` s: the
    time until it is locked counts from here on.
    """

    scenario: Scenario
    motor: FoundMotor
    least: float
    since: float = 0.0


@dataclass(frozen=True)
class Start:
    """How one run went.

    ``locked``: to the end. ``time`` s until it was for good, NaN if it never was. ``kept``: RUNNING was not left again.
    ``wrong_way`` r/min: largest speed against the reference. ``angle`` degrees electrical: largest error while RUNNING.
    ``current``: largest amplitude as a share of the drive's largest. ``ripple``: amplitude of the injected current as a
    share of the one that rated torque takes. NaN: the task does not ask. ``gave_up``: the reason, where it ended in
    FAULT.
    """

    locked: bool
    time: float
    kept: bool
    wrong_way: float
    angle: float
    current: float
    ripple: float = float("nan")
    gave_up: str = ""


def judge_start(run: FaultyRun, attempt: Attempt, max_current: float) -> Start:
    """How a run went.

    Parameters
    ----------
    run : FaultyRun
    attempt : Attempt
        What it was to master.
    max_current : float
        The drive's, A.
    """
    T = run.t[1] - run.t[0]
    along = run.omega * np.sign(run.reference[-1])
    good = run.running & (np.abs(run.angle_error) < ANGLE_BAND)
    last = slice(len(good) - round(LATE / T), None)
    locked = bool(np.all(good[last]) and np.all(along[last] > attempt.least))
    bad = np.flatnonzero(~good)
    since = run.t[bad[-1]] + T if len(bad) else 0.0
    began = np.flatnonzero(run.running)
    return Start(
        locked=locked,
        time=max(0.0, float(since - attempt.since)) if locked else float("nan"),
        kept=bool(len(began) and np.all(run.running[began[0] :])),
        wrong_way=max(0.0, float(np.max(-along)) * RPM),
        angle=float(np.max(np.abs(run.angle_error[run.running]), initial=0.0)),
        current=float(np.max(run.current)) / max_current,
        gave_up=run.gave_up,
    )


@dataclass(frozen=True)
class Task:
    """A kind of run: ``attempt`` draws one, ``judge`` says how it went.

    ``told``: a speed against the reference says something of it.
    """

    name: str
    title: str
    attempt: Callable[[Drive, np.random.Generator], Attempt]
    told: bool = False
    judge: Callable[[FaultyRun, Any, float], Start] = judge_start


@dataclass(frozen=True)
class Starts:
    """All runs of one task by a drive with one filter."""

    drive: str
    kind: str
    task: Task
    runs: tuple[Start, ...]

    @property
    def locked(self) -> bool:
        """Whether every run did."""
        return all_hold(run.locked for run in self.runs)


def draw_factors(drive: Drive, rng: np.random.Generator) -> dict[str, float]:
    """Factors on the true motor's data, evenly within the drive file's ``[tolerance]``.

    Parameters
    ----------
    drive : Drive
        Without the section its motor is exact.
    rng : numpy.random.Generator
    """
    about, m = drive.tolerance, drive.motor

    def factor(width: float) -> float:
        return 1.0 + width * rng.uniform(-1.0, 1.0)

    resistance, d, q, magnet = (
        factor(min(getattr(about, key), most) if about else 0.0)
        for key, most in (
            ("stator_resistance", np.inf),
            ("inductance", np.inf),
            ("inductance", np.inf),
            ("magnet_flux", MAGNET_SHARE),
        )
    )
    if m.inductance_d == m.inductance_q:
        q = d
    return {"R": resistance, "L_d": d, "L_q": q, "psi_m": magnet}


def start_time(drive: Drive) -> float:
    """How long a start goes on, s: longer where the drive needs more time to turn its rotor by a radian, or aligns it.

    Parameters
    ----------
    drive : Drive
        Its torque and inertia say how long a window of a start may last.
    """
    return max(START_TIME, START_WINDOWS * window_time(drive) + LATE) + (align_time(drive) if aligns(drive) else 0.0)


def _angle(rng: np.random.Generator) -> float:
    return float(rng.uniform(-np.pi, np.pi))


def _sign(rng: np.random.Generator) -> float:
    return 1.0 if rng.random() < 0.5 else -1.0


def from_rest(drive: Drive, rng: np.random.Generator) -> Attempt:
    """To the rated speed in either direction, from rest at any angle, against a load that is there from the beginning.

    Parameters
    ----------
    drive : Drive
    rng : numpy.random.Generator
    """
    task = rating(drive)
    share = ALIGNED_LOAD_SHARE if aligns(drive) else LOAD_SHARE
    sign, load = _sign(rng), rng.uniform(0.0, share) * task.torque
    ramp, duration = task.start_ramp(drive.motor.inertia, START_RAMP), start_time(drive)
    scenario = Scenario("start", sign * task.speed * RPM, ramp, sign * load, load_at=0.0, duration=duration)
    return Attempt(scenario, FoundMotor(_angle(rng), 0.0, draw_factors(drive, rng)), least=0.0)


def turning(drive: Drive, rng: np.random.Generator) -> Attempt:
    """The rotor turns at power-up, without load; the rated speed is wanted at once, in its direction or the other.

    Parameters
    ----------
    drive : Drive
    rng : numpy.random.Generator
    """
    task = rating(drive)
    speed = rng.uniform(-TURNING_SHARE, TURNING_SHARE) * task.speed
    wanted = np.copysign(task.speed, speed if rng.random() < ONWARD_SHARE else -speed)
    scenario = Scenario("turning", wanted * RPM, ramp=drive.model.sample_time, duration=start_time(drive))
    return Attempt(scenario, FoundMotor(_angle(rng), speed, draw_factors(drive, rng)), least=-np.inf)


def reversal(drive: Drive, rng: np.random.Generator) -> Attempt:
    """From rated speed to rated speed the other way under half the rated torque, which points in either direction.

    Parameters
    ----------
    drive : Drive
    rng : numpy.random.Generator
    """
    task = rating(drive)
    ramp = task.ramp(drive.motor.inertia, START_RAMP)
    begin = max(REVERSAL_FROM, 1.5 * ramp)
    scenario = Reversal(
        "reversal",
        _sign(rng) * task.speed * RPM,
        ramp,
        _sign(rng) * LOAD_SHARE * task.torque,
        load_at=0.5 * begin,
        duration=begin + REVERSAL_TIME + REVERSAL_REST,
        turn_at=begin,
    )
    found = FoundMotor(factors=draw_factors(drive, rng))
    return Attempt(scenario, found, least=(1.0 - REACHED) * task.speed, since=begin + REVERSAL_TIME)


FROM_REST = Task("rest", "from rest", from_rest, told=True)
TURNING = Task("turning", "turning", turning)
REVERSAL = Task("reverse", "reversal", reversal)


def run_attempt(loop: FaultyLoop, task: Task, number: int) -> tuple[Attempt, FaultyRun]:
    """One run of a task.

    Parameters
    ----------
    loop : FaultyLoop
    task : Task
    number : int
        All that is random follows from it.
    """
    attempt = task.attempt(stated_drive(loop.folder), np.random.default_rng([number, *task.name.encode()]))
    return attempt, loop.run(attempt.scenario, np.empty(0, FAULT), 0.0, seed=number, motor=attempt.motor)


def survey_starts(
    folders: Sequence[GeneratedFolder],
    kinds: Sequence[str] | None,
    tasks: Sequence[Task],
    runs: int,
    progress: Progress = lambda text: None,
) -> list[Starts]:
    """Every task by every drive with every filter.

    Parameters
    ----------
    folders : sequence of GeneratedFolder
    kinds : sequence of str, optional
        Every folder must have them; by default each folder's own.
    tasks : sequence of Task
    runs : int
        Of each task: numbers 1 to so many.
    progress : callable, optional
        Is told what is going on.
    """
    for folder in folders:
        for kind in kinds or ():
            folder.require(kind)  # said before the work
    found = []
    for folder in folders:
        for kind in kinds or folder.kinds:
            progress(f"{folder.drive}: {kind}: compiling")
            loop = FaultyLoop(folder, kind)
            found += [Starts(folder.drive, kind, task, tuple(_runs(loop, task, runs, progress))) for task in tasks]
    return found


def _runs(loop: FaultyLoop, task: Task, runs: int, progress: Progress) -> Iterator[Start]:
    max_current = stated_drive(loop.folder).control.max_current
    for number in range(1, runs + 1):
        if number % TOLD_EVERY == 1:
            progress(f"{loop.folder.drive}: {loop.kind}: {task.title}, run {number} of {runs}")
        attempt, run = run_attempt(loop, task, number)
        yield task.judge(run, attempt, max_current)


def times(runs: Sequence[Start]) -> tuple[float, float] | None:
    """Median and worst time until locked, s, of those that were; None where none was.

    Parameters
    ----------
    runs : sequence of Start
    """
    found = [run.time for run in runs if np.isfinite(run.time)]
    return (float(np.median(found)), float(np.max(found))) if found else None


def starts_facts(starts: Sequence[Starts]) -> dict[str, Any]:
    """Figures by drive and filter: those from rest, and under its name each other task.

    Parameters
    ----------
    starts : sequence of Starts
    """
    drives: dict[str, dict[str, Any]] = {}
    for item in starts:
        place = drives.setdefault(item.drive, {}).setdefault(item.kind, {})
        if item.task is FROM_REST:
            place.update(_facts(item))
        else:
            place[item.task.name] = _facts(item)
    return {"drives": drives}


def _facts(item: Starts) -> dict[str, Any]:
    until = times(item.runs)
    return {
        "runs": len(item.runs),
        "locked": sum(run.locked for run in item.runs),
        "lost": [number for number, run in enumerate(item.runs, start=1) if not run.locked],
        "time": dict(zip(("median", "worst"), until, strict=True)) if until else None,
        "kept": sum(run.kept for run in item.runs),
        **({"wrong_way": max(run.wrong_way for run in item.runs)} if item.task.told else {}),
        **{name: _number(largest(item.runs, name)) for name in ("angle", "current", "ripple")},
        "gave_up": [number for number, run in enumerate(item.runs, start=1) if run.gave_up],
    }


def _number(value: float) -> float | None:
    """As JSON has it."""
    return value if np.isfinite(value) else None


def largest(runs: Sequence[Start], name: str) -> float:
    """The largest of a figure over all runs; NaN where the task does not ask for it.

    Parameters
    ----------
    runs : sequence of Start
    name : str
        Of the figure.
    """
    return float(np.max([getattr(run, name) for run in runs]))


def write_starts(starts: Sequence[Starts], path: Path) -> None:
    """Every figure as JSON.

    Parameters
    ----------
    starts : sequence of Starts
    path : Path
    """
    write_facts(path, starts_facts(starts))
