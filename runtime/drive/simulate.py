"""Scenarios of a drive with its figures, data and JSON: the work of ``pmsm-ickf simulate``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from runtime.drive.experiment import SweepPoint, run_facts, sample_time_sweep, simulate
from runtime.drive.scenario import SCENARIOS
from runtime.drive.simulation import Conditions, Run
from runtime.system.files import make_folder, write_facts, write_text

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Simulated:
    """Runs of a drive, scenario by scenario and filter by filter, and the sample-time sweep if asked for."""

    runs: list[Run]
    sweep: list[SweepPoint]


def simulate_drive(
    drive: str,
    scenario: str,
    kinds: Sequence[str],
    conditions: dict[str, Any],
    controller: str,
    sweep: bool,
    json_path: Path | None,
    out: Path | None,
    progress: Progress,
    task: Mapping[str, float | None] | None = None,
) -> Simulated:
    """Run one or all scenarios; write figures, data and JSON where asked.

    Parameters
    ----------
    drive : str
        A shipped name, the path of a TOML file, or a generated folder.
    scenario : str
        Name of the scenario.
    kinds : sequence of str
        Filter kinds.
    conditions : dict
        Inverter, sensors, noise and start.
    controller : str
        "c" (the generated C) or "numpy" (its twin).
    sweep : bool
    json_path : Path or None
        Where every figure is written as JSON; None: nowhere.
    out : Path or None
        Where files are written; None: the default place.
    progress : Progress
        Told how far the work is.
    task : mapping, optional
        Speed (r/min), load (N m) and ramp (s) in place of the rated ones.
    """
    setting = Conditions(**conditions)
    names = list(SCENARIOS) if scenario == "all" else [scenario]
    runs = [run for name in names for run in simulate(drive, name, kinds, setting, controller, progress, task)]
    points = sample_time_sweep(drive, conditions=setting, progress=progress) if sweep else []
    if json_path is not None:
        facts = {"drive": drive, "runs": [run_facts(run) for run in runs], "sweep": [asdict(point) for point in points]}
        write_facts(json_path, facts)
    if out is not None:
        _write_runs(out, names, runs, points, numbered=drive == "paper_spmsm")
    return Simulated(runs, points)


def _write_runs(
    out: Path, names: Sequence[str], runs: Sequence[Run], points: Sequence[SweepPoint], numbered: bool
) -> None:
    from runtime.drive.figures import run_figure, sweep_figure

    make_folder(out)
    for run in runs:
        run.save(out / f"{run.scenario.name}_{run.kind}.npz")
    for name in names:
        chosen = [run for run in runs if run.scenario.name == name]
        write_text(out / f"{name}.svg", run_figure(chosen, numbered))
    if points:
        write_text(out / "sample_time.svg", sweep_figure(points))
