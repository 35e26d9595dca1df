"""R, the dead time's voltage and the inductances, from a rotor at rest.

At a level of current whose three phase currents keep their signs, v = R i + 4/3 V_d along the axis, exactly. A square
wave on top of it gives, at its own frequency, the ratio of currents to voltages of both axes, and with it the sampled
equations i_k = A i_(k-1) + (1 - A) / R u_k, A = exp(-R T L^-1). Regulators, noise and dead time leave that ratio alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.commission.line import Ran
from runtime.commission.plan import ANGLES, LEVEL_TIME, LEVELS
from runtime.design.facts import Facts

Array = NDArray[Any]

#: A level is reached within that share of it.
REACHED = 0.03
#: Of three levels that many must be reached, the largest at least that often as large as the smallest.
FEWEST, SPREAD = 2, 1.5
#: Phase currents keep their signs by so many sigmas.
SIGNS = 6.0
#: Degree of the drift of a current beneath a square wave.
DRIFT = 3
CHANGED = "a phase current changed its sign within the square wave"


@dataclass(frozen=True)
class Levels:
    """Of every angle: R ohm, V_d V, how far the worst level lies beside the line, of the largest R i."""

    R: Array
    V_d: Array
    bent: float
    reached: float
    wanted: float


def offsets(ran: Ran) -> Array:
    """What the sensors show without a current, A in alpha and beta; the frame stands at angle 0 there.

    Parameters
    ----------
    ran : Ran
    """
    return np.asarray(next(ran.of("offset"))[:, 4:6].mean(axis=0))


def cleaned(rows: Array, offset: Array, period: float, every: int) -> Array:
    """Rows whose currents have no offset: in a turning frame it is its mean over the row.

    Parameters
    ----------
    rows : (N, 8)
    offset : (2,)
    period : float
        s.
    every : int
        Samples of a row.
    """
    rows = rows.copy()
    back = np.arange(every) * period
    angle = rows[:, 7, None] - rows[:, 6, None] * back
    seen = ((offset[0] + 1j * offset[1]) * np.exp(-1j * angle)).mean(axis=1)
    rows[:, 4] -= seen.real
    rows[:, 5] -= seen.imag
    return rows


def levels(ran: Ran, facts: Facts) -> Levels | str:
    """R and V_d at every angle; or in words why they are not told.

    Parameters
    ----------
    ran : Ran
    facts : Facts
    """
    offset, T = offsets(ran), ran.period
    R, V_d, bent = [], [], 0.0
    share = 1.0
    for place in range(ANGLES):
        i, v, good = [], [], []
        for index in range(len(LEVELS)):
            name = f"level {index}"
            segment = next(s for s in ran.run.segments if s.what == name and s.place == place)
            rows = cleaned(next(ran.of(name, place)), offset, T, segment.every)
            rows = rows[-max(4, round(LEVEL_TIME / T / segment.every)) :]
            slope = np.polyfit(rows[:, 0] * T, rows[:, 4], 1)[0]
            i.append(rows[:, 4].mean())
            v.append(rows[:, 2].mean() - facts.L_d * slope)
            good.append(abs(i[-1] / segment.current - 1) <= REACHED)
            share = min(share, i[-1] / segment.current) if not good[-1] else share
        kept = [k for k, ok in enumerate(good) if ok]
        if len(kept) < FEWEST or i[kept[-1]] < SPREAD * i[kept[0]]:
            largest = max(i)
            return f"current not reached: {largest:.3g} A of {segment.current:.3g} A is all that flows"
        slope, intercept = np.polyfit(np.array(i)[kept], np.array(v)[kept], 1)
        off = np.array(v)[kept] - slope * np.array(i)[kept] - intercept
        R.append(slope)
        V_d.append(0.75 * intercept)
        bent = max(bent, float(np.max(np.abs(off))) / (i[kept[-1]] - i[kept[0]]))
    return Levels(np.array(R), np.array(V_d), bent, share, 1.0)


def inductances(ran: Ran, R: float, sigma: float, word: str = "") -> Array | str:
    """Inductances (angles, 2, 2) H along and across the axis; or in words why they are not told.

    Parameters
    ----------
    ran : Ran
    R : float
        ohm.
    sigma : float
        Noise of a current, A.
    word : str, optional
        Before the names of the waves' segments.
    """
    offset, found = offsets(ran), []
    for place in sorted({s.place for s in ran.run.segments if s.what == f"{word}along"}):
        u, i = np.empty((2, 2), dtype=complex), np.empty((2, 2), dtype=complex)
        turns = []
        for column, name in enumerate((f"{word}along", f"{word}across")):
            segment = next(s for s in ran.run.segments if s.what == name and s.place == place)
            rows = cleaned(next(ran.of(name, place)), offset, ran.period, segment.every)
            if not _keep_signs(rows, sigma):
                return CHANGED
            turn = 2 * math.pi / (2 * segment.half)
            u[:, column] = _amplitudes(rows[:, 2:4], turn)
            i[:, column] = _amplitudes(rows[:, 4:6], turn)
            turns.append(turn)
        L = _inductance(u, i, turns, R, ran.period)
        if L is None:
            return "the square wave drove no current that could be told from noise"
        found.append(L)
    return np.array(found)


def _amplitudes(values: Array, turn: float) -> Array:
    """Complex amplitudes (2,) at a frequency of ``turn`` rad a row, beside a slow drift: the rotor may still swing."""
    k = np.arange(len(values))
    slow = np.polynomial.legendre.legvander(2.0 * k / len(values) - 1.0, DRIFT)
    table = np.column_stack([np.cos(turn * k), np.sin(turn * k), slow])
    cosine, sine = np.linalg.lstsq(table, values, rcond=None)[0][:2]
    return np.asarray(cosine - 1j * sine)


def _keep_signs(rows: Array, sigma: float) -> bool:
    """Whether every phase current has one sign throughout."""
    i = (rows[:, 4] + 1j * rows[:, 5]) * np.exp(1j * rows[:, 7])
    for k in range(3):
        phase = (i * np.exp(-2j * math.pi * k / 3)).real
        if np.min(np.abs(phase)) < SIGNS * sigma or len(np.unique(np.sign(phase))) != 1:
            return False
    return True


def _inductance(u: Array, i: Array, turns: list[float], R: float, T: float) -> Array | None:
    """The inductance matrix of two experiments whose waves may have two frequencies: columns are the experiments.

    i = A i z^-1 + B u for each column; with B = (1 - A) / R it is A (i z^-1 - u / R) = i - u / R.
    """
    z = np.exp(1j * np.array(turns))
    left, right = i / z - u / R, i - u / R
    try:
        A = right @ np.linalg.inv(left)
        values, vectors = np.linalg.eig(A)
        L = np.linalg.inv(vectors @ np.diag(-np.log(values) / (R * T)) @ np.linalg.inv(vectors)).real
    except np.linalg.LinAlgError:
        return None
    L = (L + L.T) / 2
    return L if np.all(np.isfinite(L)) and np.all(np.linalg.eigvalsh(L) > 0) else None


@dataclass(frozen=True)
class Axes:
    """L_d and L_q of every angle, H, and by how much the d axis lies beside the current, rad."""

    L_d: Array
    L_q: Array
    beside: Array


#: Beyond that ratio of the inductances a rotor counts as salient; an axis within so many degrees of the current is it.
SALIENT, NEAR = 1.05, 12.0


def d_is_smaller(high: Array, low: Array) -> bool | None:
    """Which inductance is that of d, from those on top of a large and of a small current; None of a round rotor.

    d lies along a small current. Beyond that at which a strongly salient rotor leaves it, the angle between them grows
    with the current, and then L_d is the smaller one.

    Parameters
    ----------
    high, low : (2, 2)
        H.
    """
    values = np.linalg.eigvalsh(high)
    if values[1] < SALIENT * values[0]:
        return None
    angles = [math.degrees(math.atan2(*np.abs(np.linalg.eigh(L)[1][::-1, 0]))) for L in (low, high)]
    aligned = all(min(angle, 90.0 - angle) < NEAR for angle in angles)
    return bool(angles[0] < 45.0) if aligned else True


def axes(L: Array, smaller: bool | None) -> Axes:
    """Sort inductances (N, 2, 2) into L_d and L_q.

    Parameters
    ----------
    L : (N, 2, 2)
    smaller : bool or None
        Whether d has the smaller one; None: the rotor is round, and d lies along the current.
    """
    if smaller is None:
        return Axes(L[:, 0, 0], L[:, 1, 1], np.zeros(len(L)))
    d = 0 if smaller else 1
    values, vectors = np.linalg.eigh(L)
    beside = np.arctan2(np.abs(vectors[:, 1, d]), np.abs(vectors[:, 0, d]))
    return Axes(values[:, d], values[:, 1 - d], beside)
