"""Prove several drives at once: the work of ``pmsm-ickf verify``."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path

from model.drives.load import shipped_drives
from runtime.folders.current import check_ready
from runtime.proof.result import Proof
from runtime.proof.verify import Evidence, verify
from runtime.system.files import write_text
from runtime.system.workers import say, share

Progress = Callable[[str], None]


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


def _verify_one(drive: str, progress: Progress = say) -> tuple[Proof, Evidence]:
    return verify(drive, progress=lambda text: progress(f"{drive}: {text}"))


def _verify_all(names: Sequence[str], progress: Progress) -> list[tuple[Proof, Evidence]]:
    """One process a drive where there are cores."""
    count = min(len(names), os.cpu_count() or 1)
    if count == 1:
        return [_verify_one(name, progress) for name in names]
    return share(count, _verify_one, names, progress)
