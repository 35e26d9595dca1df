"""The two objectives of a search, with gradient and information by differences of innovations.

Both are negative logarithms. ``spread``: N/2 log det of the innovations' own covariance, for a filter whose variances
are only a means (Q large at first, so that a wrong model still follows). ``likelihood``: that of Gaussian innovations
with the filter's covariances (Schweppe 1965), in which the variances are unknowns, too; its information is Fisher's,
sum of de^T S^-1 de + tr(S^-1 dS S^-1 dS) / 2 (Segal and Weinstein 1989).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.identify.problem import Problem, Stage

Array = NDArray[Any]

#: Step of the differences, in search values.
STEP = 5e-4
#: Innovations that scores are summed over at once.
GRAIN = 10


@dataclass(frozen=True)
class Slope:
    """Value, gradient (k,) and information (k, k) at a search vector; ``scores`` (blocks, k): the gradient's parts."""

    value: float
    gradient: Array
    information: Array
    scores: Array


def values(
    problem: Problem, Q: Array, stage: Stage, most: int | None = None, only: Sequence[int] | None = None
) -> Array:
    """The objective of search vectors, (B,); infinite where the filter fails.

    Parameters
    ----------
    problem : Problem
    Q : (m, B)
    stage : Stage
        With a kappa the spread is taken, without one the likelihood.
    most : int, optional
        Rows of each recording at most.
    only : sequence of int, optional
        Recordings that count; all by default.
    """
    total = 0.5 * np.sum(((Q - problem.guess[:, None]) / problem.prior[:, None]) ** 2, axis=0)
    for recording in range(len(problem.recordings)) if only is None else only:
        moments, count, sum_ = np.zeros((2, 2, Q.shape[1])), 0, np.zeros(Q.shape[1])
        for measured, told in problem.innovations(Q, recording, stage, most):
            told = told[measured]
            count += len(told)
            if stage.kappa is None:
                sum_ += np.sum(_terms(told), axis=0)
            else:
                moments += np.einsum("nib,njb->ijb", told[:, :2], told[:, :2])
        if stage.kappa is not None:
            with np.errstate(all="ignore"):
                det = moments[0, 0] * moments[1, 1] - moments[0, 1] ** 2
                sum_ = 0.5 * count * np.log(det / count**2)
        total = total + sum_
    return np.where(np.isfinite(total), total, np.inf)


def slope(problem: Problem, q: Array, free: list[int], stage: Stage) -> Slope:
    """The objective at a search vector with its derivatives.

    Parameters
    ----------
    problem : Problem
    q : (m,)
    free : list of int
        The entries that it is differentiated by.
    stage : Stage
    """
    place = {entry: k for k, entry in enumerate(free)}
    off = (q - problem.guess) / problem.prior**2
    gradient, information = off[free].copy(), np.diag(1 / problem.prior[free] ** 2)
    value, scores = 0.5 * float(np.sum((off * problem.prior) ** 2)), []
    for recording in range(len(problem.recordings)):
        own = [entry for entry in problem.own(recording) if entry in place]
        Q = np.repeat(q[:, None], 2 * len(own) + 1, axis=1)
        for k, entry in enumerate(own):
            Q[entry, 1 + 2 * k] += STEP
            Q[entry, 2 + 2 * k] -= STEP
        blocks = problem.innovations(Q, recording, stage)
        part = _likelihood(blocks) if stage.kappa is None else _spread(blocks)
        at = [place[entry] for entry in own]
        value += part.value
        gradient[at] += part.gradient
        information[np.ix_(at, at)] += part.information
        whole = np.zeros((len(part.scores), len(free)))
        whole[:, at] = part.scores
        scores.append(whole)
    return Slope(value, gradient, information, np.concatenate(scores))


def _terms(told: Array) -> Array:
    """What each innovation adds to the likelihood, (N, B)."""
    e_a, e_b, aa, ab, bb = np.moveaxis(told, 1, 0)
    with np.errstate(all="ignore"):
        det = aa * bb - ab * ab
        return np.asarray(0.5 * np.log(det) + 0.5 * (bb * e_a * e_a - 2 * ab * e_a * e_b + aa * e_b * e_b) / det)


def _differences(told: Array) -> Array:
    return np.asarray((told[:, :, 1::2] - told[:, :, 2::2]) / (2 * STEP))


def _spread(blocks: Any) -> Slope:
    squares, cross, products, count = np.zeros((2, 2)), 0.0, 0.0, 0
    for measured, told in blocks:
        told = told[measured]
        e, d = told[:, :2, 0], _differences(told[:, :2])
        squares = squares + e.T @ e
        cross = cross + np.einsum("ni,njk->ijk", e, d)
        products = products + np.einsum("nik,njl->ijkl", d, d, optimize=True)
        count += len(e)
    with np.errstate(all="ignore"):
        value = 0.5 * count * np.log(np.linalg.det(squares / count))
    weight = np.linalg.inv(squares / count) if np.all(np.isfinite(squares)) else np.full((2, 2), np.nan)
    gradient = np.einsum("ij,ijk->k", weight, cross)
    information = np.einsum("ij,ijkl->kl", weight, products)
    return Slope(float(value), gradient, information, np.zeros((0, len(gradient))))


def _likelihood(blocks: Any) -> Slope:
    value, information, scores = 0.0, 0.0, []
    for measured, told in blocks:
        terms = np.where(measured[:, None], _terms(told), 0.0)
        value += float(np.sum(terms[:, 0]))
        score = (terms[:, 1::2] - terms[:, 2::2]) / (2 * STEP)
        grains = -(-len(score) // GRAIN)
        padded = np.zeros((grains * GRAIN, score.shape[1]))
        padded[: len(score)] = score
        scores.append(padded.reshape(grains, GRAIN, -1).sum(axis=1))
        d = _differences(told)[measured]
        aa, ab, bb = told[measured, 2:, 0].T
        c_00 = np.sqrt(aa)
        c_10, c_11 = ab / c_00, np.sqrt(bb - ab * ab / aa)
        white = [d[:, 0] / c_00[:, None]]
        white.append((d[:, 1] - c_10[:, None] * white[0]) / c_11[:, None])
        # C^-1 dS C^-T, whose square has the trace of S^-1 dS S^-1 dS
        left = [[d[:, 2] / c_00[:, None], d[:, 3] / c_00[:, None]]]
        left.append([(d[:, 3 + k] - c_10[:, None] * left[0][k]) / c_11[:, None] for k in range(2)])
        both = [
            left[0][0] / c_00[:, None],
            np.sqrt(2) * left[1][0] / c_00[:, None],
            (left[1][1] - c_10[:, None] * (left[1][0] / c_00[:, None])) / c_11[:, None],
        ]
        rows = np.concatenate([*white, *(np.sqrt(0.5) * part for part in both)])
        information = information + rows.T @ rows
    found = np.concatenate(scores)
    return Slope(value, found.sum(axis=0), np.asarray(information), found)
