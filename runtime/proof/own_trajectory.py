"""The motion that a drive is proved on; and for a machine of one's own its data, from the machine's own equations."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from model.machines import MACHINES, Machine, find_machine
from model.machines.base import Parameters, Rotor
from model.quantities import Constants
from model.rating import inverter_voltage, mtpa_current, rating, sensor_noise
from model.schema import Drive
from runtime.proof.inverter import commanded
from runtime.proof.trajectory import Motion, Trajectory, locus, make_trajectory, noisy

Array = NDArray[np.float64]

#: Shares of the largest torque that accelerates, of base speed, of the voltage that builds up the current, and of the
#: speed that a step of load may take.
ACCELERATION, OF_BASE, BUILD_UP, DIP = 0.5, 0.8, 0.5, 0.2
#: Largest lag over the ramp's time, and largest bandwidth over the sample rate.
LONGEST_LAG, WIDEST_BAND = 0.1, 0.1
#: What is still beyond reach then is tried with the longest lag, and made smaller by this factor, so many times.
SHRINK, MOST_SHRUNK = 0.7, 40


def motion_of(drive: Drive) -> Motion:
    """The drive's rated speed and load, as far as its motor gets in the time with its current and voltage.

    Parameters
    ----------
    drive : Drive
    """
    task, m, T = rating(drive), drive.motor, drive.model.sample_time
    usual, volts = Motion(task.speed, task.torque), BUILD_UP * inverter_voltage(drive)
    inductance = max(m.inductance_d, m.inductance_q)
    speed = min(task.speed, OF_BASE * task.base_speed, ACCELERATION * task.largest_torque * usual.ramp / m.inertia)
    starting = mtpa_current(drive, m.inertia * speed / usual.ramp)
    lag, longest = max(usual.lag, T, inductance * starting / volts), LONGEST_LAG * usual.ramp
    speed, lag = speed * min(1.0, longest / lag), min(lag, longest)
    load = min(task.torque, task.largest_torque)
    widest = min(WIDEST_BAND / T, volts / (2 * inductance * mtpa_current(drive, load)))
    holding = load / (m.inertia * math.e * DIP * speed)
    bandwidth = min(max(usual.bandwidth, holding), widest)
    load *= min(1.0, bandwidth / holding)
    sizes = SHRINK ** np.arange(MOST_SHRUNK + 1)
    tried = (Motion(k * speed, k * load, lag=at, bandwidth=bandwidth) for k in sizes.tolist() for at in (lag, longest))
    return next((motion for motion in tried if _within_reach(drive, motion)), Motion(0.0, 0.0, lag=longest))


def _within_reach(drive: Drive, motion: Motion) -> bool:
    """Whether the motion asks for no more voltage than the inverter has, and no more current than the box."""
    data = make_trajectory(drive.model_dump(), motion, noise=0.0)
    return bool(
        np.max(np.hypot(*data.u.T)) <= inverter_voltage(drive)
        and np.max(np.hypot(*data.y.T)) <= drive.operating_box.current
    )


def trajectory_of(
    drive: Drive, steps: int | None = None, noise: float | None = None, motion: Motion | None = None
) -> Trajectory:
    """A drive's trajectory, :func:`runtime.proof.trajectory.make_trajectory`'s for a shipped machine.

    For any other machine ``psi`` holds its two electrical states, whatever they are.

    Parameters
    ----------
    drive : Drive
        The drive.
    steps : int, optional
        Number of steps; None: the default.
    noise : float, optional
        A rms; None: :func:`model.rating.sensor_noise`.
    motion : Motion, optional
        None: :func:`motion_of`.
    """
    motion, noise = motion or motion_of(drive), sensor_noise(drive.filter.measurement_noise) if noise is None else noise
    if drive.model.machine in MACHINES:
        return make_trajectory(drive.model_dump(), motion, steps, noise)
    m, T = drive.motor, drive.model.sample_time
    steps = steps or round(0.3 / T)
    machine = find_machine(drive)(Parameters.numeric(drive), Constants(named=False))
    omega, turned, torque = motion.at(T / 2 * np.arange(2 * steps + 1), m.inertia, m.friction)
    theta = m.pole_pairs * turned
    z, i = _loaded(drive, machine, theta, torque)
    v = _driven(drive, machine, z[:, ::2], omega, theta)
    t = np.arange(1, steps + 1) * np.float64(T)
    u = commanded(drive.model_dump(), v.T, i[:, 1::2].T)
    return Trajectory(t, u, noisy(i[:, 2::2].T, noise), omega[2::2], theta[2::2], z[:, 2::2].T)


def _loaded(drive: Drive, machine: Machine, theta: Array, torque: Array) -> tuple[Array, Array]:
    """Electrical states and currents (2, N) that make a torque, on the current locus that [motor] says.

    Newton on the q current by the machine's own torque; where that does not settle, [motor]'s own is kept.
    """
    d, start = locus(drive.motor.model_dump(), torque)
    i_d, q, angle, wanted = (ca.SX.sym(name) for name in ("d", "q", "theta", "torque"))
    rotor = Rotor.at(angle)
    i = rotor.to_stator((i_d, q))
    z = machine.electrical_state(i, rotor)
    excess = ca.SX(machine.torque(z, rotor)) - wanted
    closer = ca.Function("closer", [i_d, q, angle, wanted], [q - excess / ca.jacobian(excess, q)]).map(theta.size)
    found = start
    for _ in range(8):
        found = np.array(closer(d[None, :], found[None, :], theta[None, :], torque[None, :])).ravel()
    sane = np.isfinite(found) & (np.abs(found) <= drive.operating_box.current)
    located = ca.Function("located", [i_d, q, angle], [ca.vertcat(*z), ca.vertcat(*i)]).map(theta.size)
    states, currents = located(d[None, :], np.where(sane, found, start)[None, :], theta[None, :])
    return np.array(states), np.array(currents)


def _driven(drive: Drive, machine: Machine, z: Array, omega: Array, theta: Array) -> Array:
    """Voltages (2, N), held over each sample, that take each state to the next: z (2, N + 1); the rest every T / 2.

    One Runge-Kutta step a sample, solved for v: two Newton steps, of which linear equations need one.
    """
    T, p = drive.model.sample_time, drive.motor.pole_pairs
    start, end, v, moving = (ca.SX.sym(name, n) for name, n in (("z", 2), ("end", 2), ("v", 2), ("moving", 6)))

    def slope(at: Any, k: int) -> Any:
        rotor = Rotor.at(moving[3 + k])
        return ca.vertcat(*machine.derivative((at[0], at[1]), (v[0], v[1]), p * moving[k], rotor))

    k1 = slope(start, 0)
    k2 = slope(start + T / 2 * k1, 1)
    k3 = slope(start + T / 2 * k2, 1)
    k4 = slope(start + T * k3, 2)
    missed = start + T / 6 * (k1 + 2 * k2 + 2 * k3 + k4) - end
    closer = ca.Function("closer", [start, end, v, moving], [v - ca.solve(ca.jacobian(missed, v), missed)])
    steps = z.shape[1] - 1
    rows = [series[first : first + 2 * steps : 2] for series in (omega, theta) for first in (0, 1, 2)]
    found = np.zeros((2, steps))
    for _ in range(2):
        found = np.array(closer.map(steps)(z[:, :-1], z[:, 1:], found, np.array(rows)))
    return found
