"""How a test leads a drive from mode to mode, and the times and limits that docs/firmware.md states.

Said once more here, not read from the model: a test that asks the model what is right agrees with whatever it says.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from tests.codegen.board import Board, on_board

REJECTED, NOT_CONVERGED, COMMAND, REPAIRED, DIVERGED, RESTARTED = 1, 2, 4, 8, 16, 32
#: Seconds, and shares of the maximum current.
REST, PROBE, WAIT, BLIND, ADRIFT, SETTLE, LOCKED, CATCH = 2e-3, 2e-3, 2e-3, 2e-3, 100e-3, 1e-3, 3e-3, 10e-3
#: s: so long currents may flow that the inverter does not make.
RESTLESS = 0.5
OPEN = 100e-3
ZERO, SHOWS, TRIP = 0.05, 0.1, 1.5
#: From one reading to the next: s, and rad electrical at the operating box's speed, whichever is less.
GAP, GAP_TURN = 0.5e-3, 1.2
#: Of a current, at most; then the reference says which way the rotor turns.
READINGS = 8
#: Attempts in a row that end in FAULT, and such without a rival; seconds of running, in windows of LOCKED, after which
#: they are forgotten.
ATTEMPTS, ATTEMPTS_ALONE, STEADY = 10, 20, 99e-3
#: Of a start: share of the largest current; windows at most; by how much the rival must be the better one.
START_SHARE, MAX_WINDOWS, PREFERENCE = 0.8, 20, 0.05
NAN = math.nan

BOARDS = tuple((name, variant) for name in ("paper_spmsm", "ipmsm_flux", "ipmsm_adaptive") for variant in (1, 0))
#: Those with a second filter.
RIVALS = tuple(item for item in BOARDS if item[0] != "paper_spmsm")


@contextmanager
def set_up(name: str, variant: int) -> Iterator[Board]:
    """A board whose example has been set up; gates off."""
    with on_board(name, variant) as made:
        made.now.link, made.now.reference = 0.9 * made.drive.control.dc_link, 10.0
        made.now.duty_wanted[:] = 0.25, 0.5, 0.75
        assert made.setup() == 0
        yield made


def ampere(board: Board, share: float) -> float:
    return share * board.drive.control.max_current


def probing(board: Board) -> None:
    """From RESTING until the gates are enabled."""
    board.interrupt(phase=(0.0, 0.0), status=0, moves=0)
    assert board.gates or board.until("1", board.interrupts(REST)), "the currents read zero for long enough"


def begun(board: Board) -> None:
    """On until the first step with torque has been made, of a rotor that stands: RUNNING, or STARTING."""
    probing(board)
    assert board.until("s", board.interrupts(PROBE) + 1) == board.interrupts(PROBE) + 1
    assert board.torque
    assert board.gates


def running(board: Board) -> None:
    """On until the first step in RUNNING has been made, of a rotor that did not turn, or turned as stated."""
    begun(board)
    if not board.rivals:
        return
    assert board.mode == "STARTING"
    for _ in range(20):
        if board.mode == "RUNNING":
            break
        spin(board, 1, rate(board, board.T, 0.3))
    spin(board, 1, 0.0)
    board.now.moves = 0
    assert board.mode == "RUNNING"
    assert board.share == pytest.approx(1.0)


def short_circuit(board: Board, omega: float, theta: float, count: int) -> tuple[float, float]:
    """Phase currents that zero voltage lets rise to in ``count`` intervals: di/dt = -e / L."""
    m = board.drive.motor
    rise = -board.T * count / m.inductance_q * m.pole_pairs * omega * m.magnet_flux
    i_alpha, i_beta = -rise * math.sin(theta), rise * math.cos(theta)
    return i_alpha, -0.5 * i_alpha + 0.5 * math.sqrt(3) * i_beta


def half_of_the_maximum(board: Board, count: int) -> float:
    """Speed, rad/s, at which the short circuit's current is that after ``count`` intervals."""
    m = board.drive.motor
    return ampere(board, 0.5) * m.inductance_q / (board.T * count * m.pole_pairs * m.magnet_flux)


def gap(board: Board) -> int:
    """Samples from one reading to the next, at least."""
    most = board.drive.motor.pole_pairs * board.drive.operating_box.speed
    return max(1, board.interrupts(min(GAP, GAP_TURN / most)))


def ease(board: Board) -> int:
    """Samples in which the torque of a rotor that was caught comes in."""
    m = board.drive.motor
    return board.interrupts(max(10e-3, 3.0 * m.inductance_d / m.stator_resistance))


def caught(board: Board, theta: float = 0.3, count: int = 3, sense: int = 1, turned: float = 0.5) -> float:
    """On until the rotor is caught, at ``theta``; the speed it turns with. The next interrupt makes the first step.

    Two readings of the current after ``count`` intervals of zero voltage, ``turned`` apart, the second one a sample
    before: so soon its current has died out.
    """
    probing(board)
    omega = sense * half_of_the_maximum(board, count)
    last = theta - a_sample(board, omega)
    reading(board, omega, last - sense * turned, count)
    assert board.mode == "WAITING"
    assert "s" not in board.interrupt(gap(board), phase=(0.0, 0.0))
    assert board.mode == "PROBING"
    reading(board, omega, last, count)
    assert board.mode == "WAITING"
    assert "s" not in board.interrupt(phase=(0.0, 0.0))
    assert board.mode == "CATCHING"
    return omega


def a_sample(board: Board, omega: float) -> float:
    """How far the rotor turns in a sample, rad electrical."""
    return board.drive.motor.pole_pairs * board.T * omega


def reading(board: Board, omega: float, theta: float, count: int) -> str:
    """The current of a rotor that turns, after so many intervals of zero voltage; none before."""
    board.interrupt(count - 1, phase=(0.0, 0.0))
    return board.interrupt(phase=short_circuit(board, omega, theta, count))


def spin(board: Board, count: int, omega: float, ratio: float = 1.0, status: int = 0, stop: str = "") -> int:
    """Steps of a filter that states ``omega`` and whose angle turns ``ratio`` times as fast; how many had passed when
    one had the event ``stop``, or 0."""
    board.now.moves, board.now.omega, board.now.status = 1, omega, status
    for k in range(1, count + 1):
        theta = board.now.theta + ratio * board.drive.motor.pole_pairs * board.T * omega
        board.now.theta = math.remainder(theta, 2 * math.pi)
        if stop and stop in board.interrupt():
            return k
        if not stop:
            board.interrupt()
    return 0


def until_torque(board: Board, most: int, omega: float, **given: float) -> int:
    """Steps until one has torque, that one included; 0 if none of ``most`` has."""
    for k in range(1, most + 1):
        spin(board, 1, omega, **given)  # type: ignore[arg-type]
        if not board.gates:
            return 0
        if board.torque:
            return k
    return 0


def flux(board: Board) -> bool:
    return board.drive.model.machine == "salient_flux"


def electrical(board: Board, phase: tuple[float, float], theta: float) -> list[float]:
    """The filter's first two states: currents in A, or the flux linkages in Wb that carry them."""
    m, i = board.drive.motor, complex(phase[0], (phase[0] + 2 * phase[1]) / math.sqrt(3))
    if not flux(board):
        return [i.real, i.imag]
    along = i * cmath.exp(-1j * theta)
    psi = complex(m.inductance_d * along.real + m.magnet_flux, m.inductance_q * along.imag) * cmath.exp(1j * theta)
    return [psi.real, psi.imag]


def rate(board: Board, seconds: float, angle: float) -> float:
    """Speed, rad/s, that turns the electrical angle by so much in a time."""
    return angle / (board.drive.motor.pole_pairs * board.T * board.interrupts(seconds))


def stops(board: Board, most: int, **given: object) -> int:
    """Interrupts until the gates are off."""
    found = board.until("0", most, **given)
    assert board.gates == (found == 0)
    return found


def fails(board: Board) -> None:
    """A rotor that turns, and a filter that restarts until the time to catch it is over."""
    omega = caught(board)
    assert spin(board, 10_000, omega, status=RESTARTED, stop="0") == board.interrupts(CATCH)
    board.interrupt(status=0, moves=0)


def attempts(board: Board) -> int:
    """Failures in a row that end in FAULT: a drive without a rival finds its angle by attempts."""
    return ATTEMPTS if board.drive.model.sample_time >= 50e-6 else ATTEMPTS_ALONE
