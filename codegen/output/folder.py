"""The generated folder: manifest, hashes, drift check, and an exchange that leaves no half-written state."""

from __future__ import annotations

import ctypes
import difflib
import errno
import fcntl
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

MANIFEST = "manifest.json"


class FolderError(RuntimeError):
    """A generated folder that must not be used or overwritten; one line, what and where."""


def digest(text: str) -> str:
    """Return the SHA-256 of a text, as the manifest has it."""
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
        for entry in manifest["files"].values():
            entry["sha256"]
    except FileNotFoundError:
        raise FolderError(f"'{folder}' is not a generated folder: no {MANIFEST} in it.") from None
    except (OSError, ValueError, RecursionError) as error:
        raise FolderError(f"'{folder / MANIFEST}' cannot be read: {error}") from None
    except (AttributeError, KeyError, TypeError):
        raise FolderError(f"'{folder / MANIFEST}' is no manifest: it does not list files with sha256.") from None
    return manifest


def edited_files(folder: Path) -> list[str]:
    """Files that are no longer what the manifest says: changed, missing or added."""
    with _lock(folder.parent, fcntl.LOCK_SH):
        return _edited_files(folder)


def _edited_files(folder: Path) -> list[str]:
    listed = read_manifest(folder)["files"]
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
    _refuse(folder, edited_files(folder))


def _refuse(folder: Path, edited: list[str]) -> None:
    if edited:
        raise FolderError(
            f"'{folder / edited[0]}' was edited by hand (it differs from {MANIFEST}). "
            "Put the change into the drive file and regenerate, or overwrite it with: pmsm-ickf generate --force."
        )


def difference(folder: Path, files: dict[str, str]) -> str:
    """Unified diff from what is on disk to ``files``; empty if they are byte-identical."""
    with _lock(folder.parent, fcntl.LOCK_SH):
        return _difference(folder, files)


def _difference(folder: Path, files: dict[str, str]) -> str:
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
    """Write all files to a temporary sibling, then exchange the two in one step of the file system.

    Whoever else writes to the same place waits; what a killed one left behind is removed.

    Raises
    ------
    FolderError
        If ``folder`` holds something that is not ours, was edited by hand (unless ``force``), or cannot be written.
    """
    place = Path(os.path.realpath(folder))  # a link stays a link
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FolderError(f"cannot write to '{folder.parent}': {error.strerror or error}") from None
    with _lock(place.parent, fcntl.LOCK_EX) as alone:
        if place.exists() and not force:
            if not place.is_dir() or (any(place.iterdir()) and not (place / MANIFEST).is_file()):
                raise FolderError(f"'{folder}' exists and was not generated; choose another --out or remove it.")
            if (place / MANIFEST).is_file():
                _refuse(folder, _edited_files(place))
        try:
            _replace(place, files, alone)
        except OSError as error:
            raise FolderError(f"cannot write '{folder}': {error.strerror or error}; it is left as it was.") from None


def _replace(folder: Path, files: dict[str, str], alone: bool) -> None:
    """Put ``files`` in the place of what ``folder`` holds; ``alone``: nobody else is writing here."""
    prefix = f".{folder.name}.writing-"
    if alone:
        for left in folder.parent.iterdir():
            if left.name.startswith(prefix):
                shutil.rmtree(left, ignore_errors=True)
    scratch = Path(tempfile.mkdtemp(prefix=prefix, dir=folder.parent))
    fresh = scratch / folder.name
    try:
        for name, text in files.items():
            (fresh / name).parent.mkdir(parents=True, exist_ok=True)
            (fresh / name).write_bytes(text.encode())
        fresh.chmod(0o755)
        _swap(fresh, folder)
    finally:
        if folder.exists() or not _aside(fresh).exists():  # never the only whole one
            shutil.rmtree(scratch, ignore_errors=True)


def _swap(fresh: Path, folder: Path) -> None:
    """Put ``fresh`` in the place of ``folder``, and ``folder`` in that of ``fresh`` or beside it."""
    if not folder.exists():
        os.rename(fresh, folder)
    elif not _exchange(fresh, folder):
        os.rename(folder, _aside(fresh))
        try:
            os.rename(fresh, folder)
        except BaseException:
            os.rename(_aside(fresh), folder)
            raise


def _aside(fresh: Path) -> Path:
    """Where the old folder waits while the new one takes its place."""
    return fresh.with_name(f"{fresh.name}.old")


def _exchange(one: Path, other: Path) -> bool:
    """Exchange two folders atomically; False where the system cannot (renameat2 is Linux's)."""
    renameat2 = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    if renameat2 is None:
        return False
    here, exchange = -100, 2  # AT_FDCWD, RENAME_EXCHANGE
    if renameat2(here, os.fsencode(one), here, os.fsencode(other), exchange) == 0:
        return True
    code = ctypes.get_errno()
    if code in {errno.ENOSYS, errno.EINVAL, errno.ENOTSUP}:
        return False
    raise OSError(code, os.strerror(code))


@contextmanager
def _lock(parent: Path, how: int) -> Iterator[bool]:
    """Wait for others that read (LOCK_EX) or write folders in ``parent``; the kernel lets go of a killed one's lock.

    False where there is nothing to lock, or a file system that cannot.
    """
    try:
        handle = os.open(parent, os.O_RDONLY)
    except OSError:
        yield False
        return
    try:
        try:
            fcntl.flock(handle, how)
            locked = True
        except OSError:
            locked = False
        yield locked
    finally:
        os.close(handle)
