"""Programs of others that a command starts: what they say, or a line of why there is nothing."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from codegen.evidence.programs import Ended, ProgramError, run_program
from runtime.system.errors import UserError


def run_to_end(
    command: Sequence[str], what: str = "", patience: float | None = None, folder: Path | None = None, on: str = ""
) -> Ended:
    """As :func:`codegen.evidence.programs.run_program`, for a command's user.

    Parameters
    ----------
    command : sequence of str
    what : str, optional
        How a line names it; default: its first word.
    patience : float, optional
        s, after which it is taken to hang.
    folder : Path, optional
        Where it runs.
    on : str, optional
        The file it is run on.

    Raises
    ------
    UserError
        It cannot be started, or does not end.
    """
    try:
        return run_program(command, what, patience, folder, on)
    except ProgramError as error:
        raise UserError(str(error)) from None
