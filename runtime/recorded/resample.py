"""Recordings that are sampled faster than a drive steps: u averaged over each step, i taken at its end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from runtime.recorded.clock import ALLOWED, ANY_ROWS, UNEVEN, WHOLE_ROWS, Rhythm, check_times, rhythm
from runtime.recorded.data import Recorded
from runtime.recorded.source import Array
from runtime.system.errors import UserError

#: Beyond so much of a step without a row its mean is not known.
HOLE = 0.5
#: Voltages beyond this are no samples; their sum would take the digits of all others.
ABSURD = 1e9


def resample(recorded: Recorded, T: float, drive: str) -> Recorded:
    """Bring a recording to a drive's sample time.

    A row's u is the mean over the interval that ends at its t, so the integral of u is known at every row, and a step's
    mean is a difference of it: exact where steps end on rows, else linear within a row's interval. A step with a hole
    of more than half of it, or with a voltage that is no number, has none (NaN), which the filter bridges.

    Parameters
    ----------
    recorded : Recorded
    T : float
        The drive's sample time, s.
    drive : str
        For messages.

    Returns
    -------
    Recorded
        The same if it is sampled with T already.

    Raises
    ------
    UserError
        Too few rows a step for means that are exact enough.
    """
    check_times(recorded.t, recorded.path)
    if len(recorded.t) < 2:
        return recorded
    found = rhythm(recorded.t)
    if abs(found.typical - T) <= ALLOWED * T and found.rms <= UNEVEN * T:
        return recorded
    _check_rows(recorded, found, T, drive)
    begin = recorded.t[0] - found.typical  # where the mean of the first row begins
    count = int((recorded.t[-1] - begin) / T + 1e-3)
    if count < 1:
        raise UserError(f"'{recorded.path}' is shorter than a step of drive '{drive}', {T * 1e6:.6g} us.")
    edges = begin + T * np.arange(count + 1)
    u = np.column_stack([_means(recorded.t, column, found.typical, edges, T) for column in recorded.u.T])
    y = np.column_stack([np.interp(edges[1:], recorded.t, column) for column in recorded.y.T])
    nearest = np.minimum(np.searchsorted(recorded.t, edges[1:] - found.typical / 2), len(recorded.t) - 1)
    truth = {name: values[nearest] for name, values in recorded.truth.items()}
    notes = [
        *recorded.notes,
        f"resampled from {len(recorded.t):,} rows every {found.typical * 1e6:.6g} us to {count:,} steps",
    ]
    notes += _switching(recorded.u, found.typical, T, count)
    return replace(recorded, t=edges[1:], u=u, y=y, truth=truth, notes=notes)


def _check_rows(recorded: Recorded, found: Rhythm, T: float, drive: str) -> None:
    rows = T / found.typical
    whole = abs(rows - round(rows)) <= ALLOWED * rows and found.rms <= UNEVEN * found.typical
    if rows >= ANY_ROWS or (whole and round(rows) >= WHOLE_ROWS):
        return
    advice = "Log at a fixed step" if found.rms > UNEVEN * found.typical else "Record faster"
    raise UserError(
        f"'{recorded.path}' is sampled every {found.typical * 1e6:.6g} us (median, {found.rms * 1e6:.3g} us rms off), "
        f"a step of drive '{drive}' is {T * 1e6:.6g} us: {rows:.3g} rows a step. Means over steps need {WHOLE_ROWS} or "
        f"more where steps end on rows, else {ANY_ROWS}. {advice}, or generate a drive that steps as the data do."
    )


def _means(t: Array, u: Array, typical: float, edges: Array, T: float) -> Array:
    """Mean of u over each step; NaN where it is not known."""
    interval = np.diff(t, prepend=t[0] - typical)
    unknown = ~(np.abs(u) <= ABSURD) | (interval > max(HOLE * T, 1.5 * typical))
    knots = np.concatenate(([t[0] - typical], t))

    def integral(values: Array) -> Array:
        sums = np.concatenate(([0.0], np.cumsum(values * interval)))
        return np.asarray(np.diff(np.interp(edges, knots, sums)) / T)

    mean = integral(np.where(unknown, 0.0, u))
    if unknown.any():
        mean[integral(unknown.astype(float)) > 1e-6] = np.nan
    return mean


def _switching(u: Array, typical: float, T: float, count: int) -> list[str]:
    """How well means are known of voltages that switch within a step."""
    good = u[np.all(np.abs(u) <= ABSURD, axis=1)]
    if len(good) < 2:
        return []
    steps = np.max(np.abs(np.diff(good, axis=0)), axis=1)
    jumps = steps[steps > 0.1 * float(np.max(np.ptp(good, axis=0)))]
    if len(jumps) <= 1.5 * count:  # a held voltage jumps once a step
        return []
    doubt = float(np.median(jumps)) * typical / T
    return [f"the voltages switch within a step; their edges are known to a row, so each mean to {doubt:.3g} V"]
