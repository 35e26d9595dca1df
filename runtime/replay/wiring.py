"""Currents and voltages that do not fit each other: the few ways in which sensors are wired, tried one by one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from runtime.recorded.data import Recorded
from runtime.recorded.frames import WIRINGS, rewired
from runtime.replay.innovations import Innovations

#: Steps that each wiring is tried on, by back end: the first of the recording.
TRIED = {"c": 4_000, "numpy": 400}
#: A wiring fits if the normalised innovation squared is below this, and so much smaller than as recorded.
FITS, BETTER = 10.0, 10.0


def find_wiring(recorded: Recorded, rows: int, run: Callable[[Recorded], Innovations]) -> str:
    """Try other orders and signs of the current sensors, and voltages of the step before.

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
    str
        What fits, or that none does.
    """
    head = replace(
        recorded,
        t=recorded.t[:rows],
        u=recorded.u[:rows],
        y=recorded.y[:rows],
        truth={},
    )
    before = _misfit(run(head))
    tried = {option: _misfit(run(other)) for option, other in _others(head)}
    fitting = sorted((misfit, option) for option, misfit in tried.items() if misfit < min(FITS, before / BETTER))
    begin = "currents, voltages and motor do not fit each other"
    if not fitting:
        return (
            f"{begin}, nor in another order or sign of the currents' phases, nor one step apart: units, motor data, "
            "start (--x0, --theta0)?"
        )
    misfit, option = fitting[0]
    others = ", ".join(option for _, option in fitting[1:3])
    return (
        f"{begin} as recorded: {before:.3g} for a normalised innovation squared of 2. With {option} it is {misfit:.3g}"
        + (f" (fits too: {others})" if others else "")
    )


def _others(head: Recorded) -> Iterator[tuple[str, Recorded]]:
    for wiring in WIRINGS[1:]:
        yield f"--wiring{'=' if wiring[0] == '-' else ' '}{wiring}", replace(head, y=rewired(head.y, wiring))
    yield "--begins", replace(head, t=head.t[1:], u=head.u[:-1], y=head.y[1:])


def _misfit(found: Innovations) -> float:
    """Mean normalised innovation squared over the second half, where a filter has settled."""
    nis = np.sum(found.whitened(slice(len(found.nu) // 2, None)) ** 2, axis=1)
    good = nis[np.isfinite(nis)]
    return float(np.mean(good)) if len(good) > len(nis) // 2 else np.inf
