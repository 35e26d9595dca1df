"""The host's end of a commissioning: a plan to the board, its rows back, and the byte that ends it."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.board.frames import ANSWER, TELEMETRY, Decoder, Frame, encode
from runtime.board.link import Port
from runtime.commission.protocol import (
    CLEAR,
    DONE,
    ENDED,
    EVENT,
    HELLO,
    REASONS,
    RUNNING,
    SEGMENT,
    START,
    VERDICTS,
    Hello,
    Run,
    read_hello,
)
from runtime.system.errors import UserError

Array = NDArray[Any]

#: Columns of the rows: sample of the run, place of the segment, V and A along and across the axis, rad/s, rad.
ROW = ("sample", "segment", "u_x", "u_y", "i_x", "i_y", "speed", "angle")
#: Bytes of a row's frame on the line, and bits of a byte.
ROW_BYTES, BYTE_BITS = 42, 10
#: Silence after which a running board is taken for lost, s, and tries of a command.
SILENCE, ATTEMPTS = 5.0, 10


@dataclass(frozen=True)
class Ran:
    """What came of a run: its rows (N, 8) by :data:`ROW`, where its segments began, how it ended, frames missing."""

    run: Run
    period: float
    rows: Array
    began: dict[int, int]
    state: int
    reason: int
    lost: int
    samples: int

    @property
    def whole(self) -> bool:
        """Whether it ran to its end and every row arrived."""
        return self.state == DONE and self.lost == 0

    @property
    def why(self) -> str:
        """What is wrong with it, in words."""
        if self.state != DONE:
            return REASONS[self.reason] if self.reason < len(REASONS) else f"reason {self.reason}"
        return f"{self.lost:,} frames were lost on the line"

    def began_of(self, what: str, place: int) -> int:
        """The sample at which the first row of a segment ends, less the samples of that row.

        Parameters
        ----------
        what : str
        place : int
        """
        index, segment = next((k, s) for k, s in enumerate(self.run.segments) if s.what == what and s.place == place)
        return self.began[index] - segment.every

    def of(self, what: str, place: int | None = None) -> Iterator[Array]:
        """Rows of the segments with a name, one array a segment.

        Parameters
        ----------
        what : str
        place : int, optional
        """
        for index, segment in enumerate(self.run.segments):
            if segment.what == what and place in {None, segment.place}:
                yield self.rows[self.rows[:, 1] == index]


class Bench:
    """A board that runs ``pmsm_commission``, at the end of a port.

    Raises
    ------
    UserError
        Nothing answers, or something that speaks otherwise.
    """

    def __init__(self, port: Port, baud: int, timeout: float | None = None) -> None:
        self.port, self.baud = port, baud
        self.timeout = timeout if timeout is not None else 5000.0 / baud + 0.3
        self._decoder = Decoder()
        self._waiting: list[Frame] = []
        self._sequence = 0
        self.hello = self._greet()

    def _greet(self) -> Hello:
        answer = self._ask(HELLO)
        hello = read_hello(answer) if answer is not None else None
        if answer is None:
            raise UserError(
                "no answer from the board: does its main loop call pmsm_commission_poll, at this --baud, with nothing "
                "else on the line?"
            )
        if hello is None:
            raise UserError("the board speaks another protocol: generate and build its firmware anew.")
        return hello

    def clear(self) -> None:
        """Forget why the last plan ended."""
        self._ask(CLEAR)

    def every(self, share: float = 0.85) -> int:
        """Of how many samples a row is the mean, so that the line carries all rows.

        Parameters
        ----------
        share : float, optional
            Of the line, that is used.
        """
        return max(1, int(np.ceil(ROW_BYTES * BYTE_BITS / (share * self.baud * self.hello.period))))

    def run(self, run: Run, stop: Callable[[], bool], tell: Callable[[float], None]) -> Ran:
        """Send a plan, start it, take its rows until it ends.

        Parameters
        ----------
        run : Run
        stop : callable
            Asked all the while; True ends the run by a byte.
        tell : callable
            Told the share of the plan that is done.

        Raises
        ------
        UserError
            The board refuses the plan, or falls silent.
        """
        seconds = run.samples * self.hello.period
        if seconds > self.hello.seconds or len(run.segments) > self.hello.segments:
            raise UserError(
                f"a run of {seconds:.0f} s in {len(run.segments)} segments is planned; the board's firmware allows "
                f"{self.hello.seconds:.4g} s in {self.hello.segments}: raise seconds in pmsm_commission_init."
            )
        for index, segment in enumerate(run.segments):
            self._command(SEGMENT, segment.packed(index))
        self._command(START, run.packed())
        return self._receive(run, stop, tell)

    def abort(self) -> None:
        """End whatever runs: any byte does."""
        self.port.write(b"\0\0\0\0")

    def _command(self, command: int, payload: bytes) -> None:
        answer = self._ask(command, payload)
        if answer is None:
            self.abort()
            raise UserError("the board does not answer any more; it was told to switch off.")
        if answer[:1] != b"\0":
            verdict = answer[0] if answer else len(VERDICTS)
            said = VERDICTS[verdict] if verdict < len(VERDICTS) else f"verdict {verdict}"
            raise UserError(f"the board refuses the plan: {said}.")

    def _ask(self, command: int, payload: bytes = b"") -> bytes | None:
        """The payload of the answer; None if none came."""
        for _ in range(1 if command == START else ATTEMPTS):  # a start sent again would be the byte that ends it
            self._sequence = (self._sequence + 1) & 0xFFFF
            self.port.write(encode(Frame(self._sequence, command, payload)))
            deadline = time.monotonic() + self.timeout
            while time.monotonic() < deadline:
                for frame in self._frames():
                    if frame.command == command | ANSWER and frame.sequence == self._sequence:
                        return frame.payload
        return None

    def _frames(self) -> Iterator[Frame]:
        """Frames one by one: what is not taken stays for who asks next."""
        self._waiting += self._decoder.feed(self.port.read())
        while self._waiting:
            yield self._waiting.pop(0)

    def _receive(self, run: Run, stop: Callable[[], bool], tell: Callable[[float], None]) -> Ran:
        rows: list[tuple[float, ...]] = []
        began: dict[int, int] = {}
        segment, sequence, lost, stopped = 0, None, 0, False
        heard, bad = time.monotonic(), self._decoder.bad
        while time.monotonic() - heard < SILENCE + self._longest_silence(run):
            if stop() and not stopped:
                self.abort()
                stopped = True
            for frame in self._frames():
                heard = time.monotonic()
                if frame.command not in {TELEMETRY, EVENT}:
                    continue
                lost += (frame.sequence - sequence - 1) & 0xFFFF if sequence is not None else 0
                sequence = frame.sequence
                if frame.command == TELEMETRY and len(frame.payload) == 32:
                    _, sample, *values = struct.unpack("<fI6f", frame.payload)
                    rows.append((sample, segment, *values))
                    tell(sample / run.samples)
                elif frame.command == EVENT and len(frame.payload) == 7:
                    state, reason, segment, sample = struct.unpack("<BBBI", frame.payload)
                    if state == RUNNING:
                        began[segment] = sample
                    elif state in {DONE, ENDED}:
                        lost = max(lost, self._decoder.bad - bad)
                        table = np.array(rows, dtype=float).reshape(-1, len(ROW))
                        return Ran(run, self.hello.period, table, began, state, reason, lost, sample)
        self.abort()
        raise UserError("the board fell silent while it ran; it was told to switch off. Look whether it did.")

    def _longest_silence(self, run: Run) -> float:
        """Seconds for which a plan sends nothing."""
        quiet = longest = 0
        for segment in run.segments:
            quiet = quiet + segment.samples if not segment.every else 0
            longest = max(longest, quiet, segment.every)
        return longest * self.hello.period
