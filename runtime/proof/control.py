"""The controller in plain NumPy, by hand: phasors where the model writes pairs. Imports nothing it is to check."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.proof.inverter import make_inverter

Array = NDArray[Any]

#: Where dead-time compensation of a drive that says nothing of its inverter reaches its full size, A; least DC link, V;
#: largest sensed angle, rad.
DEAD_CURRENT, LEAST_LINK, SENSED_MAX = 0.3, 1.0, 1000.0
#: A third of a turn.
THIRD = np.exp(2j * math.pi / 3)


def gains_of(parameters: Mapping[str, Any], delay: int) -> Array:
    """Pole placement in the order of the struct: speed p, i; current p on d, on q, i; limit; dead time; advance.

    Parameters
    ----------
    parameters : mapping of str to Any
        Sections of the drive file, parsed.
    delay : int
        Samples from measuring to acting, 0 or 1.
    """
    m, c, T = parameters["motor"], parameters["control"], parameters["model"]["sample_time"]
    speed, current = c["speed_bandwidth"], c["current_bandwidth"]
    J, R = m["inertia"], m["stator_resistance"]
    regulators = [2 * speed * J, speed * speed * J * T, current * m["inductance_d"], current * m["inductance_q"]]
    inverter = make_inverter(parameters)
    dead = [1.0, inverter.compensated] if inverter else [0.0, DEAD_CURRENT]
    return np.array([*regulators, current * R * T, c["max_current"], *dead, T / 2 + delay * T])


def clarke(phase: Array) -> complex:
    """Phase currents a and b (A), star point open: the third is what is missing to zero. Alpha is phase a.

    Parameters
    ----------
    phase : ndarray
        Phase currents i_a, i_b, A.
    """
    a, b = phase
    c = -a - b
    return complex(a, (b - c) / math.sqrt(3))


@dataclass(frozen=True)
class Sample:
    """One sample by hand.

    Duty cycles (3,), the voltage (V) the filter is told of, integrators (3,), and on the way the largest torque and the
    torque that is asked for (N m).
    """

    duty: Array
    v: complex
    integrator: Array
    torque_limit: float
    torque: float


def control(
    parameters: Mapping[str, Any],
    i: complex,
    rotor: Array,
    x: Array,
    command: Array,
    gain: Array,
    integrator: Array,
    i_ref: complex | None = None,
) -> Sample:
    """Compute one sample of the controller.

    Parameters
    ----------
    parameters : mapping
        Sections of the drive file.
    i : complex
        Stator current, A.
    rotor : ndarray, (2,)
        Mechanical speed, rad/s, and electrical angle, rad.
    x : ndarray, (n,)
        The filter's state, where V_d may be in it, V.
    command : ndarray, (2,)
        Speed reference, rad/s, and DC link, V.
    gain : ndarray, (9,)
        In the order of the struct.
    integrator : ndarray, (3,)
        Of speed, N m, and of d and q current, V.
    i_ref : complex, optional
        Reference currents on the rotor's axes, A; by default the least that make the torque.
    """
    m = parameters["motor"]
    speed_p, speed_i, d_p, q_p, current_i, most, dead_share, dead_current, advance = gain
    omega, theta = rotor
    error = command[0] - omega
    wanted = speed_p * error + integrator[0]
    limit = torque_of(m, best_currents(m, most, of_current))
    torque = float(np.clip(wanted, -limit, limit))
    z_speed = integrator[0] + speed_i * error + min(speed_i / speed_p, 1.0) * (torque - wanted)
    if i_ref is None:
        i_ref = best_currents(m, torque, torque_of)
    i_dq = i * np.exp(-1j * theta)
    missing = i_ref - i_dq
    omega_e = m["pole_pairs"] * omega
    flux = m["magnet_flux"] + m["inductance_d"] * i_dq.real + 1j * m["inductance_q"] * i_dq.imag
    v = d_p * missing.real + 1j * q_p * missing.imag + complex(*integrator[1:]) + 1j * omega_e * flux
    link = max(command[1], LEAST_LINK)
    limited = v * min(1.0, link / math.sqrt(3) / abs(v)) if v else v
    z_d = integrator[1] + current_i * missing.real + min(current_i / d_p, 1.0) * (limited - v).real
    z_q = integrator[2] + current_i * missing.imag + min(current_i / q_p, 1.0) * (limited - v).imag
    v_stator = limited * np.exp(1j * (theta + omega_e * advance))
    legs, currents = (np.real(x * THIRD ** -np.arange(3)) for x in (v_stator, i))
    middle = (legs.max() + legs.min()) / 2
    inverter = make_inverter(parameters)
    lost = dead_share * float(np.ravel(inverter.voltage(x))[0]) / link if inverter else dead_share
    duty = np.clip(0.5 + (legs - middle) / link + lost * np.clip(currents / dead_current, -1, 1), 0, 1)
    told = link * 2 / 3 * np.sum(duty * THIRD ** np.arange(3)) if inverter else v_stator
    return Sample(duty, complex(told), np.array([z_speed, z_d, z_q]), limit, torque)


def torque_of(motor: Mapping[str, Any], i_dq: complex) -> float:
    """Return 1.5 p (psi_m + (L_d - L_q) i_d) i_q, N m.

    Parameters
    ----------
    motor : mapping
        The drive file's section.
    i_dq : complex
        Currents on the rotor's axes, A.
    """
    flux = motor["magnet_flux"] + (motor["inductance_d"] - motor["inductance_q"]) * i_dq.real
    return float(1.5 * motor["pole_pairs"] * flux * i_dq.imag)


def of_current(motor: Mapping[str, Any], i_dq: complex) -> float:
    """Return the size of a current, A, with the sign of its torque; ``motor`` is not asked.

    Parameters
    ----------
    motor : mapping
    i_dq : complex
        Currents on the rotor's axes, A.
    """
    return math.copysign(abs(i_dq), i_dq.imag)


def best_currents(
    motor: Mapping[str, Any], wanted: float, figure: Callable[[Mapping[str, Any], complex], float]
) -> complex:
    """Find the currents of maximum torque per ampere of which a figure is as wanted, by bisection.

    At a lead delta of the current against the q axis torque changes with delta by cos(2 delta) of its reluctance part
    and by sin(delta) of its magnet part; where these cancel is the best lead for the current
    psi_m sin(delta) / (abs(L_q - L_d) cos(2 delta)). Current and torque grow with tan(2 delta), so that halving the
    logarithm of that finds what is wanted; neither end of the range loses digits.

    Parameters
    ----------
    motor : mapping
        The drive file's section.
    wanted : float
        Torque, N m, or current, A.
    figure : callable
        :func:`torque_of` or :func:`of_current`.

    Returns
    -------
    complex
        i_d + j i_q, A.
    """
    less = motor["inductance_q"] - motor["inductance_d"]
    if not wanted:
        return 0j
    if not less:
        return complex(0.0, wanted / figure(motor, 1j))
    sign = math.copysign(1.0, wanted)

    def at(tangent: float) -> complex:
        secant = math.hypot(1.0, tangent)
        lead = complex(math.sqrt((1.0 + 1.0 / secant) / 2.0), 0.0)
        lead += 0.5j * (tangent / secant) / lead.real  # cosine and sine of delta
        size = motor["magnet_flux"] * lead.imag * secant / abs(less)
        return complex(-math.copysign(size * lead.imag, less), sign * size * lead.real)

    low, high = 1e-150, 1e150
    for _ in range(100):
        middle = math.sqrt(low) * math.sqrt(high)
        low, high = (middle, high) if abs(figure(motor, at(middle))) < abs(wanted) else (low, middle)
    return at(high)
