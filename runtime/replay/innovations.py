"""The innovations of a filter at each step and the variances it expected of them; for all steps of a run at once.

Every step starts from a recorded x and P, so the steps are independent of each other once the run is over: a thousand
steps are a thousand lanes. Their time update is the generated filter's own: a step whose measurement is rejected leaves
the pure prediction, in the bits of the run.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.estimator.numpy_backend import NumpyBackend

Array = NDArray[Any]

#: Steps taken at once: their arrays stay in the processor's cache.
BLOCK = 8192


@dataclass(frozen=True)
class Innovations:
    """Innovations of a run and their covariance.

    nu (N, 2) A: y minus its expected value; S (N, 3) A^2: S_00, S_10, S_11 of its covariance, R included.
    NaN where a measurement was rejected.
    """

    nu: Array
    S: Array

    def whitened(self, rows: slice = slice(None)) -> Array:
        """C^-1 nu (., 2) with C C^T = S: of unit variance and white, if the filter is right.

        Parameters
        ----------
        rows : slice
            Default: all.
        """
        nu, S = self.nu[rows].astype(float), self.S[rows].astype(float)
        c_00 = np.sqrt(S[:, 0])
        c_10 = S[:, 1] / c_00
        c_11 = np.sqrt(S[:, 2] - c_10**2)
        z_0 = nu[:, 0] / c_00
        return np.column_stack([z_0, (nu[:, 1] - c_10 * z_0) / c_11])

    def squared(self) -> Array:
        """Normalised innovation squared (N,), block by block."""
        blocks = (self.whitened(slice(first, first + BLOCK)) for first in range(0, len(self.nu), BLOCK))
        return np.concatenate([np.empty(0), *(block[:, 0] ** 2 + block[:, 1] ** 2 for block in blocks)])


def within(pairs: Array, limit: float) -> Array:
    """Say which rows a filter accepts: both within the limit, and numbers.

    Parameters
    ----------
    pairs : ndarray, (N, 2)
    limit : float
    """
    first, second = np.abs(pairs).T
    return np.asarray((first <= limit) & (second <= limit))


def held_inputs(u: Array, u_max: float, before: Array | None = None) -> Array:
    """Return the inputs as the filter takes them: a rejected row holds the last good one, at first zero.

    Parameters
    ----------
    u : ndarray, (N, 2)
        Voltages, V.
    u_max : float
        Limit of each, V.
    before : ndarray, (2,), optional
        The last good one before these rows.
    """
    good = within(u, u_max)
    if good.all():
        return u
    last = np.maximum.accumulate(np.where(good, np.arange(len(u)), -1))
    return np.where(last[:, None] >= 0, u[last], u.dtype.type(0) if before is None else before)


class Expectations:
    """What a filter expected of the measurements of a run, mean and covariance by the cubature rule (eq. 19-22).

    Parameters
    ----------
    module : the generated Python module
    kind, dtype : str
        The filter that ran.
    """

    def __init__(self, module: ModuleType, kind: str, dtype: str) -> None:
        self._module = module
        self._predictor = NumpyBackend(module, kind, dtype)
        self._held = np.zeros(2, dtype=dtype)

    def innovations(self, u: Array, y: Array, x: Array, words: Array) -> Innovations:
        """Work out the next rows of the run.

        Parameters
        ----------
        u, y : (N, 2) V, A
            What it was given.
        x, words : (N, n), (N, n(n+1)/2)
            Its states and covariance words before each step.
        """
        limits = self._module.DEFAULTS
        accepted = within(u, limits["u_max"]) & within(y, limits["y_max"])
        inputs = held_inputs(u, limits["u_max"], self._held)
        self._held = inputs[-1]
        nu, S = np.empty((len(u), 2), dtype=u.dtype), np.empty((len(u), 3), dtype=u.dtype)
        for first in range(0, len(u), BLOCK):
            rows = slice(first, min(first + BLOCK, len(u)))
            x_pred, words_pred = _predicted(self._predictor, inputs[rows], x[rows], words[rows])
            y_pred, S[rows] = _expected(self._module, x_pred, words_pred)
            nu[rows] = y[rows] - y_pred
        if not accepted.all():
            nu[~accepted], S[~accepted] = np.nan, np.nan
        return Innovations(nu, S)


def _predicted(predictor: NumpyBackend, u: Array, x: Array, words: Array) -> tuple[Array, Array]:
    """x_pred (n, B) and the words of P_pred (., B) in float64, from x (B, n) and covariance words (B, .)."""
    predictor.reset(np.ascontiguousarray(x.T), np.ascontiguousarray(words.T))
    predictor.step(np.ascontiguousarray(u.T), np.full((2, len(u)), np.nan, dtype=u.dtype))
    x_pred, words_pred = predictor.state()
    return x_pred.astype(float), words_pred.astype(float)


def _expected(module: ModuleType, x_pred: Array, words_pred: Array) -> tuple[Array, Array]:
    """y_pred (B, 2) and S (B, 3): h over the 2n points of the cubature rule, lane by lane."""
    n = len(x_pred)
    reach = np.sqrt(n) * _roots(module, words_pred)  # [state, column, lane]
    images = np.empty((2 * n, 2, x_pred.shape[1]))
    for column in range(n):
        for k, sign in enumerate((1.0, -1.0)):
            point = tuple(x_pred + sign * reach[:, column])
            images[2 * column + k] = module.believed_currents(point, module.Float64)
    y_pred = images.mean(axis=0)
    d = images - y_pred
    R = module.DEFAULTS["R"]
    S = [np.mean(d[:, i] * d[:, j], axis=0) + (R[i] if i == j else 0.0) for i, j in ((0, 0), (1, 0), (1, 1))]
    return y_pred.T, np.column_stack(S)


def _roots(module: ModuleType, words: Array) -> Array:
    """Factors (n, n, B) of covariances P = S S^T, from their words (., B)."""
    n = len(module.STATES)
    if module.COVARIANCE == "LD":  # P = L D L^T row by row, D on the diagonal: S = L sqrt(D)
        S = np.zeros((n, n, words.shape[1]))
        S[np.tril_indices(n)] = words
        scale = np.sqrt(np.maximum(S[range(n), range(n)], 0.0))
        S[range(n), range(n)] = 1.0
        return (S * scale)[np.argsort(module.ORDER)]
    P = np.moveaxis(np.asarray(module.unpack(words)), 2, 0)[:, module.ORDER][:, :, module.ORDER]
    try:
        S = np.linalg.cholesky(P)
    except np.linalg.LinAlgError:  # the filter has diverged at some of the steps
        S = np.array([_root(matrix) for matrix in P])
    return np.moveaxis(S, 0, 2)[np.argsort(module.ORDER)]


def _root(P: Array) -> Array:
    """A Cholesky factor, NaN where there is none."""
    try:
        return np.asarray(np.linalg.cholesky(P))
    except np.linalg.LinAlgError:
        return np.full_like(P, np.nan)
