"""A motor, its controller and an averaged inverter in plain NumPy, of which no equation is the project's.

d-q currents, speed and angle by Runge and Kutta's fourth-order rule; the controller knows the angle. Many draws of the
sensors' noise run side by side, as arrays. Recordings of it are what ``identify`` is judged by.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime.recorded.data import Recorded

Array = NDArray[np.float64]
SUBSTEPS = 5


@dataclass(frozen=True)
class Motor:
    """Data in SI, and the task: mechanical rad/s, N m, A."""

    name: str
    R: float
    L_d: float
    L_q: float
    psi_m: float
    p: int
    J: float
    dc_link: float
    max_current: float
    speed: float
    torque: float
    T: float = 100e-6
    D: float = 0.0


MOTORS = {
    motor.name: motor
    for motor in (
        Motor("pump", 3.6, 36e-3, 51e-3, 0.545, 3, 0.015, 540.0, 15.0, 104.7, 5.0),
        Motor("bench", 2.875, 8.5e-3, 8.5e-3, 0.175, 4, 0.008, 311.0, 20.0, 104.7, 5.0),
        Motor("press", 0.6, 4e-3, 9e-3, 0.25, 4, 0.01, 400.0, 30.0, 150.0, 12.0),
        Motor("spindle", 1.2, 6e-3, 6e-3, 0.2, 2, 0.002, 400.0, 20.0, 300.0, 3.0),
    )
}


def derivatives(m: Motor, s: Array, v_alpha: Array, v_beta: Array, load: float) -> Array:
    """d/dt of i_d, i_q, omega, theta."""
    i_d, i_q, omega, theta = s
    w = m.p * omega
    v_d = v_alpha * np.cos(theta) + v_beta * np.sin(theta)
    v_q = v_beta * np.cos(theta) - v_alpha * np.sin(theta)
    torque = 1.5 * m.p * (m.psi_m * i_q + (m.L_d - m.L_q) * i_d * i_q)
    return np.stack(
        [
            (v_d - m.R * i_d + w * m.L_q * i_q) / m.L_d,
            (v_q - m.R * i_q - w * (m.L_d * i_d + m.psi_m)) / m.L_q,
            (torque - load - m.D * omega) / m.J,
            w,
        ]
    )


def moved(m: Motor, s: Array, u: Array, load: float) -> Array:
    """The state a sample later."""
    h = m.T / SUBSTEPS
    for _ in range(SUBSTEPS):
        k_1 = derivatives(m, s, *u, load)
        k_2 = derivatives(m, s + h / 2 * k_1, *u, load)
        k_3 = derivatives(m, s + h / 2 * k_2, *u, load)
        k_4 = derivatives(m, s + h * k_3, *u, load)
        s = s + h / 6 * (k_1 + 2 * k_2 + 2 * k_3 + k_4)
    return s


def recordings(
    m: Motor,
    draws: int,
    seconds: float = 0.4,
    noise: float = 0.05,
    seed: int = 1,
    speed: float = 1.0,
    load: float = 0.3,
    steps_at: float = 0.0,
) -> list[Recorded]:
    """Run up to a share of rated speed with a share of rated torque against it; a recording a draw of the noise.

    The speed reference ramps in the first half and steps down by a fifth at three quarters; d current is a fifth of q.
    The load is there from the share ``steps_at`` of the time on.
    """
    T, steps = m.T, round(seconds / m.T)
    rng = np.random.default_rng(seed)
    s = np.zeros((4, draws))
    u = np.zeros((2, draws))
    sums = np.zeros((3, draws))
    rows = np.empty((steps, 7, draws))
    bandwidth = 2 * np.pi * 150
    for k in range(steps):
        i_d, i_q, omega, theta = s
        i_alpha = i_d * np.cos(theta) - i_q * np.sin(theta) + noise * rng.normal(size=draws)
        i_beta = i_d * np.sin(theta) + i_q * np.cos(theta) + noise * rng.normal(size=draws)
        t = k / steps
        T_L = load * m.torque if t >= steps_at else 0.0
        rows[k] = [*u, i_alpha, i_beta, omega, theta, np.full(draws, T_L)]
        wanted = speed * m.speed * min(2 * t, 1.0) * (0.8 if t > 0.75 else 1.0)
        off = wanted - omega
        gain = m.J * 60.0 / (1.5 * m.p * m.psi_m)
        sums[2] += off * T
        q = np.clip(gain * (2 * off + 60.0 * sums[2]), -0.8 * m.max_current, 0.8 * m.max_current)
        m_d = i_alpha * np.cos(theta) + i_beta * np.sin(theta)
        m_q = i_beta * np.cos(theta) - i_alpha * np.sin(theta)
        e_d, e_q = -0.2 * np.abs(q) - m_d, q - m_q
        sums[0] += e_d * T
        sums[1] += e_q * T
        w = m.p * omega
        v_d = bandwidth * (m.L_d * e_d + m.R * sums[0]) - w * m.L_q * m_q
        v_q = bandwidth * (m.L_q * e_q + m.R * sums[1]) + w * (m.L_d * m_d + m.psi_m)
        size = np.maximum(1.0, np.hypot(v_d, v_q) / (m.dc_link / np.sqrt(3)))
        turned = theta + w * T / 2
        u = np.stack([v_d * np.cos(turned) - v_q * np.sin(turned), v_d * np.sin(turned) + v_q * np.cos(turned)]) / size
        s = moved(m, s, u, T_L)
    t = T * np.arange(steps)
    return [
        Recorded(
            Path(f"{m.name}_{draw}.npz"),
            t,
            rows[:, :2, draw],
            rows[:, 2:4, draw],
            {"omega": rows[:, 4, draw], "theta": rows[:, 5, draw], "load_torque": rows[:, 6, draw]},
        )
        for draw in range(draws)
    ]
