"""The terminal that every command writes to, and what it shows while one works."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Self

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, TextColumn, TimeRemainingColumn

from runtime.system.errors import hold_interrupts, let_interrupts, stop_if_interrupted
from runtime.system.values import read_number


class Terminal(Console):
    """A console that Ctrl-C finds between two things it shows, never within one.

    Rich counts how deep it is in what it shows. An interrupt between the counting and its ``try`` leaves the
    count wrong, and all that is shown later, how the command ended above all, stays in a buffer for good.
    """

    def __enter__(self) -> Self:
        hold_interrupts()
        super().__enter__()
        return self

    def __exit__(self, *raised: Any) -> None:
        try:
            super().__exit__(*raised)
        finally:
            let_interrupts()


# Into a file or a pipe the tables keep their width, whatever the terminal behind it.
console = Terminal() if sys.stdout.isatty() else Terminal(width=140)


#: Seconds between lines of progress where nobody watches, unless the environment variable PMSM_ICKF_LOG_EVERY says
#: otherwise: a log tells that the work goes on, and where it is.
LOG_EVERY = 60.0


def log_every() -> float:
    """Seconds between lines of progress in a log: PMSM_ICKF_LOG_EVERY, else :data:`LOG_EVERY`.

    Raises
    ------
    UserError
        The variable is no number of seconds.
    """
    stated = os.environ.get("PMSM_ICKF_LOG_EVERY")
    return LOG_EVERY if stated is None else read_number(stated, "PMSM_ICKF_LOG_EVERY:", 0.0)


_quiet = False


def be_quiet(quiet: bool) -> None:
    """Whether progress is kept from showing, from now on.

    Parameters
    ----------
    quiet : bool
    """
    global _quiet
    _quiet = quiet


def say(text: str, end: str = "\n") -> None:
    """A line as it is: names and paths are the user's, and square brackets in them are no markup.

    Parameters
    ----------
    text : str
    end : str, optional
        What follows it.
    """
    console.print(text, end=end, highlight=False, markup=False, soft_wrap=True)


@contextmanager
def working() -> Iterator[Callable[[str], None]]:
    """A spinner that says what is going on; a line a minute where there is no terminal; nothing with ``--quiet``."""
    if _quiet:
        yield lambda text: stop_if_interrupted()
    elif console.is_terminal:
        with console.status("") as status:

            def show(text: str) -> None:
                stop_if_interrupted()
                status.update(escape(text))

            yield show
    else:
        every, said = log_every(), time.monotonic()

        def write(text: str) -> None:
            nonlocal said
            stop_if_interrupted()
            if time.monotonic() - said >= every:
                said = time.monotonic()
                console.print(f"[dim]{escape(text)}[/dim]", highlight=False)

        yield write
    stop_if_interrupted()


@contextmanager
def counting(what: str, *columns: ProgressColumn, total: float | None = None) -> Iterator[Callable[..., None]]:
    """A progress bar, where there is a terminal; what it yields takes the keys of Rich's ``Progress.update``."""
    columns = columns or (MofNCompleteColumn(), TimeRemainingColumn(), TextColumn("{task.description}"))
    shown = console.is_terminal and not _quiet
    with Progress(TextColumn(what), BarColumn(), *columns, console=console, transient=True, disable=not shown) as bar:
        task = bar.add_task("", total=total)

        def update(**keys: Any) -> None:
            stop_if_interrupted()
            bar.update(task, **keys)

        yield update


@contextmanager
def work_bar(what: str, total: int) -> Iterator[Callable[[str, int], None]]:
    """A progress bar, where there is a terminal, of so many executions or steps."""
    with counting(what, total=total) as update:
        yield lambda name, more: update(advance=more, description=escape(name))
