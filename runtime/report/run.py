"""Generate, verify, simulate, check, and write the report page: the work of ``pmsm-ickf run``.

Two floors. The first is one drive, generated, proved by every link that needs this host alone, simulated. The second
adds what takes minutes: all drives, the C away from the host and under the static tools, what each pass earns, peers
(EKF, UKF), a cheap inverter and the sweep of the sample time.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from codegen.fast.ablation import Earned, earnings
from model.drives.load import shipped_drives
from model.machines.state_space import build
from runtime.drive.experiment import HARD, SweepPoint, sample_time_sweep, simulate
from runtime.drive.scenario import SCENARIOS
from runtime.drive.simulation import Run
from runtime.estimator.compiler import find_compiler
from runtime.estimator.folder import KINDS
from runtime.firmware.gates import check_or_recall
from runtime.folders.generate import Written, generate_drives
from runtime.folders.resolve import find_drive
from runtime.proof.drives import prove_or_recall
from runtime.report.chapter import Chapter
from runtime.system.workers import new_words, results, say, workers

Progress = Callable[[str], None]


#: The drive of the first floor: the paper's.
MAIN = "paper_spmsm"


@dataclass(frozen=True)
class Ran:
    """The results of a run. ``whole``: both floors."""

    written: list[Written]
    chapters: list[Chapter]
    page: Path
    whole: bool


@dataclass(frozen=True)
class Simulations:
    """A drive's closed loops; ``hard`` and ``sweep`` belong to the second floor."""

    runs: list[Run]
    hard: list[Run]
    sweep: list[SweepPoint]


def run(
    drives: Sequence[str],
    build: Path,
    everything: bool = False,
    fresh: bool = False,
    progress: Progress = lambda t: None,
) -> Ran:
    """Both floors for some drives, or for all (``everything``); without either the first floor, of :data:`MAIN`.

    ``fresh``: what an earlier run proved or checked is proved and checked again.
    """
    from runtime.report.page import write_page
    from runtime.style.figures import pyplot

    # Missing tools are reported now, not after the folders were rewritten or the proof was run.
    find_compiler()
    pyplot()
    whole = everything or bool(drives)
    names = list(drives) or (shipped_drives() if everything else [MAIN])
    written = generate_drives(names, None, progress=progress)
    chapters = _chapters(names, whole, fresh, progress)
    progress("writing the report page")
    page = build / "report" / "index.html"
    write_page(page, chapters)
    return Ran(written, chapters, page, whole)


def _chapters(names: Sequence[str], whole: bool, fresh: bool, progress: Progress) -> list[Chapter]:
    """Every drive's work, shared among the cores; the longest pieces begin first."""
    words = new_words()
    with workers(os.cpu_count() or 1, words) as submit:
        gated = [submit(check_or_recall, name, fresh, say, True) for name in names] if whole else []
        proved = [submit(prove_or_recall, name, fresh, say, True) for name in names]
        simulated = [submit(_simulated, name, whole) for name in names]
        earned = [submit(_earned, name) for name in names] if whole else []
        results([*gated, *proved, *simulated, *earned], words, progress)
    chapters = []
    for k, name in enumerate(names):
        (proof, evidence), found = proved[k].result(), simulated[k].result()
        named = find_drive(name)
        made = named.drive, named.path, proof, evidence, found.runs
        more = (found.hard, found.sweep, gated[k].result(), earned[k].result()) if whole else ()
        chapters.append(Chapter(*made, *more))
    return chapters


def _simulated(drive: str, whole: bool) -> Simulations:
    """The paper's scenarios with the drive's filters; in the second floor peers, a cheap inverter and the sweep too."""
    own = find_drive(drive).drive.filter.kinds
    kinds = KINDS if whole and drive == MAIN else own
    runs = [run for scenario in SCENARIOS for run in simulate(drive, scenario, kinds, progress=say)]
    hard = simulate(drive, "load_step", own[:1], HARD, progress=say) if whole else []
    sweep = sample_time_sweep(drive, progress=say) if whole and drive == MAIN else []
    return Simulations(runs, hard, sweep)


def _earned(drive: str) -> list[Earned]:
    """The operations that each pass saves of a drive's first filter."""
    loaded = find_drive(drive).drive
    return earnings(build(loaded), loaded.filter.kinds[0], loaded.filter.gain)
