"""The experiments of ``pmsm-ickf simulate``: a scenario with some filters, and the sweep over the sample time."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from codegen.generate import generate_bare
from codegen.output.folder import write_folder
from model.schema import Drive
from runtime.drive.scenario import find_scenario, step_start
from runtime.drive.simulation import Conditions, Run, Simulator
from runtime.estimator.compiler import find_compiler
from runtime.estimator.folder import KINDS, GeneratedFolder
from runtime.folders.resolve import NamedDrive, find_drive
from runtime.system.values import read_word

Progress = Callable[[str], None]

#: The faults of a cheap inverter: carrier comparison, 2 us of dead time, 12 bits, a sample of computation delay.
HARD = Conditions(inverter="pwm", dead_time=2e-6, bits=12, delay=1)


@dataclass(frozen=True)
class SweepPoint:
    """One cell of the sample-time sweep: figures as :meth:`Run.figures`, and whether the run was good."""

    sample_time: float
    discretization: str
    locked: bool
    figures: dict[str, float]


def changed(drive: Drive, **sections: dict[str, Any]) -> Drive:
    """A drive with keys of some sections replaced."""
    update = {name: getattr(drive, name).model_copy(update=keys) for name, keys in sections.items()}
    return drive.model_copy(update=update)


def simulate(
    drive_name: str,
    scenario: str = "load_step",
    kinds: Sequence[str] = ("ckf", "ickf"),
    conditions: Conditions | None = None,
    controller: str = "c",
    progress: Progress = lambda text: None,
    task: Mapping[str, float | None] | None = None,
) -> list[Run]:
    """Run a scenario with each filter. A filter the drive does not ship is generated for the occasion.

    Parameters
    ----------
    drive_name : str
        A shipped name or the path of a TOML file.
    scenario : str, optional
        Name of the scenario.
    kinds : sequence of str, optional
        Filter kinds.
    conditions : Conditions, optional
        Inverter, sensors, noise and start.
    controller : str, optional
        "c" (the generated C) or "numpy" (its twin).
    progress : Progress, optional
        Told how far the work is.
    task : mapping, optional
        Speed, load and ramp in place of the rated ones, see :func:`runtime.drive.scenario.find_scenario`.

    Raises
    ------
    UserError
        Unknown drive, scenario or filter; no compiler.
    """
    find_compiler()
    named = find_drive(drive_name)
    drive = named.drive
    asked = find_scenario(scenario, drive, **(task or {}))
    for kind in kinds:
        read_word(kind, "filter", KINDS)
    runs = []
    with ExitStack() as stack:
        folders = {kind: folder_with(named, kind, stack) for kind in kinds}
        for kind, folder in folders.items():
            progress(f"{drive.name}: {scenario}, {kind}: compiling")
            simulator = Simulator(folder, kind)
            runs.append(
                simulator.run(asked, conditions, controller, progress=_percent(progress, drive.name, scenario, kind))
            )
    return runs


def _percent(progress: Progress, drive: str, scenario: str, kind: str) -> Callable[[float], None]:
    return lambda share: progress(f"{drive}: {scenario}, {kind}: {100 * share:.0f} %")


def folder_with(named: NamedDrive, kind: str, stack: ExitStack) -> GeneratedFolder:
    """The drive's own folder if it has the filter, else one made in a temporary place."""
    if kind in named.drive.filter.kinds and named.generated:
        return GeneratedFolder(named.path)
    return _temporary(changed(named.drive, filter={"kinds": [kind]}), stack)


def _temporary(drive: Drive, stack: ExitStack) -> GeneratedFolder:
    path = Path(stack.enter_context(tempfile.TemporaryDirectory())) / drive.name
    write_folder(path, generate_bare(drive).files)
    return GeneratedFolder(path)


def sample_time_sweep(
    drive_name: str,
    sample_times: Sequence[float] = (100e-6, 50e-6, 20e-6, 10e-6),
    kind: str = "ckf",
    conditions: Conditions | None = None,
    progress: Progress = lambda text: None,
) -> list[SweepPoint]:
    """The same motor and tuning at several sample times, Euler and exact, after a step of the speed reference.

    Parameters
    ----------
    drive_name : str
        A shipped name or the path of a TOML file.
    sample_times : sequence of float, optional
    kind : str, optional
        Filter kind, such as "ickf".
    conditions : Conditions, optional
        Inverter, sensors, noise and start.
    progress : Progress, optional
        Told how far the work is.
    """
    find_compiler()
    drive = find_drive(drive_name).drive
    points = []
    for T in sample_times:
        for discretization in ("euler", "exact"):
            progress(f"{drive.name}: T = {T * 1e6:g} us, {discretization}")
            model = {"sample_time": T, "discretization": discretization}
            with ExitStack() as stack:
                folder = _temporary(changed(drive, model=model, filter={"kinds": [kind]}), stack)
                run = Simulator(folder, kind).run(step_start(drive), conditions)
            points.append(SweepPoint(T, discretization, run.good, run.figures()))
    return points


def run_facts(run: Run) -> dict[str, Any]:
    """One run as plain data; a figure that is no number becomes None, which JSON knows."""
    figures = {name: value if math.isfinite(value) else None for name, value in run.figures().items()}
    facts = {"filter": run.kind, "scenario": run.scenario.name, "locked": run.locked, "reached": run.reached}
    return {**facts, **figures, "status": run.status_counts, "task": asdict(run.scenario)}
