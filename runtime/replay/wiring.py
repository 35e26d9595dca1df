"""Currents and voltages that do not fit each other: the ways in which current sensors are wired, tried one by one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from runtime.recorded.data import Recorded
from runtime.recorded.frames import WIRINGS, rewired
from runtime.replay.innovations import Innovations

#: Steps that each wiring is tried on, by back end: the first of the recording.
TRIED = {"c": 4_000, "numpy": 400}
#: A wiring fits if the normalised innovation squared is below this, and so much smaller than as recorded; others fit
#: as well within a factor.
FITS, BETTER, AS_WELL = 10.0, 10.0, 2.0
#: What is said of data that no tuning makes up for.
MISFIT_WORDS = "currents, voltages and motor do not fit each other"


def find_wiring(recorded: Recorded, rows: int, run: Callable[[Recorded], Innovations]) -> str | None:
    """Try other orders and signs of the current sensors.

    Parameters
    ----------
    recorded : Recorded
        That does not fit.
    rows : int
        How many of its first rows are tried.
    run : callable
        A recording through the filter.

    Returns
    -------
    str or None
        What fits; None if none does.
    """
    head = replace(recorded, t=recorded.t[:rows], u=recorded.u[:rows], y=recorded.y[:rows], truth={})
    before = _misfit(run(head))
    tried = {option: _misfit(run(other)) for option, other in _others(head)}
    fitting = sorted((misfit, option) for option, misfit in tried.items() if misfit < min(FITS, before / BETTER))
    if not fitting:
        return None
    misfit, option = fitting[0]
    others = " or ".join(option for other, option in fitting[1:] if other <= AS_WELL * misfit)
    return (
        f"{MISFIT_WORDS} as recorded: the mean of the normalised innovation squared, 2 for a consistent filter, is "
        f"{before:.3g}. With {option} it is {misfit:.3g}" + (f", and so with {others}" if others else "")
    )


def _others(head: Recorded) -> Iterator[tuple[str, Recorded]]:
    for wiring in WIRINGS[1:]:
        yield f"--wiring{'=' if wiring[0] == '-' else ' '}{wiring}", replace(head, y=rewired(head.y, wiring))


def _misfit(found: Innovations) -> float:
    """Mean normalised innovation squared over the second half, where a filter has settled."""
    nis = found.squared()[len(found.nu) // 2 :]
    good = nis[np.isfinite(nis)]
    return float(np.mean(good)) if len(good) > len(nis) // 2 else np.inf
