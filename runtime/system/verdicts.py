"""What a verdict over several is: nothing looked at is nothing shown."""

from __future__ import annotations

from collections.abc import Iterable


def all_hold(verdicts: Iterable[bool]) -> bool:
    """Whether there is a verdict, and each is good.

    Parameters
    ----------
    verdicts : iterable of bool
        One for each that was looked at.

    Examples
    --------
    >>> all_hold([True, True]), all_hold([True, False]), all_hold([])
    (True, False, False)
    """
    found = list(verdicts)
    return bool(found) and all(found)
