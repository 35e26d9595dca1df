"""A program's run on an emulated processor, and what its lines say."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from runtime.firmware.recording import Recording
from runtime.firmware.subject import Subject
from runtime.system.errors import UserError
from runtime.system.programs import run_to_end

Array = NDArray[Any]

#: An emulation that has not ended by then hangs, s.
PATIENCE = 300

_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_STEP = re.compile(r"^S ([0-9a-f]{8}) ([0-9a-f]{8})", re.MULTILINE)
_WORD = re.compile(r"^W ([0-9a-f]{8})", re.MULTILINE)
_CALIBRATION = re.compile(r"^([EL]) ([0-9a-f]{8})", re.MULTILINE)


@dataclass(frozen=True)
class Outcome:
    """Checksums (steps,) and the cost of each step (steps,) in the processor's own unit.

    From the cost that of an empty function, called the same way, is subtracted (on the M4 two instructions,
    the return among them).
    ``known_loop`` is what the counter said of a loop of known length, in the same unit.
    """

    checksums: Array
    cost: Array
    known_loop: float


class Processor(Protocol):
    """A stand-in: how to compile for it and run it."""

    name: str  # as a table says it
    unit: str  # of Outcome.cost
    known_loop: float  # what Outcome.known_loop should be
    resolution: float  # of the counter, in that unit; 0: it is exact
    programs: tuple[str, ...]  # what has to be installed

    def run(self, subject: Subject, recording: Recording, flags: Sequence[str] = ()) -> Outcome:
        """Every step's checksum and cost. ``flags`` are added to the compiler's."""

    def words_at(self, step: int, subject: Subject, recording: Recording, flags: Sequence[str] = ()) -> Array:
        """All words after one step, from a second run."""


def outcome(text: str, steps: int, what: str, unit: float) -> Outcome:
    """Read a run's lines; ``unit`` is what one tick counts.

    Raises
    ------
    UserError
        The program did not reach its end.
    """
    found = _STEP.findall(text)
    calibration = {tag: int(value, 16) for tag, value in _CALIBRATION.findall(text)}
    if len(found) != steps or set(calibration) != {"E", "L"}:
        raise UserError(f"{what} stopped after {len(found)} of {steps} steps: {text.strip()[-200:]!r}")
    rows = np.array([[int(value, 16) for value in pair] for pair in found], dtype=np.int64).reshape(steps, 2)
    cost = (rows[:, 1] - calibration["E"]) * unit
    return Outcome(rows[:, 0].astype(np.uint32), cost, calibration["L"] * unit)


def dumped_words(text: str, count: int, what: str) -> Array:
    """The words of a run with DUMP_STEP."""
    found = [int(value, 16) for value in _WORD.findall(text)]
    if len(found) != count:
        raise UserError(f"{what} printed {len(found)} of {count} words: {text.strip()[-200:]!r}")
    return np.array(found, dtype=np.uint32)


def emulate(command: Sequence[str], program: Path, what: str) -> str:
    """Run an emulator on a program; what it printed, on either stream."""
    done = run_to_end([*command, str(program)], what, PATIENCE)
    if done.crash:
        raise UserError(f"{what} crashed: {done.crash}")
    return _COLOUR.sub("", done.out + done.err)
