"""Instructions on the host, exactly: valgrind's callgrind counts what runs between a function's entry and its exit.

A count does not depend on the machine's load or clock, so it may be asserted in a test, unlike a time. It does depend
on the compiler: assert ratios, or counts of code written in assembly.
"""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path

from runtime.firmware.emulator import PATIENCE
from runtime.firmware.tools import MissingTool
from runtime.system.errors import UserError
from runtime.system.programs import run_to_end

_TOTALS = re.compile(r"^totals: (\d+)", re.MULTILINE)
_COLLECTED = re.compile(r"Collected\s*:\s*(\d+)")


def count_instructions(program: Path, function: str, *arguments: str) -> int:
    """Instructions a program executes inside ``function``, what it calls included, over the whole run.

    Parameters
    ----------
    program : Path
        Compiled with its symbols, ``function`` not inlined.
    function : str
        Its name; ``*`` stands for any characters. C++ names are demangled.
    arguments : str
        The program's own.

    Raises
    ------
    UserError
        No valgrind, the program fails, or the function is never entered.
    """
    with tempfile.TemporaryDirectory() as scratch:
        return _counted([f"--callgrind-out-file={scratch}/out"], program, function, arguments)


def instructions_of_each(program: Path, function: str, *arguments: str) -> list[int]:
    """The same of every single call, in order.

    Parameters
    ----------
    program : Path
    function : str
    arguments : str
        As :func:`count_instructions` takes them.

    Raises
    ------
    UserError
        No valgrind, the program fails, or the function is never entered.
    """
    with tempfile.TemporaryDirectory() as scratch:
        options = [f"--callgrind-out-file={scratch}/out", f"--dump-after={function}"]
        total = _counted(options, program, function, arguments)
        parts = sorted(Path(scratch).glob("out.*"), key=lambda path: int(path.suffix[1:]))
        counts = [int(_TOTALS.findall(path.read_text(encoding="utf-8"))[-1]) for path in parts]
    assert sum(counts) == total, "a call without a count of its own"
    return counts


def _counted(options: Sequence[str], program: Path, function: str, arguments: Sequence[str]) -> int:
    valgrind = shutil.which("valgrind")
    if valgrind is None:
        raise MissingTool("valgrind", "valgrind")
    command = [valgrind, "--tool=callgrind", f"--toggle-collect={function}", *options, str(program), *arguments]
    done = run_to_end(command, f"callgrind on '{program.name}'", PATIENCE)
    found = _COLLECTED.search(done.err)
    if done.code != 0 or found is None:
        raise UserError(f"callgrind on '{program.name}' failed: {done.err.strip()[-200:]!r}")
    if not int(found.group(1)):
        raise UserError(f"callgrind on '{program.name}': '{function}' was never entered, or it was inlined.")
    return int(found.group(1))


def instructions_per_step(program: Path, function: str, first: int, last: int, more: Sequence[str] = ()) -> float:
    """Mean instructions of steps ``first`` .. ``last``: (Ir(last) - Ir(first)) / (last - first).

    ``program`` takes the number of steps as its first argument, then ``more``.
    """
    counts = [count_instructions(program, function, str(steps), *more) for steps in (first, last)]
    return (counts[1] - counts[0]) / (last - first)
