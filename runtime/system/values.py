"""Where words from outside become numbers: finite, within what they can mean, or refused in one line."""

from __future__ import annotations

import math

from runtime.system.errors import UserError

#: Beyond it a number is a slip of the finger, whatever its unit.
MOST = 1e9


def read_number(text: str, what: str, low: float = -MOST, high: float = MOST) -> float:
    """A number that somebody wrote.

    Parameters
    ----------
    text : str
    what : str
        What it is to be, as the user knows it, such as "--noise"; errors begin with it.
    low, high : float, optional
        What it may be, ends included, in its own unit.

    Raises
    ------
    UserError
        It is no number, not finite, or outside.

    Examples
    --------
    >>> read_number("1e-6", "--dead-time", 0.0, 1e-4)
    1e-06
    """
    try:
        value = float(text)
    except ValueError:
        raise UserError(f"{what} {text!r} is not a number.") from None
    return checked_number(value, what, low, high)


def checked_number(value: float, what: str, low: float = -MOST, high: float = MOST) -> float:
    """The same of what is a float already.

    Parameters
    ----------
    value : float
    what : str
    low, high : float, optional
        As :func:`read_number` has them.

    Raises
    ------
    UserError
        It is not finite, or outside.
    """
    if not math.isfinite(value):
        raise UserError(f"{what} {value} is not a finite number.")
    if not low <= value <= high:
        raise UserError(f"{what} {value:g} is not between {low:g} and {high:g}.")
    return value
