"""Prove several drives at once: the work of ``pmsm-ickf verify``."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from model.drives.load import shipped_drives
from runtime.folders.current import check_ready
from runtime.folders.kept import keep
from runtime.folders.resolve import find_drive
from runtime.proof.result import Proof
from runtime.proof.verify import Effort, Evidence, verify
from runtime.system.files import write_facts
from runtime.system.verdicts import all_hold
from runtime.system.workers import say, share

Progress = Callable[[str], None]


def verify_drives(
    drives: Sequence[str], json_path: Path | None, progress: Progress, fresh: bool = False
) -> list[tuple[Proof, Evidence]]:
    """Prove every drive, several at once where there are cores; write the machine-readable result if asked.

    What an earlier run proved from the same sources is taken from it, unless ``fresh``.

    Parameters
    ----------
    drives : sequence of str
        Shipped names, TOML files or generated folders; none: every shipped drive.
    json_path : Path or None
        Where every figure is written as JSON; None: nowhere.
    progress : Progress
        Told how far the work is.
    fresh : bool, optional
    """
    names = list(drives) or shipped_drives()
    for name in names:
        check_ready(name)
    results = _verify_all(names, progress, fresh)
    if json_path is not None:
        proofs = [proof.to_json() for proof, _ in results]
        facts = {"passed": all_hold(p["passed"] for p in proofs), "drives": proofs}
        write_facts(json_path, facts)
    return results


def prove_or_recall(
    drive: str, fresh: bool = False, progress: Progress = say, current: bool = False
) -> tuple[Proof, Evidence]:
    """:func:`verify`, or what an earlier run found with the same folder, sources, libraries and tools, if it held.

    ``current``: the folder has just been generated.

    Parameters
    ----------
    drive : str
        A shipped name, the path of a TOML file, or a generated folder.
    fresh : bool, optional
    progress : Progress, optional
        Told how far the work is.
    current : bool, optional
    """

    def prove() -> tuple[Proof, Evidence]:
        return verify(drive, progress=lambda text: progress(f"{drive}: {text}"), current=current)

    named = find_drive(drive)
    facts = [named.drive.model_dump_json(), repr(Effort())]
    (proof, evidence), kept = keep("proof", named.path, facts, prove, _held, fresh)
    proof.kept = kept
    return proof, evidence


def _held(result: tuple[Proof, Evidence]) -> bool:
    return result[0].passed


def _verify_all(names: Sequence[str], progress: Progress, fresh: bool) -> list[tuple[Proof, Evidence]]:
    """One process a drive where there are cores."""
    count = min(len(names), os.cpu_count() or 1)
    if count == 1:
        return [prove_or_recall(name, fresh, progress) for name in names]
    return share(count, partial(prove_or_recall, fresh=fresh), names, progress)
