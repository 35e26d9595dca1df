"""The gates of ``pmsm-ickf firmware``: every gate on every drive's generated C.

A gate is a function ``(folder, progress) -> list[Check]``; adding one is one more name in :data:`GATES`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

from model.drives.load import shipped_drives
from runtime.estimator.folder import GeneratedFolder
from runtime.firmware import tools
from runtime.firmware.link_ef import link_ef
from runtime.firmware.static import static_gate
from runtime.firmware.static import tool as static_tools
from runtime.firmware.static.check import Check
from runtime.folders.current import check_ready, current_package
from runtime.folders.kept import keep, tool
from runtime.folders.resolve import find_drive
from runtime.system.files import write_facts
from runtime.system.verdicts import all_hold
from runtime.system.workers import say, share

Progress = Callable[[str], None]
Gate = Callable[[GeneratedFolder, Progress], list[Check]]

GATES: tuple[Gate, ...] = (link_ef, static_gate)

#: Every program that a gate runs.
TOOLS = sorted({*tools.PACKAGES, *static_tools.PACKAGES})


@dataclass(frozen=True)
class Gated:
    """All checks of one drive."""

    drive: str
    checks: tuple[Check, ...]
    #: They were made by an earlier run, of the same text with the same tools.
    kept: bool = False

    @property
    def failed(self) -> bool:
        """Whether a check failed."""
        return any(check.state == "failed" for check in self.checks)

    @property
    def missing(self) -> bool:
        """Something could not be run here."""
        return any(check.state == "not run" for check in self.checks)

    def good(self, allow_missing: bool) -> bool:
        """Something was checked, and nothing failed; what could not be run counts unless it is ``allow_missing``."""
        return bool(self.checks) and not self.failed and (allow_missing or not self.missing)


def check_firmware(
    drives: Sequence[str],
    json_path: Path | None = None,
    progress: Progress = lambda text: None,
    fresh: bool = False,
) -> list[Gated]:
    """Run every gate; write the machine-readable result if asked.

    What an earlier run checked of the same text with the same tools is taken from it, unless ``fresh``.

    Raises
    ------
    UserError
        No generated folder, a stale or hand-edited one, or no C compiler.
    """
    names = list(drives) or shipped_drives()
    for name in names:
        check_ready(name)
    count = min(len(names), os.cpu_count() or 1)
    if count == 1:
        results = [check_or_recall(name, fresh, progress) for name in names]
    else:
        results = share(count, partial(check_or_recall, fresh=fresh), names, progress)
    if json_path is not None:
        rows = [{"drive": r.drive, "kept": r.kept, "checks": [asdict(check) for check in r.checks]} for r in results]
        facts = {"passed": all_hold(r.good(allow_missing=False) for r in results), "drives": rows}
        write_facts(json_path, facts)
    return results


def check_or_recall(drive: str, fresh: bool = False, progress: Progress = say, current: bool = False) -> Gated:
    """:func:`run_gates` on a drive's folder, or what an earlier run found with the same tools, if all was run and held.

    ``current``: the folder has just been generated.
    """
    named = find_drive(drive)
    folder = GeneratedFolder(named.path)

    def check() -> Gated:
        if not current:
            progress(f"{drive}: is the folder current")
            current_package(named)
        return run_gates(folder, progress)

    facts = [named.drive.model_dump_json(), *map(tool, TOOLS)]
    gated, kept = keep("gates", folder.path, facts, check, _held, fresh)
    return replace(gated, kept=kept)


def _held(gated: Gated) -> bool:
    return gated.good(allow_missing=False)


def run_gates(folder: GeneratedFolder, progress: Progress) -> Gated:
    """All gates on one folder."""
    return Gated(folder.drive, tuple(check for gate in GATES for check in gate(folder, progress)))
