"""Link A: motor data that may be wrong, by hand: sections of a drive file with a datum moved, and how far it may be.

Imports nothing it is to check.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from runtime.proof.inverter import lost_volts

#: Keys of [tolerance] and the motor data they speak of; where a datum is a state the key is its name.
UNCERTAIN = {
    "stator_resistance": ("stator_resistance",),
    "inductance": ("inductance_d", "inductance_q"),
    "magnet_flux": ("magnet_flux",),
}
#: A step along the imaginary axis, relative to the datum: of what is real the derivative is the imaginary part by it.
STEP = 1e-30


def doubt(parameters: Mapping[str, Any]) -> float:
    """The standard deviation of the inverter's V_d, relative, as it counts in a sample; 0 where it is a state.

    Parameters
    ----------
    parameters : mapping of str to Any
        Sections of the drive file, parsed.
    """
    stated = parameters.get("tolerance") or {}
    if not stated.get("dead_time") or "dead_time_voltage" in parameters["model"].get("adaptive", ()):
        return 0.0
    return math.sqrt(_variance(stated["dead_time"], parameters))


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
