"""Link A: motor data that may be wrong, by hand: sections of a drive file with a datum moved, and how far it may be.

Imports nothing it is to check.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.proof.inverter import lost_volts
from runtime.proof.motors import Plant, SalientFluxMotor, make_motor, rotation, times

Array = NDArray[Any]

#: Keys of [tolerance] and the motor data they speak of; where a datum is a state the key is its name.
UNCERTAIN = {
    "stator_resistance": ("stator_resistance",),
    "inductance": ("inductance_d", "inductance_q"),
    "magnet_flux": ("magnet_flux",),
}
#: A step along the imaginary axis, relative to the datum: of what is real the derivative is the imaginary part by it.
STEP = 1e-30


def doubt(parameters: Mapping[str, Any]) -> tuple[float, float] | None:
    """The standard deviation of the inverter's V_d, and of the voltage on an axis where no leg's sign is sure, V.

    Both as they count in a sample. V_d times a g that may be 4/3 long, half of its square on each axis; what stays
    alike for k samples counts as 2 k of them. None where V_d is a state or exact.

    Parameters
    ----------
    parameters : mapping of str to Any
        Sections of the drive file, parsed.
    """
    stated, volts = parameters.get("tolerance") or {}, lost_volts(parameters)
    if not (volts and stated.get("dead_time")) or "dead_time_voltage" in parameters["model"].get("adaptive", ()):
        return None
    on_an_axis = 4 / 3 / math.sqrt(2) * math.sqrt(2 * stated["unsure_samples"])
    return volts * math.sqrt(_variance(stated["dead_time"], parameters)), volts * on_an_axis


def bounds(parameters: Mapping[str, Any]) -> list[tuple[int, float, float]]:
    """Of each slow state with a tolerance: its place counted from the state's end, its least and largest value.

    Parameters
    ----------
    parameters : mapping of str to Any
        Sections of the drive file, parsed.
    """
    stated, slow = parameters.get("tolerance") or {}, parameters["model"].get("adaptive", ())
    found = []
    for place, word in enumerate(slow, -len(slow)):
        estimated = word == "dead_time_voltage"
        width = stated.get("dead_time" if estimated else word, 0.0)
        own = lost_volts(parameters) if estimated else parameters["motor"][word]
        if width:
            found.append((place, own - width * own, own + width * own))
    return found


def _variance(width: float, parameters: Mapping[str, Any]) -> float:
    stated, T = parameters["tolerance"], parameters["model"]["sample_time"]
    return float(width**2 / 3 * 2 * stated["correlation_time"] / T)


def moved_data(parameters: Mapping[str, Any]) -> list[tuple[Mapping[str, Any], float]]:
    """For each datum that may be wrong the sections with it moved by ``STEP``, and its standard deviation, relative.

    The deviation is that of an even spread, a third of the half-width squared, as often in its square as noise of this
    correlation time counts: 2 tau / T.

    Parameters
    ----------
    parameters : mapping of str to Any
        Sections of the drive file, parsed.
    """
    stated = parameters.get("tolerance") or {}
    moved: list[tuple[Mapping[str, Any], float]] = []
    for key, data in UNCERTAIN.items():
        width = stated.get(key, 0.0)
        if width and key not in parameters["model"].get("adaptive", ()):
            variance = _variance(width, parameters)
            for word in data:
                motor = {**parameters["motor"], word: parameters["motor"][word] * (1 + 1j * STEP)}
                moved.append(({**parameters, "motor": motor}, math.sqrt(variance)))
    return moved


@dataclass(frozen=True)
class WrongCurrents:
    """A motor with flux linkages as states whose inductance or magnet is moved: currents read from them are wrong.

    In the classical equations on the rotor's axes, currents given, the moved datum makes another back-EMF and another
    torque: ``moved`` holds the datum, ``right`` reads the currents.
    """

    moved: SalientFluxMotor
    right: SalientFluxMotor

    def f(self, x: Array, u: Array) -> Array:
        """A complex (n, ...) whose imaginary part is what a sample lacks; its real part means nothing.

        Parameters
        ----------
        x : ndarray, (n, ...)
        u : ndarray, (2, ...)
            Voltages, V.
        """
        d, theta = self.moved.data, x[3]
        i_d, i_q = times(rotation(-theta), self.right.h(x))
        psi_d, psi_q = d.L_d * i_d + d.now(x, "psi"), d.L_q * i_q
        e = d.p * x[2] * np.array([-psi_q, psi_d])
        torque = 1.5 * d.p * (psi_d * i_q - psi_q * i_d)
        return np.array([*(-d.T * times(rotation(theta), e)), *(row + 0j for row in d.mechanics(x, torque))])


def moved_motors(parameters: Mapping[str, Any]) -> list[tuple[Any, float]]:
    """For each datum that may be wrong what moves a sample with it, by the imaginary part of its f, and the deviation.

    Parameters
    ----------
    parameters : mapping of str to Any
        Sections of the drive file, parsed.
    """
    right = make_motor(parameters)

    def of(motor: Plant) -> Any:
        if isinstance(motor, SalientFluxMotor) and isinstance(right, SalientFluxMotor) and not np.imag(motor.data.R):
            return WrongCurrents(motor, right)
        return motor

    return [(of(make_motor(sections)), size) for sections, size in moved_data(parameters)]
