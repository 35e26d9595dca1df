"""How surely a datum is known, from what several angles, directions and currents say of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

#: Two-sided 95 % of Student's distribution, by degrees of freedom.
STUDENT = {1: 12.706, 2: 4.303, 3: 3.182, 4: 2.776, 5: 2.571, 6: 2.447, 7: 2.365}
#: What the model leaves out, as a share of the value: no interval is narrower. Measured on the simulated board, whose
#: PWM has ripple (``python -m benchmarks.commission``).
EXPECTED = {"R": 3e-3, "V_dead": 1e-2, "L": 8e-3, "L_d": 8e-3, "L_q": 8e-3, "psi_m": 4e-3, "J": 1e-2}
#: A datum is told where its interval is no wider than so many times these, of it; else 'not told'.
SURELY = {"R": 0.03, "V_dead": 0.15, "L": 0.06, "L_d": 0.06, "L_q": 0.06, "psi_m": 0.04, "J": 0.1}


@dataclass(frozen=True)
class Told:
    """A value with its 95 % interval, in SI; ``surely``: narrow enough to be used."""

    value: float
    low: float
    high: float
    surely: bool

    @property
    def width(self) -> float:
        """Half of the interval, relative to the value."""
        return (self.high - self.low) / 2 / abs(self.value) if self.value else math.inf


def of_values(word: str, values: Array, more: float = 0.0) -> Told:
    """The mean of values that were found alike, and how far it may be off.

    Parameters
    ----------
    word : str
    values : (N,)
        N at least 2.
    more : float, optional
        What else it may be off, whatever the values' scatter.
    """
    n = len(values)
    value = float(np.mean(values))
    spread = float(np.std(values, ddof=1)) / math.sqrt(n)
    half = math.hypot(STUDENT[min(n - 1, max(STUDENT))] * spread, EXPECTED[word] * abs(value), more)
    return Told(value, value - half, value + half, value > 0 and half <= SURELY[word] * value)
