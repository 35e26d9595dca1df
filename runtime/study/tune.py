"""Tuning by trial: Optuna proposes Q and R, a fleet runs each proposal over many seeds, what is best is a front."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.drive.fleet import Cases, Fleet, Outcomes
from runtime.drive.scenario import Scenario
from runtime.folders.resolve import find_drive
from runtime.study.analysis import Rate, wilson
from runtime.study.package import open_fleet
from runtime.study.run import state_study
from runtime.study.statement import Statement, differences
from runtime.study.store import write_atomically
from runtime.system.errors import UserError, take_interrupt

Array = NDArray[Any]
Progress = Callable[[int, int, str], None]

#: The objectives to minimise, means over a trial's runs in r/min, and the figure of a run behind each.
OBJECTIVES = ("start", "steady rms", "load step")
_FIGURES = ("start", "steady_rms", "load_step")

#: Trials proposed and run together; runs of each, the same for all; runs that check the outcome, seen by no trial.
TOGETHER, RUNS, CHECK_RUNS = 10, 48, 512
FRESH = 1_000_000

#: Entries may move by this factor in either direction.
REACH = 1000.0

#: Where the struct's tuning comes from in a drive file.
KEYS = {"Q": "process_noise", "R": "measurement_noise", "P_0": "initial_covariance"}


@dataclass(frozen=True)
class Point:
    """One trial: factors on the drive file's tuning, and what came of them."""

    number: int
    factors: dict[str, float]
    values: tuple[float, ...]


@dataclass(frozen=True)
class Check:
    """Means and success on fresh runs."""

    values: tuple[float, ...]
    rate: Rate


@dataclass(frozen=True)
class Tuned:
    """All trials, those no other trial beats in everything, and one of them to take.

    ``recommended`` is the point of the front that improves the worst of its objectives most, against the drive
    file's tuning: it is worse in none, on the trials' runs.
    """

    drive: str
    kind: str
    axes: tuple[str, ...]
    points: tuple[Point, ...]
    front: tuple[Point, ...]
    own: Point
    recommended: Point
    check_own: Check
    check_recommended: Check
    lines: str
    folder: Path
    wanted: int
    interrupted: bool


@dataclass(frozen=True)
class Space:
    """Which entries of the tuning move together: alpha and beta of one quantity, and both measurements."""

    axes: dict[str, tuple[tuple[str, int], ...]]
    nominal: dict[str, tuple[float, ...]]

    @classmethod
    def of(cls, module: Any, with_p0: bool) -> Space:
        """Make the space from a generated module's states and defaults.

        Parameters
        ----------
        module : module
        with_p0 : bool
            Whether P_0 is tuned too.
        """
        axes: dict[str, list[tuple[str, int]]] = {}
        for name in ("Q", "P_0") if with_p0 else ("Q",):
            for k, state in enumerate(module.STATES):
                quantity = state.removesuffix("_alpha").removesuffix("_beta")
                axes.setdefault(f"{name} {quantity}", []).append((name, k))
        axes["R"] = [("R", 0), ("R", 1)]
        nominal = {name: tuple(module.DEFAULTS[name]) for name in KEYS}
        return cls({axis: tuple(entries) for axis, entries in axes.items()}, nominal)

    def tuning(self, factors: Sequence[dict[str, float]], runs: int) -> dict[str, Array]:
        """Return the tuning of each trial in turn, (entries, trials * runs).

        Parameters
        ----------
        factors : sequence of dict of str to float
            Of each trial.
        runs : int
            Lanes of a trial.
        """
        found = {}
        for name in {name for entries in self.axes.values() for name, _ in entries}:
            columns = np.repeat(np.array(self.nominal[name])[:, None], len(factors), axis=1)
            for axis, entries in self.axes.items():
                for owner, k in entries:
                    if owner == name:
                        columns[k] *= [f[axis] for f in factors]
            found[name] = np.repeat(columns, runs, axis=1)
        return found

    def lines(self, factors: dict[str, float]) -> str:
        """Write the lines of a drive file, five digits each.

        Parameters
        ----------
        factors : dict of str to float
        """
        tuning = self.tuning([factors], 1)
        return "\n".join(f"{KEYS[n]} = [{', '.join(f'{v:.5g}' for v in tuning[n][:, 0])}]" for n in KEYS if n in tuning)


class Trials:
    """Runs proposals: every one meets the same rotors, motors and noise."""

    def __init__(self, fleet: Fleet, statement: Statement, with_p0: bool) -> None:
        self.fleet, self.statement = fleet, statement
        self.scenario: Scenario = statement.scenarios[0]
        self.space = Space.of(fleet.folder.module, with_p0)

    def run(self, factors: Sequence[dict[str, float]], first: int = 0, runs: int = RUNS) -> list[Outcomes]:
        """Run each proposal on the same runs of the statement.

        Parameters
        ----------
        factors : sequence of dict of str to float
        first, runs : int
            Runs first .. first + runs - 1.
        """
        cases = self.statement.cases(0, first, runs)
        n = len(factors)
        drawn = {name: value for name, value in vars(cases).items() if name != "tuning" and value is not None}
        repeated = {name: np.tile(np.broadcast_to(np.ravel(value), runs), n) for name, value in drawn.items()}
        outcomes = self.fleet.run(self.scenario, Cases(**repeated, tuning=self.space.tuning(factors, runs)))
        split = {name: column.reshape(n, runs) for name, column in outcomes.columns().items()}
        return [Outcomes(**{name: column[k] for name, column in split.items()}) for k in range(n)]

    def values(self, outcomes: Outcomes) -> tuple[float, ...]:
        """Return the objectives: a run that lost its lock counts as wrong by the whole speed.

        Parameters
        ----------
        outcomes : Outcomes
        """
        lost = abs(self.scenario.speed)
        figures = (np.where(outcomes.good, getattr(outcomes, name), lost) for name in _FIGURES)
        return tuple(float(np.mean(values)) for values in figures)

    def check(self, factors: dict[str, float]) -> Check:
        """Judge a tuning on runs that no trial has seen.

        Parameters
        ----------
        factors : dict of str to float
        """
        (outcomes,) = self.run([factors], FRESH, CHECK_RUNS)
        return Check(self.values(outcomes), wilson(int(outcomes.good.sum()), CHECK_RUNS))


def tune(
    drive: str,
    kind: str | None,
    wanted: int,
    out: Path | None,
    vary: Sequence[str],
    seed: int,
    with_p0: bool = False,
    progress: Progress = lambda done, of, what: None,
) -> Tuned:
    """Try tunings until ``wanted`` are done, going on where the folder stands; Ctrl-C keeps what is done.

    Parameters
    ----------
    drive : str
    kind : str or None
        Filter kind; None: the drive file's first.
    wanted : int
        Trials altogether.
    out : Path or None
        Folder of trials and figures.
    vary : sequence of str
        Ranges of what is drawn.
    seed : int
    with_p0 : bool
        Tune the initial covariance too.
    progress : callable
        Told trials done, of how many, and what is going on.

    Raises
    ------
    UserError
        Optuna is not installed; unknown words; a folder that holds another tuning.
    """
    optuna = _optuna()
    kind = kind or find_drive(drive).drive.filter.kinds[0]
    statement, (package,) = state_study([drive], [kind], "load_step", vary, seed)
    trials = Trials(open_fleet(package), statement, with_p0)
    out = out or Path("build") / "tune" / f"{package.drive}_{kind}"
    study = _open(optuna, out, statement, trials.space, seed)
    interrupted = False
    try:
        while (done := len(_finished(optuna, study))) < wanted:
            progress(done, wanted, f"{package.drive}, {kind}")
            _round(optuna, study, trials, min(TOGETHER, wanted - done))
    except KeyboardInterrupt:
        take_interrupt()
        interrupted = True
    points = tuple(_finished(optuna, study))
    if not points:
        raise KeyboardInterrupt
    return _tuned(package.drive, kind, trials, points, out, wanted, interrupted)


def _round(optuna: Any, study: Any, trials: Trials, count: int) -> None:
    """Some proposals side by side; the drive file's own tuning is the first."""
    axes = trials.space.axes
    queued = study.get_trials(deepcopy=False, states=(optuna.trial.TrialState.WAITING,))
    if not queued and not any(_is_own(point) for point in _finished(optuna, study)):
        study.enqueue_trial(dict.fromkeys(axes, 1.0))
    distributions = {axis: optuna.distributions.FloatDistribution(1 / REACH, REACH, log=True) for axis in axes}
    asked = [study.ask(distributions) for _ in range(count)]
    for trial, outcomes in zip(asked, trials.run([trial.params for trial in asked]), strict=True):
        study.tell(trial, trials.values(outcomes))


def _is_own(point: Point) -> bool:
    """The drive file's tuning."""
    return all(factor == 1.0 for factor in point.factors.values())


def _finished(optuna: Any, study: Any) -> list[Point]:
    complete = study.get_trials(deepcopy=False, states=(optuna.trial.TrialState.COMPLETE,))
    return [Point(trial.number, dict(trial.params), tuple(trial.values)) for trial in complete]


def _tuned(
    drive: str, kind: str, trials: Trials, points: tuple[Point, ...], out: Path, wanted: int, interrupted: bool
) -> Tuned:
    front = pareto(points)
    axes = tuple(trials.space.axes)
    own = next(point for point in points if _is_own(point))
    best = recommend(front, own)
    checks = trials.check(own.factors), trials.check(best.factors)
    lines = trials.space.lines(best.factors)
    return Tuned(drive, kind, axes, points, front, own, best, *checks, lines, out, wanted, interrupted)


def pareto(points: Sequence[Point]) -> tuple[Point, ...]:
    """Return the points that no other beats in one objective without being worse in another, by the first objective.

    Parameters
    ----------
    points : sequence of Point
    """
    values = np.array([point.values for point in points])
    kept = []
    for k, point in enumerate(points):
        better = np.all(values <= values[k], axis=1) & np.any(values < values[k], axis=1)
        if not better.any():
            kept.append(point)
    return tuple(sorted(kept, key=lambda point: point.values))


def recommend(front: Sequence[Point], own: Point) -> Point:
    """Return the point whose worst objective, over the drive file's, is best; worse in none if any is.

    Parameters
    ----------
    front : sequence of Point
    own : Point
        The drive file's.
    """
    ratios = np.log([point.values for point in front]) - np.log(own.values)
    keys = [(float(row.max()), float(row.sum())) for row in ratios]
    return front[min(range(len(front)), key=keys.__getitem__)]


def _optuna() -> Any:
    try:
        import optuna
    except ImportError:
        raise UserError("study tune needs Optuna: pip install 'pmsm-ickf[study]'.") from None
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    return optuna


def _open(optuna: Any, out: Path, statement: Statement, space: Space, seed: int) -> Any:
    """The study in ``out``/trials.log, after a look at what that folder is for."""
    facts = {**statement.facts(), "axes": list(space.axes), "nominal": {n: list(v) for n, v in space.nominal.items()}}
    path = out / "tune.json"
    try:
        out.mkdir(parents=True, exist_ok=True)
        if path.exists():
            found = json.loads(path.read_text(encoding="utf-8"))
            if found != facts:
                raise UserError(
                    f"'{out}' holds another tuning ({differences(facts, found)}). Choose another --out, or remove it."
                )
        else:
            write_atomically(path, (json.dumps(facts, indent=2) + "\n").encode())
        backend = optuna.storages.journal.JournalFileBackend(str(out / "trials.log"))
        storage = optuna.storages.JournalStorage(backend)
        study = optuna.create_study(
            storage=storage, study_name="tune", directions=["minimize"] * len(OBJECTIVES), load_if_exists=True
        )
    except (OSError, ValueError) as error:
        raise UserError(f"'{out}' cannot be used: {error}. Choose another --out.") from None
    state = optuna.trial.TrialState
    for trial in study.get_trials(deepcopy=False, states=(state.RUNNING,)):  # an interruption left them without result
        study.tell(trial.number, state=state.FAIL)
    study.sampler = optuna.samplers.TPESampler(seed=seed + len(study.trials), multivariate=True, constant_liar=True)
    return study


def tuned_facts(tuned: Tuned) -> dict[str, Any]:
    """Return everything that is printed as plain data.

    Parameters
    ----------
    tuned : Tuned
    """

    def fact(point: Point) -> dict[str, Any]:
        objectives = dict(zip(OBJECTIVES, point.values, strict=True))
        return {"trial": point.number, "objectives": objectives, "factors": point.factors}

    def checked(check: Check) -> dict[str, Any]:
        return {"objectives": dict(zip(OBJECTIVES, check.values, strict=True)), "success": vars(check.rate)}

    return {
        "drive": tuned.drive,
        "filter": tuned.kind,
        "trials": len(tuned.points),
        "interrupted": tuned.interrupted,
        "front": [fact(point) for point in tuned.front],
        "drive_file": fact(tuned.own),
        "recommended": {**fact(tuned.recommended), "lines": tuned.lines.split("\n")},
        "fresh_runs": {"drive_file": checked(tuned.check_own), "recommended": checked(tuned.check_recommended)},
    }
