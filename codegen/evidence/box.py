"""Samples of the operating box: random states, covariances, inputs and measurements of a drive."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from model.inverter import STATE, fading_current, takes_voltage
from model.machines import find_machine
from model.machines.adaptive import own_value
from model.machines.base import Parameters, Rotor
from model.machines.state_space import StateSpaceModel
from model.quantities import Constants
from model.schema import Drive

#: Motor data that are states are drawn from this share of the drive file's value.
ADAPTIVE_SHARE = (0.7, 1.3)


@dataclass(frozen=True)
class BoxSamples:
    """Arrays with a trailing sample axis B: x (n, B), P (n(n+1)/2, B) packed, u (2, B) in V, y (2, B) in A."""

    x: np.ndarray
    P: np.ndarray
    u: np.ndarray
    y: np.ndarray


def sample_box(drive: Drive, model: StateSpaceModel, count: int, seed: int = 1) -> BoxSamples:
    """Draw ``count`` situations, values rounded to float32 so that both precisions start from the same numbers.

    Currents, speed and voltage are uniform in the declared box (currents within 70 % of it, so that a
    measurement inside the box can be drawn), the angle is uniform over the circle. One sigma of each state is
    log-uniform between that of one step's process noise and twice that of P_0, the correlation is random.
    The measurement belongs to a true state drawn from the covariance, and carries the measurement noise.

    Parameters
    ----------
    drive : Drive
        The drive.
    model : StateSpaceModel
        The symbolic state space model.
    count : int
        How many.
    seed : int, optional
        Seed of what is random.
    """
    rng = np.random.default_rng(seed)
    n = len(model.states)
    x = _states(drive, rng, count)
    P = _covariances(drive, rng, count, n)
    voltage = drive.operating_box.voltage
    u = np.clip(rng.uniform(-voltage, voltage, (2, count)), -held(voltage), held(voltage))
    root = np.linalg.cholesky(P)
    truth = x + np.einsum("bij,jb->ib", root, rng.uniform(-1.5, 1.5, (n, count)))
    step = ca.Function("step", [model.x, model.u], [model.numeric(model.f_commanded)]).map(count)
    observe = ca.Function("observe", [model.x], [model.numeric(model.h)]).map(count)
    y = np.array(observe(step(truth, u)))
    y += np.sqrt(drive.filter.measurement_noise)[:, None] * rng.uniform(-1.5, 1.5, (2, count))
    most = held(drive.operating_box.current)
    y = np.clip(y, -most, most)
    packed = np.array([P[:, i, j] for i in range(n) for j in range(i + 1)])
    return BoxSamples(*(array.astype(np.float32).astype(float) for array in (x, packed, u, y)))


def held(limit: float) -> float:
    """The largest float32 that is not beyond a limit of the drive file, in either precision.

    Parameters
    ----------
    limit : float
    """
    nearest = np.float32(limit)
    return float(nearest if float(nearest) <= limit else np.nextafter(nearest, np.float32(0.0)))


def _states(drive: Drive, rng: np.random.Generator, count: int) -> np.ndarray:
    box = drive.operating_box
    i = rng.uniform(-0.7 * box.current, 0.7 * box.current, (2, count))
    if takes_voltage(drive):  # a third of them where the legs' signs are none, or just are
        i[:, ::3] *= min(1.0, 3.0 * fading_current(drive) / box.current)
    omega = rng.uniform(-box.speed, box.speed, count)
    theta = rng.uniform(-np.pi, np.pi, count) * (1 - 1e-6)
    rows = [*electrical_states(drive, i, theta), omega, theta]
    if drive.model.mechanics == "load_torque":
        rows.append(rng.uniform(-box.load_torque, box.load_torque, count))
    for word in drive.model.adaptive:
        rows.append(_slow(drive, word, drive.filter.initial_covariance[len(rows)], rng, count))
    return np.vstack(rows)


def _slow(drive: Drive, word: str, variance: float, rng: np.random.Generator, count: int) -> np.ndarray:
    """Values of an adaptive state; the inverter's voltage from none to twice what is stated, or to three sigmas."""
    value = own_value(drive, word)
    if word == STATE:
        return rng.uniform(0.0, max(2.0 * value, 3.0 * float(np.sqrt(variance))), count)
    return value * rng.uniform(*ADAPTIVE_SHARE, count)


def electrical_states(drive: Drive, i: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """The two electrical states at given currents and angles.

    Parameters
    ----------
    drive : Drive
    i : ndarray, (2, B)
        Stator currents i_alpha, i_beta, A.
    theta : ndarray, (B,)
        Electrical angle, rad.

    Returns
    -------
    ndarray, (2, B)
        In the machine's unit, A or Wb.
    """
    machine = find_machine(drive)(Parameters.numeric(drive), Constants(named=False))
    current, angle = ca.SX.sym("i", 2), ca.SX.sym("theta")
    z = machine.electrical_state((current[0], current[1]), Rotor.at(angle))
    electrical = ca.Function("electrical", [current, angle], [ca.vertcat(*z)]).map(theta.size)
    return np.array(electrical(i, theta[None, :]))


def _covariances(drive: Drive, rng: np.random.Generator, count: int, n: int) -> np.ndarray:
    low = np.sqrt(drive.filter.process_noise)
    high = np.sqrt(drive.filter.initial_covariance)
    sigma = np.exp(rng.uniform(np.log(np.minimum(low, high)), np.log(np.maximum(low, high)), (count, n)))
    factor = rng.uniform(-1, 1, (count, n, n + 2))
    P = factor @ factor.transpose(0, 2, 1)
    norm = np.sqrt(np.einsum("bii->bi", P))
    scale = sigma / norm
    return np.asarray(P * scale[:, :, None] * scale[:, None, :])
