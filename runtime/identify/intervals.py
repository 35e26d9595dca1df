"""What was found of each datum, how surely, and in words what the recordings cannot show.

A half-width is the largest of Fisher's and of several that the scores give (the sandwich of Huber and White):
summed over blocks of samples, since the errors of a model that is a little wrong stay alike for a while, and over a few
long stretches of the recordings, with Student's factor, since they differ from one way of running to the next. Where
the search was ended before it was at the best, the way to there by Newton's step is added. Where that is too wide to
tell the datum, the interval also holds all that the guess may be off.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.identify.likelihood import GRAIN
from runtime.identify.problem import Problem
from runtime.identify.search import Found
from runtime.identify.unknowns import Datum

Array = NDArray[Any]

#: Two-sided 95 % of a normal variable.
Z_95 = 1.959963984540054
#: Innovations that one block of scores is of, and numbers of stretches that a recording is cut into.
BLOCKS, STRETCHES = (10, 50, 200), (24, 12, 6)
#: A stretch is of that many innovations at least.
SHORTEST = 100
#: How far the ripple's factor, and the logarithm of the current below which a sign fades, may be off what suits the
#: model best: near zero current a real leg takes what neither of them says.
SHAPED, SHAPE = ("ripple", "I_0"), 0.15
#: A datum counts as told where its half-width is below this share of it; a signed one also where it is below a size
#: that does not matter: of the DC link, or in sigmas of the current sensors.
TOLD, TOLD_VOLTAGE, TOLD_SIGMAS = 0.25, 0.002, 0.5
#: Beyond are told: the factor of the sensors' noise, and how far in logarithms a datum is from its guess.
NOISY, FAR = 2.0, math.log(3.0)
#: Correlations beyond are told.
TOGETHER = 0.95


@dataclass(frozen=True)
class Estimate:
    """A datum in SI, its 95 % interval, and whether the recordings tell it."""

    datum: Datum
    guess: float
    value: float
    low: float
    high: float
    told: bool

    @property
    def width(self) -> float:
        """Half of the interval, relative to the value."""
        return (self.high - self.low) / 2 / abs(self.value) if self.value else math.inf


@dataclass(frozen=True)
class Result:
    """All estimates; their correlation (k, k); how many of their combinations are told; what is not, in words."""

    estimates: tuple[Estimate, ...]
    correlation: Array
    rank: int
    words: tuple[str, ...]

    def of(self, word: str) -> Estimate:
        """The estimate of a datum.

        Parameters
        ----------
        word : str
            As in --free.
        """
        return next(estimate for estimate in self.estimates if estimate.datum.word == word)


def result(problem: Problem, found: Found) -> Result:
    """The estimates with their intervals.

    Parameters
    ----------
    problem : Problem
    found : Found
    """
    shape = [k for k, unknown in enumerate(problem.unknowns) if unknown.name in SHAPED]
    half = half_widths(found, problem.prior, shape)
    data = problem.data
    estimates = []
    limits = []
    for k in data:
        unknown, datum = problem.unknowns[k], problem.unknowns[k].datum
        assert datum is not None
        low, value, high = (float(unknown.value(found.q[k] + sign * half[k])) for sign in (-1, 0, 1))
        limits.append(_limit(problem, datum, value) / unknown.size)
        told = bool(half[k] <= limits[-1])
        if not told:  # then the guess is worth as much, as far as it is doubted
            doubt = Z_95 * unknown.prior
            low = min(low, float(unknown.value(unknown.start - doubt)))
            high = max(high, float(unknown.value(unknown.start + doubt)))
        estimates.append(Estimate(datum, problem.subject.guess(datum), value, low, high, told))
    covariance = np.linalg.inv(found.slope.information)[np.ix_(data, data)]
    sigma = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(sigma, sigma)
    scale = np.array(limits) / Z_95
    rank = int(np.sum(np.linalg.eigvalsh(np.linalg.inv(covariance / np.outer(scale, scale))) > 1.0))
    prior, said = 1 / problem.prior[data] ** 2, np.diag(found.slope.information)[data]
    idle = [bool(k) for k in said <= prior * (1 + 1e-9)]
    words = (*_words(estimates, correlation, idle), *doubts(problem, found, estimates))
    return Result(tuple(estimates), correlation, rank, words)


def half_widths(found: Found, prior: Array, shape: Sequence[int] = ()) -> Array:
    """Half-widths of the 95 % intervals of all unknowns, in search values, (m,); at most those of the prior.

    Parameters
    ----------
    found : Found
    prior : (m,)
        Standard deviations.
    shape : sequence of int, optional
        Unknowns that shape the inverter's loss.
    """
    inverse = np.linalg.inv(found.slope.information)
    widest = Z_95 * np.sqrt(np.diag(inverse))
    for parts, factor in _cuts(found.slope.scores):
        spread = np.sqrt(np.diag(inverse @ (parts.T @ parts) @ inverse))
        widest = np.maximum(widest, factor * spread)
    for place in shape:  # what the estimates become where the shape of the inverter's loss is another
        widest = np.hypot(widest, SHAPE * inverse[:, place] / inverse[place, place])
    left = np.abs(inverse @ found.slope.gradient)  # the way to the best, where the search was ended before
    return np.minimum(widest + left, Z_95 * prior)


def _cuts(scores: Array) -> Any:
    """Sums of the scores over blocks and over stretches, each with the factor of its 95 %."""
    grains = len(scores)
    for length in BLOCKS:
        each = length // GRAIN
        count = -(-grains // each)
        padded = np.zeros((count * each, scores.shape[1]))
        padded[:grains] = scores
        yield padded.reshape(count, each, -1).sum(axis=1), Z_95
    for count in STRETCHES:
        if grains * GRAIN >= count * SHORTEST:
            edges = np.linspace(0, grains, count + 1).astype(int)[:-1]
            yield np.add.reduceat(scores, edges) * math.sqrt(count / (count - 1)), student(count - 1)


def student(degrees: int) -> float:
    """Two-sided 95 % of Student's distribution, by the first terms of its expansion about the normal one.

    Parameters
    ----------
    degrees : int
        From 5 on, where it is good to 2e-3.

    Examples
    --------
    >>> round(student(5), 2), round(student(23), 3)
    (2.57, 2.069)
    """
    z, n = Z_95, degrees
    terms = (
        (z**3 + z) / 4,
        (5 * z**5 + 16 * z**3 + 3 * z) / 96,
        (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / 384,
    )
    return float(z + sum(term / n ** (k + 1) for k, term in enumerate(terms)))


def doubts(problem: Problem, found: Found, estimates: list[Estimate]) -> Any:
    """What lets one doubt that this is the machine, in words.

    Parameters
    ----------
    problem : Problem
    found : Found
    estimates : list of Estimate
    """
    k = problem.index("noise")
    noise = float(problem.unknowns[k].value(found.q[k]))
    if noise > NOISY:
        sigma = math.sqrt(problem.subject.noise[0])
        yield (
            f"the currents err by {noise:.2g} times the {sigma:.2g} A that the file says of the sensors: is that "
            "right, and is the machine of this kind? If not, the intervals are too narrow."
        )
    far = [e.datum.word for e in estimates if e.told and e.datum.positive and abs(math.log(e.value / e.guess)) > FAR]
    if far:
        yield (
            f"{', '.join(far)}: beyond a third or three times the guess, which is farther than a guess should be off; "
            "do columns, units and pole pairs fit?"
        )


def _limit(problem: Problem, datum: Datum, value: float) -> float:
    """The half-width up to which a datum is told: of a logarithm, or in its unit."""
    if datum.positive:
        return TOLD
    facts = problem.subject.facts
    enough = TOLD_VOLTAGE * facts.dc_link if datum.unit == "V" else TOLD_SIGMAS * math.sqrt(problem.subject.noise[0])
    return max(TOLD * abs(value), enough)


def _words(estimates: list[Estimate], correlation: Array, idle: list[bool]) -> Any:
    """What is not told, and what goes together; ``idle``: data that no innovation hangs on."""
    for k, estimate in enumerate(estimates):
        if estimate.told:
            continue
        datum = estimate.datum
        if idle[k]:
            yield f"{datum.word}: the equations of this machine do not have it."
            continue
        partners = [
            other.datum.word for j, other in enumerate(estimates) if j != k and abs(correlation[k, j]) > TOGETHER
        ]
        beside = f", nor can it be told from {' and '.join(partners)}" if partners else ""
        yield (
            f"{datum.word}: these recordings do not show it ({estimate.low:.3g} .. {estimate.high:.3g} {datum.unit})"
            f"{beside}; {datum.run}."
        )
    for k, one in enumerate(estimates):
        for j, other in enumerate(estimates[:k]):
            if one.told and other.told and abs(correlation[k, j]) > TOGETHER:
                yield (
                    f"{other.datum.word} and {one.datum.word} go together (correlation {correlation[k, j]:+.3f}): "
                    f"their combination is better known than each; {one.datum.run}."
                )
