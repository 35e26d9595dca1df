"""How wrong an estimate is where the truth is known: speed, position, load torque."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.recorded.units import RPM

Array = NDArray[Any]

#: The end of a record, over which steady errors are taken, s; of a short record its last quarter.
STEADY = 0.05
#: Beyond so many degrees electrical at the end the rotor was lost.
LOST = 30.0


@dataclass(frozen=True)
class Errors:
    """Errors against the truth.

    Speed in r/min: largest before the load step, rms at the end, largest after the load step. Position in degrees
    electrical: largest, rms at the end, of the last row. Load torque in N m: rms at the end, of the last row.
    ``load_step_at`` s. None: not known.
    """

    load_step_at: float | None = None
    speed_start: float | None = None
    speed_steady_rms: float | None = None
    speed_load_step: float | None = None
    position_max: float | None = None
    position_steady_rms: float | None = None
    position_end: float | None = None
    load_torque_steady_rms: float | None = None
    load_torque_end: float | None = None

    @property
    def lost(self) -> bool:
        """The position at the end is wrong by more than 30 degrees, or no number."""
        return self.position_steady_rms is not None and not self.position_steady_rms <= LOST

    def to_json(self) -> dict[str, float | None]:
        """Plain data; what is no number becomes None."""
        return {name: v if v is not None and np.isfinite(v) else None for name, v in asdict(self).items()}


class AgainstTruth:
    """The errors of a run's estimate ``x`` (N, n), where ``omega`` (N,) rad/s and ``theta`` (N,) rad are the truth."""

    x: Array
    omega: Array
    theta: Array

    @property
    def speed_error(self) -> Array:
        """Estimated minus true speed, r/min."""
        return speed_error(self.x, self.omega)

    @property
    def angle_error(self) -> Array:
        """Estimated minus true electrical angle, degrees, in [-180, 180)."""
        return angle_error(self.x, self.theta)


def speed_error(x: Array, omega: Array) -> Array:
    """Return estimated minus true speed, r/min.

    Parameters
    ----------
    x : ndarray, (N, n)
        Estimates.
    omega : ndarray, (N,)
        True mechanical speed, rad/s.
    """
    return np.asarray((x[:, 2].astype(float) - omega) * RPM)


def angle_error(x: Array, theta: Array) -> Array:
    """Return estimated minus true electrical angle, degrees, in [-180, 180).

    Parameters
    ----------
    x : ndarray, (N, n)
        Estimates.
    theta : ndarray, (N,)
        True electrical angle, rad.
    """
    return np.asarray(np.degrees(np.remainder(x[:, 3].astype(float) - theta + np.pi, 2 * np.pi) - np.pi))


def find_load_step(t: Array, load_torque: Array) -> int | None:
    """Find the row at which the load jumps: it leaves its first level by half its range and settles on another one.

    A ramp is dated where half of it is done; noise about one level is no step.

    Parameters
    ----------
    t : ndarray, (N,)
        Time, s.
    load_torque : ndarray, (N,)
        N m.

    Returns
    -------
    int or None
    """
    good = load_torque[np.isfinite(load_torque)]
    if not len(good) or np.ptp(good) == 0.0:
        return None
    half = np.ptp(good) / 2
    first = float(np.median(load_torque[t <= t[0] + min(0.01, (t[-1] - t[0]) / 10)]))
    away = np.flatnonzero(np.abs(load_torque - first) >= half)
    if not len(away):
        return None
    k = int(away[0])
    after = load_torque[(t >= t[k]) & (t <= t[k] + 0.05)]
    return k if abs(float(np.median(after)) - float(np.median(load_torque[:k] if k else [first]))) > half else None


def errors(t: Array, x: Array, state_names: tuple[str, ...], truth: dict[str, Array]) -> Errors | None:
    """Work out figures of an estimate against what is known of the truth; None where nothing is.

    Parameters
    ----------
    t : ndarray, (N,)
        Time, s.
    x : ndarray, (N, n)
        Estimates.
    state_names : tuple of str
    truth : dict of str to ndarray, (N,)
        omega (rad/s), theta (rad electrical), load_torque (N m), as far as they are known.
    """
    if not truth:
        return None
    late = t >= t[-1] - min(STEADY, (t[-1] - t[0]) / 4)
    found: dict[str, float] = {}
    step = find_load_step(t, truth["load_torque"]) if "load_torque" in truth else None
    if step is not None:
        found["load_step_at"] = float(t[step])
    if "omega" in truth:
        e = speed_error(x, truth["omega"])
        found["speed_start"] = _largest(e[:step])
        found["speed_steady_rms"] = _rms(e[late])
        if step is not None:
            found["speed_load_step"] = _largest(e[step:])
    if "theta" in truth:
        e = angle_error(x, truth["theta"])
        found |= {"position_max": _largest(e), "position_steady_rms": _rms(e[late]), "position_end": float(e[-1])}
    if "load_torque" in truth and "load_torque" in state_names:
        e = x[:, state_names.index("load_torque")].astype(float) - truth["load_torque"]
        found |= {"load_torque_steady_rms": _rms(e[late]), "load_torque_end": float(e[-1])}
    return Errors(**found)


def _largest(e: Array) -> float:
    return float(np.max(np.abs(e))) if len(e) else 0.0


def _rms(e: Array) -> float:
    return float(np.sqrt(np.mean(e**2)))
