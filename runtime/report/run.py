"""Generate, verify, simulate, check, and write the report page: the work of ``pmsm-ickf run``."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from codegen.fast.ablation import Earned, earnings
from model.drives.load import shipped_drives
from model.machines.state_space import build
from runtime.drive.experiment import HARD, KINDS, sample_time_sweep, simulate
from runtime.drive.scenario import SCENARIOS
from runtime.estimator.compiler import find_compiler
from runtime.estimator.folder import GeneratedFolder
from runtime.firmware.gates import run_gates
from runtime.folders.generate import Written, generate_drives
from runtime.folders.resolve import find_drive
from runtime.proof.drives import verify_drives
from runtime.report.chapter import Chapter
from runtime.system.workers import workers

Progress = Callable[[str], None]


def _earned(drive: str) -> list[Earned]:
    """What each pass saves of a drive's first filter."""
    loaded = find_drive(drive).drive
    return earnings(build(loaded), loaded.filter.kinds[0], loaded.filter.gain)


def run_all(drives: Sequence[str], build: Path, progress: Progress) -> tuple[list[Written], list[Chapter], Path]:
    """Generate, verify, simulate, write the report page; the work of ``pmsm-ickf run``."""
    from runtime.report.page import write_page
    from runtime.style.figures import pyplot

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
        gated = [threads.submit(run_gates, GeneratedFolder(find_drive(name).path), progress) for name in names]
        try:
            for name, (proof, evidence), gates, passes in zip(names, results, gated, earned, strict=True):
                named = find_drive(name)
                drive = named.drive
                kinds = KINDS if name == "paper_spmsm" else drive.filter.kinds
                runs = [run for scenario in SCENARIOS for run in simulate(name, scenario, kinds, progress=progress)]
                hard = simulate(name, "load_step", drive.filter.kinds[:1], HARD, progress=progress)
                sweep = sample_time_sweep(name, progress=progress) if name == "paper_spmsm" else []
                made = drive, named.path, proof, evidence, runs, hard, sweep
                chapters.append(Chapter(*made, gates.result(), passes.result()))
        except BaseException:
            threads.shutdown(wait=False, cancel_futures=True)
            raise
    progress("writing the report page")
    page = build / "report" / "index.html"
    write_page(page, chapters)
    return written, chapters, page
