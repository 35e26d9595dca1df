"""One period of a drive's life, prescribed: speed and load, and the currents and voltages that they ask for.

Made backwards, without a controller: speed and load torque give torque, torque and field weakening give currents,
currents and angle give flux linkages, and the voltage is what moves one flux linkage to the next. So u is exactly the
mean over each interval. The period may be repeated for ever: it ends in the rotor-fixed state it begins in, and the
rotor has turned by an angle that is no part of the circle, so that no two periods are alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

#: s: length of the period.
PERIOD = 4.0
#: s: standing still.
DWELL = 0.004
#: Speed over base speed at these times, s; TOP stands for the top speed, beyond the base speed. From standstill
#: through field weakening either way, through standstill three times, standing still for a while in the end.
TOP = 2.0
SPEED = (
    (0.0, 0.0), (0.12, 0.3), (0.7, 0.3), (1.1, TOP), (1.5, TOP), (2.0, -0.3), (2.4, -0.3), (2.8, -TOP), (3.1, -TOP),
    (3.5, 0.3), (3.8, 0.3), (PERIOD - DWELL, 0.0), (PERIOD, 0.0),
)  # fmt: skip
#: Load torque over that of a third of the largest current, from these times on, s.
LOAD = ((0.0, 0.0), (0.45, 1.0), (1.25, -0.5), (1.4, 0.7), (2.15, -1.0), (2.3, 0.3), (2.95, 0.6), (3.55, 0.0))
#: s: within which load torque and acceleration change from one value to the next.
RISE = 2e-3
#: Top speed over base speed, at most; and of the largest current, what weakens the field.
HIGHEST, WEAKENING = 1.15, 0.8


@dataclass(frozen=True)
class Journey:
    """The period in N samples of T, at k = 0 .. N; complex numbers are alpha + j beta.

    ``u`` (N,) V, mean over the interval from k to k + 1; ``i`` (N + 1,) A and ``theta`` (N + 1,) rad electrical, from 0
    on and unwrapped; ``omega`` (N + 1,) rad/s mechanical; ``load`` (N + 1,) N m; ``base`` rad/s: the base speed.
    """

    u: Complex
    i: Complex
    theta: Array
    omega: Array
    load: Array
    base: float


def make_journey(parameters: Mapping[str, Any]) -> Journey:
    """The period of a drive file's parsed sections ``motor``, ``model`` and ``control``.

    Parameters
    ----------
    parameters : mapping of str to Any
        Sections of the drive file, parsed.
    """
    m, T = parameters["motor"], parameters["model"]["sample_time"]
    steps = round(PERIOD / T)
    t = T / 2 * np.arange(2 * steps + 1)  # and the middle of each interval
    v_max = parameters["control"]["dc_link"] / np.sqrt(3.0)
    base = v_max / (m["pole_pairs"] * m["magnet_flux"])
    i_max = parameters["control"]["max_current"]
    weakest = m["magnet_flux"] - m["inductance_d"] * WEAKENING * i_max
    top = min(HIGHEST, m["magnet_flux"] / weakest) if weakest > 0 else HIGHEST
    omega, slope, turned = _motion(t, base, top)
    unit = 1.5 * m["pole_pairs"] * m["magnet_flux"]
    load = _loads(t) * unit * i_max / 3
    i = _currents(m, omega, m["inertia"] * slope + m["friction"] * omega + load, base)
    theta = m["pole_pairs"] * turned
    rotor = np.exp(1j * theta)
    psi = (m["magnet_flux"] + m["inductance_d"] * i.real + 1j * m["inductance_q"] * i.imag) * rotor
    i = i * rotor
    mean_i = (i[:-1:2] + 4 * i[1::2] + i[2::2]) / 6  # Simpson over each interval
    u = (psi[2::2] - psi[:-1:2]) / T + m["stator_resistance"] * mean_i
    return Journey(u, i[::2], theta[::2], omega[::2], load[::2], base)


def _motion(t: Array, base: float, top: float) -> tuple[Array, Array, Array]:
    """omega rad/s, its slope, its integral: straight from waypoint to waypoint, the slope changing within RISE."""
    omega, slope, turned = np.zeros_like(t), np.zeros_like(t), np.zeros_like(t)
    before = 0.0
    for (begin, first), (end, last) in pairwise(SPEED):
        a, b = (np.sign(w) * min(abs(w), top) * base for w in (first, last))
        after = (b - a) / (end - begin)
        s, late = _rise(t, begin)
        slope += (after - before) * s**3 * (10 - 15 * s + 6 * s**2)
        omega += (after - before) * (RISE * s**4 * (2.5 - 3 * s + s**2) + late)
        turned += (after - before) * (RISE**2 * s**5 * (0.5 - 0.5 * s + s**2 / 7) + late * RISE / 2 + late**2 / 2)
        before = after
    return omega, slope, turned


def _rise(t: Array, begin: float) -> tuple[Array, Array]:
    """How much of a rise that begins then is over, 0 .. 1; and how long it has been over, s."""
    return np.clip((t - begin) / RISE, 0.0, 1.0), np.maximum(t - begin - RISE, 0.0)


def _loads(t: Array) -> Array:
    load = np.zeros_like(t)
    for (begin, value), (_, before) in zip(LOAD[1:], LOAD[:-1], strict=True):
        s, _ = _rise(t, begin)
        load += (value - before) * s**3 * (10 - 15 * s + 6 * s**2)
    return load


def _currents(m: Mapping[str, Any], omega: Array, torque: Array, base: float) -> Complex:
    """i_d + j i_q, A: beyond the base speed i_d keeps omega times the d flux where it was."""
    share = np.minimum(1.0, base / np.maximum(np.abs(omega), base))
    i_d = m["magnet_flux"] * (share - 1.0) / m["inductance_d"]
    per_a = 1.5 * m["pole_pairs"] * (m["magnet_flux"] + (m["inductance_d"] - m["inductance_q"]) * i_d)
    return np.asarray(i_d + 1j * torque / per_a)
