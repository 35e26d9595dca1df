"""How a command ends that cannot go on: in one line."""

from __future__ import annotations

import os
import signal
import sys
import threading
from types import FrameType
from typing import Any, NoReturn

from runtime.system.workers import kill_descendants


class UserError(Exception):
    """Bad input or a missing tool; the command line prints it and exits with 2.

    Its text is one line that says what, where and what would be right.
    """


_interrupted = threading.Event()
_signals: list[int] = []
_unbroken = 0  # things under way in the main thread that an interrupt must not cut in two
_held_back = False


def remember_interrupts() -> None:
    """From here on Ctrl-C is not lost: CasADi above all swallows a KeyboardInterrupt that reaches it.

    SIGTERM is the same: it leaves time to end what was started.
    """

    def remember(number: int, frame: FrameType | None) -> None:
        global _held_back
        _signals.append(number)
        _interrupted.set()
        if _unbroken and not _held_back:  # the second one cuts: what is under way may have come to a stand
            _held_back = True
        else:
            signal.default_int_handler(number, frame)

    def quiet(unraisable: Any) -> None:
        """Where Python cannot raise it, in a finaliser say, it would be printed: it is remembered, that is enough."""
        if not issubclass(unraisable.exc_type, KeyboardInterrupt):
            sys.__unraisablehook__(unraisable)

    if threading.current_thread() is threading.main_thread():
        sys.unraisablehook = quiet
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, remember)


def hold_interrupts() -> None:
    """An interrupt waits until ``let_interrupts``: for what would be of no use any more if it were cut in two."""
    global _unbroken
    if threading.current_thread() is threading.main_thread():
        _unbroken += 1


def let_interrupts() -> None:
    """The end of what ``hold_interrupts`` began; an interrupt that waited is raised here."""
    global _unbroken, _held_back
    if threading.current_thread() is not threading.main_thread():
        return
    _unbroken -= 1
    if _held_back and not _unbroken:
        _held_back = False
        raise KeyboardInterrupt


def was_interrupted() -> bool:
    """Ctrl-C or SIGTERM came, whether or not anybody heard it."""
    return _interrupted.is_set()


def stop_if_interrupted() -> None:
    """Raise the KeyboardInterrupt that was swallowed; called where nothing is half done."""
    if was_interrupted():
        raise KeyboardInterrupt


def take_interrupt() -> None:
    """The caller has heard Ctrl-C and finishes in its own way, with what is done so far: others go on as before."""
    _interrupted.clear()


def end_interrupted() -> NoReturn:
    """After Ctrl-C: one line and exit code 130; 143 after SIGTERM. Compilers and emulators end with the command."""
    kill_descendants(os.getpid())
    print("pmsm-ickf: interrupted", file=sys.stderr)
    code = 143 if signal.SIGTERM in _signals else 130
    # CPython remembers an interrupt that came through exec of a text (dataclasses are made so) and would
    # end by SIGINT instead of with our code; the next exec makes it forget.
    exec("")
    sys.exit(code)
