"""Motor data that a filter may estimate: slow extra states, appended to the machine's and the mechanics' own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca

from model.inverter import STATE, lost_voltage
from model.machines.base import Parameters
from model.quantities import Constants, Quantity
from model.schema import Drive

#: A drive file's word, the state it adds, and the parameter that state takes the place of.
ADAPTIVE: dict[str, tuple[Quantity, str]] = {
    "magnet_flux": (Quantity("magnet_flux", r"\psi_m", "Wb", "magnet flux linkage, wandering"), "psi_m"),
    "stator_resistance": (Quantity("stator_resistance", "R_s", "ohm", "stator resistance, wandering"), "R"),
    STATE: (Quantity(STATE, "V_d", "V", "voltage a leg loses to dead time and switches, wandering"), "V_d"),
}


def own_value(drive: Drive, word: str) -> float:
    """What an adaptive state starts at and returns to: the drive file's value, Wb, ohm or V.

    Parameters
    ----------
    drive : Drive
    word : str
        One of :data:`ADAPTIVE`.
    """
    return lost_voltage(drive) if word == STATE else float(getattr(drive.motor, word))


@dataclass(frozen=True)
class Adaptive:
    """Slow states: each wanders by its process noise and returns to the motor's value by ``rate`` a sample.

    The return is needed. At constant speed without current on the d axis R and psi_m cannot be told apart: only
    R i_q + omega_e psi_m shows. A plain random walk then drifts along that line without end, driven by the noise
    (0.4 ohm a second on ``ipmsm_adaptive``), with speed and angle right all the while, until a load step meets it.
    """

    words: tuple[str, ...]
    rate: float
    motor: Parameters
    constant: Constants

    @property
    def states(self) -> tuple[Quantity, ...]:
        """In the drive file's order."""
        return tuple(ADAPTIVE[word][0] for word in self.words)

    def parameters(self, values: list[Any]) -> Parameters:
        """The motor's data with the adaptive ones replaced by state values.

        Parameters
        ----------
        values : list of SX
            One a word, in the drive file's order: Wb, ohm or V.
        """
        names = [ADAPTIVE[word][1] for word in self.words]
        return replace(self.motor, **dict(zip(names, values, strict=True)))

    def advance(self, values: list[Any]) -> list[Any]:
        """One sample later: v + rate (motor's - v).

        ``rate`` is a power of two (:attr:`model.schema.Model.return_rate`): float32 holds 1 - rate exactly, so that the
        point of rest is the motor's value. 1e-4 rounded moves it by 3e-4 of itself.

        Parameters
        ----------
        values : list of SX
            One a word, in the drive file's order: Wb, ohm or V.
        """
        after = []
        for word, value in zip(self.words, values, strict=True):
            whose = "drive" if word == STATE else "motor"
            own = self.constant(f"OWN_{word.upper()}", getattr(self.motor, ADAPTIVE[word][1]), f"the {whose}'s {word}")
            back = self.constant("RETURN", ca.SX(self.rate), "T / adaptive_time, to a power of two")
            after.append(value + back * (own - value))
        return after
