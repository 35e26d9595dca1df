"""MATLAB's .mat files, to version 7 by SciPy and 7.3 by h5py: vectors, columns of matrices, fields of structures.

A Simulink "structure with time" gives its signals by their labels. Objects (timeseries, Dataset) are MATLAB's alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from runtime.recorded.source import Array, Source, check_lengths, checked_column, unreadable
from runtime.system.errors import UserError

#: A matrix of more columns than this holds no signals.
MOST_COLUMNS = 64
#: What version 7.3 begins with after its 512 bytes of text.
_HDF5 = b"\x89HDF\r\n\x1a\n"


def read_mat(path: Path) -> Source:
    """Read the columns of a .mat file.

    Parameters
    ----------
    path : Path

    Raises
    ------
    UserError
        A missing library, a damaged file, or one that holds objects alone.
    """
    try:
        with path.open("rb") as file:
            begin = file.read(520)
    except OSError as error:
        raise UserError(f"'{path}' cannot be read as recorded data: {error.strerror}.") from None
    read = _version_73 if _HDF5 in (begin[:8], begin[512:520]) else _version_5
    with np.errstate(all="ignore"):
        try:
            columns = list(read(path))
        except (UserError, KeyboardInterrupt):
            raise
        except Exception as error:  # SciPy and h5py have many
            raise unreadable(path, error) from None
    if not columns:
        raise UserError(
            f"'{path}' holds no vectors of numbers. Objects such as timeseries or Dataset are MATLAB's alone: log as "
            "'Structure with time' or 'Array', or save the vectors t, u_a, ..."
        )
    names = tuple(name for name, _ in columns)

    def load(chosen: Sequence[int]) -> list[Array]:
        picked = [(names[k], checked_column(path, *columns[k])) for k in chosen]
        check_lengths(path, picked)
        return [values for _, values in picked]

    return Source(path, names, ("",) * len(names), load, names)


def _version_5(path: Path) -> Iterator[tuple[str, Array]]:
    try:
        from scipy.io import loadmat
    except ImportError:
        raise _lacking("scipy") from None
    for name, value in loadmat(path, chars_as_strings=True).items():
        if not name.startswith("__"):
            yield from _columns(name, value)


def _columns(name: str, value: Any) -> Iterator[tuple[str, Array]]:
    """Columns of a variable: a structure field by field, a matrix column by column."""
    if not isinstance(value, np.ndarray):
        return
    fields = value.dtype.names
    if fields and value.size == 1:
        if {"time", "signals"} <= set(fields):
            yield from _structure_with_time(name, value.flat[0])
            return
        for field in fields:
            yield from _columns(f"{name}.{field}", value.flat[0][field])
    elif not fields:
        yield from _vectors(name, value)


def _structure_with_time(name: str, value: Any) -> Iterator[tuple[str, Array]]:
    yield from _vectors(f"{name}.time", value["time"])
    signals = value["signals"]
    for number, signal in enumerate(signals.flat, 1):
        label = signal["label"] if "label" in (signals.dtype.names or ()) else ""
        label = str(np.asarray(label).flat[0]) if np.size(label) else ""
        yield from _vectors(label or f"{name}.signals{number if signals.size > 1 else ''}", signal["values"])


def _vectors(name: str, value: Array) -> Iterator[tuple[str, Array]]:
    """A vector by its name; a matrix (N, k) as name:1 .. name:k. A single number is a setting, no signal."""
    value = np.squeeze(np.asarray(value))
    if value.dtype.kind not in "fiub" or value.ndim not in {1, 2}:
        return
    if value.ndim == 1:
        yield name, value
    elif value.shape[1] <= MOST_COLUMNS:
        for k in range(value.shape[1]):
            yield f"{name}:{k + 1}", value[:, k]


def _version_73(path: Path) -> Iterator[tuple[str, Array]]:
    try:
        import h5py
    except ImportError:
        raise _lacking("h5py") from None
    found: list[tuple[str, Array]] = []

    def take(name: str, item: Any) -> None:
        numbers = isinstance(item, h5py.Dataset) and item.dtype.kind in "fiub"
        words = item.attrs.get("MATLAB_class", b"double") in (b"char", b"cell", b"struct")
        empty = "MATLAB_empty" in item.attrs
        if numbers and not words and not empty and not name.startswith("#"):
            found.extend(_vectors(name.replace("/", "."), np.asarray(item[()]).T))

    with h5py.File(path, "r") as file:
        file.visititems(take)
    yield from found


def _lacking(library: str) -> UserError:
    return UserError(f"this .mat file needs {library}: pip install 'pmsm-ickf[mat]'.")
