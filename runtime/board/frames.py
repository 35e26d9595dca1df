"""Frames as ``board/pmsm_link.c`` sends them: sequence, command, payload, CRC-32; COBS-coded between zeros.

A frame whose damage is a burst of up to 32 bits on the frame itself is always caught by the CRC; other damage
passes with a probability of 2^-32 = 2.3e-10 for each damaged frame. Damage to a COBS code is of the other kind.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field

ANSWER = 0x80
HELLO, RESET, SET_STATE, STEP = 1, 2, 3, 4
DAMAGED, REFUSED, TELEMETRY = 0xF0, 0xF1, 0xE0

#: More bytes without a zero are no frame: the board's PMSM_FRAME_MAX and its COBS code.
LONGEST = 251


@dataclass(frozen=True)
class Frame:
    """One undamaged frame."""

    sequence: int
    command: int
    payload: bytes = b""


def encode(frame: Frame) -> bytes:
    """The bytes on the line, with the zeros around them.

    >>> encode(Frame(1, HELLO)).hex(" ")
    '00 02 01 06 01 b3 83 84 89 00'
    """
    body = struct.pack("<HB", frame.sequence, frame.command) + frame.payload
    body += struct.pack("<I", zlib.crc32(body))
    return b"\0" + stuff(body) + b"\0"


def decode(coded: bytes) -> Frame | None:
    """The frame between two zeros, or None if it is damaged."""
    body = unstuff(coded) if len(coded) <= LONGEST else None
    if body is None or len(body) < 7 or zlib.crc32(body[:-4]) != struct.unpack("<I", body[-4:])[0]:
        return None
    sequence, command = struct.unpack("<HB", body[:3])
    return Frame(sequence, command, body[3:-4])


def stuff(body: bytes) -> bytes:
    """COBS for fewer than 254 bytes: each run up to a zero, headed by its length plus one.

    Parameters
    ----------
    body : bytes
        What is sent.
    """
    return b"".join(bytes([len(run) + 1]) + run for run in body.split(b"\0"))


def unstuff(coded: bytes) -> bytes | None:
    """The inverse of :func:`stuff`; None if a code points beyond the end."""
    runs, at = [], 0
    while at < len(coded):
        end = at + coded[at]
        if end > len(coded):
            return None
        runs.append(coded[at + 1 : end])
        at = end
    return b"\0".join(runs)


@dataclass
class Decoder:
    """Bytes in, frames out; what is damaged is counted and dropped, and the next zero starts afresh."""

    bad: int = 0
    _held: bytearray = field(default_factory=bytearray)

    def feed(self, received: bytes) -> list[Frame]:
        """The frames that ``received`` completes, in order."""
        *complete, rest = (bytes(self._held) + received).split(b"\0")
        self._held = bytearray(rest[: LONGEST + 1])  # enough to know that it is too long
        frames = [decode(coded) for coded in complete if coded]
        good = [frame for frame in frames if frame is not None]
        self.bad += len(frames) - len(good)
        return good
