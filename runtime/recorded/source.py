"""The columns of a file before anybody has said what they are: what every format is read into."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from runtime.system.errors import UserError

Array = NDArray[Any]


@dataclass(frozen=True)
class Source:
    """A file's columns.

    ``names`` are without their units, ``written`` as they stand in the file, ``units`` as written beside them, "" where
    there is none. ``load`` reads columns by their numbers, float64 (N,). ``notes`` say what the format itself made of
    them; ``hint`` is what to say where a column is missing.
    """

    path: Path
    names: tuple[str, ...]
    units: tuple[str, ...]
    load: Callable[[Sequence[int]], list[Array]]
    written: tuple[str, ...] = ()
    notes: list[str] = field(default_factory=list)
    hint: str = ""

    def find(self, name: str) -> list[int]:
        """Find the columns a name may mean: as written in the file, else without its unit, else ``#3`` the third.

        Parameters
        ----------
        name : str
        """
        for names in (self.written, self.names):
            found = [k for k, one in enumerate(names) if one == name]
            if found:
                return found
        number = int(name[1:]) if name[:1] == "#" and name[1:].isdecimal() and len(name) < 8 else 0
        return [number - 1] if 1 <= number <= len(self.names) else []

    @property
    def listed(self) -> str:
        """The names, for a message."""
        names = [name[:40] for name in self.names if name]
        return ", ".join(names[:20]) + (", ..." if len(names) > 20 else "") if names else "no column"


def checked_column(path: Path, name: str, values: Array) -> Array:
    """Take an array for a column of numbers.

    Parameters
    ----------
    path : Path
    name : str
    values : ndarray

    Returns
    -------
    ndarray, (N,)
        float64.

    Raises
    ------
    UserError
        Another shape, or no numbers.
    """
    if values.ndim != 1 or values.dtype.kind not in "fiub":
        raise UserError(f"'{path}': {name} has shape {values.shape} and type {values.dtype}; a column is numbers (N,).")
    return values.astype(float, copy=False)


def check_lengths(path: Path, columns: Sequence[tuple[str, Array]]) -> None:
    """Refuse columns of different lengths.

    Parameters
    ----------
    path : Path
    columns : sequence of (str, ndarray)

    Raises
    ------
    UserError
    """
    if len({len(values) for _, values in columns}) > 1:
        said = ", ".join(f"{name} {len(values)}" for name, values in columns)
        raise UserError(f"'{path}': the columns have different lengths: {said}.")


def unreadable(path: Path, error: Exception) -> UserError:
    """Say that a library could not read a file.

    Parameters
    ----------
    path : Path
    error : Exception
    """
    said = (isinstance(error, OSError) and error.strerror) or str(error)
    said = " ".join(said.split())[:200] or type(error).__name__
    return UserError(f"'{path}' cannot be read as recorded data: {said}")
