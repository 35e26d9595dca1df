"""Receive what ``pmsm_telemetry`` sends and keep it as recorded data, gaps marked.

The board's estimates are kept as ``omega_estimate`` and ``theta_estimate``, never under the names of the truth.
``lost_before`` counts the frames lost on the line before a row; ``sample`` is the board's own counter, which also
shows what the board left out on purpose or because the line was too slow.
"""

from __future__ import annotations

import signal
import struct
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from runtime.board.frames import TELEMETRY, Decoder, Frame
from runtime.board.link import Port, UnpluggedError

COLUMNS = (
    "t",
    "u_alpha",
    "u_beta",
    "i_alpha",
    "i_beta",
    "omega_estimate",
    "theta_estimate",
    "sample",
    "lost_before",
)
#: Rows reach the disk after this long at the latest, s.
FLUSH = 0.5

Row = tuple[float, ...]


class Sink(Protocol):
    """Where rows go."""

    def append(self, rows: list[Row]) -> None:
        """Keep them for good."""


@dataclass
class Recording:
    """The received samples. ``recent`` are the last rows, for a live view; the others are on the disk only.

    ``left_out``: times the step between two sample numbers was larger than the smallest although no frame was lost.
    """

    rows: int = 0
    lost: int = 0
    gaps: int = 0
    damaged: int = 0
    doubled: int = 0
    restarts: int = 0
    other: int = 0
    left_out: int = 0
    first_gaps: list[float] = field(default_factory=list)
    recent: deque[Row] = field(default_factory=lambda: deque(maxlen=2000))
    ended: str = ""


class Receiver:
    """Frames to rows: time from the sample number, gaps from the sequence number."""

    def __init__(self) -> None:
        self.recording = Recording()
        self._decoder = Decoder()
        self._sequence: int | None = None
        self._sample = 0
        self._t = 0.0
        self._stride: int | None = None

    def feed(self, received: bytes) -> list[Row]:
        """The rows that ``received`` completes."""
        rows = [row for frame in self._decoder.feed(received) if (row := self._row(frame)) is not None]
        self.recording.damaged = self._decoder.bad
        self.recording.rows += len(rows)
        self.recording.recent.extend(rows)
        return rows

    def _row(self, frame: Frame) -> Row | None:
        if frame.command != TELEMETRY or len(frame.payload) != 32:
            self.recording.other += 1
            return None
        if frame.sequence == self._sequence:
            self.recording.doubled += 1
            return None
        period, sample, *values = struct.unpack("<fI6f", frame.payload)
        lost = self._advance(frame.sequence, sample, float(str(np.float32(period))))
        return (self._t, *values, float(sample), float(lost))

    def _advance(self, sequence: int, sample: int, period: float) -> int:
        """Bring time and numbers up to this frame; how many frames are missing before it."""
        recording = self.recording
        first, lost, passed = self._sequence is None, 0, (sample - self._sample) & 0xFFFFFFFF
        if not first:
            lost = (sequence - (self._sequence or 0) - 1) & 0xFFFF
            if passed == 0 or passed >= 1 << 31:  # backwards: the board started again, how much is missing is unknown
                recording.restarts += 1
                passed, lost = 1, 1
            elif not lost:
                recording.left_out += self._stride is not None and passed > self._stride
                self._stride = min(passed, self._stride or passed)
            self._t += passed * period
        if lost:
            recording.lost += lost
            recording.gaps += 1
            if len(recording.first_gaps) < 10:
                recording.first_gaps.append(self._t)
        self._sequence, self._sample = sequence, sample
        return lost


@contextmanager
def ctrl_c() -> Iterator[Callable[[], bool]]:
    """Ctrl-C as a question to ask, so that it never cuts a write in two."""
    seen: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: seen.append(number))
    try:
        yield lambda: bool(seen)
    finally:
        signal.signal(signal.SIGINT, before)


def record(
    port: Port,
    sink: Sink,
    seconds: float | None,
    stop: Callable[[], bool] = lambda: False,
    show: Callable[[Recording], None] = lambda recording: None,
) -> Recording:
    """Receive until the time is up, ``stop`` says so, or the line fails; everything received is in ``sink`` then.

    Memory stays bounded: rows leave for the sink every half second.
    """
    receiver = Receiver()
    started = flushed = time.monotonic()
    waiting: list[Row] = []
    try:
        while not stop() and (seconds is None or time.monotonic() - started < seconds):
            waiting += receiver.feed(port.read())
            if time.monotonic() - flushed >= FLUSH:
                sink.append(waiting)
                waiting, flushed = [], time.monotonic()
                show(receiver.recording)
    except UnpluggedError as error:
        receiver.recording.ended = f"{error}: is the cable plugged in?"
    sink.append(waiting)
    return receiver.recording
