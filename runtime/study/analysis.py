"""Figures of a study: success with its interval, quantiles, and filters against each other on the same draws."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.supervisor.table import MODES, REASONS
from runtime.study.run import Group, Study

Array = NDArray[Any]

#: Figures of a run that quantiles are given of, with their units; of runs that locked.
FIGURES = {"start": "r/min", "load_step": "r/min", "steady_rms": "r/min", "angle": "deg", "lock_time": "s"}
QUANTILES = (0.05, 0.5, 0.95, 1.0)

#: A start that is over by then counts as quick, s.
QUICK = 0.2

#: Two-sided 95 % of a normal distribution.
Z_95 = 1.959963984540054
RESAMPLES = 2000


@dataclass(frozen=True)
class Rate:
    """A share of successes with its Wilson 95 % interval."""

    successes: int
    runs: int
    rate: float
    low: float
    high: float


@dataclass(frozen=True)
class Difference:
    """Second filter minus first on the runs both have, with a 95 % interval from resampled runs.

    ``figure`` is ``success`` (in shares) or one of :data:`FIGURES`, then on the runs that both locked.
    """

    drive: str
    first: str
    second: str
    figure: str
    runs: int
    mean: float
    low: float
    high: float


def wilson(successes: int, runs: int) -> Rate:
    """Return Wilson's score interval: right at 0 and at 1, where the usual one has no width.

    Parameters
    ----------
    successes, runs : int

    Examples
    --------
    >>> rate = wilson(10, 10)
    >>> round(rate.low, 4), rate.high
    (0.7225, 1.0)
    """
    if runs == 0:
        return Rate(0, 0, math.nan, 0.0, 1.0)
    p, z = successes / runs, Z_95
    middle = (p + z * z / (2 * runs)) / (1 + z * z / runs)
    half = z / (1 + z * z / runs) * math.sqrt(p * (1 - p) / runs + z * z / (4 * runs * runs))
    low = 0.0 if successes == 0 else middle - half
    high = 1.0 if successes == runs else middle + half
    return Rate(successes, runs, p, low, high)


def success(group: Group) -> Rate:
    """Count runs that locked: at the end the angle within 30 degrees and the speed within a tenth of the reference.

    Parameters
    ----------
    group : Group
    """
    return wilson(int(np.count_nonzero(group.outcomes.good)), len(group.index))


def quick(group: Group) -> Rate:
    """Count runs whose rotor turned the right way with the angle within 30 degrees from :data:`QUICK` on, to the end.

    Parameters
    ----------
    group : Group
    """
    outcomes = group.outcomes
    return wilson(int(np.count_nonzero(outcomes.good & (outcomes.lock_time <= QUICK))), len(group.index))


def quantiles(group: Group) -> dict[str, tuple[float, ...]]:
    """Work out each figure's quantiles over the runs that locked; NaN where none did.

    Parameters
    ----------
    group : Group
    """
    locked = group.outcomes.good
    found = {}
    for name in FIGURES:
        values = getattr(group.outcomes, name)[locked]
        found[name] = tuple(np.quantile(values, QUANTILES).tolist()) if values.size else (math.nan,) * len(QUANTILES)
    return found


def paired(first: Group, second: Group, seed: int = 1) -> list[Difference]:
    """Compare two filters of one drive run by run: the same rotor, motor, load and noise in both.

    Parameters
    ----------
    first, second : Group
    seed : int
        Of the bootstrap.
    """
    _, a, b = np.intersect1d(first.index, second.index, assume_unique=True, return_indices=True)
    if not a.size:
        return []
    rng = np.random.default_rng(seed)
    won = [group.outcomes.good[where].astype(float) for group, where in ((first, a), (second, b))]
    both = (won[0] > 0) & (won[1] > 0)
    changes = {"success": won[1] - won[0]}
    for name in FIGURES:
        changes[name] = (getattr(second.outcomes, name)[b] - getattr(first.outcomes, name)[a])[both]
    return [
        Difference(first.drive, first.kind, second.kind, name, values.size, *_resampled(values, rng))
        for name, values in changes.items()
        if values.size
    ]


def _resampled(values: Array, rng: np.random.Generator) -> tuple[float, float, float]:
    """Mean, and the 2.5 % and 97.5 % quantiles of the means of samples drawn from it with repetition."""
    if np.all(values == values[0]):
        return (float(values[0]),) * 3
    means = np.array([np.mean(values[rng.integers(0, values.size, values.size)]) for _ in range(RESAMPLES)])
    low, high = np.quantile(means, (0.025, 0.975))
    return float(np.mean(values)), float(low), float(high)


def comparisons(study: Study) -> list[Difference]:
    """Compare every other filter of a drive with its first one.

    Parameters
    ----------
    study : Study
    """
    found: list[Difference] = []
    for drive in dict.fromkeys(group.drive for group in study.groups):
        first, *others = (group for group in study.groups if group.drive == drive)
        for other in others:
            found += paired(first, other)
    return found


def success_over(group: Group, variable: str, edges: Array) -> list[Rate]:
    """Return the success in each slice of a variable.

    Parameters
    ----------
    group : Group
    variable : str
        A name that was varied.
    edges : ndarray, (slices + 1,)
        In the variable's unit.
    """
    slot = np.clip(np.digitize(group.drawn[variable], edges) - 1, 0, len(edges) - 2)
    locked = group.outcomes.good
    return [wilson(int(locked[slot == k].sum()), int(np.count_nonzero(slot == k))) for k in range(len(edges) - 1)]


def ended(group: Group) -> tuple[dict[str, int], dict[str, int]]:
    """Count the modes in which supervisors ended, and the reasons why they last gave up a rotor.

    Parameters
    ----------
    group : Group
        Of a study whose drives have their supervisors.

    Returns
    -------
    tuple of dict
        By the names in the generated code; without those of which there is none.
    """
    modes, reasons = (Counter(column.tolist()) for column in (group.outcomes.mode, group.outcomes.reason))
    return (
        {mode.name: modes[k] for k, mode in enumerate(MODES) if modes[k]},
        {reason.name: reasons[k] for k, reason in enumerate(REASONS) if k and reasons[k]},
    )


def study_facts(study: Study) -> dict[str, Any]:
    """Return everything that is printed as plain data.

    Parameters
    ----------
    study : Study
    """
    return {
        **study.statement.facts(),
        "runs": study.runs,
        "interrupted": study.interrupted,
        "groups": [
            {
                "drive": group.drive,
                "filter": group.kind,
                "success": asdict(success(group)),
                f"locked_within_{QUICK:g}_s": asdict(quick(group)),
                **(dict(zip(("modes", "reasons"), ended(group), strict=True)) if study.statement.supervised else {}),
                "not_finite": int(np.count_nonzero(~group.outcomes.finite)),
                "quantiles": {
                    name: dict(zip((f"{q:g}" for q in QUANTILES), _plain(values), strict=True))
                    for name, values in quantiles(group).items()
                },
            }
            for group in study.groups
        ],
        "paired": [asdict(item) for item in comparisons(study)],
    }


def _plain(values: Sequence[float]) -> list[float | None]:
    """JSON has no NaN."""
    return [value if math.isfinite(value) else None for value in values]
