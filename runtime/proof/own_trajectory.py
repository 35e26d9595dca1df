"""The proof's trajectory for a machine of one's own: the same motion, currents and voltages from its own equations."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from model.machines import MACHINES, Machine, find_machine
from model.machines.base import Parameters, Rotor
from model.quantities import Constants
from model.schema import Drive
from runtime.proof.trajectory import Trajectory, make_trajectory, motion, noisy

Array = NDArray[np.float64]


def trajectory_of(drive: Drive, steps: int | None = None) -> Trajectory:
    """A drive's trajectory, :func:`runtime.proof.trajectory.make_trajectory`'s for a shipped machine.

    For any other machine ``psi`` holds its two electrical states, whatever they are.

    Parameters
    ----------
    drive : Drive
        The drive.
    steps : int, optional
        Number of steps; None: the default.
    """
    if drive.model.machine in MACHINES:
        return make_trajectory(drive.model_dump(), steps=steps)
    T = drive.model.sample_time
    steps = steps or round(0.3 / T)
    machine = find_machine(drive)(Parameters.numeric(drive), Constants(named=False))
    omega, theta, torque = motion(drive.motor.model_dump(), T, steps).T
    z, i = _loaded(drive, machine, theta, torque)
    v = _driven(drive, machine, z[:, ::2], omega, theta)
    t = np.arange(1, steps + 1) * np.float64(T)
    return Trajectory(t, v.T, noisy(i[:, 2::2].T), omega[2::2], theta[2::2], z[:, 2::2].T)


def _loaded(drive: Drive, machine: Machine, theta: Array, torque: Array) -> tuple[Array, Array]:
    """Electrical states and currents (2, N) that make a torque, on the current locus the controller takes.

    Newton on the q current from what [motor] says; where that does not settle, [motor]'s own is kept.
    """
    m = drive.motor
    q, angle, wanted = ca.SX.sym("q"), ca.SX.sym("theta"), ca.SX.sym("torque")
    rotor = Rotor.at(angle)
    i = rotor.to_stator(_locus(drive, q))
    z = machine.electrical_state(i, rotor)
    excess = ca.SX(machine.torque(z, rotor)) - wanted
    closer = ca.Function("closer", [q, angle, wanted], [q - excess / ca.jacobian(excess, q)]).map(theta.size)
    start = torque / (1.5 * m.pole_pairs * m.magnet_flux)
    found = start
    for _ in range(8):
        found = np.array(closer(found[None, :], theta[None, :], torque[None, :])).ravel()
    sane = np.isfinite(found) & (np.abs(found) <= drive.operating_box.current)
    located = ca.Function("located", [q, angle], [ca.vertcat(*z), ca.vertcat(*i)]).map(theta.size)
    states, currents = located(np.where(sane, found, start)[None, :], theta[None, :])
    return np.array(states), np.array(currents)


def _locus(drive: Drive, q: Any) -> tuple[Any, Any]:
    """i_d, i_q in A: i_d = 0, or maximum torque per ampere by [motor]'s saliency (:mod:`model.loop.controller`)."""
    m = drive.motor
    saliency = m.inductance_q - m.inductance_d
    if saliency == 0.0:
        return 0.0, q
    half = m.magnet_flux / (2 * saliency)
    i_d = half - ca.sqrt(half * half + q * q)
    return i_d, q / (1 - saliency / m.magnet_flux * i_d)


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
