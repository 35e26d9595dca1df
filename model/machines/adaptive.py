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

    ``half_widths``: of the range that each estimate is held in, relative to the motor's value; 0 or none: it is free.

    The return is needed. At constant speed without current on the d axis R and psi_m cannot be told apart: only
    R i_q + omega_e psi_m shows. A plain random walk then drifts along that line without end, driven by the noise
    (0.4 ohm a second on ``ipmsm_adaptive``), with speed and angle right all the while, until a load step meets it.
    """

    words: tuple[str, ...]
    rate: float
    motor: Parameters
    constant: Constants
    half_widths: tuple[float, ...] = ()

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
            own = self.constant(f"OWN_{word.upper()}", self._own(word), f"the {self._whose(word)}'s {word}")
            back = self.constant("RETURN", ca.SX(self.rate), "T / adaptive_time, to a power of two")
            after.append(value + back * (own - value))
        return after

    def within(self, values: list[Any]) -> list[Any]:
        """Estimates held within their tolerance.

        What is learnt where it does not show, or from what the model does not know of (an inverter's volts at little
        current are taken for R i), ends at a datum that a plain filter might have been given.

        Parameters
        ----------
        values : list of SX
            One a word, in the drive file's order: Wb, ohm or V.
        """
        widths = self.half_widths or (0.0,) * len(self.words)
        each = zip(self.words, values, widths, strict=True)
        return [self._within(word, value, width) if width else value for word, value, width in each]

    def _within(self, word: str, value: Any, width: float) -> Any:
        own = self._own(word)
        of = f"of the {self._whose(word)}'s {word}"
        least = self.constant(f"LEAST_{word.upper()}", own * (1 - width), f"{1 - width:.6g} {of}")
        most = self.constant(f"MOST_{word.upper()}", own * (1 + width), f"{1 + width:.6g} {of}")
        return ca.fmax(least, ca.fmin(most, value))

    def _own(self, word: str) -> Any:
        """The motor's or inverter's value."""
        return getattr(self.motor, ADAPTIVE[word][1])

    @staticmethod
    def _whose(word: str) -> str:
        return "drive" if word == STATE else "motor"
