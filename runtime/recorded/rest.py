"""What the current sensors say while the machine rests: their offsets."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

#: Rows a rest has at least; of a longer one so many are looked at.
SHORTEST, LONGEST = 50, 20_000
#: A voltage below so much of the largest may be none; the mean of none is a tenth of that or less.
QUIET = 0.01
#: An offset is told beyond so many of its own standard deviations, and beyond so much of the largest current.
SURE, WORTH = 5.0, 1e-3
#: Rows of a recording that are looked at.
LOOKED_AT = 2_000_000


def offset_notes(u: Array, currents: Mapping[str, Array]) -> list[str]:
    """Say which offsets the current sensors have, where the recording has a rest; nothing is corrected.

    A rest is no voltage, and currents that are noise about a level: a turning rotor would make them alternate.

    Parameters
    ----------
    u : ndarray, (N, 2)
        u_alpha, u_beta, V.
    currents : mapping of str to ndarray, (N,)
        The columns that currents are recorded in, A.
    """
    rows = find_rest(u[:LOOKED_AT])
    if rows is None:
        return []
    said = []
    for name, current in currents.items():
        level, deviation = _level(current[rows])
        if not np.isfinite(level):
            return []
        largest = float(np.max(np.abs(current[:LOOKED_AT]), initial=0.0, where=np.isfinite(current[:LOOKED_AT])))
        if abs(level) > max(SURE * deviation, WORTH * largest):
            said.append((name, level, deviation))
    if not said:
        return []
    levels = ", ".join(f"{name} {level:.4g} +- {deviation:.2g} A" for name, level, deviation in said)
    options = " ".join(f"--offset {name}={-level:.4g}" for name, level, _ in said)
    return [
        f"without voltage (rows {rows.start + 1:,} .. {rows.stop:,}) the currents are not zero: {levels}; "
        f"if these are offsets of the sensors: {options}"
    ]


def find_rest(u: Array) -> slice | None:
    """Find the longest stretch without voltage, its first :data:`LONGEST` rows.

    Parameters
    ----------
    u : ndarray, (N, 2)
        V.

    Returns
    -------
    slice or None
        None if it is shorter than :data:`SHORTEST` rows, or if there is no voltage anywhere.
    """
    size = np.maximum(np.abs(u[:, 0]), np.abs(u[:, 1]))
    top = float(np.max(size, initial=0.0, where=np.isfinite(size)))
    if top == 0.0:
        return None
    still = np.concatenate(([False], size <= QUIET * top, [False]))
    edges = np.flatnonzero(still[1:] != still[:-1])
    begins, ends = edges[::2], edges[1::2]
    if not len(begins) or np.max(ends - begins) < SHORTEST:
        return None
    k = int(np.argmax(ends - begins))
    rest = slice(int(begins[k]), min(int(ends[k]), int(begins[k]) + LONGEST))
    return rest if np.max(np.abs(u[rest].mean(axis=0))) <= QUIET / 10 * top else None


def _level(i: Array) -> tuple[float, float]:
    """Mean of a current and its standard deviation; NaN where it is not noise about a level (von Neumann's ratio)."""
    i = i[np.isfinite(i)]
    if len(i) < SHORTEST:
        return np.nan, np.nan
    variance, by_steps = float(np.var(i)), float(np.mean(np.diff(i) ** 2)) / 2
    if variance > 2.0 * by_steps:
        return np.nan, np.nan
    return float(np.mean(i)), float(np.sqrt(variance / len(i)))
