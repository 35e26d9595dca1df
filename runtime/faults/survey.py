"""The survey of ``pmsm-ickf faults``: every fault, with many seeds, on some drives; how they recover."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.rating import rating
from runtime.drive.scenario import Scenario, find_scenario
from runtime.estimator.folder import GeneratedFolder
from runtime.faults.catalogue import FAULTS, Circumstances, Fault
from runtime.faults.loop import FaultyLoop, FaultyRun
from runtime.folders.stated import stated_drive
from runtime.recorded.units import RPM
from runtime.system.files import write_text
from runtime.system.verdicts import all_hold

Array = NDArray[Any]
Progress = Callable[[str], None]

#: Recovered: the drive runs, and the estimate stays within 2 % of the rated speed and so many degrees electrical of the
#: truth to the end, of which at least so much must be left, s.
ANGLE_BAND, LEAST_REST = 10.0, 0.05
#: The fault begins so long after the load step, s, plus up to so much: anywhere in an electrical turn.
FAULT_AFTER, FAULT_SPREAD = 0.1, 0.02
#: How long a run goes on after its load step, s.
AFTER_LOAD = 0.45
#: The generated controller alone is there to compare with: so many runs of it say enough.
ALONE_SEEDS = 20
#: PMSM_NOT_CONVERGED says nothing of a fault: an ICKF sets it in healthy runs too.
NOT_CONVERGED = 0x2
#: A status that comes so long after the fault still counts as its own, s.
AFTERMATH = 0.01


@dataclass(frozen=True)
class Recovery:
    """One run.

    ``time`` s from the fault's end until the drive runs and the estimate is in its band for the rest, NaN
    if never; ``told`` samples from the fault's begin until a status bit or a reaction, -1 if none; ``status`` bits in
    and shortly after the fault, but for "not converged". Largest since the fault's begin: errors of the estimate while
    the drive ran (r/min, degrees electrical), ``deviation`` of the true speed from its reference (r/min), ``current``
    (A, amplitude). ``idle`` s without torque. ``gave_up``: the reason of the FAULT in which the run ended, inverter
    off; empty: it did not. ``driven_off``: in the end the load drives the rotor so fast that its back-EMF conducts
    through the diodes: no voltage there is could take it back.
    """

    time: float
    told: int
    status: int
    speed_error: float
    angle_error: float
    deviation: float
    current: float
    idle: float
    gave_up: str = ""
    driven_off: bool = False

    @property
    def recovered(self) -> bool:
        """Whether the drive came back."""
        return bool(np.isfinite(self.time))

    @property
    def safe(self) -> bool:
        """Whether it came back, or ended in FAULT and said why."""
        return self.recovered or bool(self.gave_up)


@dataclass(frozen=True)
class Outcome:
    """All runs of one fault with one filter.

    ``alone``: the first of them by the generated controller without the application's reaction. ``example``: the first
    run.
    """

    drive: str
    kind: str
    fault: Fault
    recoveries: tuple[Recovery, ...]
    alone: tuple[Recovery, ...]
    example: FaultyRun

    @property
    def recovered(self) -> bool:
        """Whether every run did, or ended in FAULT, inverter off, and said why, where nothing else could be done.

        That is where the fault lasts, or where the load has driven the rotor off.
        """
        lasts = bool(self.fault.lasting)
        return all_hold(run.recovered or (run.safe and (lasts or run.driven_off)) for run in self.recoveries)


def column(recoveries: Sequence[Recovery], name: str) -> Array:
    """One figure of every run."""
    return np.array([getattr(recovery, name) for recovery in recoveries])


def judge(run: FaultyRun, T: float) -> Recovery:
    """The outcome of a fault in a run.

    Parameters
    ----------
    run : FaultyRun
        The run.
    T : float
        Sample time, s.
    """
    since = slice(run.first, None)
    good = run.running & (np.abs(run.speed_error) < run.band) & (np.abs(run.angle_error) < ANGLE_BAND)
    bad = np.flatnonzero(~good)
    back = int(bad[-1]) + 1 if len(bad) else 0
    recovered = len(good) - back >= round(LEAST_REST / T)
    during = slice(run.first, run.after + round(AFTERMATH / T))
    status = run.status[during] & ~NOT_CONVERGED
    said = np.flatnonzero((status != 0) | ~run.running[during])
    used = run.running & run.powered
    used[: run.first] = False
    return Recovery(
        time=max(0, back - run.after) * T if recovered else float("nan"),
        told=int(said[0]) if len(said) else -1,
        status=int(np.bitwise_or.reduce(status)),
        speed_error=_largest(run.speed_error[used]),
        angle_error=_largest(run.angle_error[used]),
        deviation=_largest((run.omega - run.reference)[since] * RPM),
        current=_largest(run.current[since]),
        idle=float(np.count_nonzero(~run.running[since]) * T),
        gave_up=run.gave_up,
        driven_off=bool(abs(run.omega[-1]) > run.diodes),
    )


def _largest(values: Array) -> float:
    """Largest magnitude; 0 where there is nothing, NaN where something is."""
    return float(np.max(np.abs(values))) if len(values) else 0.0


def circumstances(folder: GeneratedFolder, scenario: Scenario) -> Circumstances:
    """The scales that the faults of a drive are measured by.

    Parameters
    ----------
    folder : GeneratedFolder
        The generated folder.
    scenario : Scenario
        Speed reference and load over time.
    """
    parameters = folder.manifest["parameters"]
    motor = parameters["motor"]
    return Circumstances(
        T=folder.module.SAMPLE_TIME,
        link=parameters["control"]["dc_link"],
        amplitude=scenario.load / (1.5 * motor["pole_pairs"] * motor["magnet_flux"]),
        range=folder.module.DEFAULTS["y_max"],
        torque=rating(stated_drive(folder)).largest_torque,
    )


def run_fault(loop: FaultyLoop, fault: Fault, scenario: Scenario, seed: int, reacting: bool = True) -> FaultyRun:
    """One run; the seed makes the noise, the instant of the fault and what is random about it."""
    rng = np.random.default_rng([seed, 1])
    at = 0.0 if fault.at_start else scenario.load_at + FAULT_AFTER + rng.uniform(0.0, FAULT_SPREAD)
    scenario = replace(scenario, duration=max(scenario.duration + fault.patience, fault.lasting))
    rows = fault.rows(circumstances(loop.folder, scenario), rng)
    return loop.run(scenario, rows, at, seed=seed, reacting=reacting)


def survey(
    folders: Sequence[GeneratedFolder],
    kinds: Sequence[str] | None,
    seeds: int,
    load: float | None = None,
    speed: float | None = None,
    faults: Sequence[Fault] = FAULTS,
    progress: Progress = lambda text: None,
) -> list[Outcome]:
    """Every fault on every drive with every filter.

    Parameters
    ----------
    folders : sequence of GeneratedFolder
    kinds : sequence of str, optional
        Every folder must have them; by default each folder's own.
    seeds : int
        Runs of each: seeds 1 to so many.
    load, speed : float
        N m and r/min at which the faults strike; None: the drive's rated ones.
    """
    outcomes = []
    for folder in folders:
        for kind in kinds or ():
            folder.require(kind)  # said before the work
    for folder in folders:
        for kind in kinds or folder.kinds:
            progress(f"{folder.drive}: {kind}: compiling")
            loop = FaultyLoop(folder, kind)
            scenario = task_of(folder, load, speed)
            for fault in faults:
                progress(f"{folder.drive}: {kind}: {fault.title}")
                outcomes.append(_outcome(loop, fault, scenario, seeds))
    return outcomes


def task_of(folder: GeneratedFolder, load: float | None = None, speed: float | None = None) -> Scenario:
    """A drive under load at speed, long enough for a fault and a recovery.

    Parameters
    ----------
    folder : GeneratedFolder
    load, speed : float, optional
        N m and r/min in place of the rated ones.
    """
    usual = find_scenario("load_step", stated_drive(folder), speed, load)
    return replace(usual, name="faults", duration=usual.load_at + AFTER_LOAD)


def _outcome(loop: FaultyLoop, fault: Fault, scenario: Scenario, seeds: int) -> Outcome:
    T = loop.module.SAMPLE_TIME
    example = run_fault(loop, fault, scenario, seed=1)
    recoveries, alone = (
        tuple(judge(run_fault(loop, fault, scenario, seed, reacting), T) for seed in range(1, last + 1))
        for reacting, last in ((True, seeds), (False, min(seeds, ALONE_SEEDS)))
    )
    return Outcome(loop.folder.drive, loop.kind, fault, recoveries, alone, example)


def outcome_facts(outcome: Outcome) -> dict[str, Any]:
    """One outcome as plain data, every run of it."""
    return {
        "drive": outcome.drive,
        "filter": outcome.kind,
        "fault": outcome.fault.name,
        "recovered": outcome.recovered,
        "runs": [asdict(recovery) for recovery in outcome.recoveries],
        "alone": [asdict(recovery) for recovery in outcome.alone],
    }


def write_outcomes(outcomes: Sequence[Outcome], path: Path) -> None:
    """Every figure as JSON; a run that did not recover has null for its time."""
    import json

    facts = [outcome_facts(outcome) for outcome in outcomes]
    for fact in facts:
        for run in (*fact["runs"], *fact["alone"]):
            run.update({name: None for name, value in run.items() if value != value})
    write_text(path, json.dumps(facts, indent=2) + "\n")
