"""What ``pmsm-ickf firmware`` does: every gate on every drive's generated C.

A gate is a function ``(folder, progress) -> list[Check]``; adding one is one more name in :data:`GATES`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from model.drives.load import shipped_drives
from runtime.estimator.folder import GeneratedFolder
from runtime.firmware.link_ef import link_ef
from runtime.firmware.static import static_gate
from runtime.firmware.static.check import Check
from runtime.folders.current import check_ready, current_package
from runtime.folders.resolve import find_drive
from runtime.system.files import write_text

Progress = Callable[[str], None]
Gate = Callable[[GeneratedFolder, Progress], list[Check]]

GATES: tuple[Gate, ...] = (link_ef, static_gate)


@dataclass(frozen=True)
class Gated:
    """All checks of one drive."""

    drive: str
    checks: tuple[Check, ...]

    @property
    def failed(self) -> bool:
        return any(check.state == "failed" for check in self.checks)

    @property
    def missing(self) -> bool:
        """Something could not be run here."""
        return any(check.state == "not run" for check in self.checks)

    def good(self, allow_missing: bool) -> bool:
        return not self.failed and (allow_missing or not self.missing)


def check_firmware(
    drives: Sequence[str], json_path: Path | None = None, progress: Progress = lambda text: None
) -> list[Gated]:
    """Run every gate; write the machine-readable result if asked.

    Raises
    ------
    UserError
        No generated folder, a stale or hand-edited one, or no C compiler.
    """
    names = list(drives) or shipped_drives()
    for name in names:
        check_ready(name)
    for name in names:
        progress(f"{name}: is the folder current")
        current_package(find_drive(name))
    results = [run_gates(GeneratedFolder(find_drive(name).path), progress) for name in names]
    if json_path is not None:
        rows = [{"drive": r.drive, "checks": [asdict(check) for check in r.checks]} for r in results]
        facts = {"passed": all(r.good(allow_missing=False) for r in results), "drives": rows}
        write_text(json_path, json.dumps(facts, indent=2) + "\n")
    return results


def run_gates(folder: GeneratedFolder, progress: Progress) -> Gated:
    """All gates on one folder."""
    return Gated(folder.drive, tuple(check for gate in GATES for check in gate(folder, progress)))
