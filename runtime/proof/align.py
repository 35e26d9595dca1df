"""The current of an alignment by hand: one complex number along its axis. Imports nothing it is to check."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.proof.control import clarke, modulated
from runtime.proof.inverter import lost_volts
from runtime.proof.mode_memory import Memory
from runtime.proof.mode_numbers import ZERO, Numbers

#: Of the largest current, what a rotor may make across the axis before it is regulated; V: a link is no lower.
LEFT_ACROSS, LEAST_LINK = 0.5, 1.0
#: Bit of the status: a command was no number, or too large.
COMMAND = 4


def turn_axis(hand: Numbers, m: Memory, theta: float, phase: Sequence[float]) -> bool:
    """The current rises a quarter of a turn beside its axis, then is turned there; whether none flows across it.

    Parameters
    ----------
    hand : Numbers
    m : Memory
        Changed: where the current points, and what the measured one lacks along that and is across it.
    theta : float
        The axis, rad electrical.
    phase : sequence of float
        i_a, i_b, A.
    """
    if m.mode != "ALIGNING":
        m.arrays["aligning"], m.arrays["axis"] = [0.0], [0.0, 0.0, 0.0]
        return False
    progress = min(m.arrays["aligning"][0] + hand.T / hand.align_turn, 2.0)
    way = cmath.exp(1j * (theta + math.pi / 2 * min(1.0, 2.0 - progress)))
    wanted = hand.align_current * min(progress, 1.0)
    beta = (phase[0] + 2 * phase[1]) / math.sqrt(3)
    missing = [wanted - (way.real * phase[0] + way.imag * beta), way.real * beta - way.imag * phase[0]]
    m.arrays["aligning"], m.arrays["missing"] = [progress], missing
    m.arrays["axis"] = [way.real, way.imag, wanted]
    return progress >= 2.0 and all(abs(i) <= ZERO * hand.most for i in missing)


def aligned(hand: Numbers, d: Any, phase: NDArray[np.float64], command: tuple[float, float]) -> list[float]:
    """Duty cycles (3,) of a sample of ALIGNING; voltages, integrators and status of the drive go on with it.

    Parameters
    ----------
    hand : Numbers
    d : SimpleNamespace
        The drive, changed.
    phase : ndarray, (2,)
        A.
    command : tuple of float
        Speed reference, rad/s; DC link, V.
    """
    c, axis = d.control, complex(*d.supervisor.axis[:2])
    good = bool(abs(command[1]) <= c.command_max[1])
    d.status = 0 if good else COMMAND
    c.command_held = (c.command_held[0], command[1] if good else c.command_held[1])
    d_p, _, current_i, most, dead_share, dead_current = c.gain[2:8]
    wanted = d.supervisor.axis[2] * hand.allowed_by_link(command[1], command[0], 0.0)
    i = clarke(phase)
    if not (abs(i.real) <= c.filter.y_max and abs(i.imag) <= c.filter.y_max):  # no current: none is missing
        i = wanted * axis
    found = i * axis.conjugate()
    missing = wanted - found.real
    beyond = math.copysign(max(abs(found.imag) - LEFT_ACROSS * most, 0.0), found.imag)
    v = complex(d_p * missing + c.integrator[1], -hand.across * found.imag - d_p * beyond)
    link = max(c.command_held[1], LEAST_LINK)
    limited = v * min(1.0, link / math.sqrt(3) / abs(v)) if v else v
    taken_back = min(current_i / d_p, 1.0) * (limited - v).real
    along = c.integrator[1] + current_i * missing + taken_back
    c.integrator = (c.integrator[0], along, *c.integrator[2:])
    lost = np.array([lost_volts(hand.parameters)])
    duty, told = modulated(hand.parameters, limited * axis, i, lost, link, dead_share, dead_current)
    acting = (told.real, told.imag)
    c.v_acting, c.v_queued = (c.v_queued, acting) if c.delay else (acting, c.v_queued)
    return list(duty)
