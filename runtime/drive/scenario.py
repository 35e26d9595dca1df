"""A drive's task: speed reference and load over time, of a size that suits it, and where its errors are read."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model.rating import rating
from model.schema import Drive
from runtime.recorded.units import RPM
from runtime.system.errors import UserError
from runtime.system.values import read_word

Array = NDArray[np.float64]

#: From here on a start counts as over, unless its ramp is longer: errors of position are read after it, s.
STARTED = 0.15
#: The end of a run, in which it is judged, s.
LATE = 0.05
#: Shortest ramp, shortest rest before the load step and shortest time after it, s; the last two also as time constants
#: of the speed loop.
RAMP, REST, LOADED = 0.15, (0.05, 3.0), (0.2, 12.0)
#: How far from its reference a speed may end: this share of it, and no less than that of the rated one.
REACHED, REACHED_OF_RATED = 0.1, 0.02


@dataclass(frozen=True)
class Scenario:
    """A ramp to a speed, then perhaps a step of load. Times in s, speed in r/min, load in N m.

    ``least_band`` r/min: so far from its reference the speed may end however low that is.
    """

    name: str
    speed: float
    ramp: float = RAMP
    load: float = 0.0
    load_at: float = 0.2
    duration: float = 0.4
    least_band: float = 0.0

    @property
    def started(self) -> float:
        """When the start counts as over, s."""
        return max(self.ramp, STARTED)

    def band(self, speed: Array | float | None = None) -> Array:
        """How far from its reference the speed may end, r/min.

        Parameters
        ----------
        speed : ndarray or float, optional
            References in place of the scenario's own, r/min.
        """
        return np.maximum(REACHED * np.abs(self.speed if speed is None else speed), self.least_band)

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


SCENARIOS = ("no_load", "load_step")


def scenarios(drive: Drive) -> dict[str, Scenario]:
    """The scenarios of a drive by name: to its rated speed, without and with a step of its rated torque.

    Parameters
    ----------
    drive : Drive
        Its rating, inertia and speed loop set speed, load and times.
    """
    task, slow = rating(drive), 1.0 / drive.control.speed_bandwidth
    ramp = task.ramp(drive.motor.inertia, RAMP)
    load_at = ramp + max(REST[0], REST[1] * slow)
    usual = Scenario(
        "no_load",
        speed=_rounded(task.speed * RPM),
        ramp=ramp,
        load_at=load_at,
        duration=load_at + max(LOADED[0], LOADED[1] * slow),
        least_band=REACHED_OF_RATED * task.speed * RPM,
    )
    return {"no_load": usual, "load_step": replace(usual, name="load_step", load=task.torque)}


def step_start(drive: Drive) -> Scenario:
    """The hardest start: a step of the reference, so that the torque limit alone sets the pace. Used for the sweep.

    Parameters
    ----------
    drive : Drive
    """
    return replace(find_scenario("load_step", drive), name="step_start", ramp=1e-3)


def find_scenario(
    name: str, drive: Drive, speed: float | None = None, load: float | None = None, ramp: float | None = None
) -> Scenario:
    """A drive's scenario by name, some of it replaced.

    Parameters
    ----------
    name : str
    drive : Drive
    speed, load, ramp : float, optional
        In place of the rated ones: r/min; N m, of the load step alone; s.

    Raises
    ------
    UserError
        There is no such scenario, or a number is none that a drive can be asked for.
    """
    read_word(name, "scenario", SCENARIOS)
    found = scenarios(drive)[name]
    for word, value in (("speed", speed), ("load", load), ("ramp", ramp)):
        if value is not None and not math.isfinite(value):
            raise UserError(f"--{word} {value} is no number that a drive can be asked for.")
    if ramp is not None and ramp <= 0.0:
        raise UserError(f"--ramp {ramp:g} s: a ramp takes some time.")
    if ramp is not None:
        later = ramp - found.ramp
        found = replace(found, ramp=ramp, load_at=found.load_at + later, duration=found.duration + later)
    if load is not None and found.load:
        found = replace(found, load=load)
    return found if speed is None else replace(found, speed=speed)


def _rounded(speed: float) -> float:
    """1000 r/min are 1000 again after their way through rad/s."""
    return float(f"{speed:.12g}")
