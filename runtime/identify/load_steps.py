"""When the load torque steps: told by the likelihood, so that it may otherwise be constant and J shows.

A load that steps once makes a filter that knows wandering loads alone take it for one that always wanders, behind which
no acceleration says anything of J. So the load may jump in one short window, all such windows are tried, and the noise
of the load elsewhere with them (the intervention analysis of Box and Tiao 1975, by likelihoods of the innovations).
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.identify.likelihood import values
from runtime.identify.problem import Problem, Stage
from runtime.identify.rows import Rows

Array = NDArray[Any]

#: Steps of a recording at most.
MOST_STEPS = 4
#: A load that wanders less than this share of the rated torque over a recording has no step that matters.
STILL = 0.1
#: Windows that a recording is cut into, those that the best is cut into again and again, and rows of the shortest.
WINDOWS, FINER, SHORTEST = 20, 4, 4
#: What the noise of the load elsewhere may then be, times what it was.
QUIETER = (1.0, 0.3, 0.1, 0.03, 0.01, 3e-3, 1e-3, 3e-4)
#: By how much the logarithm of the likelihood grows at least, more than the best of all windows of a load without steps
#: makes it grow.
GAIN = 20.0
#: Where the best of the first windows earns less than this share of it, none is looked into.
HOPELESS = 0.3
#: Column of a row that has the variance of a jump, (N m)^2.
COLUMN = 5


def with_next_step(problem: Problem, q: Array) -> tuple[Problem, Array] | None:
    """The problem with the step that explains most, and the search vector with the noise of the load that then suits.

    Parameters
    ----------
    problem : Problem
    q : (m,)

    Returns
    -------
    (Problem, (m,)) or None
        None: no step explains enough.
    """
    place = problem.index("s_T")
    walk = float(problem.unknowns[place].value(q[place]))
    best: tuple[float, Problem, Array] | None = None
    for recording, rows in enumerate(problem.recordings):
        wandered = walk * rows.steps**0.5
        if len(rows.load_steps) >= MOST_STEPS or wandered < STILL * problem.subject.facts.torque:
            continue
        found = _best_step(problem, q, recording)
        if found[0] > (best[0] if best else GAIN):
            best = found
    return None if best is None else best[1:]


def _best_step(problem: Problem, q: Array, recording: int) -> tuple[float, Problem, Array]:
    """By how much the best step of a recording makes the likelihood grow, the problem with it, the search vector."""
    place, rows = problem.index("s_T"), problem.recordings[recording]
    Q = np.repeat(q[:, None], len(QUIETER), axis=1)
    Q[place] += np.log(QUIETER)
    without = float(np.min(values(problem, Q, Stage(), only=(recording,))))
    first, last, count = 1, len(rows.table), WINDOWS
    while True:
        edges = np.unique(np.linspace(first, last, min(count, last - first) + 1).astype(int))
        tried = [_stepping(problem, recording, slice(int(a), int(b))) for a, b in pairwise(edges)]
        heights = np.array([values(one, Q, Stage(), only=(recording,)) for one in tried])
        window, lane = np.unravel_index(int(np.argmin(heights)), heights.shape)
        first, last, count = int(edges[window]), int(edges[window + 1]), FINER
        gain = without - float(heights[window, lane])
        if last - first <= SHORTEST or not gain > HOPELESS * GAIN:
            return gain, tried[window], Q[:, lane]


def _stepping(problem: Problem, recording: int, window: slice) -> Problem:
    """The same with a load that may step by the rated torque within a window of a recording's rows."""
    rows = problem.recordings[recording]
    table = rows.table.copy()
    length, facts = window.stop - window.start, problem.subject.facts
    table[window, COLUMN] += facts.torque**2 / length
    at = facts.T * (window.start + window.stop - 1) / 2
    changed = replace(rows, table=table, load_steps=(*rows.load_steps, at))
    return problem.changed(recordings=_with(problem.recordings, recording, changed))


def _with(all_: tuple[Rows, ...], place: int, one: Rows) -> tuple[Rows, ...]:
    return (*all_[:place], one, *all_[place + 1 :])
