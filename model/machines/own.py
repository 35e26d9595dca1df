"""A machine of one's own: a class in a Python file beside the drive file, run and tried before anything is built on it.

The file's text travels with the drive and into its generated folder, so that the equations a folder was made from are
always the ones at hand. Running the file is running a program: read it before you load a drive file of somebody else's.
"""

from __future__ import annotations

import difflib
import hashlib
import inspect
import keyword
import random
import re
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import PurePosixPath, PureWindowsPath
from types import ModuleType
from typing import Any

import casadi as ca

from model.machines.base import Machine, Parameters, Rotor
from model.quantities import Constants, Quantity
from model.schema import Drive

_WORD = re.compile(r"(?P<file>.+\.py):(?P<name>[A-Za-z_]\w*)")
#: Text allowed in C comments and tables: ASCII, and nothing that ends either.
_PLAIN = re.compile(r"(?!.*\*/)[ -{}~]*")
_TAKEN = ("omega", "theta", "load_torque", "magnet_flux", "stator_resistance")


class MachineError(ValueError):
    """A machine that cannot be used; one line that says what, where and what would be right."""


@dataclass(frozen=True)
class Word:
    """``my_machine.py:MyMachine``: a file, relative to the drive file, and a class in it."""

    file: str
    name: str


def read_word(word: str) -> Word | None:
    """The parts of ``FILE.py:CLASS``; None for any other word.

    Parameters
    ----------
    word : str
        What stands in ``model.machine``.

    Raises
    ------
    MachineError
        A path that is not relative to the drive file: it would not be there on another computer.

    >>> read_word("my_machine.py:MyMachine")
    Word(file='my_machine.py', name='MyMachine')
    """
    match = _WORD.fullmatch(word)
    if match is None:
        return None
    file = match["file"]
    if PurePosixPath(file).is_absolute() or PureWindowsPath(file).is_absolute():
        raise MachineError(f"model.machine = '{word}': give the file's path relative to the drive file.")
    return Word(file, match["name"])


def load_module(word: Word, text: str) -> ModuleType:
    """Run a machine file's text, once a process for each text.

    Parameters
    ----------
    word : Word
        File and class of a machine of one's own.
    text : str
        The text.

    Raises
    ------
    MachineError
        It cannot be run: with the line and the reason.
    """
    identity = hashlib.sha256(f"{word.file}\n{text}".encode()).hexdigest()
    name = f"machine_{identity[:16]}"
    if name in sys.modules:
        return sys.modules[name]
    module = ModuleType(name)
    sys.modules[name] = module  # dataclasses look their module up there
    try:
        exec(compile(text, word.file, "exec", dont_inherit=True), module.__dict__)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise MachineError(f"machine file {_blame(word.file, error)}") from None
    return module


def load_class(word: Word, text: str) -> type[Machine]:
    """The class of a machine file.

    Parameters
    ----------
    word : Word
        File and class of a machine of one's own.
    text : str
        The text.

    Raises
    ------
    MachineError
        The file cannot be run, has no such class, or the class is no complete Machine.
    """
    module = load_module(word, text)
    here = f"machine file '{word.file}'"
    found = getattr(module, word.name, None)
    if found is None:
        machines = [
            name for name, item in vars(module).items() if _is_machine(item) and item.__module__ == module.__name__
        ]
        close = difflib.get_close_matches(word.name, machines, n=1)
        hint = f" Did you mean '{close[0]}'?" if close else f" Its machines: {', '.join(machines) or 'none'}."
        raise MachineError(f"{here} has no class '{word.name}'.{hint}")
    if not _is_machine(found):
        raise MachineError(
            f"{here}: '{word.name}' is no machine; derive it: class {word.name}(Machine), from model.machines."
        )
    machine: type[Machine] = found
    missing = sorted(getattr(machine, "__abstractmethods__", ()))
    if missing:
        raise MachineError(f"{here}: class {word.name} does not say its {', '.join(missing)}.")
    _check_states(machine, f"{here}: class {word.name}")
    return machine


def running(word: Word, doing: str, function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function of a machine file.

    Parameters
    ----------
    word : Word
        File and class of a machine of one's own.
    doing : str
        What is called, for the error: "MyMachine.torque".
    function : callable
        A method of the class.
    *arguments : object
        What it is called with.

    Raises
    ------
    MachineError
        Whatever it raises, with the line.
    """
    try:
        return function(*arguments)
    except (Exception, SystemExit) as error:
        raise MachineError(f"machine file {_blame(word.file, error, doing)}") from None


def kept_as(word: Word) -> str:
    """Where a generated folder keeps the machine file it was made from.

    Parameters
    ----------
    word : Word
        File and class of a machine of one's own.
    """
    return f"machine/{PurePosixPath(word.file).name}"


def title(machine: type[Machine]) -> str:
    """The title of an own machine in headers and reports: its docstring up to the first full stop or semicolon.

    Parameters
    ----------
    machine : type of Machine
        A class of one's own.

    Returns
    -------
    str
        The class's name where the docstring has no such part or holds what C comments cannot.
    """
    lines = (inspect.getdoc(machine) or "").splitlines() if machine.__doc__ else []
    first = re.split(r"[.;:](?:\s|$)", lines[0])[0].strip() if lines else ""
    if not first or not _PLAIN.fullmatch(first):
        return machine.__name__
    return first[0].lower() + first[1:] if first[1:2].islower() else first


def try_out(drive: Drive, machine: type[Machine]) -> None:
    """Call everything the class says, with the drive's numbers.

    Parameters
    ----------
    drive : Drive
        Its numbers are put in; its ``model.machine`` is a ``FILE.py:CLASS``.
    machine : type of Machine
        That class.

    Raises
    ------
    MachineError
        A method fails or returns something else than it should, or ``electrical_state`` is not the inverse of
        ``currents``.
    """
    word = read_word(drive.model.machine)
    assert word is not None
    z, v, i = (ca.vertsplit(ca.SX.sym(name, 2)) for name in ("z", "v", "i"))
    omega_e, theta = ca.SX.sym("omega_e"), ca.SX.sym("theta")
    rotor = Rotor.at(theta)
    said = machine(Parameters.numeric(drive), Constants(named=False))

    def call(method: str, *arguments: Any) -> Any:
        return running(word, f"{word.name}.{method}", getattr(said, method), *arguments)

    def demand(method: str, good: bool, wanted: str) -> None:
        if not good:
            raise MachineError(f"machine file '{word.file}': {word.name}.{method} must return {wanted}.")

    currents = call("currents", z, rotor)
    good = (
        isinstance(currents, tuple) and len(currents) == 2 and _is_pair(currents[0]) and isinstance(currents[1], dict)
    )
    demand("currents", good, "a pair of currents in A and a dict of named intermediates, such as {}")
    demand("derivative", _is_pair(call("derivative", z, v, omega_e, rotor)), "a pair, dz/dt of both states")
    demand("torque", _is_scalar(call("torque", z, rotor)), "one scalar in N m")
    state = call("electrical_state", i, rotor)
    demand("electrical_state", _is_pair(state), "a pair, both states")
    call("euler" if drive.model.discretization == "euler" else "exact", z, v, omega_e, theta)
    back = call("currents", tuple(state), rotor)[0]
    _check_inverse(drive, word, ca.Function("back", [ca.vertcat(*i), theta], [ca.vertcat(*back)]))


def _check_inverse(drive: Drive, word: Word, back: Callable[..., Any]) -> None:
    """currents(electrical_state(i)) = i at a few points of the operating box."""
    draw = random.Random(1)
    largest = 0.7 * drive.operating_box.current
    for _ in range(20):
        i, theta = [draw.uniform(-largest, largest) for _ in range(2)], draw.uniform(-3.1, 3.1)
        found = [float(value) for value in ca.vertsplit(back(i, theta))]
        if not all(abs(a - b) <= 1e-7 * largest for a, b in zip(i, found, strict=True)):
            raise MachineError(
                f"machine file '{word.file}': {word.name}.electrical_state is not the inverse of currents: at theta = "
                f"{theta:.3g} rad i = ({i[0]:.4g}, {i[1]:.4g}) A come back as ({found[0]:.4g}, {found[1]:.4g}) A."
            )


def _is_machine(item: Any) -> bool:
    return isinstance(item, type) and issubclass(item, Machine)


def _is_scalar(value: Any) -> bool:
    return isinstance(value, int | float) or (isinstance(value, ca.SX | ca.DM) and value.numel() == 1)


def _is_pair(value: Any) -> bool:
    return isinstance(value, tuple | list) and len(value) == 2 and all(map(_is_scalar, value))


def _check_states(machine: type[Machine], where: str) -> None:
    states = getattr(machine, "states", None)
    if not (isinstance(states, tuple) and len(states) == 2 and all(isinstance(s, Quantity) for s in states)):
        raise MachineError(f"{where}: states must be a tuple of two Quantity(name, symbol, unit, meaning).")
    names = [state.name for state in states]
    for name in names:
        if not re.fullmatch(r"[a-z][a-z0-9_]*", name) or keyword.iskeyword(name):
            raise MachineError(f"{where}: state '{name}' must be called like a C variable, such as psi_alpha.")
        if name in _TAKEN or names.count(name) > 1:
            raise MachineError(f"{where}: a state called '{name}' is there already.")
    for state in states:
        for text in (state.unit, state.meaning):
            if not _PLAIN.fullmatch(text):
                raise MachineError(
                    f"{where}: '{text}' of state '{state.name}' goes into C comments: plain ASCII, please."
                )


def _blame(file: str, error: BaseException, doing: str = "") -> str:
    """'my_machine.py', line 7: NameError: ... (in MyMachine.torque); the deepest line of the file that took part."""
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == file]
    line = error.lineno if isinstance(error, SyntaxError) and error.filename == file else next(reversed(lines), None)
    reason = error.msg if isinstance(error, SyntaxError) else str(error).strip().partition("\n")[0]
    at = f", line {line}" if line else ""
    return f"'{file}'{at}: {type(error).__name__}: {reason}" + (f" (in {doing})" if doing else "")
