"""A live view of a recording: curves where there is a display, else a table that renews itself."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from rich.console import Console
from rich.live import Live

from runtime.board.record import COLUMNS, Recording
from runtime.board.tables import recording_table

#: Curves of the live plot: axis title -> columns.
AXES = {
    "u, V": ("u_alpha", "u_beta"),
    "i, A": ("i_alpha", "i_beta"),
    "omega estimate, rad/s": ("omega_estimate",),
}

#: matplotlib back ends that draw into files: what it falls back to without a display.
FILES_ONLY = {"agg", "cairo", "pdf", "pgf", "ps", "svg", "template"}

Show = Callable[[Recording], None]


@contextmanager
def live_view(console: Console, plot: bool) -> Iterator[Show]:
    """Something to show a recording with, twice a second.

    Parameters
    ----------
    console : Console
        Where it is printed.
    plot : bool
    """
    figure = _window(console) if plot else None
    if figure is not None:
        yield lambda recording: _draw(figure, recording)
        return
    # Rich renews the table itself; into a file or a pipe it prints nothing until the end.
    with Live(console=console, refresh_per_second=4, transient=True) as live:
        yield lambda recording: live.update(recording_table(recording))


def _window(console: Console) -> Any:
    """An open figure, or None, and why, where none can be shown."""
    try:
        import matplotlib
        from matplotlib import pyplot
    except ImportError:
        console.print("no live plot: it needs matplotlib (pip install 'pmsm-ickf[report]'); a table instead.")
        return None
    pyplot.ion()
    if matplotlib.get_backend().lower() in FILES_ONLY:
        console.print("no live plot: there is no display; a table instead.")
        return None
    figure, _ = pyplot.subplots(len(AXES), 1, sharex=True)
    figure.show()
    return figure


def _draw(figure: Any, recording: Recording) -> None:
    if not recording.recent:
        return
    rows = np.array(recording.recent)
    for axes, (title, names) in zip(figure.axes, AXES.items(), strict=True):
        axes.clear()
        axes.set_ylabel(title)
        for name in names:
            axes.plot(rows[:, 0], rows[:, COLUMNS.index(name)], label=name)
        axes.legend(loc="upper right")
    figure.axes[-1].set_xlabel("t, s")
    figure.canvas.draw_idle()
    figure.canvas.flush_events()
