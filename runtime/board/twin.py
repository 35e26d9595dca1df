"""The host's own execution of the filter on the board, started from any state the board reports."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.board.board import Words
from runtime.estimator.c_backend import CBackend
from runtime.estimator.estimator import load_folder
from runtime.estimator.folder import GeneratedFolder

Array = NDArray[Any]


class Twin:
    """One filter on the host. Its state words are x, the struct's covariance words as they are, and u_held."""

    def __init__(self, folder: GeneratedFolder, kind: str, backend: str, dtype: str) -> None:
        self.estimator = load_folder(folder, kind, backend, dtype)
        self.dtype = np.dtype(dtype)
        self.names = self.estimator.state_names
        self.word_names = word_names(self.names, covariance_field(folder))

    @property
    def words(self) -> Array:
        """State words, as the board tells them."""
        x, P = self.estimator.backend.state()
        return np.concatenate([x, P, np.array(list(self._struct.u_held), dtype=self.dtype)])

    @words.setter
    def words(self, words: Array) -> None:
        n, words = len(self.names), words.astype(self.dtype)
        self.estimator.backend.reset(words[:n].copy(), words[n:-2].copy())
        self._struct.u_held = tuple(words[-2:])

    @property
    def P(self) -> Array:
        """The covariance itself, (n, n)."""
        return self.estimator.P

    def step(self, u: Words, y: Words) -> tuple[Array, int, int]:
        """State words after the step, status, iterations.

        Parameters
        ----------
        u : Words
            Voltage, V, (2,).
        y : Words
            Currents, A, (2,).
        """
        self.estimator.step(u, y)
        return self.words, int(self.estimator.status), int(self.estimator.iterations)

    def covariance(self, words: Array) -> Array:
        """The matrix that state words stand for, (n, n).

        Parameters
        ----------
        words : ndarray
            Words of the struct.
        """
        kept = self.words
        self.words = words
        matrix = self.P
        self.words = kept
        return matrix

    @property
    def _struct(self) -> Any:
        backend = self.estimator.backend
        return backend.filters[0] if isinstance(backend, CBackend) else backend.filter  # type: ignore[attr-defined]


def covariance_field(folder: GeneratedFolder) -> str:
    """The struct's field of covariance words, whatever they hold."""
    return str(getattr(folder.module, "COVARIANCE", "P"))


def word_names(states: tuple[str, ...], covariance: str) -> list[str]:
    """A name for every state word; ``covariance`` is the struct's field that carries P.

    Parameters
    ----------
    states : tuple of str
        The states.
    covariance : str
        The field that carries P: "P" or "LD".

    Examples
    --------
    >>> word_names(("i", "w"), "P")
    ['i', 'w', 'P_00', 'P_10', 'P_11', 'u_held_alpha', 'u_held_beta']
    """
    n = len(states)
    words = [f"{covariance}_{i}{j}" for i in range(n) for j in range(i + 1)]
    return [*states, *words, "u_held_alpha", "u_held_beta"]
