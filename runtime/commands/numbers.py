"""Options that take a number: what a float may be besides, nan, inf and 1e308, is refused in one line.

Each is the ``callback`` of a ``typer.Option``.
"""

from __future__ import annotations

from collections.abc import Callable

import typer

from runtime.system.values import MOST, checked_number

Check = Callable[[typer.CallbackParam, float | None], float | None]


def within(low: float = -MOST, high: float = MOST) -> Check:
    """A number between two ends, or none.

    Parameters
    ----------
    low, high : float, optional
        Included, in the option's unit.
    """

    def check(param: typer.CallbackParam, value: float | None) -> float | None:
        return None if value is None else checked_number(value, param.opts[0], low, high)

    return check


#: Electrical angle, rad: more turns than anybody counts.
ANGLE = within(-1e3, 1e3)
#: Seconds that a command lasts, or a ramp.
SECONDS = within(1e-6, 1e6)
#: Of anything, not negative.
POSITIVE = within(0.0)
#: Of anything.
ANY = within()
