"""A recording as the rows that :mod:`runtime.identify.equations` takes: on the filter's steps, ripple worked out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.inverter import SQRT_3
from runtime.recorded.clock import check_clock
from runtime.recorded.data import Recorded
from runtime.replay.innovations import held_inputs
from runtime.system.errors import UserError

Array = NDArray[Any]

#: Fewer rows say nothing of a motor.
LEAST = 100
#: Rows over which the first speed is looked for, and those between two voltages that are compared.
FIRST, APART = 200, 10
#: Directions of the legs a, b, c.
AXES = np.array([[1.0, 0.0], [-0.5, SQRT_3 / 2], [-0.5, -SQRT_3 / 2]])


@dataclass(frozen=True)
class Rows:
    """``table`` (N, 15), see :data:`runtime.identify.equations.ROW`; ``omega_e``: first electrical speed, rad/s.

    The first row begins the filter: its currents count, its voltage does not. ``load_steps``: when the load may step, s
    after the first row.
    """

    recorded: Recorded
    table: Array
    omega_e: float
    notes: tuple[str, ...]
    load_steps: tuple[float, ...] = ()

    @property
    def steps(self) -> int:
        """Innovations, one a row after the first."""
        return len(self.table) - 1


def rows_of(recorded: Recorded, T: float, dc_link: float, name: str) -> Rows:
    """The rows of a recording.

    Parameters
    ----------
    recorded : Recorded
    T : float
        Sample time, s.
    dc_link : float
        V.
    name : str
        The drive's, for errors.

    Raises
    ------
    UserError
        Times that do not fit, too few rows, or none measured.
    """
    clock = check_clock(recorded.t, T, recorded.path, name)
    steps, at = clock.count, slice(None) if clock.steps is None else clock.steps
    u, y = np.full((steps, 2), np.nan), np.full((steps, 2), np.nan)
    u[at], y[at] = recorded.u, recorded.y
    measured = np.all(np.isfinite(y), axis=1)
    begin = int(np.argmax(measured))
    if measured.sum() < LEAST:
        raise UserError(
            f"'{recorded.path}' has {measured.sum()} measured rows; motor data take {LEAST} at least, some thousands "
            "for good ones."
        )
    lost = np.any(~np.isfinite(u), axis=1)
    u = held_inputs(u, np.finfo(float).max)[begin:]
    missing = int(np.count_nonzero(~measured[begin:] | lost[begin:]))
    notes = [*recorded.notes, *clock.notes]
    if missing and not clock.gaps:
        notes.append(f"{missing:,} rows are not numbers: bridged by prediction")
    edges, swing = ripple(u, dc_link, T)
    y = np.where(measured[:, None], y, 0.0)[begin:]
    table = np.column_stack([u, y, measured[begin:], np.zeros(len(u)), edges, swing])
    return Rows(recorded, table, first_speed(u, T), tuple(notes))


def ripple(u: Array, dc_link: float, T: float) -> tuple[Array, Array]:
    """When each leg turns on, as a share of the sample (N, 3), and how far the flux linkage then is below its course.

    One period of a carrier a sample, in whose middle all legs are on, the legs centred between the rails. At t the
    motor has had 2/3 of the DC link along the axis of each leg that is on, for as long as it is, where its course had
    the mean u. When the leg turns off it is as far above. As (N, 6), V s: alpha and beta for each leg's edge.

    Parameters
    ----------
    u : (N, 2) V
    dc_link : float
        V.
    T : float
        s.
    """
    phases = np.column_stack([u[:, 0], (SQRT_3 * u[:, 1] - u[:, 0]) / 2, (-SQRT_3 * u[:, 1] - u[:, 0]) / 2])
    common = (phases.max(axis=1) + phases.min(axis=1)) / 2
    duty = np.clip(0.5 + (phases - common[:, None]) / dc_link, 0.0, 1.0)
    on = (1 - duty) * T / 2
    held = np.maximum(0.0, on[:, :, None] - on[:, None, :])  # s, by the leg that turns on and the one that is on
    swing = u[:, None, :] * on[:, :, None] - 2 / 3 * dc_link * held @ AXES
    return on / T, swing.reshape(len(u), 6)


def first_speed(u: Array, T: float) -> float:
    """Electrical speed at the beginning by the turning of the voltage, rad/s: a rotor that turns has a back-EMF.

    Parameters
    ----------
    u : (N, 2) V
    T : float
        s.
    """
    z = u[:FIRST, 0] + 1j * u[:FIRST, 1]
    turned = np.sum(z[APART:] * np.conj(z[:-APART]))
    return float(np.angle(turned) / (APART * T)) if abs(turned) > 0 else 0.0
