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


def remember_interrupts() -> None:
    """From here on Ctrl-C is not lost: CasADi above all swallows a KeyboardInterrupt that reaches it.

    SIGTERM is the same: it leaves time to end what was started.
    """

    def remember(number: int, frame: FrameType | None) -> None:
        _signals.append(number)
        _interrupted.set()
        signal.default_int_handler(number, frame)

    def quiet(unraisable: Any) -> None:
        """Where Python cannot raise it, in a finaliser say, it would be printed: it is remembered, that is enough."""
        if not issubclass(unraisable.exc_type, KeyboardInterrupt):
            sys.__unraisablehook__(unraisable)

    if threading.current_thread() is threading.main_thread():
        sys.unraisablehook = quiet
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, remember)


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
