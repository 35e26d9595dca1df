"""The session behind ``commission``: the port or a simulated motor, the recording, and what is written at the end."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.board.link import SerialPort, UnpluggedError
from runtime.board.record import ctrl_c
from runtime.board.simulated import NAME
from runtime.commission.commission import Commissioned, Tell, commission
from runtime.commission.line import Bench as Board
from runtime.commission.line import Ran
from runtime.commission.plan import SPEED, Limits
from runtime.commission.simulated import SimulatedMotor, Truth
from runtime.design.facts import Facts
from runtime.recorded.data import check_suffix, write_recorded
from runtime.system.errors import UserError

Array = NDArray[Any]

#: A board's own limits and sample time agree with the facts where they differ by no more.
ALIKE = 1e-3


@dataclass(frozen=True)
class Place:
    """Where the board is: a port and its speed; or the motor to simulate."""

    port: str
    baud: int
    truth: Truth | None = None


def limits_of(facts: Facts, current: float | None, speed: float | None) -> Limits:
    """What nothing may go beyond: the facts' largest current and rated speed, or less.

    Parameters
    ----------
    facts : Facts
    current : float or None
        A.
    speed : float or None
        rad/s, mechanical.

    Raises
    ------
    UserError
        More than the facts allow.
    """
    if current is not None and current > facts.max_current:
        raise UserError(
            f"--max-current {current:g} A is beyond rated.max_current of the facts, {facts.max_current:g} A."
        )
    if speed is not None and speed > facts.speed:
        raise UserError(f"--max-speed is beyond the rated speed of the facts, {facts.speed:.4g} rad/s.")
    return Limits(current or facts.max_current, speed or SPEED * facts.speed)


@contextmanager
def open_board(place: Place) -> Iterator[Board]:
    """The board, asked who it is.

    Parameters
    ----------
    place : Place

    Raises
    ------
    UserError
        No port, no board, or one that speaks otherwise.
    """
    if place.port != NAME:
        port = SerialPort(place.port, place.baud)
        try:
            yield Board(port, place.baud)
        finally:
            port.close()
        return
    assert place.truth is not None
    with SimulatedMotor(place.truth) as simulated:
        port = SerialPort(simulated.port, place.baud)
        try:
            yield Board(port, place.baud)
        finally:
            port.close()


def check_board(board: Board, facts: Facts, limits: Limits) -> None:
    """Refuse a board whose sample time or limits are not those of the facts.

    Parameters
    ----------
    board : Board
    facts : Facts
    limits : Limits

    Raises
    ------
    UserError
        One line that says which.
    """
    hello = board.hello
    if abs(hello.period / facts.T - 1) > ALIKE:
        raise UserError(f"the board samples every {hello.period:.6g} s, the facts say {facts.T:.6g} s: mend one.")
    if hello.current < limits.current * (1 - ALIKE):
        raise UserError(
            f"the board's firmware allows {hello.current:.4g} A, the plan is for {limits.current:.4g} A: "
            f"--max-current {hello.current:.4g}, or the limits in pmsm_commission_init."
        )
    if hello.speed < facts.p * limits.speed * (1 - ALIKE):
        raise UserError(
            f"the board's firmware allows {hello.speed / facts.p:.4g} rad/s, the plan is for {limits.speed:.4g} rad/s: "
            "--max-speed, or the limits in pmsm_commission_init."
        )


class Recording:
    """Every run's rows into one file of recorded data, written anew whenever a run has ended."""

    def __init__(self, path: Path) -> None:
        check_suffix(path)
        if path.suffix != ".npz":
            raise UserError(f"--out '{path}': the recording of a commissioning is .npz.")
        if path.exists():
            raise UserError(f"'{path}' exists; move it away or choose another --out.")
        if not path.parent.is_dir():
            raise UserError(f"--out '{path}': there is no folder '{path.parent}'.")
        self.path = path
        self.runs: list[Ran] = []

    def keep(self, ran: Ran) -> None:
        """Add a run's rows to the file.

        Parameters
        ----------
        ran : Ran
        """
        self.runs.append(ran)
        write_recorded(self.path, columns(self.runs))


def columns(runs: list[Ran]) -> dict[str, Array]:
    """Columns of the recording: those of recorded data, and what a row is.

    Parameters
    ----------
    runs : list of Ran
    """
    parts: dict[str, list[Array]] = {}
    begin = 0.0
    for number, ran in enumerate(runs):
        rows = ran.rows
        every = np.array([segment.every for segment in ran.run.segments])
        index = rows[:, 1].astype(int)
        half = 0.5 * rows[:, 6] * ran.period
        u = (rows[:, 2] + 1j * rows[:, 3]) * np.exp(1j * (rows[:, 7] - half))
        i = (rows[:, 4] + 1j * rows[:, 5]) * np.exp(1j * rows[:, 7])
        one = {"t": begin + rows[:, 0] * ran.period, "u_alpha": u.real, "u_beta": u.imag}
        one |= {"i_alpha": i.real, "i_beta": i.imag, "axis_speed": rows[:, 6], "axis_angle": rows[:, 7]}
        one |= {"run": np.full(len(rows), float(number)), "segment": rows[:, 1], "every": every[index].astype(float)}
        for name, values in one.items():
            parts.setdefault(name, []).append(values)
        begin += (ran.samples + 1) * ran.period
    return {name: np.concatenate(values) for name, values in parts.items()}


def carry_out(board: Board, facts: Facts, limits: Limits, recording: Recording, tell: Tell) -> Commissioned:
    """All runs, with Ctrl-C as the byte that ends them.

    Parameters
    ----------
    board : Board
    facts : Facts
    limits : Limits
    recording : Recording
    tell : callable
        Told what runs and the share of it that is done.

    Raises
    ------
    UserError
        The board fell silent, or refuses a plan.
    """
    try:
        with ctrl_c() as stop:
            board.clear()
            return commission(board, facts, limits, stop, tell, recording.keep)
    except UnpluggedError as error:
        raise UserError(
            f"{error}: the board goes on by itself until its plan or its time is over. Switch its supply off."
        ) from None
