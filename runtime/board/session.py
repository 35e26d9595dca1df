"""The session behind ``pil`` and ``record``: find the port, the board's folder and the inputs, then run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from runtime.board.board import Board, Identity
from runtime.board.frames import LONGEST
from runtime.board.link import Link, RefusedError, SerialPort, UnpluggedError
from runtime.board.pil import PilResult, check_settings, run_pil
from runtime.board.record import COLUMNS, Recording, ctrl_c, record
from runtime.board.recorded import RecordFile
from runtime.board.simulated import NAME, SimulatedBoard
from runtime.estimator.folder import GENERATED, GeneratedFolder
from runtime.folders.resolve import drive_folder
from runtime.folders.stated import stated_drive
from runtime.proof.own_trajectory import trajectory_of
from runtime.recorded.data import Array, read_recorded
from runtime.system.errors import UserError
from runtime.system.files import write_facts

DEFAULT_DRIVE = "paper_spmsm"


@dataclass(frozen=True)
class LineSettings:
    """How to reach the board; ``timeout`` None: what the longest frames take at this speed, and 0.1 s for the board."""

    port: str
    baud: int = 115200
    timeout: float | None = None
    attempts: int = 20

    @property
    def patience(self) -> float:
        """Seconds of silence after which a request is sent again."""
        return self.timeout if self.timeout is not None else 2 * 10 * (LONGEST + 2) / self.baud + 0.1


@contextmanager
def open_port(line: LineSettings, drive: str | None, kind: str | None, telemetry: bool) -> Iterator[SerialPort]:
    """The named serial port, or a simulated board's.

    Parameters
    ----------
    line : LineSettings
    drive : str or None
        A shipped name or a generated folder; None: the one that the board names.
    kind : str or None
        Filter kind, such as "ickf".
    telemetry : bool
    """
    if line.port != NAME:
        port = SerialPort(line.port, line.baud)
        try:
            yield port
        finally:
            port.close()
        return
    folder = drive_folder(drive or DEFAULT_DRIVE)
    with SimulatedBoard(folder, kind or folder.kinds[-1], telemetry) as board:
        port = SerialPort(board.port, line.baud)
        try:
            yield port
        finally:
            port.close()


def folder_of(identity: Identity, drive: str | None) -> GeneratedFolder:
    """The named folder; else the one the board names, shipped or under ./generated.

    Parameters
    ----------
    identity : Identity
    drive : str or None
        A shipped name or a generated folder; None: the one that the board names.
    """
    if drive is not None:
        return drive_folder(drive)
    for place in (GENERATED, Path("generated")):
        if (place / identity.drive / "manifest.json").is_file():
            return GeneratedFolder(place / identity.drive)
    raise UserError(
        f"the board runs drive '{identity.drive}', which is neither shipped nor under ./generated: "
        "name its generated folder, pmsm-ickf pil FOLDER --port ..."
    )


def inputs_of(folder: GeneratedFolder, data: Path | None, steps: int) -> tuple[Array, Array]:
    """Recorded data if given, else the start trajectory the proof uses; at most ``steps`` rows of u V and y A."""
    if data is not None:
        recorded = read_recorded(data, need_time=False)
        u, y = recorded.u, recorded.y
    else:
        trajectory = trajectory_of(stated_drive(folder), steps)
        u, y = trajectory.u, trajectory.y
    with np.errstate(over="ignore"):  # infinite then, which the filter rejects
        return u[:steps].astype(np.float32), y[:steps].astype(np.float32)


def pil(
    line: LineSettings,
    drive: str | None,
    kind: str | None,
    data: Path | None,
    steps: int,
    mode: str | None,
    tolerance: str,
    backend: str,
    progress: Callable[[int, int], None],
) -> PilResult:
    """Link G over a port.

    Parameters
    ----------
    line : LineSettings
    drive : str or None
        A shipped name or a generated folder; None: the one that the board names.
    kind : str or None
        Filter kind, such as "ickf".
    data : Path or None
    steps : int
        Number of steps.
    mode : str or None
    tolerance : str
        "bits" or "certificate".
    backend : str
        "numpy" or "c".
    progress : callable
        Told how far the work is.

    Raises
    ------
    UserError
        Bad settings, no port, no board, or another drive's firmware on it.
    """
    mode = check_settings(mode, tolerance)
    with open_port(line, drive, kind, telemetry=False) as port:
        try:
            board = Board(Link(port, line.patience, line.attempts))
        except (UnpluggedError, RefusedError) as error:
            raise UserError(f"{error} before the board said who it is.") from None
        if kind is not None and board.identity.kind != kind:
            raise UserError(f"the board runs a '{board.identity.kind}', not the '{kind}' asked for.")
        folder = folder_of(board.identity, drive)
        stated_drive(folder)
        u, y = inputs_of(folder, data, steps)
        return run_pil(board, folder, u, y, mode, tolerance, backend, lambda done: progress(done, len(u)))


def write_json(result: PilResult, ticks_hz: float | None, path: Path) -> None:
    """Every figure of a run."""
    write_facts(path, result.to_json(ticks_hz))


def record_data(
    line: LineSettings, drive: str | None, out: Path, seconds: float | None, show: Callable[[Recording], None]
) -> Recording:
    """Receive telemetry into a file of recorded data.

    Parameters
    ----------
    line : LineSettings
    drive : str or None
        A shipped name or a generated folder; None: the one that the board names.
    out : Path
        Where files are written.
    seconds : float or None
        s.
    show : callable
    """
    with open_port(line, drive, None, telemetry=True) as port:
        file = RecordFile(out, COLUMNS)
        try:
            with ctrl_c() as stop:
                return record(port, file, seconds, stop, show)
        finally:
            file.close()
