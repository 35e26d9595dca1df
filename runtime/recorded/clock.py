"""The times of recorded data against a drive's sample time: they must fit; gaps are found, jitter is told."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.system.errors import UserError

Array = NDArray[Any]

#: The median interval may differ so much from the drive's sample time.
ALLOWED = 0.01
#: Jitter beyond this share of the sample time is told.
JITTER = 0.05
#: Beyond this share of the sample time, rms, rows are no steps.
UNEVEN = 0.1
#: Rows a step of which averages are exact enough: where steps end on rows, and anywhere.
WHOLE_ROWS, ANY_ROWS = 2, 4


@dataclass(frozen=True)
class Clock:
    """When the filter takes each row.

    ``steps`` (N,): the filter's step at which each row is taken, 0 first, where rows are missing; None where every row
    is a step. ``count``: number of steps. ``notes`` tell of jitter and gaps.
    """

    steps: Array | None
    count: int
    notes: list[str]

    @property
    def gaps(self) -> bool:
        """Whether rows are missing."""
        return self.steps is not None


@dataclass(frozen=True)
class Rhythm:
    """How evenly rows come: ``typical`` s, the median interval; ``missing`` (N - 1,) rows in each; deviations in s."""

    typical: float
    missing: Array
    jitter: float
    rms: float


def check_times(t: Array, path: Path) -> None:
    """Refuse times that are no numbers or do not increase.

    Parameters
    ----------
    t : (N,) s
    path : Path

    Raises
    ------
    UserError
    """
    bad = np.flatnonzero(~np.isfinite(t))
    if len(bad):
        raise UserError(f"'{path}': t is not a number in {len(bad):,} of {len(t):,} rows, first in row {bad[0] + 1}.")
    back = np.flatnonzero(t[1:] <= t[:-1])
    if len(back):
        k = back[0]
        raise UserError(
            f"'{path}': t does not increase from row {k + 1} ({t[k]:.9g} s) to row {k + 2} ({t[k + 1]:.9g} s), "
            f"and at {len(back) - 1:,} further rows. Too few digits, or recordings joined?"
        )


def rhythm(t: Array) -> Rhythm:
    """Measure how evenly rows come.

    Parameters
    ----------
    t : (N,) s
        Increasing, N of 2 or more.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # absurd times deviate by no number at all
        return _rhythm(np.diff(t))


def _rhythm(interval: Array) -> Rhythm:
    typical = float(np.median(interval))
    # Rounded down a little: a late sample is jitter, not a gap, up to three quarters of an interval.
    missing = np.maximum(np.rint(interval / typical - 0.25) - 1, 0.0)
    interval -= (missing + 1) * typical
    jitter = float(max(interval.max(), -interval.min()))
    return Rhythm(typical, missing, jitter, float(np.sqrt(np.mean(interval * interval))))


def check_clock(t: Array, T: float, path: Path, drive: str) -> Clock:
    """Place the rows of recorded data on a drive's steps.

    Parameters
    ----------
    t : (N,) s
    T : float
        The drive's sample time, s.
    path : Path
    drive : str
        For messages.

    Raises
    ------
    UserError
        t is not a number or does not increase, the sample times do not fit, rows come unevenly, or more is missing than
        recorded.
    """
    check_times(t, path)
    if len(t) < 2:
        return Clock(None, len(t), [])
    found = rhythm(t)
    typical = found.typical
    if not abs(typical - T) <= ALLOWED * T:
        raise UserError(
            f"'{path}' is sampled every {typical * 1e6:.6g} us (median), drive '{drive}' steps every {T * 1e6:.6g} us. "
            f"{_remedy(typical, T)} Is t in s? Otherwise --scale t=ms."
        )
    if not found.rms <= UNEVEN * T:
        raise UserError(
            f"'{path}' is not sampled evenly: every {typical * 1e6:.6g} us (median), {found.rms * 1e6:.3g} us rms off "
            f"that, where a step of drive '{drive}' is {T * 1e6:.6g} us. Log at a fixed step, this one or at most a "
            "quarter of it; of the latter --resample makes steps."
        )
    notes = []
    if abs(typical - T) > 1e-4 * T:
        notes.append(f"the median sample time is {typical * 1e6:.6g} us, the drive's {T * 1e6:.6g} us")
    if found.jitter > JITTER * T:
        notes.append(
            f"t jitters by {found.jitter * 1e6:.3g} us at most, {found.rms * 1e6:.3g} us rms; "
            "every row counts as one step"
        )
    gaps = np.flatnonzero(found.missing)
    if not len(gaps):
        return Clock(None, len(t), notes)
    total = float(found.missing.sum())
    where = f"{len(gaps):,} gaps, {total:,.0f} samples missing, the first after t = {t[gaps[0]]:.6g} s"
    if total > len(t):
        raise UserError(f"'{path}' has {where}: more is missing than recorded. Replay the pieces by themselves.")
    steps = np.concatenate(([0], np.cumsum(found.missing.astype(np.int64) + 1)))
    return Clock(steps, int(steps[-1]) + 1, [*notes, f"{where}: bridged by prediction, the last voltage held"])


def _remedy(typical: float, T: float) -> str:
    rows = T / typical
    if rows >= ANY_ROWS or (rows >= WHOLE_ROWS - ALLOWED and abs(rows - round(rows)) <= ALLOWED * rows):
        return "--resample averages u over each step and takes i at its end."
    return f"Record faster and --resample, or generate the drive with model.sample_time = {typical:.6g}."
