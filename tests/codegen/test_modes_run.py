"""A drive that runs, what stops it, and what it does after; seen from the example interrupt.

The filter is scripted (`board.c`): its status and its angle are the test's. Times and limits are those that
docs/firmware.md states; nothing of the supervisor's own numbers is read here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from tests.codegen.board import Board
from tests.codegen.modes import (
    ADRIFT,
    BLIND,
    BOARDS,
    COMMAND,
    DIVERGED,
    LOCKED,
    NAN,
    NOT_CONVERGED,
    OPEN,
    REJECTED,
    REPAIRED,
    REST,
    RESTARTED,
    RESTLESS,
    SETTLE,
    SHOWS,
    START_SHARE,
    STEADY,
    TRIP,
    ZERO,
    ampere,
    attempts,
    begun,
    caught,
    ease,
    fails,
    gap,
    probing,
    rate,
    running,
    set_up,
    spin,
    stops,
    until_torque,
)


@pytest.fixture(params=BOARDS, ids=lambda item: f"{item[0]}-{item[1]}")
def board(request: pytest.FixtureRequest) -> Iterator[Board]:
    with set_up(*request.param) as made:
        yield made


# --- running: what stops torque


@pytest.mark.parametrize("side", [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)])
def test_overcurrent_trips_at_the_third_sample_in_a_row(board: Board, side: tuple[float, float]) -> None:
    running(board)
    step = board.interrupt()
    assert "1" not in step, "the latch is cleared once, as that would clear a trip of the hardware too"
    above, below = (tuple(f * ampere(board, TRIP) * value for value in side) for f in (1.001, 0.999))
    assert stops(board, 50, phase=below) == 0
    assert stops(board, 2, phase=above) == 0
    assert stops(board, 1, phase=below) == 0
    assert stops(board, 10, phase=above) == 3
    assert (board.mode, board.reason) == ("RESTING", "CURRENT")
    assert "s" not in board.interrupt(phase=(0.0, 0.0)), "no filter, no torque"
    running(board)
    assert stops(board, 10, phase=above) == 3, "as often as it takes"


def test_overcurrent_trips_while_catching_too(board: Board) -> None:
    caught(board)
    board.interrupt()
    high = (1.001 * ampere(board, TRIP), 0.0)
    assert stops(board, 10, phase=high) == 3
    caught(board)
    assert stops(board, 10, phase=high) == 3, "counted from none after the rest"


def test_a_restart_stops_torque_at_once(board: Board) -> None:
    running(board)
    for other in (0, REPAIRED, NOT_CONVERGED):
        assert stops(board, 1, status=RESTARTED | other) == 1
        assert (board.mode, board.reason) == ("RESTING", "RESTARTED")
        running(board)


@pytest.mark.parametrize(("status", "seconds", "reason"), [(REJECTED, BLIND, "BLIND"), (DIVERGED, ADRIFT, "DIVERGED")])
def test_blind_or_diverged_for_too_long_stops_torque(board: Board, status: int, seconds: float, reason: str) -> None:
    running(board)
    most = board.interrupts(seconds)
    assert stops(board, most - 1, status=status) == 0
    assert board.torque
    assert stops(board, 1, status=0) == 0
    assert stops(board, 3 * most, status=status | NOT_CONVERGED) == most
    assert (board.mode, board.reason) == ("RESTING", reason)
    running(board)
    assert stops(board, most - 1, status=status) == 0, "counted from none after the rest"
    assert stops(board, 2, status=status) == 1


def test_counts_begin_with_none_after_a_catch(board: Board) -> None:
    for status, seconds in ((REJECTED, BLIND), (DIVERGED, ADRIFT)):
        board.setup()
        running(board)
        assert stops(board, 3 * board.interrupts(seconds), status=status)
        omega = caught(board)
        assert until_torque(board, 10_000, omega, status=0) == board.interrupts(LOCKED) + 1


@pytest.mark.parametrize("status", [NOT_CONVERGED, REPAIRED, COMMAND])
def test_what_is_no_reason_to_stop(board: Board, status: int) -> None:
    running(board)
    assert stops(board, 2 * board.interrupts(ADRIFT), status=status) == 0
    assert board.torque


@pytest.mark.parametrize(("ratio", "good"), [(0.46, True), (0.42, False), (1.54, True), (1.58, False), (-1.0, False)])
def test_torque_ends_where_the_angle_does_not_turn_as_stated(board: Board, ratio: float, good: bool) -> None:
    """Half of what is stated and 0.3 rad, over 3 ms: sqrt(0.6^2 + 0.3^2) = 0.671 of 1.2 rad."""
    running(board)
    count, omega = board.interrupts(LOCKED), rate(board, LOCKED, 1.2)
    spin(board, count - 1, omega)  # of the first window one is past
    assert spin(board, count, omega, stop="0") == 0
    assert spin(board, count, omega, ratio=ratio, stop="0") == (0 if good else count)
    assert board.reason == ("NONE" if good else "SLIPPED")
    if good:
        assert spin(board, count - 1, omega, stop="0") == 0, "each window is judged for itself"
        assert spin(board, 1, omega, stop="0") == 0


@pytest.mark.parametrize(("drift", "good"), [(0.29, True), (0.31, False), (-0.29, True), (-0.31, False)])
def test_a_jolt_while_running(board: Board, drift: float, good: bool) -> None:
    running(board)
    count, tiny = board.interrupts(LOCKED), rate(board, LOCKED, 1e-4)
    spin(board, count - 1, tiny)
    assert spin(board, count, tiny, ratio=1 + drift / 1e-4, stop="0") == (0 if good else count)


@pytest.mark.parametrize("phase", range(3))
def test_an_open_phase_ends_in_fault(board: Board, phase: int) -> None:
    """Its current reads nothing, the others' are opposite, for 3 rad and 100 ms; the angle turns as stated."""
    running(board)
    count = 3 * board.interrupts(LOCKED)
    turn = rate(board, LOCKED, 1.0)
    other = 0.5 * ampere(board, 1.0)
    board.now.phase[:] = [(0.0, other), (other, 0.0), (other, -other)][phase]
    half_turn = math.ceil(3.0 / (board.drive.motor.pole_pairs * board.T * turn))
    last = half_turn + board.interrupts(OPEN) - 1
    assert spin(board, last + count, turn, stop="0") in {last, last + 1}
    assert (board.mode, board.reason) == ("FAULT", "PHASE")
    board.interrupt(20 * board.interrupts(REST), phase=(0.0, 0.0))
    assert not board.gates, "no attempt follows"


@pytest.mark.parametrize("share", [0.0, 0.9 * SHOWS])
def test_small_currents_are_no_open_phase(board: Board, share: float) -> None:
    running(board)
    board.now.phase[:] = 0.0, share * ampere(board, 1.0)
    assert spin(board, 10 * board.interrupts(LOCKED), rate(board, LOCKED, 1.0), stop="0") == 0


def test_a_phase_that_carries_current_once_in_a_while_is_not_open(board: Board) -> None:
    running(board)
    count, turn = board.interrupts(LOCKED), rate(board, LOCKED, 1.0)
    for _ in range(3):
        board.now.phase[:] = 0.0, 0.5 * ampere(board, 1.0)
        assert spin(board, 3 * count + board.interrupts(OPEN) - 4, turn, stop="0") == 0, (
            "a stuck sensor is ridden through"
        )
        board.now.phase[:] = 1.01 * ampere(board, ZERO), 0.5 * ampere(board, 1.0)
        assert spin(board, 1, turn, stop="0") == 0


def test_a_current_that_stands_is_no_open_phase(board: Board) -> None:
    """At standstill a phase may have none for ever: where the angle does not turn nothing is open."""
    running(board)
    board.now.phase[:] = 0.0, 0.9 * ampere(board, 1.0)
    assert spin(board, 20 * board.interrupts(LOCKED), 0.0, stop="0") == 0


@pytest.mark.parametrize(("share", "good"), [(2.99, True), (3.01, False), (-2.99, True), (-3.01, False)])
def test_no_motor_turns_as_fast_as_a_runaway_estimate(board: Board, share: float, good: bool) -> None:
    running(board)
    assert spin(board, 2, share * board.drive.operating_box.speed, stop="0") == (0 if good else 1)
    assert board.reason == ("NONE" if good else "RUNAWAY")


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_turning_on_over_the_seam_of_the_angle_is_turning_on(board: Board, sense: float) -> None:
    running(board)
    assert spin(board, 5 * board.interrupts(LOCKED), sense * rate(board, LOCKED, 5.0), stop="0") == 0
    assert board.torque


def test_a_maximum_current_that_was_tuned_stays(board: Board) -> None:
    """Between two interrupts, in any mode: no step leaves its own limit behind."""
    if not board.variant:
        return
    usual, tuned, other = (share * board.drive.control.max_current for share in (1.0, 0.7, 0.6))
    assert board.largest_current[0] == pytest.approx(usual)
    running(board)
    assert board.largest_current[0] == pytest.approx(usual)
    board.largest_current[0] = tuned
    board.interrupt()
    assert board.now.gain_max == pytest.approx(tuned)
    assert stops(board, 1, status=RESTARTED) == 1
    assert board.largest_current[0] == pytest.approx(tuned)
    omega = caught(board)
    spin(board, 1, omega)
    assert board.now.gain_max == 0, "without torque"
    assert board.largest_current[0] == pytest.approx(tuned)
    board.largest_current[0] = other
    assert until_torque(board, 10_000, omega)
    assert board.now.gain_max == pytest.approx(other / ease(board))
    spin(board, ease(board), omega)
    assert board.now.gain_max == pytest.approx(other)
    assert stops(board, 1, status=RESTARTED) == 1
    begun(board)
    assert board.now.gain_max == pytest.approx((START_SHARE if board.rivals else 1.0) * other)
    assert board.largest_current[0] == pytest.approx(other)


def test_the_dc_link_takes_torque_away(board: Board) -> None:
    """Less of any below 70 % of the drive file's, none from 50 % down; above 115 % less of torque that brakes."""
    running(board)
    link, omega = board.drive.control.dc_link, 0.5 * board.drive.operating_box.speed
    for volts, drives, brakes in ((1.0, 1, 1), (0.6, 0.5, 0.5), (0.5, 0, 0), (1.2, 1, 0.5), (1.3, 1, 0), (NAN, 0, 0)):
        for reference, wanted in ((1.1 * omega, drives), (0.9 * omega, brakes)):
            board.now.reference, board.now.link = reference, volts * link
            spin(board, 2, omega)
            assert board.gates
            assert board.share == pytest.approx(wanted, abs=1e-5)


def test_torque_comes_back_after_catches_that_failed(board: Board) -> None:
    omega = caught(board)
    for _ in range(2):
        assert spin(board, 10_000, omega, status=DIVERGED, stop="0")
        omega = caught(board)
    assert until_torque(board, 10_000, omega) == board.interrupts(LOCKED) + 1


def test_torque_of_a_caught_rotor_comes_in_step_by_step(board: Board) -> None:
    """In 10 ms, or thrice the time constant of the d axis where that is longer; and anew after the next catch."""
    count = ease(board)
    for _ in range(2):
        omega = caught(board)
        assert until_torque(board, 10_000, omega)
        assert board.share == pytest.approx(1 / count, rel=1e-5)
        spin(board, count // 2 - 1, omega)
        assert board.share == pytest.approx(count // 2 / count, rel=1e-4)
        spin(board, count - count // 2 - 1, omega)
        assert board.share == pytest.approx(1 - 1 / count, rel=1e-4)
        spin(board, 3, omega)
        assert board.share == 1.0
        spin(board, 1, omega, status=RESTARTED)
        board.interrupt(status=0, moves=0)


def test_the_limits_themselves_are_within(board: Board) -> None:
    """A current that is within the limit by no more than float32's rounding, of it and of its square."""
    zero, shows, trip = (_within(ampere(board, share)) for share in (ZERO, SHOWS, TRIP))
    assert board.until("1", 10_000, phase=(zero, -zero)) == board.interrupts(REST)
    board.interrupt(5, phase=(shows, shows))
    assert board.gates
    assert "s" not in board.interrupt(phase=(0.0, shows))
    board.interrupt(phase=(trip, 0.0))
    assert board.mode == "WAITING"
    board.interrupt(gap(board), phase=(zero, -zero))
    assert board.mode == "PROBING"
    board.interrupt(phase=(0.0, trip))
    assert board.mode == "WAITING"
    board.interrupt(phase=(zero, -zero))
    assert board.gates
    assert "s" in board.interrupt(phase=(trip, -trip))
    assert stops(board, 2 * board.interrupts(SETTLE), phase=(trip, -trip)) == 0


def _within(limit: float) -> float:
    return float(np.float32(limit * (1.0 - 2.0**-22)))


# --- FAULT


def test_so_many_attempts_in_a_row_that_fail_end_in_fault(board: Board) -> None:
    for k in range(1, attempts(board) + 1):
        assert board.mode == "RESTING"
        fails(board)
        assert board.kept("failures") == k
        assert board.reason == "NOT_CAUGHT"
    assert board.mode == "FAULT"
    for _ in range(3 * board.interrupts(REST)):
        events = board.interrupt(phase=(0.0, 0.0))
        assert "0" in events
        assert "s" not in events
        assert list(board.now.duty) == [0.5, 0.5, 0.5]
    assert (board.mode, board.reason) == ("FAULT", "NOT_CAUGHT")


@pytest.mark.parametrize("share", [0.06, 1.0, float("nan")])
def test_currents_that_never_rest_end_in_fault(board: Board, share: float) -> None:
    """A sensor that is off, or a rotor so fast that diodes conduct: half a second, and it is said."""
    last = board.interrupts(RESTLESS)
    for k in range(last):
        assert (board.mode, board.reason) == ("RESTING", "NONE"), k
        assert "1" not in board.interrupt(phase=(0.0, share * ampere(board, 1.0)))
    assert (board.mode, board.reason) == ("FAULT", "CURRENT")
    board.keep("acknowledged", 1)
    running(board)


def test_a_fault_that_is_acknowledged_is_forgotten(board: Board) -> None:
    for _ in range(attempts(board)):
        fails(board)
    board.keep("acknowledged", 1)
    board.interrupt()
    assert (board.mode, board.reason, board.kept("failures")) == ("RESTING", "NONE", 0)
    running(board)
    assert board.kept("acknowledged") == 0
    assert stops(board, 1, status=RESTARTED) == 1
    for k in range(2, attempts(board) + 1):
        assert board.mode == "RESTING", k
        fails(board)
    assert board.mode == "FAULT", "as many again, and not acknowledged beforehand"


def test_what_is_acknowledged_before_there_is_a_fault_is_not(board: Board) -> None:
    for _ in range(attempts(board) - 1):
        fails(board)
    board.keep("acknowledged", 1)
    fails(board)
    board.interrupt(3)
    assert board.mode == "FAULT"


def test_a_while_of_running_forgets_the_attempts(board: Board) -> None:
    for _ in range(attempts(board) - 1):
        fails(board)
    running(board)
    windows = board.interrupts(STEADY) - 1  # of the first one a sample is past
    assert stops(board, windows - 1, status=0) == 0
    assert board.kept("failures") == attempts(board) - 1
    board.interrupt()
    assert board.kept("failures") == 0
    assert board.reason == "NOT_CAUGHT", "why it last gave up is kept"
    stops(board, 1, status=RESTARTED)
    board.interrupt(status=0)
    assert board.mode == "RESTING"


@pytest.mark.parametrize("place", [-1, 7, 99])
def test_a_mode_that_is_none_rests(board: Board, place: int) -> None:
    """A memory that has changed by itself."""
    for lead in (probing, running):
        lead(board)
        board.keep("mode", place)
        assert "0" in board.interrupt(phase=(0.0, 0.0))
        assert board.mode == "RESTING"
        assert not board.gates
        assert "s" not in board.interrupt()
    running(board)
