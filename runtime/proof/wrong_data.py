"""Link A: motor data that may be wrong, by hand: sections of a drive file with a datum moved, and how far it may be.

Imports nothing it is to check.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

#: Keys of [tolerance] and the motor data they speak of; where a datum is a state the key is its name.
UNCERTAIN = {
    "stator_resistance": ("stator_resistance",),
    "inductance": ("inductance_d", "inductance_q"),
    "magnet_flux": ("magnet_flux",),
}
#: A step along the imaginary axis, relative to the datum: of what is real the derivative is the imaginary part by it.
STEP = 1e-30


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
            variance = width**2 / 3 * 2 * stated["correlation_time"] / parameters["model"]["sample_time"]
            for word in data:
                motor = {**parameters["motor"], word: parameters["motor"][word] * (1 + 1j * STEP)}
                moved.append(({**parameters, "motor": motor}, math.sqrt(variance)))
    return moved
