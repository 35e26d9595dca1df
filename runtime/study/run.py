"""Runs a study, here or on a cluster, and gathers what is done."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.rating import sensor_noise
from model.schema import Drive
from runtime.drive.experiment import folder_with
from runtime.drive.fleet import Outcomes
from runtime.drive.scenario import find_scenario
from runtime.estimator.compiler import find_compiler
from runtime.estimator.folder import KINDS
from runtime.folders.resolve import find_drive
from runtime.study.package import Package, pack, run_package
from runtime.study.statement import Statement, parse_ranges
from runtime.study.store import Chunk, Store, chunks
from runtime.system.errors import UserError, take_interrupt
from runtime.system.values import read_word

Array = NDArray[Any]
#: Called with runs done, of all, and what is being run.
Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class Group:
    """All finished runs of one drive with one filter: their index, what was drawn for them, and what came of it."""

    drive: str
    kind: str
    index: Array
    drawn: dict[str, Array]
    outcomes: Outcomes


@dataclass(frozen=True)
class Study:
    """The chunks of a study that exist; ``interrupted`` if less than was wanted."""

    statement: Statement
    runs: int
    groups: tuple[Group, ...]
    folder: Path
    interrupted: bool


def state_study(
    drives: Sequence[str],
    kinds: Sequence[str],
    scenario: str,
    vary: Sequence[str],
    seed: int,
    supervised: bool = False,
) -> tuple[Statement, list[Package]]:
    """State a study and gather its code. A filter that a drive does not ship is generated for the occasion.

    Parameters
    ----------
    drives : sequence of str
    kinds : sequence of str
        Filter kinds.
    scenario : str
    vary : sequence of str
        Ranges, see :func:`runtime.study.statement.parse_range`.
    seed : int
    supervised : bool, optional
        From power-up, with the supervisor; else the controller alone.

    Raises
    ------
    UserError
        Unknown drives, filters, scenario or variables; no compiler.
    """
    find_compiler()
    ranges = parse_ranges(vary)
    for kind in kinds:
        read_word(kind, "filter", KINDS)
    packages, tasks, rated = [], [], []
    for name in dict.fromkeys(drives):
        named = find_drive(name)
        for kind in dict.fromkeys(kinds):
            tasks.append(find_scenario(scenario, named.drive))
            rated.append(_rated(named.drive))
            with ExitStack() as stack:
                packages.append(pack(folder_with(named, kind, stack), kind, supervised))
    subjects = tuple((package.drive, package.kind) for package in packages)
    if len(set(subjects)) < len(subjects):
        raise UserError("two of the drives have the same name; each needs a name of its own.")
    digests = tuple(package.digest for package in packages)
    return Statement(subjects, digests, tuple(tasks), tuple(rated), ranges, seed, supervised), packages


def _rated(drive: Drive) -> dict[str, float]:
    """Sensor noise (A), load (N m) and speed (r/min) that suit a drive."""
    task = find_scenario("load_step", drive)
    return {"noise": sensor_noise(drive.filter.measurement_noise), "load": task.load, "speed": task.speed}


def run_study(
    statement: Statement,
    packages: Sequence[Package],
    runs: int,
    out: Path,
    scheduler: str | None = None,
    progress: Progress = lambda done, of, what: None,
) -> Study:
    """Run what is missing of a study and gather all of it; an interruption (Ctrl-C) keeps what is done.

    Parameters
    ----------
    statement : Statement
    packages : sequence of Package
    runs : int
        Of each drive with each filter, altogether.
    out : Path
        Where finished chunks lie.
    scheduler : str, optional
        Address of a Dask scheduler.
    progress : callable
        Told runs done, of how many, of which filter.
    """
    store = Store(out, statement)
    missing = list(store.missing(runs))
    total = runs * len(packages)
    done = total - sum(chunk.count for chunk in missing)
    progress(done, total, "")
    try:
        if scheduler is None:
            _run_here(store, packages, missing, done, total, progress)
        elif missing:
            from runtime.study.cluster import run_there

            run_there(scheduler, store, packages, missing, lambda count: progress(count + done, total, scheduler))
    except KeyboardInterrupt:
        take_interrupt()
        return gather(store, runs, interrupted=True)
    return gather(store, runs, interrupted=False)


def _run_here(
    store: Store, packages: Sequence[Package], missing: list[Chunk], done: int, total: int, progress: Progress
) -> None:
    """Chunk after chunk, each on all threads."""
    statement = store.statement
    for chunk in missing:
        package = packages[chunk.subject]
        what, before = f"{package.drive}, {package.kind}", done

        def tell(count: int, of: int, before: int = before, what: str = what) -> None:
            progress(before + count, total, what)

        tell(0, chunk.count)
        cases = statement.cases(chunk.subject, chunk.first, chunk.count)
        store.save(chunk, run_package(package, statement.scenarios[chunk.subject], cases, progress=tell))
        done += chunk.count


def gather(store: Store, runs: int, interrupted: bool) -> Study:
    """Gather everything that is there, by drive and filter.

    Parameters
    ----------
    store : Store
    runs : int
    interrupted : bool
        Whether more was wanted.
    """
    statement = store.statement
    found: list[list[tuple[Chunk, Outcomes]]] = [[] for _ in statement.subjects]
    for chunk in chunks(statement, runs):
        outcomes = store.load(chunk)
        if outcomes is not None:
            found[chunk.subject].append((chunk, outcomes))
    drawn = statement.draw(0, runs)
    groups = []
    for (drive, kind), pieces in zip(statement.subjects, found, strict=True):
        if pieces:
            index = np.concatenate([np.arange(c.first, c.first + c.count) for c, _ in pieces])
            columns = {f.name: np.concatenate([getattr(o, f.name) for _, o in pieces]) for f in fields(Outcomes)}
            of_these = {name: column[index] for name, column in drawn.items()}
            groups.append(Group(drive, kind, index, of_these, Outcomes(**columns)))
    return Study(statement, runs, tuple(groups), store.folder, interrupted)
