"""The formats of recorded data: one line each says which file is whose."""

from __future__ import annotations

import stat
from collections.abc import Callable
from pathlib import Path

from runtime.recorded.mat import read_mat
from runtime.recorded.mdf import read_mdf
from runtime.recorded.npz import read_npz
from runtime.recorded.source import Source
from runtime.recorded.text import read_text
from runtime.system.errors import UserError

#: By suffix. Any other file is told by its first bytes, and is text if these say nothing.
FORMATS: dict[str, Callable[[Path], Source]] = {
    ".npz": read_npz,
    ".mat": read_mat,
    ".mf4": read_mdf,
    ".mdf": read_mdf,
}
FIRST_BYTES: dict[bytes, Callable[[Path], Source]] = {
    b"PK\x03\x04": read_npz,
    b"MDF     ": read_mdf,
    b"UnFinMF ": read_mdf,
    b"MATLAB 5.0 MAT-file": read_mat,
    b"MATLAB 7.3 MAT-file": read_mat,
    b"\x89HDF\r\n": read_mat,
}


def read_source(path: Path) -> Source:
    """Open a recording of any format: its columns, before they are understood.

    Parameters
    ----------
    path : Path

    Raises
    ------
    UserError
        A file that cannot be read, or a library that is missing.
    """
    _check_file(path)
    reader = FORMATS.get(path.suffix.lower())
    if reader is None:
        try:
            with path.open("rb") as file:
                begin = file.read(32)
        except OSError:
            begin = b""  # the reader of text says why
        reader = next((one for mark, one in FIRST_BYTES.items() if begin.startswith(mark)), read_text)
    return reader(path)


def _check_file(path: Path) -> None:
    """Refuse a pipe, which would be waited for, or be empty when its numbers are read after its header."""
    try:
        mode = path.stat().st_mode
    except OSError:
        return  # the reader says why
    if stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode):
        raise UserError(f"'{path}' is a pipe, and recorded data is read more than once: write it to a file.")
