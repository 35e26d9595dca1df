"""The board as seen from the host: who it is, and what a step of its filter did."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.board.frames import HELLO, RESET, SET_STATE, STEP
from runtime.board.link import Link, NoAnswerError
from runtime.system.errors import UserError

Words = NDArray[np.float32]

PROTOCOL = 1


@dataclass(frozen=True)
class Identity:
    """The board's identity: ``drive_sha`` and ``code_sha`` are the first 16 hex digits of sha256."""

    drive: str
    kind: str
    drive_sha: str
    code_sha: str
    version: str
    n_x: int
    n_P: int
    ticks_of_nothing: int


@dataclass(frozen=True)
class Answer:
    """After a step: state words x, P, u_held as the board holds them, and what the step cost in timer ticks."""

    status: int
    iterations: int
    ticks: int
    words: Words


class Board:
    """One board under ``pmsm_pil``; made by asking who it is.

    Raises
    ------
    UserError
        If nothing answers, or something that speaks another protocol.
    """

    def __init__(self, link: Link) -> None:
        self.link = link
        self.identity, *self._before = self._hello()

    def line_figures(self) -> tuple[int, int]:
        """Since the start: requests the board answered again, damaged frames it dropped."""
        _, repeats, bad = self._hello()
        return (repeats - self._before[0]) & 0xFFFF, (bad - self._before[1]) & 0xFFFF

    def _hello(self) -> tuple[Identity, int, int]:
        """Identity; how often the board answered a repeated request; how many damaged frames it dropped."""
        try:
            payload = self.link.request(HELLO)
        except NoAnswerError:
            raise UserError(self._silence()) from None
        if len(payload) < 11 or payload[0] != PROTOCOL:
            spoken = payload[0] if payload else "none"
            raise UserError(
                f"the board speaks protocol {spoken}, this is {PROTOCOL}: generate and build its firmware anew."
            )
        _, n_x, n_P, repeats, bad, nothing = struct.unpack("<BBBHHI", payload[:11])
        words = payload[11:].decode("ascii", "replace").split()
        if len(words) != 5:
            raise UserError(f"the board's name '{' '.join(words)}' is not one of pmsm-ickf's.")
        drive, kind, drive_sha, code_sha, version = words
        return Identity(drive, kind, drive_sha, code_sha, version, n_x, n_P, nothing), repeats, bad

    def _silence(self) -> str:
        if self.link.counts.echoes:
            return "the line only echoes what is sent: transmit and receive are bridged, or no pmsm_pil runs behind it."
        if self.link.counts.damaged_answers:
            return "bytes arrive but no undamaged frame: is --baud what the board uses?"
        return "no answer from the board: is it running, with pmsm_pil_poll in its main loop, at this --baud?"

    def reset(self) -> Answer:
        """The drive's tuning and start values."""
        return self._answer(self.link.request(RESET))

    def set_state(self, words: Words) -> Answer:
        """Put the filter into a state: x, P, u_held.

        Parameters
        ----------
        words : Words
            Words of the struct.
        """
        return self._answer(self.link.request(SET_STATE, words.astype("<f4").tobytes()))

    def step(self, u: Words, y: Words) -> Answer:
        """One step with u (2,) V and y (2,) A.

        Parameters
        ----------
        u : Words
            Voltage, V, (2,).
        y : Words
            Currents, A, (2,).
        """
        return self._answer(self.link.request(STEP, np.concatenate([u, y]).astype("<f4").tobytes()))

    def _answer(self, payload: bytes) -> Answer:
        status, iterations, ticks = struct.unpack("<HHI", payload[:8])
        words = np.frombuffer(payload[8:], dtype="<f4").astype(np.float32, copy=True)
        return Answer(status, iterations, ticks, words)


def check_identity(identity: Identity, manifest: dict[str, Any]) -> None:
    """Refuse firmware that is not this folder's.

    Raises
    ------
    UserError
        One line that says what differs.
    """
    drive, sha = manifest["drive"], manifest["input_sha256"][:16]
    if (identity.drive, identity.drive_sha) != (drive, sha):
        raise UserError(
            f"the firmware on the board was generated from drive '{identity.drive}' (sha256 {identity.drive_sha}), "
            f"not from '{drive}' ({sha}): build and load this drive's, or name the board's."
        )
    if identity.kind not in manifest["filters"]:
        raise UserError(f"the board runs a '{identity.kind}', which drive '{drive}' was not generated for.")
    code = manifest["files"][f"{drive}_{identity.kind}.c"]["sha256"][:16]
    if identity.code_sha != code:
        raise UserError(
            f"the firmware on the board holds another text of {drive}_{identity.kind}.c (sha256 {identity.code_sha}, "
            f"pmsm-ickf {identity.version}) than the folder ({code}): build and load it anew."
        )
