"""The covariances of a long run, worked out again where somebody asks for them: they are most of its memory."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.estimator.estimator import Backend
from runtime.recorded.clock import Clock

Array = NDArray[Any]

#: Covariance words of a run are kept up to so many bytes.
KEPT = 64 << 20


class Inputs:
    """Recorded voltages and currents on the filter's steps, a stretch at a time; a missing row is NaN, and rejected.

    Parameters
    ----------
    u, y : ndarray, (N, 2)
        V, A.
    clock : Clock
    dtype : numpy.dtype
        The filter's.
    """

    def __init__(self, u: Array, y: Array, clock: Clock, dtype: np.dtype[Any]) -> None:
        self._u, self._y, self._at, self._dtype = u, y, clock.steps, dtype
        self.rows, self.steps = len(u), clock.count

    def of(self, first: int, last: int) -> tuple[Array, Array]:
        """Give u and y (., 2) of the steps first .. last - 1.

        Parameters
        ----------
        first, last : int
        """
        rows, steps = self.places(first, last)
        if self._at is None:
            return self._u[rows].astype(self._dtype), self._y[rows].astype(self._dtype)
        filled = np.full((2, last - first, 2), np.nan, dtype=self._dtype)
        filled[0, steps], filled[1, steps] = self._u[rows], self._y[rows]
        return filled[0], filled[1]

    def places(self, first: int, last: int) -> tuple[slice, slice | Array]:
        """Find the rows of some steps, and their places among these.

        Parameters
        ----------
        first, last : int
        """
        if self._at is None:
            return slice(first, last), slice(None)
        rows = slice(*(int(k) for k in np.searchsorted(self._at, (first, last))))
        return rows, self._at[rows] - first


class Words:
    """Covariance words (N, n(n+1)/2) of a run, by rows; a long run keeps where each chunk began and runs it again.

    Parameters
    ----------
    backend : Backend
        That ran; it is at the end of the run.
    inputs : Inputs
    chunk : int
        Steps in each.
    """

    def __init__(self, backend: Backend, inputs: Inputs, chunk: int) -> None:
        self._backend, self._inputs, self._chunk = backend, inputs, chunk
        self._marks: list[Any] = []
        self._kept: dict[int, Array] = {}
        self._again: tuple[int, Array] | None = None
        self._bytes = 0

    def mark(self) -> None:
        """Remember that a chunk begins here."""
        self._marks.append(self._backend.snapshot())

    def keep(self, words: Array) -> None:
        """Take the words of the chunk that ended, unless they are too many.

        Parameters
        ----------
        words : ndarray
            Of every step of it.
        """
        self._bytes += words.nbytes
        if self._bytes <= KEPT:
            self._kept[len(self._marks) - 1] = words

    def __len__(self) -> int:
        return self._inputs.rows

    def __getitem__(self, rows: slice | Array) -> Array:
        numbers = np.arange(*rows.indices(len(self))) if isinstance(rows, slice) else np.asarray(rows)
        found: Array | None = None
        for chunk in range(len(self._marks)):
            first, last = chunk * self._chunk, min((chunk + 1) * self._chunk, self._inputs.steps)
            own, steps = self._inputs.places(first, last)
            here = (numbers >= own.start) & (numbers < min(own.stop, len(self)))
            if not here.any():
                continue
            words = self._of_chunk(chunk, first, last)[steps]
            if found is None:
                found = np.empty((len(numbers), words.shape[1]), dtype=words.dtype)
            found[here] = words[numbers[here] - own.start]
        return np.empty((0, 0)) if found is None else found

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        return np.asarray(self[:], dtype=dtype)

    def _of_chunk(self, chunk: int, first: int, last: int) -> Array:
        if chunk in self._kept:
            return self._kept[chunk]
        if self._again is None or self._again[0] != chunk:
            end = self._backend.snapshot()
            self._backend.restore(self._marks[chunk])
            self._again = chunk, self._backend.run(*self._inputs.of(first, last))[1]
            self._backend.restore(end)
        return self._again[1]
