"""Programs of others, run to their end: one that cannot be started or does not end is one line, as one that crashed."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

#: Seconds after which a program is taken to hang, where nothing else is said.
PATIENCE = 300.0

#: What a compiler's driver says where the compiler proper crashed or was killed; the driver itself ends well.
CRASHED = ("internal compiler error", "signal terminated program")


class ProgramError(RuntimeError):
    """A program that cannot be started, crashes, hangs, or makes nothing sensible; one line: which, and on what."""


@dataclass(frozen=True)
class Ended:
    """How a program ended: its exit code, negative for a signal, and what it said."""

    code: int
    out: str
    err: str

    @property
    def crash(self) -> str:
        """By what it crashed, or the compiler that it had started; empty if it did not."""
        if self.code < 0:
            return f"{signal.strsignal(-self.code)}."
        lines = (line for line in self.err.splitlines() if any(words in line for words in CRASHED))
        return next(lines, "")[:200] if self.code else ""


def run_program(
    command: Sequence[str],
    what: str = "",
    patience: float | None = None,
    folder: Path | None = None,
    on: str = "",
    temporary: Path | None = None,
) -> Ended:
    """Run a program in a group of its own: what it has started ends with it.

    Parameters
    ----------
    command : sequence of str
    what : str, optional
        How a line names it; default: its first word.
    patience : float, optional
        s; default: :data:`PATIENCE`.
    folder : Path, optional
        Where it runs.
    on : str, optional
        The file it is run on.
    temporary : Path, optional
        Where its own temporary files go: what it leaves where it is ended then goes with that folder.

    Raises
    ------
    ProgramError
        It cannot be started, or does not end.
    """
    what, limit = what or command[0], PATIENCE if patience is None else patience
    environment = {**os.environ, "TMPDIR": str(temporary)} if temporary else None
    try:
        process = subprocess.Popen(
            list(command), cwd=folder, env=environment, process_group=0, encoding="utf-8", errors="replace",
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip
    except OSError as error:
        raise ProgramError(f"{what} cannot be started: {error.strerror}.") from None
    try:
        out, err = process.communicate(timeout=limit)
    except subprocess.TimeoutExpired:
        raise ProgramError(f"{what} did not end within {limit:g} s{f' on {on}' if on else ''}.") from None
    finally:
        if process.returncode is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    return Ended(process.returncode, out, err)
