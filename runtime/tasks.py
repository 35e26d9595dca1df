"""What the commands do, without the words of the command line."""

from __future__ import annotations

import json
import multiprocessing
import os
import queue
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from codegen.evidence.budget import check_budget
from codegen.evidence.measure import Measurer, kept_records
from codegen.fast.ablation import Earned, earnings
from codegen.folder import MANIFEST, difference, write_folder
from codegen.generate import generate
from codegen.ir.graph import UnsupportedOperationError
from model.drive import DriveError, load_drive, shipped_drives
from model.state_space import build
from runtime.drive.experiment import HARD, KINDS, SweepPoint, run_facts, sample_time_sweep, simulate
from runtime.drive.scenario import SCENARIOS
from runtime.drive.simulation import Conditions, Run
from runtime.errors import UserError
from runtime.estimator.compiler import find_compiler
from runtime.estimator.folder import GENERATED, GeneratedFolder
from runtime.files import make_folder, write_text
from runtime.firmware.tasks import run_gates
from runtime.proof.result import Proof
from runtime.proof.verify import Evidence, check_ready, generated_folder, verify
from runtime.report.chapter import Chapter
from runtime.workers import workers

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
    chosen = list(drives) or shipped_drives()
    packages = _generate_all(chosen, out, check, form, progress)
    names = [package.name for package in packages]
    for name in names:
        if names.count(name) > 1:
            raise DriveError(f"two drives are called '{name}'; each needs a name of its own.")
    folders = [target_folder(drive, package.name, out) for drive, package in zip(chosen, packages, strict=True)]
    results = []
    for folder, drive, package in zip(folders, chosen, packages, strict=True):
        diff = difference(folder, package.files)
        state = "unchanged" if not diff else "stale" if check else "updated" if (folder / MANIFEST).is_file() else "new"
        if diff and not check:
            progress(f"{drive}: writing")
            write_folder(folder, package.files, force)
        results.append(Written(package.name, folder, state, len(package.files), diff))
    return results


@dataclass(frozen=True)
class InMemory:
    """A generated folder before it is one."""

    name: str
    files: dict[str, str]


def _generate_all(
    drives: Sequence[str], out: Path | None, check: bool, form: str, progress: Progress
) -> list[InMemory]:
    """Several drives at once where there are cores."""
    count = min(len(drives), os.cpu_count() or 1)
    if count == 1:
        progress(f"{drives[0]}: generating")
        return [_generate(drive, out, check, form) for drive in drives]
    with workers(count) as submit:
        futures = [submit(_generate, drive, out, check, form) for drive in drives]
        results = []
        for drive, future in zip(drives, futures, strict=True):
            progress(f"{drive}: generating")
            results.append(future.result())
        return results


def _generate(drive: str, out: Path | None, check: bool, form: str) -> InMemory:
    """One drive in memory, within its budget; stack and code size as the folder has them, else measured."""
    loaded = load_drive(drive)
    kept = kept_records(target_folder(drive, loaded.name, out))
    try:
        package = generate(loaded, measurer=Measurer(kept, compile=True, retry=not check), form=form)
    except UnsupportedOperationError as error:
        raise UserError(f"drive '{loaded.name}': {error}") from None
    if form == "fast":  # the literal form is for reading and proving, not for the chip
        check_budget(loaded, package.accounts)
    return InMemory(package.drive.name, package.files)


def verify_drives(drives: Sequence[str], json_path: Path | None, progress: Progress) -> list[tuple[Proof, Evidence]]:
    """Prove every drive, several at once where there are cores; write the machine-readable result if asked."""
    names = list(drives) or shipped_drives()
    for name in names:
        check_ready(name)
    results = _verify_all(names, progress)
    if json_path is not None:
        proofs = [proof.to_json() for proof, _ in results]
        facts = {"passed": all(p["passed"] for p in proofs), "drives": proofs}
        write_text(json_path, json.dumps(facts, indent=2) + "\n")
    return results


def _verify_one(drive: str, progress: Progress) -> tuple[Proof, Evidence]:
    return verify(drive, progress=lambda text: progress(f"{drive}: {text}"))


def _verify_all(names: Sequence[str], progress: Progress) -> list[tuple[Proof, Evidence]]:
    """One process a drive where there are cores; their words arrive through a queue."""
    count = min(len(names), os.cpu_count() or 1)
    if count == 1:
        return [_verify_one(name, progress) for name in names]
    with multiprocessing.Manager() as manager, workers(count) as submit:
        words = manager.Queue()
        futures = [submit(_verify_one, name, words.put) for name in names]
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
        write_text(json_path, json.dumps(facts, indent=2) + "\n")
    if out is not None:
        _write_runs(out, names, runs, points, numbered=drive == "paper_spmsm")
    return Simulated(runs, points)


def _write_runs(
    out: Path, names: Sequence[str], runs: Sequence[Run], points: Sequence[SweepPoint], numbered: bool
) -> None:
    from runtime.report.drive_figures import run_figure, sweep_figure

    make_folder(out)
    for run in runs:
        run.save(out / f"{run.scenario.name}_{run.kind}.npz")
    for name in names:
        chosen = [run for run in runs if run.scenario.name == name]
        write_text(out / f"{name}.svg", run_figure(chosen, numbered))
    if points:
        write_text(out / "sample_time.svg", sweep_figure(points))


def _earned(drive: str) -> list[Earned]:
    """What each pass saves of a drive's first filter."""
    loaded = load_drive(drive)
    return earnings(build(loaded), loaded.filter.kinds[0], loaded.filter.gain)


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
    count = min(len(names), os.cpu_count() or 1)
    # Emulators and gates are processes of their own: threads start them while this one simulates.
    with ThreadPoolExecutor(count) as threads, workers(count) as submit:
        earned = [submit(_earned, name) for name in names]
        gated = [threads.submit(run_gates, GeneratedFolder(generated_folder(name)), progress) for name in names]
        try:
            for name, (proof, evidence), gates, passes in zip(names, results, gated, earned, strict=True):
                drive = load_drive(name)
                kinds = KINDS if name == "paper_spmsm" else drive.filter.kinds
                runs = [run for scenario in SCENARIOS for run in simulate(name, scenario, kinds, progress=progress)]
                hard = simulate(name, "load_step", drive.filter.kinds[:1], HARD, progress=progress)
                sweep = sample_time_sweep(name, progress=progress) if name == "paper_spmsm" else []
                made = drive, generated_folder(name), proof, evidence, runs, hard, sweep
                chapters.append(Chapter(*made, gates.result(), passes.result()))
        except BaseException:
            threads.shutdown(wait=False, cancel_futures=True)
            raise
    progress("writing the report page")
    page = build / "report" / "index.html"
    write_page(page, chapters)
    return written, chapters, page
