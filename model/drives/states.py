"""What a drive file says a state: so many numbers, and an angle that its points can tell."""

from __future__ import annotations

import math
from collections.abc import Collection

from model.machines.mechanics import MECHANICS
from model.schema import Drive, DriveError

#: Of the widest angle's variance: what a sample adds, and its rounding, still fit below.
ANGLE_ROOM = 0.9


def most_angle_variance(states: int, kinds: Collection[str]) -> float:
    """Of the angle in P_0, rad^2: all points drawn are within half a turn of the mean.

    Farther away a point is one with its opposite (sqrt(n) sigma = pi; sqrt(n + 1) sigma for a UKF), so that a step
    gives up an angle that wide, each time anew. An EKF draws no points.

    Parameters
    ----------
    states : int
        n.
    kinds : collection of str
        The filters that are generated.
    """
    if not set(kinds) - {"ekf"}:
        return math.inf
    return ANGLE_ROOM * math.pi**2 / (states + ("ukf" in kinds))


def check_states(drive: Drive, electrical: list[str], where: str) -> None:
    """Raise DriveError where the numbers of a section do not fit the model's states.

    Parameters
    ----------
    drive : Drive
    electrical : list of str
        The machine's own states.
    where : str
        The file's name, for the message.

    Raises
    ------
    DriveError
        A list is too short or too long, the root's order names other states, or the angle's P_0 is too wide.
    """
    mechanical = [quantity.name for quantity in MECHANICS[drive.model.mechanics].states]
    states = electrical + mechanical + list(drive.model.adaptive)
    for key in ("initial_state", "initial_covariance", "process_noise"):
        values = getattr(drive.filter, key)
        if values is not None and len(values) != len(states):
            raise DriveError(
                f"drive '{where}': filter.{key} has {len(values)} entries; "
                f"this model has {len(states)} states: {', '.join(states)}."
            )
    order = drive.filter.root_order
    if order is not None and sorted(order) != sorted(states):
        raise DriveError(
            f"drive '{where}': filter.root_order names {', '.join(order) or 'nothing'}; "
            f"it must name each of the model's states once: {', '.join(states)}."
        )
    k, most = states.index("theta"), most_angle_variance(len(states), drive.filter.kinds)
    variance = drive.filter.initial_covariance[k]
    if variance > most:
        raise DriveError(
            f"drive '{where}': filter.initial_covariance[{k}] = {variance:g} rad^2, of theta: its points would be "
            f"half a turn off and more, where they tell no angle; at most {most:.3g} for {len(states)} states. "
            "A rotor that may stand anywhere is what [start] is for."
        )
