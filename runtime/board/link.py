"""A request over the line and its answer, however the line behaves; and the port itself (pyserial)."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, Protocol

from runtime.board.frames import ANSWER, DAMAGED, REFUSED, Decoder, Frame, encode
from runtime.system.errors import UserError

#: A read gives up after this long, so that a deadline or Ctrl-C is never far away, s.
SLICE = 0.005


class UnpluggedError(Exception):
    """The port itself failed: the cable, the adapter, or the board's end of it is gone."""


class NoAnswerError(Exception):
    """Every try of a request went unanswered."""


class RefusedError(Exception):
    """The board received the request undamaged and says that it makes no sense to it."""


class Port(Protocol):
    """A serial line, or what stands in for one."""

    def read(self) -> bytes:
        """The bytes that have arrived; waits at most :data:`SLICE`, then returns nothing. Raises UnpluggedError."""

    def write(self, data: bytes) -> None:
        """Send. Raises UnpluggedError."""

    def close(self) -> None:
        """Leave the line."""


class SerialPort:
    """A port of this machine, 8 data bits, no parity, one stop bit."""

    def __init__(self, name: str, baud: int) -> None:
        self._serial = _open_serial(name, baud)
        self.name = name

    def read(self) -> bytes:
        """Read what has arrived; empty after a short wait."""
        try:
            first = self._serial.read(1)
            return bytes(first + self._serial.read(self._serial.in_waiting)) if first else b""
        except OSError as error:
            raise UnpluggedError(f"port '{self.name}' failed while reading ({_reason(error)})") from None

    def write(self, data: bytes) -> None:
        """Send bytes."""
        try:
            self._serial.write(data)
        except OSError as error:
            raise UnpluggedError(f"port '{self.name}' failed while writing ({_reason(error)})") from None

    def close(self) -> None:
        """Close the port."""
        self._serial.close()


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).partition("\n")[0]


def _open_serial(name: str, baud: int) -> Any:
    try:
        import serial
        from serial.tools import list_ports
    except ImportError:
        raise UserError("a serial port needs pyserial: pip install 'pmsm-ickf[board]'.") from None
    try:
        port = serial.Serial(name, baud, timeout=SLICE, write_timeout=5.0)
        port.reset_input_buffer()
    except (OSError, ValueError) as error:
        there = ", ".join(sorted(item.device for item in list_ports.comports())) or "none found"
        reason = _reason(error) if isinstance(error, OSError) else str(error)
        raise UserError(f"cannot open port '{name}': {reason}. Ports of this machine: {there}.") from None
    return port


@dataclass
class Counts:
    """Counts of the line's faults. Lost, doubled and damaged frames are told apart by number and CRC."""

    requests: int = 0
    resent: int = 0
    timeouts: int = 0
    damaged_answers: int = 0
    damaged_requests: int = 0
    doubled_answers: int = 0
    echoes: int = 0


class Link:
    """Requests with numbers; a request is repeated under its number until its answer arrives undamaged.

    Parameters
    ----------
    port : Port
    timeout : float
        Silence after which a request is sent again, s.
    attempts : int
        How often a request is sent before it counts as lost.
    """

    def __init__(self, port: Port, timeout: float, attempts: int) -> None:
        self.port, self.timeout, self.attempts = port, timeout, attempts
        self.counts = Counts()
        self._decoder = Decoder()
        self._sequence = 0

    def request(self, command: int, payload: bytes = b"") -> bytes:
        """Send a command, return the payload of its answer.

        Raises
        ------
        NoAnswerError, RefusedError, UnpluggedError
        """
        self._sequence = (self._sequence + 1) & 0xFFFF
        frame = Frame(self._sequence, command, payload)
        self.counts.requests += 1
        for attempt in range(self.attempts):
            self.counts.resent += attempt > 0
            self.port.write(encode(frame))
            answer = self._await(frame)
            if answer is not None:
                return answer
        raise NoAnswerError

    def _await(self, frame: Frame) -> bytes | None:
        """The answer to ``frame``; None when it is time to send it again."""
        deadline = time.monotonic() + self.timeout
        while time.monotonic() < deadline:
            bad, damaged = self._decoder.bad, False
            for received in self._decoder.feed(self.port.read()):
                if received.command == frame.command | ANSWER and received.sequence == frame.sequence:
                    return received.payload
                damaged |= self._sort(received)
            self.counts.damaged_answers += self._decoder.bad - bad
            if damaged or self._decoder.bad > bad:
                return None
        self.counts.timeouts += 1
        return None

    def _sort(self, frame: Frame) -> bool:
        """Count what is not the answer; True if the board asks to send again."""
        if frame.command == REFUSED:
            raise RefusedError(f"it is at request {frame.sequence}, the host at {self._sequence}")
        if frame.command == DAMAGED:
            self.counts.damaged_requests += 1
            return True
        if frame.command & ANSWER:
            self.counts.doubled_answers += 1
        else:
            self.counts.echoes += 1
        return False
