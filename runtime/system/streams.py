"""The three streams of a process: there at all, and still read by somebody."""

from __future__ import annotations

import os
import select
import sys

#: Exit code where nobody reads the output any more, as of a program that SIGPIPE ends.
UNREAD = 141


class UnreadError(BrokenPipeError):
    """Nobody reads the output of the command any more."""


def open_streams() -> None:
    """Open what the caller has closed (``>&-``) to nowhere.

    Python has None for such a stream, and the first file that is opened would take its number: what a compiler or
    another program says there would be written into that file.
    """
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free, which is this one
            setattr(sys, name, os.fdopen(number, mode, closefd=False, encoding="utf-8", errors="replace"))


def reader_is_gone() -> bool:
    """Whether output goes to a pipe, as to ``| head -1``, whose reader has ended."""
    watch = select.poll()
    for stream in (sys.stdout, sys.stderr):
        try:
            watch.register(stream.fileno(), 0)
        except (OSError, ValueError):  # no stream of the system's
            continue
    return any(event & select.POLLERR for _, event in watch.poll(0))
