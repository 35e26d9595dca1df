"""Python's collector of circles, kept from looking where there are none: among what was just loaded, and at the end.

Both together took a sixth of the processor time of ``generate`` for a small drive.
"""

from __future__ import annotations

import atexit
import gc
from collections.abc import Iterator
from contextlib import contextmanager

_ends_with_its_command = False
_left = 0


@contextmanager
def loading() -> Iterator[None]:
    """Modules are loaded in the block: nothing of them is garbage, neither now nor later."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
        gc.freeze()
    finally:
        if enabled:
            gc.enable()


def end_without_search() -> None:
    """At its end the process gives back all memory at once, without a search for circles in it.

    Finalisers of objects in circles do not run then; what must happen at the end is for ``with`` and :mod:`atexit`.
    """
    global _ends_with_its_command
    _ends_with_its_command = True
    atexit.register(gc.freeze)


def leave_circles(times: int) -> None:
    """Before a piece of work: what it leaves in circles lies until the process ends, or until the next ``times`` calls.

    Nothing changes where the process goes on after the command.

    Parameters
    ----------
    times : int
        Pieces of work whose circles there is memory for.
    """
    global _left
    if _ends_with_its_command:
        gc.disable()
        _left += 1
        if _left % times == 0:
            gc.collect()
