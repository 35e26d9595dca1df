"""The currents by which a drive tells which way its rotor turns, and where: PROBING and WAITING.

See test_modes_start for what comes before and after; times and limits are those that docs/firmware.md states.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest

from tests.codegen.board import Board
from tests.codegen.modes import (
    BOARDS,
    NAN,
    PROBE,
    READINGS,
    RESTARTED,
    WAIT,
    ZERO,
    a_sample,
    ampere,
    caught,
    electrical,
    gap,
    half_of_the_maximum,
    probing,
    reading,
    set_up,
    short_circuit,
    spin,
)


@pytest.fixture(params=BOARDS, ids=lambda item: f"{item[0]}-{item[1]}")
def board(request: pytest.FixtureRequest) -> Iterator[Board]:
    with set_up(*request.param) as made:
        yield made


def test_between_two_readings_the_gates_are_off_until_the_current_has_died_out(board: Board) -> None:
    probing(board)
    zero = ampere(board, ZERO)
    board.interrupt(phase=(ampere(board, 0.5), 0.0))
    assert board.mode == "WAITING"
    assert not board.gates
    for phase in ((1.001 * zero, 0.0), (0.0, -1.001 * zero)):
        events = board.interrupt(gap(board), phase=phase)
        assert "1" not in events
        assert "s" not in events
        assert list(board.now.duty) == [0.5, 0.5, 0.5]
    assert board.until("1", 1, phase=(0.999 * zero, -0.999 * zero)) == 1
    assert board.mode == "PROBING"


@pytest.mark.parametrize("readings", [1, 2])
@pytest.mark.parametrize("current", [1.001 * ZERO, NAN])
def test_a_current_that_does_not_die_out_is_a_failure(board: Board, current: float, readings: int) -> None:
    probing(board)
    board.interrupt(phase=(ampere(board, 0.5), 0.0))
    if readings == 2:
        board.interrupt(gap(board), phase=(0.0, 0.0))
        board.interrupt(phase=(ampere(board, 0.5), 0.0))
    for k in range(board.interrupts(WAIT)):
        assert board.mode == "WAITING", k
        board.interrupt(phase=(ampere(board, current), 0.0))
    assert (board.mode, board.reason, board.kept("failures")) == ("RESTING", "CURRENT", 1)


def test_the_filter_begins_where_the_rotor_has_turned_to(board: Board) -> None:
    """With the gates off until the second reading's current has died out, and the currents that are left then."""
    last, zero = caught(board), ampere(board, ZERO)
    board.setup()
    probing(board)
    for theta in (-0.5, 0.3):
        board.interrupt(gap(board), phase=(0.0, 0.0))
        board.interrupt(2, phase=(0.0, 0.0))
        board.interrupt(phase=short_circuit(board, last, theta, 3))
        assert board.mode == "WAITING"
    for phase in ((1.001 * zero, 0.0), (0.0, -1.001 * zero), (0.0, 30 * zero)):
        events = board.interrupt(phase=phase)
        assert "1" not in events
        assert "s" not in events
    left = 0.9 * zero, -0.5 * zero
    assert "1" in board.interrupt(phase=left)
    assert board.mode == "CATCHING"
    board.interrupt(phase=left, status=0, moves=0)
    x = list(board.now.x)
    intervals = gap(board) + 3 if board.gates else 0
    assert intervals
    assert abs(math.remainder(x[3] - 0.3 - 4 * a_sample(board, x[2]), 2 * math.pi)) < 0.0045
    assert x[:2] == pytest.approx(electrical(board, left, x[3]), rel=1e-4, abs=1e-5)


def test_what_turned_and_then_makes_no_current_stands(board: Board) -> None:
    """A rotor that came to rest between the readings; the next probe begins with a first reading again."""
    probing(board)
    board.interrupt(phase=(ampere(board, 0.5), 0.0))
    board.interrupt(gap(board), phase=(0.0, 0.0))
    assert board.until("s", 10_000) == board.interrupts(PROBE) + 1
    assert board.mode == ("STARTING" if board.rivals else "RUNNING")
    spin(board, 1, 0.0, status=RESTARTED)
    board.interrupt(status=0, moves=0)
    probing(board)
    board.interrupt(phase=(ampere(board, 0.5), 0.0))
    assert board.mode == "WAITING"


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("turned", [0.12, 1.5, 3.0])
def test_which_way_the_current_turned_says_which_way_the_rotor_turns(board: Board, sense: int, turned: float) -> None:
    """Whatever the reference says."""
    for reference in (10.0, -10.0, 0.0):
        assert board.setup() == 0
        board.now.reference = reference
        omega = caught(board, sense=sense, turned=turned)
        board.interrupt(status=0, moves=0)
        assert list(board.now.x)[2] == pytest.approx(omega, rel=1e-5)
        assert abs(math.remainder(list(board.now.x)[3] - 0.3, 2 * math.pi)) < 0.0045


def read_again(board: Board, omega: float, angles: list[float]) -> int:
    """Readings of a current whose rotor stands at these angles, until the filter begins; how many there were."""
    probing(board)
    for count, theta in enumerate(angles, start=1):
        assert board.mode == "PROBING"
        reading(board, omega, theta, 3)
        assert board.mode == "WAITING"
        if "1" in board.interrupt(phase=(0.0, 0.0)):
            assert board.mode == "CATCHING"
            board.interrupt(status=0, moves=0)
            return count
        assert board.until("1", 2 * gap(board), phase=(0.0, 0.0)) == gap(board) - 1
    return 0


@pytest.mark.parametrize("sense", [1, -1])
def test_a_current_that_turned_too_little_is_read_again(board: Board, sense: int) -> None:
    """Until its sine is 0.1, from the first reading on: slow rotors take several."""
    for reference in (10.0, -10.0):
        for step, readings in ((0.08, 3), (0.04, 4), (0.03, 5)):
            assert board.setup() == 0
            board.now.reference = reference
            omega = sense * half_of_the_maximum(board, 3)
            angles = [0.3 + sense * step * k for k in range(10)]
            assert read_again(board, omega, angles) == readings
            assert list(board.now.x)[2] == pytest.approx(omega, rel=1e-5)
            expected = angles[readings - 1] + a_sample(board, omega)
            assert abs(math.remainder(list(board.now.x)[3] - expected, 2 * math.pi)) < 0.0045


@pytest.mark.parametrize("sense", [1, -1])
def test_the_reference_is_asked_once_the_current_was_read_often_enough(board: Board, sense: int) -> None:
    """One that turns by 0.08 rad, and no further. The other way round the rotor stands half a turn on."""
    for reference in (10.0, -10.0, 0.0):
        assert board.setup() == 0
        board.now.reference = reference
        omega = sense * half_of_the_maximum(board, 3)
        assert read_again(board, omega, [0.3, *[0.3 + sense * 0.08] * 10]) == READINGS
        expected = 1 if reference >= 0 else -1
        assert list(board.now.x)[2] == pytest.approx(expected * abs(omega), rel=1e-5)
        there = 0.3 + sense * 0.08 + (0.0 if expected == sense else math.pi) + expected * abs(a_sample(board, omega))
        assert abs(math.remainder(list(board.now.x)[3] - there, 2 * math.pi)) < 0.0045
