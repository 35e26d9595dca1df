"""The magnets' flux and the inertia, from a rotor that follows a turning current vector.

The stator's flux is (v - R i) / (j omega) at constant speed, whatever the machine; what the inverter takes from v is
worked out from the signs of the measured phase currents. That flux less L_q i points along d, and its amount is
psi_m + (L_d - L_q) i_d. The inertia is the energy that goes in while the rotor speeds up and comes out while it slows
down again; losses are alike both times.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.commission.electrical import cleaned, offsets
from runtime.commission.line import Ran

Array = NDArray[Any]

#: The rotor follows where it lies within so many degrees of the current at constant speed.
FOLLOWS = 40.0


@dataclass(frozen=True)
class Machine:
    """What is known by now: ohm, H, V, pole pairs."""

    R: float
    L_d: float
    L_q: float
    V_d: float
    p: int


@dataclass(frozen=True)
class Turned:
    """Of every hold: psi_m Wb, A, rad/s electrical, rad that d lies behind. Of every direction: J kg m^2."""

    psi_m: Array
    current: Array
    speed: Array
    behind: Array
    J: Array


def lost_voltage(rows: Array, V_d: float) -> complex:
    """What legs lose to dead time, seen from the current's frame, V: the mean over a whole number of sixths of a turn.

    Parameters
    ----------
    rows : (N, 8)
        So fine that a turn has many of them.
    V_d : float
        V.
    """
    speed, angle = rows[:, 6].mean(), rows[:, 7]
    i = (rows[:, 4] + 1j * rows[:, 5]) * np.exp(1j * angle)
    lost = np.zeros(len(rows), dtype=complex)
    for k in range(3):
        axis = np.exp(2j * math.pi * k / 3)
        lost += V_d * 2 / 3 * np.sign((i * np.conj(axis)).real) * axis
    seen = lost * np.exp(-1j * angle)
    step = abs(speed) * np.median(np.diff(rows[:, 0])) * _period(rows)
    whole = int(len(rows) * step / (math.pi / 3)) * (math.pi / 3) / step
    return complex(seen[: max(1, round(whole))].mean())


def _period(rows: Array) -> float:
    """Sample time, from how far the angle comes in a sample."""
    passed = np.diff(rows[:, 0])
    turned = np.diff(np.unwrap(rows[:, 7]))
    return float(np.sum(turned) / np.sum(passed) / rows[:, 6].mean())


def turned(ran: Ran, machine: Machine) -> Turned | str:
    """psi_m and J; or in words why they are not told.

    Parameters
    ----------
    ran : Ran
    machine : Machine
    """
    psi, current, speed, behind, J = [], [], [], [], []
    for place in (0, 1):
        for index in (0, 1):
            one = _flux(ran, machine, place, index)
            if isinstance(one, str):
                return one
            psi.append(one[0])
            current.append(one[1])
            speed.append(one[2])
            behind.append(one[3])
        J.append(_inertia(ran, machine, place))
    return Turned(*(np.array(values) for values in (psi, current, speed, behind, J)))


def _rows(ran: Ran, what: str, place: int) -> tuple[Array, int]:
    segment = next(s for s in ran.run.segments if s.what == what and s.place == place)
    return cleaned(next(ran.of(what, place)), offsets(ran), ran.period, segment.every), segment.samples


def _flux(ran: Ran, machine: Machine, place: int, index: int) -> tuple[float, float, float, float] | str:
    """psi_m, the current along d, speed, angle behind, of one hold."""
    rows, _ = _rows(ran, f"hold {index}", place)
    rows = rows[len(rows) // 2 :]
    burst, _ = _rows(ran, f"burst {index}", place)
    omega = rows[:, 6].mean()
    half_step = omega * ran.period / 2
    u = complex(rows[:, 2].mean(), rows[:, 3].mean())
    i = complex(rows[:, 4].mean(), rows[:, 5].mean())
    wanted = next(s.current for s in ran.run.segments if s.what == f"hold {index}" and s.place == place)
    if abs(i.real / wanted - 1) > 0.05:
        return f"current not reached while turning: {i.real:.3g} A of {wanted:.3g} A"
    flux = (u - lost_voltage(burst, machine.V_d) - machine.R * i * math.cos(half_step)) / (
        1j * omega * math.sin(half_step) / half_step
    )
    active = flux - machine.L_q * i
    d = active / abs(active)
    angle = float(np.angle(d))
    i_d = (i * d.conjugate()).real
    if abs(math.degrees(angle)) > FOLLOWS:
        return f"the rotor does not follow the current: its flux lies {math.degrees(angle):.0f} degrees beside it"
    return abs(active) - (machine.L_d - machine.L_q) * i_d, i_d, float(omega), angle


def _inertia(ran: Ran, machine: Machine, place: int) -> float:
    """Energy over half the square of the speed, up and down together."""
    energy, square, columns = [], [], []
    for index, what in enumerate(("up", "down")):
        rows, samples = _rows(ran, what, place)
        step = np.diff(np.concatenate([[ran.began_of(what, place)], rows[:, 0]])) * ran.period
        power = 1.5 * (rows[:, 2] * rows[:, 4] + rows[:, 3] * rows[:, 5])
        power -= 1.5 * machine.R * (rows[:, 4] ** 2 + rows[:, 5] ** 2)
        energy.append(np.cumsum(power * step))
        omega = rows[:, 6] / machine.p
        square.append(omega**2 / 2)
        time = np.cumsum(step)
        way = np.cumsum(np.abs(omega) * step)
        one = np.zeros((len(rows), 4))
        one[:, 0], one[:, 1], one[:, 2 + index] = time, way, 1.0
        columns.append(one)
    table = np.column_stack([np.concatenate(square), np.concatenate(columns)])
    return float(np.linalg.lstsq(table, np.concatenate(energy), rcond=None)[0][0])
