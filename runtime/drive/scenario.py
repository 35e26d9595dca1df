"""A drive's task: speed reference and load over time, and where its errors are read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.recorded.units import RPM
from runtime.system.errors import UserError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scenario:
    """A ramp to a speed, then perhaps a step of load. Times in s, speed in r/min, load in N m."""

    name: str
    speed: float = 1000.0
    ramp: float = 0.15
    load: float = 0.0
    load_at: float = 0.2
    duration: float = 0.4

    def speed_reference(self, t: Array) -> Array:
        """Mechanical rad/s at the times t.

        Parameters
        ----------
        t : ndarray
            Time, s.
        """
        return self.speed / RPM * np.clip(t / self.ramp, 0.0, 1.0)

    def load_torque(self, t: Array) -> Array:
        """N m at the times t.

        Parameters
        ----------
        t : ndarray
            Time, s.
        """
        return np.where(t >= self.load_at - 1e-12, self.load, 0.0)


#: From here on a start counts as over: errors of position are read after it, s.
STARTED = 0.15

#: The hardest start: a step of the reference, so that the torque limit alone sets the pace. Used for the sweep.
STEP_START = Scenario("step_start", ramp=1e-3, load=5.0)

SCENARIOS = {
    "no_load": Scenario("no_load"),
    "load_step": Scenario("load_step", load=5.0),
}


def find_scenario(name: str) -> Scenario:
    """A scenario by name; UserError if there is none."""
    if name not in SCENARIOS:
        raise UserError(f"no scenario '{name}'; there are: {', '.join(SCENARIOS)}.")
    return SCENARIOS[name]
