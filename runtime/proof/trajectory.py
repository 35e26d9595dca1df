"""A PMSM trajectory to prove on: accelerate to 1000 r/min, then take a 5 N m load step.

Made backwards, without a current controller: a speed loop on the mechanics gives torque, torque gives
currents (i_d = 0), currents and angle give flux linkages, and the voltage is what moves one flux linkage
to the next. So u is exactly the mean over each interval, for any sample time and either machine.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Trajectory:
    """Recorded data: t (N,) s; u (N, 2) V, mean over the interval ending at t; y (N, 2) A with noise; truth.

    omega (N,) rad/s mechanical, theta (N,) rad electrical (unwrapped), psi (N, 2) Wb.
    """

    t: Array
    u: Array
    y: Array
    omega: Array
    theta: Array
    psi: Array


def make_trajectory(
    parameters: Mapping[str, Any],
    steps: int | None = None,
    speed: float = 1000.0,
    load: float = 5.0,
    noise: float = 0.05,
    seed: int = 1,
) -> Trajectory:
    """Start, reach ``speed`` (r/min) at 0.15 s, take ``load`` (N m) at 0.2 s, go on.

    Parameters
    ----------
    parameters : mapping
        A drive file's parsed sections ``motor`` and ``model``.
    steps : int, optional
        Default: 0.3 s.
    noise : float
        Standard deviation of the measured currents, A.
    """
    m, T = parameters["motor"], parameters["model"]["sample_time"]
    steps = steps or round(0.3 / T)
    omega, theta, torque = motion(m, T, steps, speed, load).T
    i_q = torque / (1.5 * m["pole_pairs"] * m["magnet_flux"])  # i_d = 0
    rotor = np.exp(1j * theta)
    i = 1j * i_q * rotor
    psi = (m["magnet_flux"] + 1j * m["inductance_q"] * i_q) * rotor
    mean_i = (i[:-1:2] + 4 * i[1::2] + i[2::2]) / 6  # Simpson over each interval
    v = (psi[2::2] - psi[:-1:2]) / T + m["stator_resistance"] * mean_i
    measured = noisy(_pairs(i[2::2]), noise, seed)
    t = T * np.arange(1, steps + 1)
    return Trajectory(t, _pairs(v), measured, omega[2::2], theta[2::2], _pairs(psi[2::2]))


def noisy(i: Array, noise: float = 0.05, seed: int = 1) -> Array:
    """Currents (N, 2) as sensors with that standard deviation (A) give them.

    Parameters
    ----------
    i : ndarray
        Currents, A.
    noise : float, optional
    seed : int, optional
        Seed of what is random.
    """
    return i + np.random.default_rng(seed).normal(0.0, noise, i.shape)


def motion(m: Mapping[str, Any], T: float, steps: int, speed: float = 1000.0, load: float = 5.0) -> Array:
    """Rows omega, theta, torque every T / 2, 2 steps + 1 of them; speed in r/min, load in N m.

    Parameters
    ----------
    m : mapping of str to Any
    T : float
        Sample time, s.
    steps : int
        Number of steps.
    speed : float, optional
        Mechanical speed, rad/s.
    load : float, optional
        Load torque, N m.
    """
    return _mechanics(m, T / 2, 2 * steps, speed * math.pi / 30, load)


def _pairs(values: NDArray[np.complex128]) -> Array:
    return np.column_stack([values.real, values.imag])


def _mechanics(m: Mapping[str, Any], dt: float, steps: int, speed: float, load: float) -> Array:
    """Rows omega, theta, torque at 0, dt, 2 dt, ...: a PI speed loop (60 rad/s) behind a 1 ms torque lag, RK4.

    From 0.4 s on, long settled, speed and torque are held.
    """
    J, D, p = m["inertia"], m["friction"], m["pole_pairs"]
    bandwidth, lag, ramp, load_at, held_from = 60.0, 1e-3, 0.15, 0.2, 0.4

    def slope(t: float, s: Array) -> Array:
        omega, _, torque, integral = s
        wanted = speed * min(t / ramp, 1.0)
        error = wanted - omega
        command = 2 * bandwidth * J * error + bandwidth**2 * J * integral + (J * speed / ramp if t < ramp else 0.0)
        T_L = load if t >= load_at else 0.0
        return np.array([(torque - T_L - D * omega) / J, p * omega, (command - torque) / lag, error])

    state = np.zeros(4)
    rows = np.empty((steps + 1, 3))
    rows[0] = state[:3]
    moving = min(steps, round(held_from / dt))
    for k in range(moving):
        t = k * dt
        k1 = slope(t, state)
        k2 = slope(t + dt / 2, state + dt / 2 * k1)
        k3 = slope(t + dt / 2, state + dt / 2 * k2)
        k4 = slope(t + dt, state + dt * k3)
        state = state + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        rows[k + 1] = state[:3]
    omega, theta, torque = rows[moving]
    rows[moving:, 0], rows[moving:, 2] = omega, torque
    rows[moving:, 1] = theta + p * omega * dt * np.arange(steps + 1 - moving)
    return rows
