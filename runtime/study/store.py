"""A study on disk: its statement, and one file a finished chunk. Whatever interrupts it, a file is whole or absent."""

from __future__ import annotations

import json
import os
import tempfile
import threading
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from runtime.drive.fleet import Outcomes
from runtime.study.statement import Statement, differences
from runtime.system.errors import UserError

STATEMENT = "study.json"

#: Runs in a file: a fraction of a second of work, and enough for many threads.
CHUNK = 512

_COLUMNS = tuple(f.name for f in fields(Outcomes))


@dataclass(frozen=True)
class Chunk:
    """Runs first .. first + count - 1 of subject number ``subject``."""

    subject: int
    first: int
    count: int


def chunks(statement: Statement, runs: int) -> list[Chunk]:
    """List all chunks of a study in the order they are run: the filters take turns, so that runs can be paired.

    Parameters
    ----------
    statement : Statement
    runs : int
    """
    starts = range(0, runs, CHUNK)
    subjects = range(len(statement.subjects))
    return [Chunk(subject, first, min(CHUNK, runs - first)) for first in starts for subject in subjects]


class Store:
    """The folder of one study.

    Raises
    ------
    UserError
        If the folder holds another study, or cannot be written.
    """

    def __init__(self, folder: Path, statement: Statement) -> None:
        self.folder, self.statement = folder, statement
        facts = {**statement.facts(), "digest": statement.digest}
        path = folder / STATEMENT
        try:
            if path.exists():
                self._check(json.loads(path.read_text(encoding="utf-8")), facts)
        except (OSError, ValueError) as error:
            raise UserError(f"'{path}' cannot be used: {error}. Choose another --out.") from None

    def _begin(self) -> None:
        """Make the folder, and say in it which study it holds: with the first chunk, for before it a study can fail."""
        path = self.folder / STATEMENT
        facts = {**self.statement.facts(), "digest": self.statement.digest}
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            if not path.exists():
                write_atomically(path, (json.dumps(facts, indent=2) + "\n").encode())
        except OSError as error:
            raise UserError(f"'{path}' cannot be used: {error}. Choose another --out.") from None

    def _check(self, found: dict[str, Any], wanted: dict[str, Any]) -> None:
        if found.get("digest") != wanted["digest"]:
            raise UserError(
                f"'{self.folder}' holds another study ({differences(wanted, found)}). "
                "Choose another --out, or repeat its command to go on with it."
            )

    def _path(self, chunk: Chunk) -> Path:
        drive, kind = self.statement.subjects[chunk.subject]
        return self.folder / "runs" / f"{drive}_{kind}_{chunk.first:08d}_{chunk.count}.npz"

    def load(self, chunk: Chunk) -> Outcomes | None:
        """Load a chunk's outcomes; None if it was not run, or its file is damaged.

        Parameters
        ----------
        chunk : Chunk
        """
        try:
            with np.load(self._path(chunk), allow_pickle=False) as data:
                columns = {name: data[name] for name in _COLUMNS}
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return None
        return Outcomes(**columns) if all(len(c) == chunk.count for c in columns.values()) else None

    def save(self, chunk: Chunk, outcomes: Outcomes) -> None:
        """Write a chunk, whole or not at all.

        Parameters
        ----------
        chunk : Chunk
        outcomes : Outcomes
        """
        self._begin()
        path = self._path(chunk)
        path.parent.mkdir(exist_ok=True)
        with tempfile.TemporaryFile() as scratch:
            np.savez(scratch, allow_pickle=False, **outcomes.columns())
            scratch.seek(0)
            write_atomically(path, scratch.read())

    def missing(self, runs: int) -> Iterator[Chunk]:
        """Yield the chunks that are not there.

        Parameters
        ----------
        runs : int
        """
        return (chunk for chunk in chunks(self.statement, runs) if self.load(chunk) is None)


def write_atomically(path: Path, raw: bytes) -> None:
    """Write into a neighbour first, then rename: readers and crashes see the old file or the new one.

    Parameters
    ----------
    path : Path
    raw : bytes

    Raises
    ------
    UserError
        If it cannot be written; what was at ``path`` is still there.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}.{threading.get_ident()}")
    try:
        with part.open("wb") as file:
            file.write(raw)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)
    except OSError as error:
        raise UserError(f"cannot write '{path}': {error.strerror or error}.") from None
    finally:
        part.unlink(missing_ok=True)
