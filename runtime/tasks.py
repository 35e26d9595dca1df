"""What the commands do, without the words of the command line."""

from __future__ import annotations

import json
import multiprocessing
import os
import queue
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from codegen.budget import check_budget
from codegen.folder import MANIFEST, difference, write_folder
from codegen.generate import Package, generate
from codegen.measure import Measurer, kept_records
from model.drive import DriveError, load_drive, shipped_drives
from runtime.drive.experiment import HARD, KINDS, SweepPoint, run_facts, sample_time_sweep, simulate
from runtime.drive.scenario import SCENARIOS
from runtime.drive.simulation import Conditions, Run
from runtime.errors import UserError
from runtime.estimator.compiler import find_compiler
from runtime.estimator.folder import GENERATED, GeneratedFolder
from runtime.firmware.tasks import run_gates
from runtime.proof.result import Proof
from runtime.proof.verify import Evidence, check_ready, generated_folder, verify
from runtime.report.chapter import Chapter

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Written:
    """One drive's outcome: ``state`` is new, updated, unchanged or stale; ``diff`` what changed."""

    drive: str
    folder: Path
    state: str
    files: int
    diff: str


def target_folder(drive: str, name: str, out: Path | None) -> Path:
    """``out``/name; by default the project's generated/ for shipped drives, ./generated for TOML files."""
    if out is not None:
        return out / name
    if drive in shipped_drives():
        return GENERATED / name
    if name in shipped_drives() and (Path("generated") / name).resolve() == (GENERATED / name).resolve():
        raise DriveError(
            f"drive '{drive}': the name '{name}' belongs to a shipped drive; give yours its own, or use --out."
        )
    return Path("generated") / name


def generate_drives(
    drives: Sequence[str],
    out: Path | None,
    check: bool = False,
    force: bool = False,
    form: str = "fast",
    progress: Progress = lambda text: None,
) -> list[Written]:
    """Generate every drive in memory first, then write: a bad one leaves all folders as they were.

    With ``check`` nothing is written.
    """
    if form != "fast" and out is None:
        raise UserError("the literal form is for reading: say where it goes with --out DIR, beside the shipped one.")
    packages = []
    for drive in drives or shipped_drives():
        progress(f"{drive}: generating")
        packages.append((drive, _generate(drive, out, check, form)))
    names = [package.drive.name for _, package in packages]
    for name in names:
        if names.count(name) > 1:
            raise DriveError(f"two drives are called '{name}'; each needs a name of its own.")
    folders = [target_folder(drive, package.drive.name, out) for drive, package in packages]
    results = []
    for folder, (drive, package) in zip(folders, packages, strict=True):
        diff = difference(folder, package.files)
        state = "unchanged" if not diff else "stale" if check else "updated" if (folder / MANIFEST).is_file() else "new"
        if diff and not check:
            progress(f"{drive}: writing")
            write_folder(folder, package.files, force)
        results.append(Written(package.drive.name, folder, state, len(package.files), diff))
    return results


def _generate(drive: str, out: Path | None, check: bool, form: str) -> Package:
    """One drive in memory, within its budget; stack and code size as the folder has them, else measured."""
    loaded = load_drive(drive)
    kept = kept_records(target_folder(drive, loaded.name, out))
    package = generate(loaded, measurer=Measurer(kept, compile=True, retry=not check), form=form)
    check_budget(loaded, package.accounts)
    return package


def verify_drives(drives: Sequence[str], json_path: Path | None, progress: Progress) -> list[tuple[Proof, Evidence]]:
    """Prove every drive, several at once where there are cores; write the machine-readable result if asked."""
    names = list(drives) or shipped_drives()
    for name in names:
        progress(f"{name}: checking")
        check_ready(name)
    workers = min(len(names), os.cpu_count() or 1)
    if workers > 1:
        results = _verify_parallel(names, workers, progress)
    else:
        results = [_verify_one(name, progress) for name in names]
    if json_path is not None:
        proofs = [proof.to_json() for proof, _ in results]
        json_path.write_text(
            json.dumps({"passed": all(p["passed"] for p in proofs), "drives": proofs}, indent=2) + "\n"
        )
    return results


def _verify_one(drive: str, progress: Progress) -> tuple[Proof, Evidence]:
    return verify(drive, progress=lambda text: progress(f"{drive}: {text}"))


def _verify_parallel(names: Sequence[str], workers: int, progress: Progress) -> list[tuple[Proof, Evidence]]:
    """One process a drive; their words arrive through a queue."""
    with (
        multiprocessing.Manager() as manager,
        ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool,
    ):
        words = manager.Queue()
        futures = [pool.submit(_verify_one, name, words.put) for name in names]
        while not all(future.done() for future in futures):
            try:
                progress(words.get(timeout=0.2))
            except queue.Empty:
                continue
        return [future.result() for future in futures]


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
) -> Simulated:
    """Run one or all scenarios; write figures, data and JSON where asked."""
    setting = Conditions(**conditions)
    names = list(SCENARIOS) if scenario == "all" else [scenario]
    runs = [run for name in names for run in simulate(drive, name, kinds, setting, controller, progress)]
    points = sample_time_sweep(drive, conditions=setting, progress=progress) if sweep else []
    if json_path is not None:
        facts = {"drive": drive, "runs": [run_facts(run) for run in runs], "sweep": [asdict(point) for point in points]}
        json_path.write_text(json.dumps(facts, indent=2) + "\n")
    if out is not None:
        _write_runs(out, names, runs, points, numbered=drive == "paper_spmsm")
    return Simulated(runs, points)


def _write_runs(
    out: Path, names: Sequence[str], runs: Sequence[Run], points: Sequence[SweepPoint], numbered: bool
) -> None:
    from runtime.report.drive_figures import run_figure, sweep_figure

    out.mkdir(parents=True, exist_ok=True)
    for run in runs:
        run.save(out / f"{run.scenario.name}_{run.kind}.npz")
    for name in names:
        chosen = [run for run in runs if run.scenario.name == name]
        (out / f"{name}.svg").write_text(run_figure(chosen, numbered))
    if points:
        (out / "sample_time.svg").write_text(sweep_figure(points))


def run_all(drives: Sequence[str], build: Path, progress: Progress) -> tuple[list[Written], list[Chapter], Path]:
    """Generate, verify, simulate, write the report page; the work of ``pmsm-ickf run``."""
    from runtime.report.figures import pyplot
    from runtime.report.page import write_page

    # What is missing is said now, not after the folders were rewritten or the proof was run.
    find_compiler()
    pyplot()
    names = list(drives) or shipped_drives()
    written = generate_drives(names, None, progress=progress)
    results = verify_drives(names, None, progress)
    chapters = []
    for name, (proof, evidence) in zip(names, results, strict=True):
        drive = load_drive(name)
        kinds = KINDS if name == "paper_spmsm" else drive.filter.kinds
        runs = [run for scenario in SCENARIOS for run in simulate(name, scenario, kinds, progress=progress)]
        hard = simulate(name, "load_step", drive.filter.kinds[:1], HARD, progress=progress)
        sweep = sample_time_sweep(name, progress=progress) if name == "paper_spmsm" else []
        folder = generated_folder(name)
        firmware = run_gates(GeneratedFolder(folder), progress)
        chapters.append(Chapter(drive, folder, proof, evidence, runs, hard, sweep, firmware))
    progress("writing the report page")
    page = build / "report" / "index.html"
    write_page(page, chapters)
    return written, chapters, page
