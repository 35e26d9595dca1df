"""What an inverter with dead time takes from the voltage it is asked for, where its phase currents pass zero.

A leg changes late where the current keeps the other diode conducting: that hangs on the sign of the current at that
very edge, and the current there is the sampled one and the ripple since. With small voltages the legs change one after
the other within the dead time itself, so that the edges have to be followed one by one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

#: Instants of a row at which signs are looked at.
WITHIN = 24
#: Axes of the three legs, as complex numbers.
AXES = np.exp(2j * math.pi * np.arange(3) / 3)


@dataclass(frozen=True)
class Inverter:
    """DC link V, sample time s, dead time s; inductances H of the machine behind it."""

    dc_link: float
    T: float
    dead_time: float
    L_d: float
    L_q: float


def mean_sign_loss(rows: Array, V_d: float, T: float) -> Array:
    """What legs lose by the signs of the rows' currents, without ripple, V in the frame, as complex numbers (N,).

    Parameters
    ----------
    rows : (N, 8)
    V_d : float
        V.
    T : float
        Sample time, s.
    """
    frame = _frames(rows, T)
    i = (rows[:, 4] + 1j * rows[:, 5])[:, None] * frame
    lost = sum(V_d * 2 / 3 * np.sign((i * np.conj(axis)).real) * axis for axis in AXES)
    return np.asarray((lost / frame).mean(axis=1))


def followed_loss(rows: Array, inverter: Inverter) -> complex:
    """What legs lose, every edge followed, V in the frame: the mean over a whole number of sixths of a turn.

    Parameters
    ----------
    rows : (N, 8)
        Of some sixths of a turn, and so fine that each has many of them.
    inverter : Inverter
    """
    T, omega = inverter.T, rows[:, 6].mean()
    every = round(float(np.median(np.diff(rows[:, 0]))))
    step = abs(omega) * every * T
    count = max(1, round(int((len(rows) - 1) * step / (math.pi / 3)) * (math.pi / 3) / step))
    if every == 1:  # the interval of a row begins with the current of the row before
        u, i, begin = rows[1:, 2:4], rows[:-1, 4:6], np.exp(1j * rows[:-1, 7])[:, None]
    else:
        u, i, begin = rows[:, 2:4], rows[:, 4:6], _frames(rows, T)
    u, i, begin = u[:count], i[:count], begin[:count]
    middle = begin * np.exp(0.5j * omega * T)
    u_stator = ((u[:, 0] + 1j * u[:, 1])[:, None] * middle).ravel()
    i_stator = ((i[:, 0] + 1j * i[:, 1])[:, None] * begin).ravel()
    lost = _interval_loss(u_stator, i_stator, middle.ravel(), omega, inverter)
    return complex((lost / middle.ravel()).mean())


def _frames(rows: Array, T: float) -> Array:
    """The frame's axis at instants within each row, (N, WITHIN)."""
    length = np.median(np.diff(rows[:, 0])) * T
    back = (np.arange(WITHIN) + 0.5) / WITHIN * length
    return np.asarray(np.exp(1j * (rows[:, 7, None] - rows[:, 6, None] * back)))


def _interval_loss(u: Array, i: Array, axis: Array, omega: float, inverter: Inverter) -> Array:
    """Asked less applied voltage of intervals, V in the stator, (N,): a carrier period, legs centred.

    ``i`` is the current at the beginning; the back-EMF is what leaves its turning as it is.
    """
    T, V = inverter.T, inverter.dc_link
    leg = (u[:, None] * np.conj(AXES)).real
    duty = 0.5 + (leg - (leg.max(axis=1) + leg.min(axis=1))[:, None] / 2) / V
    V_d = V * inverter.dead_time / T
    signs = np.sign((i[:, None] * np.conj(AXES)).real)
    i_frame = i / axis
    slope = 1j * omega * (inverter.L_d * i_frame.real + 1j * inverter.L_q * i_frame.imag) * axis
    emf = u - V_d * 2 / 3 * (signs * AXES).sum(axis=1) - slope
    applied = np.zeros(len(u), dtype=complex)
    for before, edge in ((0, T / 2 * (1 - duty)), (1, T / 2 * duty)):
        i, flux = _half_period(i, emf, axis, edge, before, inverter)
        applied += flux
    return u - applied / T


def _half_period(
    i: Array, emf: Array, axis: Array, edge: Array, before: int, inverter: Inverter
) -> tuple[Array, Array]:
    """Current at the end, and volt seconds, of half a carrier period in which every leg leaves ``before`` once."""
    count, end = len(i), inverter.T / 2
    state = np.full((count, 3), float(before))
    due, asked = edge.copy(), np.zeros((count, 3), dtype=bool)
    at, flux = np.zeros(count), np.zeros(count, dtype=complex)
    rows = np.arange(count)
    for _ in range(7):
        leg = due.argmin(axis=1)
        until = np.minimum(due[rows, leg], end)
        v = 2 / 3 * inverter.dc_link * (state * AXES).sum(axis=1)
        flux += v * (until - at)
        driving = (v - emf) * (until - at) / axis
        i = i + (driving.real / inverter.L_d + 1j * driving.imag / inverter.L_q) * axis
        at = until
        late = (((i * np.conj(AXES[leg])).real > 0) == (before == 0)) & ~asked[rows, leg]
        changes = ~late & (due[rows, leg] < end)
        state[rows[changes], leg[changes]] = 1 - before
        asked[rows, leg] = True
        due[rows, leg] = np.where(late, due[rows, leg] + inverter.dead_time, np.inf)
    return i, flux
