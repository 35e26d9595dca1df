"""Half-widths of identified data, on scores whose statistics are known: no filter, no recording."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from runtime.identify.intervals import Estimate, doubts, half_widths
from runtime.identify.likelihood import Slope
from runtime.identify.unknowns import DATA

#: Of the search vector: two data, one known ten times as well as the other, and correlated.
INFORMATION = np.array([[100.0, 5.0], [5.0, 1.0]])
WIDE = np.full(2, 1e3)


def widths(scores: Any, prior: Any = WIDE, gradient: Any = (0.0, 0.0)) -> Any:
    slope = Slope(0.0, np.asarray(gradient), INFORMATION, np.asarray(scores))
    return half_widths(SimpleNamespace(slope=slope), prior)  # type: ignore[arg-type]


def test_without_scatter_it_is_fishers() -> None:
    """The marginal standard deviation, by the determinant: of the first 1 / (I_11 - I_12^2 / I_22)."""
    sigma = np.array([1 / (100.0 - 25.0), 1 / (1.0 - 25.0 / 100.0)]) ** 0.5
    np.testing.assert_allclose(widths(np.zeros((400, 2))), stats.norm.ppf(0.975) * sigma, rtol=1e-9)


def test_a_search_that_was_ended_on_its_way_allows_for_the_rest_of_it() -> None:
    """Away from the best of a parabola by 0.3 and -2: the interval about there reaches the one about the best."""
    away = np.array([0.3, -2.0])
    there = widths(np.zeros((400, 2)), gradient=INFORMATION @ away)
    np.testing.assert_allclose(there, widths(np.zeros((400, 2))) + np.abs(away), rtol=1e-9)


def test_the_prior_is_the_widest() -> None:
    np.testing.assert_allclose(widths(np.zeros((400, 2)), np.full(2, 1e-3)), stats.norm.ppf(0.975) * 1e-3, rtol=1e-9)


@pytest.mark.parametrize("memory", [0.0, 0.9])
def test_the_interval_holds_the_truth_as_often_as_it_says(memory: float) -> None:
    """Scores are what the model says, or go on as they were, which Fisher's information knows nothing of."""
    rng, grains, draws = np.random.default_rng(2), 400, 400
    root = np.linalg.cholesky(INFORMATION / grains)
    held = 0
    for _ in range(draws):
        white = rng.normal(size=(grains, 2))
        for k in range(1, grains):
            white[k] += memory * white[k - 1]
        scores = white @ root.T
        error = np.linalg.solve(INFORMATION, scores.sum(axis=0))
        held += np.count_nonzero(
            np.abs(error) <= widths(scores - scores.mean(axis=0))
        )  # at the estimate they sum to zero
    assert held >= 0.93 * 2 * draws
    assert memory > 0 or held <= 0.999 * 2 * draws, "an interval that always holds says nothing"


@pytest.mark.parametrize(
    ("noise", "value", "said"),
    [(1.0, 1.4, []), (3.0, 1.4, ["the currents err by 3 times the 0.05 A"]), (1.0, 0.2, ["R: beyond a third"])],
)
def test_what_lets_one_doubt_the_machine_is_said(noise: float, value: float, said: list[str]) -> None:
    unknown = SimpleNamespace(value=np.exp)
    problem = SimpleNamespace(
        index=lambda name: 0, unknowns=[unknown], subject=SimpleNamespace(noise=(0.0025, 0.0, 0.0025))
    )
    found = SimpleNamespace(q=np.array([np.log(noise)]))
    estimates = [Estimate(DATA["R"], 1.0, value, 0.9 * value, 1.1 * value, True)]
    words = list(doubts(problem, found, estimates))  # type: ignore[arg-type]
    assert len(words) == len(said)
    assert all(word.startswith(expected) for word, expected in zip(words, said, strict=True))
