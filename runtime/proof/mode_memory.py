"""What the modes by hand keep from one interrupt to the next. Imports nothing it is to check."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

#: In the place of the first two states: whatever carries the measured currents where the rotor is placed.
CARRIES = None
#: What may happen in each mode.
EVENTS = {
    "RESTING": ("gave up", "no current", "restless"),
    "PROBING": ("lost, CURRENT", "turns", "turned", "stands"),
    "WAITING": ("begins there", "died out", "lost, CURRENT"),
    "CATCHING": ("lost, CURRENT", "settled", "turned round", "found", "lost, NOT_CAUGHT"),
    "STARTING": (
        *("lost, CURRENT", "lost, BLIND", "lost, RESTARTED", "lost, NOT_STARTED"),
        *("rival is better", "found", "as stated", "not as stated", "nothing turned"),
    ),
    "ALIGNING": ("lost, CURRENT", "aligned", "lost, NOT_ALIGNED"),
    "RUNNING": (
        *("lost, CURRENT", "open", "lost, BLIND", "lost, RUNAWAY", "lost, DIVERGED", "lost, RESTARTED"),
        *("lost, SLIPPED", "steady"),
    ),
    "FAULT": ("acknowledged",),
}


@dataclass
class Filter:
    """A filter: state, variances (D of L D L^T) and the words beside them, where it begins; ``rest`` is all else."""

    x: list[Any]
    variances: list[float]
    beside: list[float]
    nis: float
    x_0: list[float]
    P_0: list[float]
    rest: dict[str, Any] = field(default_factory=dict)

    def begin(self, rotor: tuple[float, float] | None = None) -> None:
        """x_0 and P_0; with speed (rad/s) and angle (rad) of a rotor, at these.

        Parameters
        ----------
        rotor : tuple of float, optional
        """
        self.x, self.variances, self.nis = list(self.x_0), list(self.P_0), 0.0
        self.beside = [0.0] * len(self.beside)
        self.rest["u_held"], self.rest["iterations"] = [0.0, 0.0], 0
        if rotor is not None:
            self.x[:4] = [CARRIES, CARRIES, rotor[0], math.remainder(rotor[1], 2 * math.pi)]


@dataclass
class Memory:
    """The machine's own fields, by their names in the header; mode and reason by name."""

    mode: str
    reason: str
    rival: Filter | None = None
    whole: dict[str, int] = field(default_factory=dict)
    arrays: dict[str, list[Any]] = field(default_factory=dict)


@dataclass(frozen=True)
class Said:
    """What the filter's step reported of itself."""

    rejected: bool = False
    diverged: bool = False
    restarted: bool = False
