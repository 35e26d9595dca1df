"""The magnets' flux and the inertia, from a rotor that follows a turning current vector.

The stator's flux is (v - R i) / (j omega) at constant speed, whatever the machine; what the inverter takes from v is
worked out from the signs of the measured phase currents. That flux less L_q i points along d, and its amount is
psi_m + (L_d - L_q) i_d. The inertia is the energy that goes in while the rotor speeds up and comes out while it slows
down again; losses are alike both times.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.commission.electrical import cleaned, offsets
from runtime.commission.line import Ran
from runtime.commission.lost import Inverter, followed_loss, mean_sign_loss

Array = NDArray[Any]

#: The rotor follows where it lies within so many degrees of the current at constant speed.
FOLLOWS = 40.0


@dataclass(frozen=True)
class Machine:
    """What is known by now: ohm, H, V, pole pairs, Wb, kg m^2, V."""

    R: float
    L_d: float
    L_q: float
    V_d: float
    p: int
    psi_m: float
    J: float
    dc_link: float

    def inverter(self, T: float) -> Inverter:
        """The inverter before it, with a sample time of T s."""
        return Inverter(self.dc_link, T, self.V_d * T / self.dc_link, self.L_d, self.L_q)


@dataclass(frozen=True)
class Turned:
    """Of every hold: psi_m Wb, A, rad/s electrical, rad that d lies behind. Of every direction: J kg m^2."""

    psi_m: Array
    current: Array
    speed: Array
    behind: Array
    J: Array

    @property
    def psi_by_direction(self) -> Array:
        """psi_m of each direction, Wb, (2,): what the inverter takes blurs the smaller of its two currents more."""
        weight = self.current.reshape(2, -1) ** 2
        return np.asarray((self.psi_m.reshape(2, -1) * weight).sum(axis=1) / weight.sum(axis=1))


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
    found = replace(machine, psi_m=float(np.mean(psi)))
    for place in (0, 1):
        value = machine.J
        for _ in range(3):
            value = _inertia(ran, found, place, value)
        J.append(value)
    return Turned(*(np.array(values) for values in (psi, current, speed, behind, J)))


def _rows(ran: Ran, what: str, place: int) -> tuple[Array, int]:
    segment = next(s for s in ran.run.segments if s.what == what and s.place == place)
    return cleaned(next(ran.of(what, place)), offsets(ran), ran.period, segment.every), segment.samples


def _flux(ran: Ran, machine: Machine, place: int, index: int) -> tuple[float, float, float, float] | str:
    """psi_m, the current along d, speed, angle behind, of one hold."""
    rows, _ = _rows(ran, f"hold {index}", place)
    rows = rows[-max(1, len(rows) // 3) :]
    burst, _ = _rows(ran, f"burst {index}", place)
    omega = rows[:, 6].mean()
    half_step = omega * ran.period / 2
    u = complex(rows[:, 2].mean(), rows[:, 3].mean())
    i = complex(rows[:, 4].mean(), rows[:, 5].mean())
    wanted = next(s.current for s in ran.run.segments if s.what == f"hold {index}" and s.place == place)
    if abs(i.real / wanted - 1) > 0.05:
        return f"current not reached while turning: {i.real:.3g} A of {wanted:.3g} A"
    lost = followed_loss(burst, machine.inverter(ran.period))
    flux = (u - lost - machine.R * i * math.cos(half_step)) / (1j * omega * math.sin(half_step) / half_step)
    active = flux - machine.L_q * i
    d = active / abs(active)
    angle = float(np.angle(d))
    i_d = (i * d.conjugate()).real
    if abs(math.degrees(angle)) > FOLLOWS:
        return f"the rotor does not follow the current: its flux lies {math.degrees(angle):.0f} degrees beside it"
    return abs(active) - (machine.L_d - machine.L_q) * i_d, i_d, float(omega), angle


def _inertia(ran: Ran, machine: Machine, place: int, J: float) -> float:
    """Energy over half the square of the speed, up and down together; ``J`` as it is known by now.

    The rotor stays behind the axis by its acceleration over the square of its natural frequency, so that it is slower
    than the axis while that angle grows.
    """
    energy, square, columns = [], [], []
    for index, what in enumerate(("up", "down")):
        rows, samples = _rows(ran, what, place)
        step = np.diff(np.concatenate([[ran.began_of(what, place)], rows[:, 0]])) * ran.period
        power = 1.5 * (rows[:, 2] * rows[:, 4] + rows[:, 3] * rows[:, 5])
        lost = mean_sign_loss(rows, machine.V_d, ran.period)
        power -= 1.5 * (lost.real * rows[:, 4] + lost.imag * rows[:, 5])
        power -= 1.5 * machine.R * (rows[:, 4] ** 2 + rows[:, 5] ** 2)
        energy.append(np.cumsum(power * step))
        current = float(rows[:, 4].mean())
        swing = 1.5 * machine.p**2 * (machine.psi_m + (machine.L_d - machine.L_q) * current) * current / J
        x = (rows[:, 0] - ran.began_of(what, place)) / samples
        change = (1 if what == "up" else -1) * np.sign(rows[:, 6].sum()) * np.abs(rows[:, 6]).max()
        bend = (60 * x - 180 * x**2 + 120 * x**3) * change / (samples * ran.period) ** 2
        omega = (rows[:, 6] - bend / swing) / machine.p
        square.append(omega**2 / 2)
        one = np.zeros((len(rows), 4))
        one[:, 0], one[:, 1], one[:, 2 + index] = np.cumsum(step), np.cumsum(np.abs(omega) * step), 1.0
        columns.append(one)
    table = np.column_stack([np.concatenate(square), np.concatenate(columns)])
    return float(np.linalg.lstsq(table, np.concatenate(energy), rcond=None)[0][0])
