"""Compare a stage of two computations on the scale of its rows, many steps at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.quantities import Stage

Array = NDArray[Any]

#: P = P_pred - K Pyy K^T, as printed, is a difference: where a measurement takes all but this share of a variance, the
#: roundings of P_pred show, and the row is judged by this share of it (1e-10 of it: 45 roundings of P_pred).
CANCELLED = 1e-4
#: The gain is known to the roundings of Pyy times its condition, and P_pred - K Pyy K^T no better: the share is at
#: least this times the condition (1e-10 of it: nine roundings of Pyy, whose entries are sums of ten products and more;
#: seven were met on ``traction_70kw``). It matters where both outputs say the same.
PER_CONDITION = 1e-5
#: The points lie about x, and their differences from it are known to a rounding of x: where x is so many sigmas large,
#: Pxy and the gain have it, in either computation, and the share is at least this times that number (1e-10 of it: two
#: roundings). It matters where a measurement says nearly all of a state that data in doubt made unsure.
PER_OFFSET = 2e-6

#: What motor data that may be wrong add to P_pred comes of differences that may vanish, as at rest a wrong L does
#: nothing: it is judged by no less than this share of P_pred (1e-10 of it: 45 roundings of P_pred).
ADDED = 1e-4


@dataclass(frozen=True)
class Sigmas:
    """The scales of a step's errors, each with a leading step axis N.

    ``state`` (N, n): sqrt diag P_pred. ``innovation`` (N, 2): sqrt diag Pyy. ``noise`` (2,): sqrt R.
    ``condition`` (N,): of Pyy. ``offset`` (N,): the largest of x_pred in its sigmas.
    """

    state: Array
    innovation: Array
    noise: Array
    condition: Array
    offset: Array | float = 0.0


def entries_of(stage: Stage, values: Array) -> Array:
    """Reference arrays (N, rows[, columns]) -> (N, entries) in the stage's order.

    Parameters
    ----------
    stage : Stage
        A stage with as many entries as a lower triangle has takes that of a square matrix.
    values : ndarray, (N, rows[, columns])
        The reference's.
    """
    n = values.shape[1]
    if values.ndim == 3 and len(stage.entries) == n * (n + 1) // 2 and values.shape[2] == n:
        rows, columns = np.tril_indices(n)
        return values[:, rows, columns]
    return values.reshape(values.shape[0], -1)


def scale_of(stage: Stage, values: Array, sigmas: Sigmas) -> Array:
    """(N, entries): of a covariance's entry the product of its sigmas, of any other what its row has.

    Parameters
    ----------
    stage : Stage
        Tells rows and scale.
    values : ndarray, (N, rows[, columns])
        The reference's, in the stage's unit.
    sigmas : Sigmas
        Of the same N steps.
    """
    if stage.scale not in ("covariance", "difference", "addend"):
        return row_scale(stage, values, sigmas)
    scale = covariance_scale(values)
    if stage.scale == "addend":
        scale = np.maximum(scale, ADDED * sigmas.state[..., :, None] * sigmas.state[..., None, :])
    if stage.scale == "difference":
        scale = np.maximum(scale, minuend_scale(sigmas.state, sigmas.condition, sigmas.offset))
    return entries_of(stage, scale)


def covariance_scale(P: Array) -> Array:
    """(..., n, n): of each entry of covariances the product of its two sigmas."""
    sigma = np.sqrt(np.maximum(np.einsum("...ii->...i", P), 0.0))
    return np.asarray(sigma[..., :, None] * sigma[..., None, :])


def minuend_scale(sigma: Array, condition: Array, offset: Array | float = 0.0) -> Array:
    """(..., n, n): by what an entry of P_pred - K Pyy K^T is judged at least, a share of P_pred's sigmas' product.

    Parameters
    ----------
    sigma : ndarray, (..., n)
        sqrt diag P_pred.
    condition : ndarray, (...)
        Of Pyy; 0 where nothing is subtracted.
    offset : ndarray, (...), or float
        Of the points, in sigmas; 0 of what spreads none.
    """
    least = np.maximum(CANCELLED, np.maximum(PER_CONDITION * condition, PER_OFFSET * offset))
    share = np.where(condition > 0, least, 0.0)
    return np.asarray(share[..., None, None] * sigma[..., :, None] * sigma[..., None, :])


def row_scale(stage: Stage, values: Array, sigmas: Sigmas) -> Array:
    """(N, entries): for each entry its row's largest magnitude, or the row's natural size if that is larger.

    Parameters
    ----------
    stage : Stage
        Tells rows and scale.
    values : ndarray, (N, rows[, columns])
        The reference's, in the stage's unit.
    sigmas : Sigmas
        Of the same N steps.
    """
    full = np.abs(values.reshape(*values.shape[:2], -1)).max(axis=2)
    low, high = sigmas.innovation.min(axis=1, keepdims=True), sigmas.innovation.max(axis=1, keepdims=True)
    natural = {
        "state": sigmas.state,
        "output": np.broadcast_to(sigmas.noise, (values.shape[0], 2)),
        "cross": sigmas.state * low,
        "gain": sigmas.state / high,
        "row": np.zeros_like(full),
    }[stage.scale]
    return np.asarray(np.maximum(full, natural)[:, list(stage.rows)])


def relative_error(stage: Stage, expected: Array, found: Array, sigmas: Sigmas, angle: int) -> Array:
    """(N, entries) of |found - expected| over the row's scale; a missing number counts as infinite.

    Parameters
    ----------
    stage : Stage
        Tells rows and scale.
    expected : array, (N, rows[, columns])
        The reference.
    found : array, (N, entries)
        What the generated code computed.
    angle : int
        Row whose values live on a circle (in stages of states).
    """
    difference = found - entries_of(stage, expected)
    if stage.scale == "state":
        turning = np.array(stage.rows) == angle
        difference[:, turning] = np.remainder(difference[:, turning] + np.pi, 2 * np.pi) - np.pi
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.abs(difference) / scale_of(stage, expected, sigmas)
    error[difference == 0] = 0.0
    error[np.isnan(error)] = np.inf
    return np.asarray(error)
