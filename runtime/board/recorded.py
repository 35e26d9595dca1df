"""Recorded data written row by row, as ``record`` does, so that a crash loses nothing."""

from __future__ import annotations

import os
from pathlib import Path
from typing import BinaryIO

import numpy as np

from runtime.recorded.data import check_suffix
from runtime.system.errors import UserError
from runtime.system.files import whole_file


class RecordFile:
    """Rows appended to a .csv, or to a .npz by way of ``<name>.part``, a NumPy array file that is whole at any time.

    After a crash ``numpy.load("<name>.part")`` gives the rows up to the last flush, as columns by name.
    """

    def __init__(self, path: Path, names: tuple[str, ...]) -> None:
        check_suffix(path)
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
            with whole_file(self.path) as file:
                np.savez(file, allow_pickle=False, **{name: columns[name] for name in self.names})
            del columns
            self._on_disk.unlink()

    def _header(self) -> None:
        """NumPy leaves room in it for the number of rows to grow."""
        self._file.seek(0)
        description = {"descr": self.kind.descr, "fortran_order": False, "shape": (self.rows,)}
        np.lib.format.write_array_header_1_0(self._file, description)
