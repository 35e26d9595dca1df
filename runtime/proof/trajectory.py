"""A PMSM trajectory to prove on: accelerate, then take a step of load, each of a size that suits the drive.

Made backwards, without a controller, and in closed form: a prescribed motion asks for a torque, the torque for
currents, currents and angle give flux linkages, and the voltage is what moves one flux linkage to the next. That
voltage is exactly the mean over each interval, for any motor, sample time and shipped machine; u is what to command for
it to arrive.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.proof.inverter import commanded

Array = NDArray[np.float64]

#: Points of the table from torque to current; between two of them the current is at most 1e-6 from the curve.
TABLE = 2000


@dataclass(frozen=True)
class Trajectory:
    """Recorded data: t (N,) s; u (N, 2) V, commanded, mean over the interval ending at t; y (N, 2) A with noise; truth.

    omega (N,) rad/s mechanical, theta (N,) rad electrical (unwrapped), psi (N, 2) Wb.
    """

    t: Array
    u: Array
    y: Array
    omega: Array
    theta: Array
    psi: Array


@dataclass(frozen=True)
class Motion:
    """A ramp to ``speed`` (rad/s mechanical) in ``ramp`` s, and a step to ``load`` (N m) at ``load_at`` s.

    The acceleration follows its ends with the time constant ``lag`` (s). The load pulls the speed down as a regulator
    with a double pole at ``bandwidth`` (rad/s) lets it: by load / (J bandwidth e) at most. So the torque has no jump.
    """

    speed: float
    load: float
    ramp: float = 0.15
    load_at: float = 0.2
    lag: float = 1e-3
    bandwidth: float = 60.0

    def at(self, t: NDArray[Any], inertia: float, friction: float) -> tuple[Array, Array, Array]:
        """Speed (rad/s), its integral (rad) and the electromagnetic torque (N m) behind it.

        Parameters
        ----------
        t : ndarray, (N,)
            s, from 0 on.
        inertia, friction : float
            kg m^2, N m s/rad.
        """
        omega, turned, slope = np.zeros_like(t), np.zeros_like(t), np.zeros_like(t)
        for begin, rate in ((0.0, self.speed / self.ramp), (self.ramp, -self.speed / self.ramp)):
            s = np.maximum(t - begin, 0.0)
            behind = self.lag * -np.expm1(-s / self.lag)
            slope += rate / self.lag * behind
            omega += rate * (s - behind)
            turned += rate * (s * s / 2 - self.lag * (s - behind))
        s = np.maximum(t - self.load_at, 0.0)
        a, taken = self.bandwidth, np.where(t >= self.load_at, self.load, 0.0)
        fading = np.exp(-a * s)
        slope -= taken / inertia * (1 - a * s) * fading
        omega -= taken / inertia * s * fading
        turned -= taken / inertia * (1 - (1 + a * s) * fading) / a**2
        return omega, turned, inertia * slope + friction * omega + taken


def make_trajectory(
    parameters: Mapping[str, Any], motion: Motion, steps: int | None = None, noise: float = 0.05, seed: int = 1
) -> Trajectory:
    """A motor's data along a motion, on the current locus of maximum torque per ampere.

    Parameters
    ----------
    parameters : mapping
        A drive file's parsed sections ``motor`` and ``model``.
    motion : Motion
    steps : int, optional
        Default: 0.3 s.
    noise : float
        Standard deviation of the measured currents, A.
    seed : int, optional
        Seed of what is random.
    """
    m, T = parameters["motor"], parameters["model"]["sample_time"]
    steps = steps or round(0.3 / T)
    half = T / 2 * np.arange(2 * steps + 1)  # and the middle of each interval
    omega, turned, torque = motion.at(half, m["inertia"], m["friction"])
    theta = m["pole_pairs"] * turned
    i_d, i_q = locus(m, torque)
    rotor = np.exp(1j * theta)
    i = (i_d + 1j * i_q) * rotor
    psi = (m["magnet_flux"] + m["inductance_d"] * i_d + 1j * m["inductance_q"] * i_q) * rotor
    mean_i = (i[:-1:2] + 4 * i[1::2] + i[2::2]) / 6  # Simpson over each interval
    v = (psi[2::2] - psi[:-1:2]) / T + m["stator_resistance"] * mean_i
    measured = noisy(_pairs(i[2::2]), noise, seed)
    u = commanded(parameters, _pairs(v), _pairs(mean_i))
    return Trajectory(half[2::2], u, measured, omega[2::2], theta[2::2], _pairs(psi[2::2]))


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


def locus(m: Mapping[str, Any], torque: Array) -> tuple[Array, Array]:
    """i_d, i_q (A) that make a torque: i_d near the least current's, from a table, and i_q from the torque equation.

    Parameters
    ----------
    m : mapping of str to Any
        Motor data.
    torque : ndarray
        N m.
    """
    gain, saliency = 1.5 * m["pole_pairs"], m["inductance_q"] - m["inductance_d"]
    largest = float(np.max(np.abs(torque), initial=0.0))
    if not saliency or not largest:
        return np.zeros_like(torque), torque / (gain * m["magnet_flux"])
    # The magnet alone would need so much current, more than enough where reluctance helps.
    current = largest / (gain * m["magnet_flux"]) * np.linspace(0.0, 1.0, TABLE) ** 2
    ratio = saliency * current / m["magnet_flux"]
    share = 2 * ratio / (1 + np.sqrt(1 + 8 * ratio * ratio))
    made = gain * (m["magnet_flux"] + saliency * share * current) * np.sqrt(1 - share * share) * current
    i_d = np.interp(np.abs(torque), made, -share * current)
    return i_d, torque / (gain * (m["magnet_flux"] - saliency * i_d))


def _pairs(values: NDArray[np.complex128]) -> Array:
    return np.column_stack([values.real, values.imag])
