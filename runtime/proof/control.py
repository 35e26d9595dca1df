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
#: largest sensed angle, rad; a slower rotor's torque is not limited by power, rad/s.
DEAD_CURRENT, LEAST_LINK, SENSED_MAX, SLOWEST = 0.3, 1.0, 1000.0, 1e-3
#: The field is weakened from this share of the largest voltage on, with at most this share of the largest current, this
#: much slower than the currents are regulated; of the magnet's torque per ampere so much is left at least.
ROOM, DEEPEST, SLOWER, LEAST_FLUX = 0.95, 0.95, 0.1, 0.05
#: What the curve of maximum torque per ampere, in a fixed number of operations, may take of the least current, and of
#: its d part.
EXCESS, FURTHER = 1.003, 1.1
#: A third of a turn.
THIRD = np.exp(2j * math.pi / 3)


def gains_of(parameters: Mapping[str, Any], delay: int) -> Array:
    """Pole placement, in the order of the struct.

    Speed p, i; current p on d, on q, i; limit; dead time's share and current; advance; weakening; then the largest
    torque and the largest power, of those that are stated.

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
    room = ROOM * c["dc_link"] / math.sqrt(3)
    base_speed = room / abs(m["magnet_flux"] + 1j * m["inductance_q"] * c["max_current"])  # electrical
    by_volt = SLOWER * current * T / (base_speed * m["inductance_d"])  # A a sample
    advance = T / 2 + delay * T
    stated = [c[key] for key in ("max_torque", "max_power") if c.get(key) is not None]
    return np.array([*regulators, current * R * T, c["max_current"], *dead, advance, by_volt / (2 * room), *stated])


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

    Duty cycles (3,), the voltage (V) the filter is told of, integrators (4,), and on the way the largest torque and the
    torque that is asked for (N m), and the currents that are to make it (A, on the rotor's axes).
    """

    duty: Array
    v: complex
    integrator: Array
    torque_limit: float
    torque: float
    i_ref: complex


def control(
    parameters: Mapping[str, Any],
    i: complex,
    rotor: Array,
    x: Array,
    command: Array,
    gain: Array,
    integrator: Array,
    i_d_best: float | None = None,
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
    gain : ndarray, (10,) or more
        In the order of the struct.
    integrator : ndarray, (4,)
        Of speed, N m, of d and q current, V, and what the field is weakened by, A.
    i_d_best : float, optional
        d current of the least current that makes the torque, A; by default it is found.
    """
    m = parameters["motor"]
    speed_p, speed_i, d_p, q_p, current_i, most, dead_share, dead_current, advance, weakening, *stated = gain
    omega, theta = rotor
    error = command[0] - omega
    wanted = speed_p * error + integrator[0]
    omega_e = m["pole_pairs"] * omega
    limit, deepest = within_reach(m, most, omega_e, integrator[3])
    limit = stated_limit(parameters["control"], list(stated), limit, omega)
    torque = float(np.clip(wanted, -limit, limit))
    z_speed = integrator[0] + speed_i * error + min(speed_i / speed_p, 1.0) * (torque - wanted)
    if i_d_best is None:
        i_d_best = best_currents(m, torque, torque_of).real
    i_ref = weakened_currents(m, most, torque, max(i_d_best + integrator[3], -deepest))
    i_dq = i * np.exp(-1j * theta)
    missing = i_ref - i_dq
    flux = m["magnet_flux"] + m["inductance_d"] * i_dq.real + 1j * m["inductance_q"] * i_dq.imag
    v = d_p * missing.real + 1j * q_p * missing.imag + complex(*integrator[1:3]) + 1j * omega_e * flux
    link = max(command[1], LEAST_LINK)
    limited = v * min(1.0, link / math.sqrt(3) / abs(v)) if v else v
    room = ROOM * link / math.sqrt(3)
    longer = integrator[3] + weakening * max((room - abs(v)) * (room + abs(v)), -(room**2))
    z_weakening = max(min(longer, 0.0), -(deepest + most))
    z_d = integrator[1] + current_i * missing.real + min(current_i / d_p, 1.0) * (limited - v).real
    z_q = integrator[2] + current_i * missing.imag + min(current_i / q_p, 1.0) * (limited - v).imag
    v_stator = limited * np.exp(1j * (theta + omega_e * advance))
    duty, told = modulated(parameters, v_stator, i, x, link, dead_share, dead_current)
    return Sample(duty, told, np.array([z_speed, z_d, z_q, z_weakening]), limit, torque, i_ref)


def stated_limit(control: Mapping[str, Any], stated: list[float], torque: float, omega: float) -> float:
    """The torque (N m) that keeps within what the drive file states.

    Parameters
    ----------
    control : mapping
        The drive file's section: which limits there are.
    stated : list of float
        The gains behind the others: largest torque, N m, and power, W, of those that there are.
    torque : float
        What current and voltage make, N m.
    omega : float
        Speed, rad/s.
    """
    left = list(stated)
    if control.get("max_torque") is not None and torque > left[0]:
        torque = left[0]
    if control.get("max_power") is None:
        return torque
    speed = max(abs(omega), SLOWEST)
    return torque * min(1.0, left[-1] / (torque * speed)) if torque > 0 else torque


def modulated(
    parameters: Mapping[str, Any], v: complex, i: complex, x: Array, link: float, dead_share: float, dead_current: float
) -> tuple[Array, complex]:
    """Duty cycles (3,), and the voltage (V) that the filter is told of.

    Parameters
    ----------
    parameters : mapping
        Sections of the drive file.
    v, i : complex
        Stator voltage that is wanted, V, and current, A.
    x : ndarray, (n,)
        The filter's state, where V_d may be in it, V.
    link : float
        DC link, V.
    dead_share, dead_current : float
        The controller's gains: what is made up for, and below which current (A) less of it.
    """
    legs, currents = (np.real(of * THIRD ** -np.arange(3)) for of in (v, i))
    middle = (legs.max() + legs.min()) / 2
    inverter = make_inverter(parameters)
    lost = dead_share * float(np.ravel(inverter.voltage(x))[0]) / link if inverter else dead_share
    duty = np.clip(0.5 + (legs - middle) / link + lost * np.clip(currents / dead_current, -1, 1), 0, 1)
    return duty, complex(link * 2 / 3 * np.sum(duty * THIRD ** np.arange(3)) if inverter else v)


def within_reach(motor: Mapping[str, Any], most: float, omega_e: float, z: float) -> tuple[float, float]:
    """The largest torque (N m) of currents that the field is weakened with, and how far it is, at most (A).

    Parameters
    ----------
    motor : mapping
        The drive file's section.
    most : float
        The largest current, A.
    omega_e : float
        Electrical speed, rad/s.
    z : float
        What is added to the d current of the least current, A; 0 or negative.
    """
    best = best_currents(motor, most, of_current)
    deepest = least_voltage_current(motor, omega_e, best.real, most)
    i_d = max(best.real + z, -deepest)
    beyond = i_d - best.real - z
    left = max(math.sqrt(max(most**2 - i_d**2, 0.0)) - beyond, 0.0)
    return min(torque_of(motor, best), left * torque_per_ampere(motor, i_d)), deepest


def weakened_currents(motor: Mapping[str, Any], most: float, torque: float, i_d: float) -> complex:
    """Currents with this d part that make a torque, A; of a salient machine no more than the circle allows.

    Parameters
    ----------
    motor : mapping
        The drive file's section.
    most : float
        The largest current, A.
    torque : float
        N m.
    i_d : float
        A.
    """
    is_round = motor["inductance_d"] == motor["inductance_q"]
    circle = math.inf if is_round else math.sqrt(max((EXCESS * most) ** 2 - i_d**2, 0.0))
    return complex(i_d, min(max(torque / torque_per_ampere(motor, i_d), -circle), circle))


def least_voltage_current(motor: Mapping[str, Any], omega_e: float, i_d_best: float, most: float) -> float:
    """How far the field is weakened, A: where the terminals of a motor without torque have the least voltage.

    Of R i_d + j omega_e (psi_m + L_d i_d), linear in i_d, that is the projection of the back-EMF on the impedance.
    Reluctance may go as much further as its torque wants; torque wants a rest of the current.

    Parameters
    ----------
    motor : mapping
        The drive file's section.
    omega_e : float
        Electrical speed, rad/s.
    i_d_best : float
        d current of the largest torque, A.
    most : float
        The largest current, A.
    """
    impedance = complex(motor["stator_resistance"], omega_e * motor["inductance_d"])
    projected = (1j * omega_e * motor["magnet_flux"] / impedance).real
    return float(min(DEEPEST * most, projected + FURTHER * max(-i_d_best, 0.0)))


def torque_per_ampere(motor: Mapping[str, Any], i_d: float) -> float:
    """Return the torque of i_q = 1 A at a d current, N m; some is left where reluctance is against the magnet.

    Parameters
    ----------
    motor : mapping
        The drive file's section.
    i_d : float
        A.
    """
    least = LEAST_FLUX * 1.5 * motor["pole_pairs"] * motor["magnet_flux"]
    return float(max(torque_of(motor, complex(i_d, 1.0)), least))


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
