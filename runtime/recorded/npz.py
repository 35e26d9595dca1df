"""NumPy's .npz: an array a column. A column is read when it is asked for."""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from runtime.recorded.source import Array, Source, check_lengths, checked_column, unreadable


def read_npz(path: Path) -> Source:
    """Read the names of an archive's arrays.

    Parameters
    ----------
    path : Path

    Raises
    ------
    UserError
        If it is no such archive.
    """
    try:
        with path.open("rb") as raw:
            if not zipfile.is_zipfile(raw):  # of which NumPy says that it is pickled, and how to unpickle it
                raise ValueError("it is no archive of arrays, as numpy.savez writes one.")
        with np.load(path, allow_pickle=False) as file:
            names = tuple(file.files)
    except Exception as error:  # zipfile and zlib have their own, for a damaged archive
        raise unreadable(path, error) from None

    def load(chosen: Sequence[int]) -> list[Array]:
        columns = []
        try:
            with np.load(path, allow_pickle=False) as file:
                for k in chosen:
                    columns.append((names[k], np.asarray(file[names[k]])))
        except Exception as error:
            raise unreadable(path, error) from None
        columns = [(name, checked_column(path, name, values)) for name, values in columns]
        check_lengths(path, columns)
        return [values for _, values in columns]

    return Source(path, names, ("",) * len(names), load, names)
