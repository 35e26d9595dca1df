"""What an inverter takes from the voltage, in plain NumPy, by hand: phasors where the model writes three legs.

Imports nothing it is to check. A leg falls short of its commanded voltage against its current, by the dead time's share
of the DC link and by the drop of what conducts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

#: Directions of the three legs, as phasors.
LEGS = np.exp(2j * math.pi / 3 * np.arange(3))


@dataclass(frozen=True)
class LossyInverter:
    """``V_d`` V, unless the state has it at ``place``; a leg's sign is linear below ``fading`` A.

    A state V_d is learnt from ``showing`` A on, in full where the square is twice as much.
    """

    V_d: float
    fading: float
    place: int | None
    showing: float
    compensated: float  # A, up to which the controller's compensation is linear

    def shortfall(self, i: Array) -> Array:
        """In which direction and how far, in units of V_d, the voltage falls short: (..., 2) of currents (..., 2).

        Parameters
        ----------
        i : ndarray, (..., 2)
            Stator current, A.
        """
        sum_of_legs = 2 / 3 * (self._against(i) * LEGS).sum(axis=-1)
        return np.stack([sum_of_legs.real, sum_of_legs.imag], axis=-1)

    def unsure(self, i: Array) -> Array:
        """How far the legs are from falling short in full, (..., 1) of currents (..., 2): 0 where all do, 1 where none.

        Two legs of opposite sign differ by 2, and of three two pairs do: eight in the sum of squares.
        """
        against = self._against(i)
        apart = np.sum((against - np.roll(against, 1, axis=-1)) ** 2, axis=-1, keepdims=True)
        return np.asarray(np.sqrt(np.maximum(0.0, 1.0 - apart / 8.0)))

    def _against(self, i: Array) -> Array:
        """Each leg's share of V_d, -1 .. 1, (..., 3) of currents (..., 2)."""
        z = i[..., 0] + 1j * i[..., 1]
        return np.asarray(np.clip(np.real(z[..., None] * np.conj(LEGS)) / self.fading, -1, 1))

    def shown(self, i: Array) -> Array:
        """The share of it that says something of a V_d that is a state: (..., 1) of currents (..., 2); else all."""
        square = np.sum(i * i, axis=-1, keepdims=True) / self.showing**2
        return np.clip(square - 1.0, 0.0, 1.0) if self.place is not None else np.ones_like(square)

    def voltage(self, x: Array) -> Any:
        """V_d where the state is x (..., n), V."""
        return self.V_d if self.place is None else x[..., self.place, None]


def lost_volts(parameters: Mapping[str, Any]) -> float:
    """V_d as a drive file's parsed sections have it, V.

    Parameters
    ----------
    parameters : mapping of str to Any
        Sections of the drive file, parsed.
    """
    stated = parameters.get("inverter")
    if not stated:
        return 0.0
    period = 1 / stated["switching_frequency"] if stated["switching_frequency"] else parameters["model"]["sample_time"]
    return float(parameters["control"]["dc_link"] * stated["dead_time"] / period + stated["switch_drop"])


def make_inverter(parameters: Mapping[str, Any]) -> LossyInverter | None:
    """The inverter of a drive file's parsed sections; None where nothing is lost.

    Parameters
    ----------
    parameters : mapping of str to Any
        Sections of the drive file, parsed.
    """
    slow, V_d = list(parameters["model"].get("adaptive", ())), lost_volts(parameters)
    estimated = "dead_time_voltage" in slow
    if not (estimated or V_d):
        return None
    noise = math.sqrt(parameters["filter"]["measurement_noise"][0])
    place = slow.index("dead_time_voltage") - len(slow) if estimated else None
    most = parameters["control"]["max_current"]
    stated = parameters.get("inverter") or {}
    fading = stated.get("fading_current") or max(3 * noise, most / 200)
    return LossyInverter(V_d, fading, place, most / 20, stated.get("compensation_current") or fading)


def commanded(parameters: Mapping[str, Any], v: Array, i: Array) -> Array:
    """The voltage to command for v (N, 2) V to arrive under currents i (N, 2) A.

    Parameters
    ----------
    parameters : mapping of str to Any
        Sections of the drive file, parsed.
    v : ndarray, (N, 2)
    i : ndarray, (N, 2)
    """
    inverter = make_inverter(parameters) if parameters.get("inverter") else None
    return v + inverter.V_d * inverter.shortfall(i) if inverter else v
