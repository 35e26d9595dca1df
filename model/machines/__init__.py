"""Machines: one class with its equations each. ``MACHINES`` maps a drive file's word to a class that is shipped.

:func:`find_machine` is the one place where a drive's word becomes a class, shipped or of one's own.
"""

from __future__ import annotations

import difflib

from model.machines.base import Machine
from model.machines.own import MachineError, load_class, read_word
from model.machines.salient import SalientPMSM
from model.machines.salient_flux import SalientFluxPMSM
from model.machines.surface import SurfacePMSM
from model.schema import Drive

MACHINES: dict[str, type[Machine]] = {
    "surface": SurfacePMSM,
    "salient": SalientPMSM,
    "salient_flux": SalientFluxPMSM,
}


def find_machine(drive: Drive) -> type[Machine]:
    """The class with a drive's equations.

    Parameters
    ----------
    drive : Drive
        Its ``model.machine`` is a shipped word or ``FILE.py:CLASS``, with the file's text in ``machine_text``.

    Raises
    ------
    MachineError
        Its file is not at hand, cannot be run, or holds no such machine.
    """
    word = drive.model.machine
    if word in MACHINES:
        return MACHINES[word]
    own = read_word(word)
    if own is None:
        raise MachineError(unknown_word(word))
    if not drive.machine_text:
        raise MachineError(f"model.machine = '{word}': the text of '{own.file}' is not at hand; load the drive's file.")
    return load_class(own, drive.machine_text)


def unknown_word(word: str) -> str:
    """The error message for a word that names no machine.

    Parameters
    ----------
    word : str
        What stands in ``model.machine``.
    """
    if word.endswith(".py"):
        return f"model.machine = '{word}' names no class. Did you mean '{word}:MyMachine', with its name?"
    close = difflib.get_close_matches(word, MACHINES, n=1)
    hint = f" Did you mean '{close[0]}'?" if close else ""
    known = ", ".join(f"'{name}'" for name in MACHINES)
    return f"model.machine = '{word}' is none of {known}, and no 'FILE.py:CLASS' of your own.{hint}"


__all__ = [
    "MACHINES",
    "Machine",
    "MachineError",
    "SalientFluxPMSM",
    "SalientPMSM",
    "SurfacePMSM",
    "find_machine",
    "unknown_word",
]
