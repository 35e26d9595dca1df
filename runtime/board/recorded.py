"""Recorded data on disk: read for ``pil --data``, written row by row by ``record`` so that a crash loses nothing.

Columns: t s; u_alpha, u_beta V, mean over the interval ending at t; i_alpha, i_beta A at t; optional truth.
"""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from runtime.errors import UserError

Array = NDArray[Any]

INPUTS = ("u_alpha", "u_beta", "i_alpha", "i_beta")


def read_inputs(path: Path) -> tuple[Array, Array]:
    """u (N, 2) V and y (N, 2) A of recorded data, .npz or .csv with a header.

    Raises
    ------
    UserError
        If the file cannot be read, lacks a column, or its columns are empty or not numbers.
    """
    try:
        if path.suffix == ".npz":
            with np.load(path, allow_pickle=False) as file:
                columns = {name: np.asarray(file[name], dtype=float) for name in INPUTS if name in file}
        else:
            with path.open(encoding="utf-8") as text, warnings.catch_warnings(action="ignore"):
                names = [name.strip() for name in text.readline().split(",")]
                table = np.loadtxt(text, delimiter=",", ndmin=2)
            columns = {name: table[:, names.index(name)] for name in INPUTS if name in names and table.size}
    except (OSError, ValueError) as error:
        raise UserError(f"'{path}' cannot be read as recorded data: {error}") from None
    missing = [name for name in INPUTS if name not in columns]
    if missing:
        raise UserError(f"'{path}' lacks the column {', '.join(missing)}; recorded data has t, {', '.join(INPUTS)}.")
    rows = np.column_stack([columns[name] for name in INPUTS])
    if not len(rows):
        raise UserError(f"'{path}' holds no samples.")
    return rows[:, :2], rows[:, 2:]


class RecordFile:
    """Rows appended to a .csv, or to a .npz by way of ``<name>.part``, a NumPy array file that is whole at any time.

    After a crash ``numpy.load("<name>.part")`` gives the rows up to the last flush, as columns by name.
    """

    def __init__(self, path: Path, names: tuple[str, ...]) -> None:
        if path.suffix not in {".npz", ".csv"}:
            raise UserError(f"'{path}': recorded data is .npz or .csv.")
        self.path, self.names, self.rows = path, names, 0
        self.kind = np.dtype([(name, "<f8") for name in names])
        self._on_disk = path if path.suffix == ".csv" else path.with_name(path.name + ".part")
        if self._on_disk != path and self._on_disk.exists():
            raise UserError(
                f"'{self._on_disk}' is left from a recording that did not end well: keep it (numpy.load reads it), "
                "then move it away."
            )
        try:
            self._file: BinaryIO = self._on_disk.open("wb")
        except OSError as error:
            raise UserError(f"cannot write '{self._on_disk}': {error.strerror}.") from None
        if path.suffix == ".csv":
            self._file.write((",".join(names) + "\n").encode())
        else:
            self._header()

    def append(self, rows: list[tuple[float, ...]]) -> None:
        """Add rows and put them on the disk."""
        if not rows:
            return
        try:
            self._write(rows)
        except OSError as error:
            raise UserError(f"cannot write '{self._on_disk}': {error.strerror}; what came before is kept.") from None

    def _write(self, rows: list[tuple[float, ...]]) -> None:
        self._file.seek(0, os.SEEK_END)
        if self.path.suffix == ".csv":
            self._file.write("".join(",".join(f"{value:.12g}" for value in row) + "\n" for row in rows).encode())
        else:
            self._file.write(np.array(rows, dtype=self.kind).tobytes())
            self._file.flush()
        self.rows += len(rows)
        if self.path.suffix == ".npz":
            self._header()  # after the rows: it never promises more than there is
        self._file.flush()
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Finish: the .npz is made column by column from the part file, which then goes."""
        self._file.close()
        if self.path.suffix == ".npz":
            columns = np.load(self._on_disk, mmap_mode="r") if self.rows else np.empty(0, dtype=self.kind)
            np.savez(self.path, allow_pickle=False, **{name: columns[name] for name in self.names})
            del columns
            self._on_disk.unlink()

    def _header(self) -> None:
        """NumPy leaves room in it for the number of rows to grow."""
        self._file.seek(0)
        description = {"descr": self.kind.descr, "fortran_order": False, "shape": (self.rows,)}
        np.lib.format.write_array_header_1_0(self._file, description)
