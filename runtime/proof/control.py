"""The controller in plain NumPy, by hand: phasors where the model writes pairs. Imports nothing it is to check."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

#: Where dead-time compensation reaches its full size, A; least DC link, V; largest sensed angle, rad.
DEAD_CURRENT, LEAST_LINK, SENSED_MAX = 0.3, 1.0, 1000.0
#: A third of a turn.
THIRD = np.exp(2j * math.pi / 3)


def gains_of(parameters: Mapping[str, Any], delay: int) -> Array:
    """Pole placement in the order of the struct: speed p, i; current p on d, on q, i; limit; dead time; advance."""
    m, c, T = parameters["motor"], parameters["control"], parameters["model"]["sample_time"]
    speed, current = c["speed_bandwidth"], c["current_bandwidth"]
    J, R = m["inertia"], m["stator_resistance"]
    regulators = [2 * speed * J, speed * speed * J * T, current * m["inductance_d"], current * m["inductance_q"]]
    return np.array([*regulators, current * R * T, c["max_current"], 0.0, DEAD_CURRENT, T / 2 + delay * T])


def clarke(phase: Array) -> complex:
    """Phase currents a and b (A), star point open: the third is what is missing to zero. Alpha is phase a."""
    a, b = phase
    c = -a - b
    return complex(a, (b - c) / math.sqrt(3))


def control(
    parameters: Mapping[str, Any], i: complex, rotor: Array, command: Array, gain: Array, integrator: Array
) -> tuple[Array, complex, Array]:
    """One sample: duty cycles (3,), the voltage they stand for (V), integrators (3,).

    ``i`` in A; ``rotor``: mechanical rad/s, electrical rad; ``command``: rad/s, V of the DC link.
    """
    m = parameters["motor"]
    speed_p, speed_i, d_p, q_p, current_i, most, dead_share, dead_current, advance = gain
    omega, theta = rotor
    torque_per_ampere = 1.5 * m["pole_pairs"] * m["magnet_flux"]
    error = command[0] - omega
    wanted = speed_p * error + integrator[0]
    torque = float(np.clip(wanted, -torque_per_ampere * most, torque_per_ampere * most))
    z_speed = integrator[0] + speed_i * (error + (torque - wanted) / speed_p)
    i_ref = _references(m, torque)
    i_dq = i * np.exp(-1j * theta)
    missing = i_ref - i_dq
    omega_e = m["pole_pairs"] * omega
    flux = m["magnet_flux"] + m["inductance_d"] * i_dq.real + 1j * m["inductance_q"] * i_dq.imag
    v = d_p * missing.real + 1j * q_p * missing.imag + complex(*integrator[1:]) + 1j * omega_e * flux
    link = max(command[1], LEAST_LINK)
    limited = v * min(1.0, link / math.sqrt(3) / abs(v)) if v else v
    z_d = integrator[1] + current_i * (missing.real + (limited - v).real / d_p)
    z_q = integrator[2] + current_i * (missing.imag + (limited - v).imag / q_p)
    v_stator = limited * np.exp(1j * (theta + omega_e * advance))
    legs, currents = (np.real(x * THIRD ** -np.arange(3)) for x in (v_stator, i))
    middle = (legs.max() + legs.min()) / 2
    duty = 0.5 + (legs - middle) / link + dead_share * np.clip(currents / dead_current, -1, 1)
    return np.clip(duty, 0, 1), complex(v_stator), np.array([z_speed, z_d, z_q])


def _references(m: Mapping[str, Any], torque: float) -> complex:
    """Currents that make a torque: i_d = 0, or where the axes differ maximum torque per ampere, one pass."""
    i_q = torque / (1.5 * m["pole_pairs"] * m["magnet_flux"])
    less = m["inductance_q"] - m["inductance_d"]
    if not less:
        return complex(0.0, i_q)
    half = m["magnet_flux"] / (2 * less)
    i_d = half - math.hypot(half, i_q)
    return complex(i_d, torque / (1.5 * m["pole_pairs"] * (m["magnet_flux"] - less * i_d)))
