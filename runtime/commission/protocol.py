"""Words and records of ``board/pmsm_commission.h``, as the line carries them."""

from __future__ import annotations

import struct
from dataclasses import dataclass

HELLO, CLEAR, SEGMENT, START = 0x10, 0x11, 0x12, 0x13
EVENT = 0xE1
PROTOCOL = 1

#: States of the board, and what the reasons of an end are in words.
IDLE, RUNNING, DONE, ENDED = range(4)
REASONS = (
    "no reason",
    "a byte on the line ended it",
    "a phase current was beyond its limit",
    "the DC link was outside its limits",
    "the plan took longer than it may",
    "rows came faster than the line carries them",
)
BYTE_ARRIVED = 1
VERDICTS = (
    "taken",
    "the last plan ended by a limit or a byte",
    "a number of the plan is beyond the limits that the board's firmware sets",
    "the board does not know this command",
)
GATES_OFF, DRAIN, STIFF = 1, 2, 4


@dataclass(frozen=True)
class Hello:
    """What the board is: samples, memory, and the limits that its firmware sets (A, rad/s electrical, s)."""

    state: int
    reason: int
    delay: int
    segments: int
    rows: int
    period: float
    current: float
    speed: float
    seconds: float


@dataclass(frozen=True)
class Segment:
    """A stretch of a plan.

    Current along the axis (A), its speed (rad/s electrical) and a turn (rad) are reached after ``ramp`` of its
    ``samples``. ``along``, ``across`` V: a square wave whose sign changes every ``half`` samples. A row is the mean of
    ``every`` samples, 0: none. ``what`` and ``place`` name it to who reads the rows.
    """

    what: str
    samples: int
    current: float
    ramp: int = 1
    speed: float = 0.0
    turn: float = 0.0
    along: float = 0.0
    across: float = 0.0
    half: int = 0
    every: int = 0
    flags: int = 0
    place: int = 0

    def packed(self, index: int) -> bytes:
        """Payload of the command.

        Parameters
        ----------
        index : int
            Place in the plan.
        """
        ints = struct.pack("<BHHH", index, self.flags, self.half, self.every)
        floats = (float(self.samples), float(self.ramp), self.current, self.speed, self.turn, self.along, self.across)
        return ints + struct.pack("<7f", *floats)


@dataclass(frozen=True)
class Run:
    """A plan with its limits (A, V) and its controller.

    ``gains``: V/A and V/A a sample along the current, and across it; ``flux`` V s and ``inductance`` H: times speed,
    the voltage across that is expected; ``lost`` V of a leg by the sign of its current, which fades below ``fade`` A.
    """

    name: str
    segments: tuple[Segment, ...]
    current_limit: float
    link: tuple[float, float]
    gains: tuple[float, float, float, float]
    flux: float
    inductance: float
    lost: float
    fade: float

    def packed(self) -> bytes:
        """Payload of the command that starts it."""
        numbers = (self.current_limit, *self.link, *self.gains, self.flux, self.inductance, self.lost, self.fade)
        return struct.pack("<B11f", len(self.segments), *numbers)

    @property
    def samples(self) -> int:
        """How many it lasts, but for what waits for the line."""
        return sum(segment.samples for segment in self.segments)


def read_hello(payload: bytes) -> Hello | None:
    """The board's answer; None if it speaks another protocol.

    Parameters
    ----------
    payload : bytes
    """
    if len(payload) != 23 or payload[0] != PROTOCOL:
        return None
    return Hello(*struct.unpack("<BBBBH4f", payload[1:]))
