"""The formats of recorded data: one line each says which file is whose."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from runtime.recorded.mat import read_mat
from runtime.recorded.mdf import read_mdf
from runtime.recorded.npz import read_npz
from runtime.recorded.source import Source
from runtime.recorded.text import read_text

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
    reader = FORMATS.get(path.suffix.lower())
    if reader is None:
        try:
            with path.open("rb") as file:
                begin = file.read(32)
        except OSError:
            begin = b""  # the reader of text says why
        reader = next((one for mark, one in FIRST_BYTES.items() if begin.startswith(mark)), read_text)
    return reader(path)
