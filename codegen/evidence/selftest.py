"""Inputs of the self-test: a start, the corners of the operating box, and inputs that must be rejected.

Every number is rounded to few binary digits, so that the last bit of a platform's sine cannot change what is
generated; the bits that are expected come from executing the generated module (:mod:`codegen.evidence.recording`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from codegen.evidence.box import electrical_states
from model.loop.controller import Gains, design
from model.machines.state_space import StateSpaceModel, default_initial_state
from model.schema import Drive

Array = NDArray[np.float64]

#: Steps of the start, and of each corner of the box. 28 vectors: some 1.5 K words of flash with four states.
START_STEPS = 16
CORNER_STEPS = 3
#: Steps of the start whose inputs are bad: a current beyond the box, then a voltage that is no number.
BEYOND, NOT_A_NUMBER = 11, 12
#: Samples of the controller's self-test; in the last two the speed reference asks for more than the inverter has.
CONTROL_STEPS = 10
#: Samples of it whose inputs are bad: a current that is no number, then commands that are none.
CONTROL_BAD_CURRENT, CONTROL_BAD_COMMAND = 4, 6

#: Speed (share of the box), angle in rad, currents (shares), load torque (share), and which variances it begins with.
CORNERS = (
    (1.0, math.pi - 0.02, 0.6, -0.3, 0.8, "initial"),
    (-1.0, -math.pi + 0.02, -0.6, 0.4, -0.8, "initial"),
    (1.0, 1.5, -0.3, 0.6, 0.5, "process"),
    (-0.5, -2.2, 0.5, 0.5, -0.3, "process"),
)


@dataclass(frozen=True)
class Segment:
    """A run of vectors that begins with a reset: x_0, P_0 (n,); u (N, 2) V; y (N, 2) A. float32 holds them all."""

    title: str
    x_0: Array
    P_0: Array
    u: Array
    y: Array


@dataclass(frozen=True)
class ControlRun:
    """Inputs of the controller's self-test: phase (N, 2) A; command (N, 2) rad/s and V; it starts from _foc_init."""

    phase: Array
    command: Array
    delay: int


def coarse(values: NDArray[np.float64] | list[float] | float, digits: int = 12) -> Array:
    """Rounded to ``digits`` binary digits.

    Parameters
    ----------
    values : array_like
    digits : int, optional
        Of the mantissa.

    >>> float(coarse(3.14159265))
    3.1416015625
    """
    mantissa, exponent = np.frexp(np.asarray(values, dtype=float))
    return np.asarray(np.ldexp(np.round(np.ldexp(mantissa, digits)), exponent - digits))


def _single(values: list[float]) -> Array:
    return np.array(values, dtype=np.float32).astype(float)


def segments(drive: Drive, model: StateSpaceModel) -> list[Segment]:
    """The start, then one segment a corner.

    Parameters
    ----------
    drive : Drive
        Its operating box has the corners.
    model : StateSpaceModel
        Made of the same drive.
    """
    initial = _single(drive.filter.initial_covariance)
    variances = {"initial": initial, "process": 4 * _single(drive.filter.process_noise)}
    start = coarse(default_initial_state(drive))
    u = 0.1 * drive.operating_box.voltage * _turning(START_STEPS, 0.3)
    runs = [_segment("start", drive, model, start, initial, u)]
    runs[0].y[BEYOND, 0] = 2 * drive.operating_box.current
    runs[0].u[NOT_A_NUMBER, 1] = np.nan
    for k, corner in enumerate(CORNERS):
        u = 0.9 * drive.operating_box.voltage * _turning(CORNER_STEPS, 2.0, first=0.7 + k)
        x_0 = _corner_state(drive, corner)
        runs.append(_segment(f"corner {k + 1} of the box", drive, model, x_0, variances[corner[-1]], u))
    return runs


def control_run(drive: Drive) -> ControlRun:
    """Currents that turn, a speed reference that ends out of reach, and the drive's DC link.

    Parameters
    ----------
    drive : Drive
        Its operating box gives the speed, its control section the current and the DC link.
    """
    phase = 0.3 * drive.control.max_current * _turning(CONTROL_STEPS, 0.4)
    speed = np.where(np.arange(CONTROL_STEPS) < CONTROL_STEPS - 2, 0.1, 1.0) * drive.operating_box.speed
    link = np.full(CONTROL_STEPS, drive.control.dc_link)
    run = ControlRun(coarse(phase), coarse(np.column_stack([speed, link])), delay=1)
    run.phase[CONTROL_BAD_CURRENT, 1] = np.nan
    run.command[CONTROL_BAD_COMMAND] = np.inf, np.nan
    return run


def gains(drive: Drive, delay: int) -> Gains:
    """The gains that _foc_init loads.

    Parameters
    ----------
    drive : Drive
        The drive.
    delay : int
        Samples from measuring to acting, 0 or 1.
    """
    return design(drive, delay)


def _turning(steps: int, by: float, first: float = 0.0) -> Array:
    """Unit vectors (steps, 2), turned by ``by`` rad from one to the next."""
    angle = first + by * np.arange(steps)
    return np.column_stack([np.cos(angle), np.sin(angle)])


def _corner_state(drive: Drive, corner: tuple[float, float, float, float, float, str]) -> Array:
    speed, theta, i_alpha, i_beta, load, _ = corner
    box = drive.operating_box
    i = box.current * np.array([[i_alpha], [i_beta]])
    state = [*electrical_states(drive, i, np.array([theta]))[:, 0], speed * box.speed, theta]
    if drive.model.mechanics == "load_torque":
        state.append(load * box.load_torque)
    return coarse(state + default_initial_state(drive)[len(state) :])


def _segment(title: str, drive: Drive, model: StateSpaceModel, x_0: Array, P_0: Array, u: Array) -> Segment:
    """Measurements belong to a motor that starts at x_0 and obeys the model, give or take a sigma."""
    step = ca.Function("step", [model.x, model.u], [model.numeric(model.f_commanded)])
    observe = ca.Function("observe", [model.x], [model.numeric(model.h)])
    u = coarse(u)
    limit = 0.9 * drive.operating_box.current
    sigma = np.sqrt(drive.filter.measurement_noise)
    truth, rows = x_0, []
    for k, voltage in enumerate(u):
        truth = np.array(step(truth, voltage)).ravel()
        y = np.array(observe(truth)).ravel() + sigma * [(-1) ** k, (-1) ** (k // 2)]
        rows.append(np.clip(y, -limit, limit))
    return Segment(title, x_0, P_0, u, coarse(rows))
