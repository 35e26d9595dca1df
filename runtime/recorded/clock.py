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


@dataclass(frozen=True)
class Clock:
    """When the filter takes each row.

    ``steps`` (N,): the filter's step at which each row is taken, 0 first; more steps than rows where some are
    missing. ``notes`` tell of jitter and gaps.
    """

    steps: Array
    notes: list[str]

    @property
    def gaps(self) -> bool:
        """Whether rows are missing."""
        return bool(self.steps[-1] + 1 > len(self.steps))


def check_clock(t: Array, T: float, path: Path, drive: str) -> Clock:
    """Place the rows of recorded data on a drive's steps.

    Parameters
    ----------
    t : (N,) s
    T : float
        The drive's sample time, s.

    Raises
    ------
    UserError
        t is not a number or does not increase, the sample times do not fit, or more is missing than recorded.
    """
    bad = np.flatnonzero(~np.isfinite(t))
    if len(bad):
        raise UserError(f"'{path}': t is not a number in {len(bad):,} of {len(t):,} rows, first in row {bad[0] + 1}.")
    if len(t) < 2:
        return Clock(np.zeros(len(t), dtype=np.int64), [])
    interval = np.diff(t)
    back = np.flatnonzero(interval <= 0)
    if len(back):
        k = back[0]
        raise UserError(
            f"'{path}': t does not increase from row {k + 1} ({t[k]:.9g} s) to row {k + 2} ({t[k + 1]:.9g} s), "
            f"and at {len(back) - 1:,} further rows. Too few digits, or recordings joined?"
        )
    typical = float(np.median(interval))
    if abs(typical - T) > ALLOWED * T:
        raise UserError(
            f"'{path}' is sampled every {typical * 1e6:.6g} us (median), drive '{drive}' steps every {T * 1e6:.6g} us. "
            f"Resample the data, or generate the drive with model.sample_time = {typical:.6g}. "
            "Is t in s? Otherwise --scale t=ms."
        )
    notes = []
    if abs(typical - T) > 1e-4 * T:
        notes.append(f"the median sample time is {typical * 1e6:.6g} us, the drive's {T * 1e6:.6g} us")
    # Rounded down a little: a late sample is jitter, not a gap, up to three quarters of an interval.
    missing = np.maximum(np.rint(interval / typical - 0.25).astype(np.int64) - 1, 0)
    steps = np.concatenate(([0], np.cumsum(missing + 1)))
    regular = interval - (missing + 1) * typical
    jitter = float(np.max(np.abs(regular)))
    if jitter > JITTER * T:
        rms = float(np.sqrt(np.mean(regular**2)))
        notes.append(
            f"t jitters by {jitter * 1e6:.3g} us at most, {rms * 1e6:.3g} us rms; every row counts as one step"
        )
    gaps = np.flatnonzero(missing)
    if len(gaps):
        total = int(missing.sum())
        where = f"{len(gaps):,} gaps, {total:,} samples missing, the first after t = {t[gaps[0]]:.6g} s"
        if total > len(t):
            raise UserError(f"'{path}' has {where}: more is missing than recorded. Replay the pieces by themselves.")
        notes.append(f"{where}: bridged by prediction, the last voltage held")
    return Clock(steps, notes)
