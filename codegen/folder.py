"""The generated folder: manifest, hashes, drift check, and a swap that leaves no half-written state."""

from __future__ import annotations

import difflib
import hashlib
import json
import os
import shutil
import tempfile
from pathlib import Path
from typing import Any

MANIFEST = "manifest.json"


class FolderError(RuntimeError):
    """A generated folder that must not be used or overwritten; one line, what and where."""


def digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def with_manifest(files: dict[str, str], facts: dict[str, Any]) -> dict[str, str]:
    """Add manifest.json, which lists every file with size and hash."""
    listed = {name: {"bytes": len(text.encode()), "sha256": digest(text)} for name, text in sorted(files.items())}
    return {**files, MANIFEST: json.dumps({**facts, "files": listed}, indent=2) + "\n"}


def read_manifest(folder: Path) -> dict[str, Any]:
    """The folder's manifest.

    Raises
    ------
    FolderError
        If there is none or it cannot be read.
    """
    try:
        manifest: dict[str, Any] = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise FolderError(f"'{folder}' is not a generated folder: no {MANIFEST} in it.") from None
    except (OSError, ValueError) as error:
        raise FolderError(f"'{folder / MANIFEST}' cannot be read: {error}") from None
    return manifest


def edited_files(folder: Path) -> list[str]:
    """Files that are no longer what the manifest says: changed, missing or added."""
    manifest = read_manifest(folder)
    listed = manifest["files"]
    changed = []
    for name, entry in listed.items():
        path = folder / name
        if not path.is_file() or hashlib.sha256(path.read_bytes()).hexdigest() != entry["sha256"]:
            changed.append(name)
    present = {
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    return sorted({*changed, *(present - set(listed) - {MANIFEST})})


def check_unedited(folder: Path) -> None:
    """Raise FolderError if anything in the folder was edited by hand."""
    edited = edited_files(folder)
    if edited:
        raise FolderError(
            f"'{folder / edited[0]}' was edited by hand (it differs from {MANIFEST}). "
            "Put the change into the drive file and regenerate, or overwrite it with: pmsm-ickf generate --force."
        )


def difference(folder: Path, files: dict[str, str]) -> str:
    """Unified diff from what is on disk to ``files``; empty if they are byte-identical."""
    parts: list[str] = []
    present = (
        {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file() and "__pycache__" not in p.parts}
        if folder.is_dir()
        else set()
    )
    for name in sorted(present | set(files)):
        raw = (folder / name).read_bytes() if name in present else b""
        if name in files and raw == files[name].encode():
            continue
        old, new = raw.decode("utf-8", "replace").splitlines(), files.get(name, "").splitlines()
        label = f"{folder.name}/{name}"
        parts += difflib.unified_diff(old, new, f"on disk: {label}", f"generated now: {label}", lineterm="", n=1)
        if old == new:
            parts.append(f"{label}: line endings differ")
    return "\n".join(parts)


def write_folder(folder: Path, files: dict[str, str], force: bool = False) -> None:
    """Write all files to a temporary sibling, then swap it in.

    Raises
    ------
    FolderError
        If ``folder`` holds something that is not ours, was edited by hand (unless ``force``), or cannot be written.
    """
    if folder.exists() and not force:
        if not folder.is_dir() or (any(folder.iterdir()) and not (folder / MANIFEST).is_file()):
            raise FolderError(f"'{folder}' exists and was not generated; choose another --out or remove it.")
        if (folder / MANIFEST).is_file():
            check_unedited(folder)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        fresh = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    except OSError as error:
        raise FolderError(f"cannot write to '{folder.parent}': {error.strerror or error}") from None
    try:
        for name, text in files.items():
            (fresh / name).parent.mkdir(parents=True, exist_ok=True)
            (fresh / name).write_bytes(text.encode())
        fresh.chmod(0o755)
        _swap(fresh, folder)
    except OSError as error:
        raise FolderError(f"cannot write '{folder}': {error.strerror or error}; it is left as it was.") from None
    finally:
        shutil.rmtree(fresh, ignore_errors=True)


def _swap(fresh: Path, folder: Path) -> None:
    """Put ``fresh`` in the place of ``folder``; the old one is removed only once the new one is there."""
    if not folder.exists():
        fresh.rename(folder)
        return
    aside = Path(tempfile.mkdtemp(prefix=f".{folder.name}.old.", dir=folder.parent))
    try:
        folder.rename(aside / folder.name)
        try:
            os.rename(fresh, folder)
        except OSError:
            (aside / folder.name).rename(folder)
            raise
    finally:
        if folder.exists():  # whichever it is, it is whole
            shutil.rmtree(aside, ignore_errors=True)
