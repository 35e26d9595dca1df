"""The example interrupt's modes, seen from outside: gates, torque, what the filter begins with, what is sent.

The filter is scripted (`board.c`): its status and its angle are the test's. Times and limits are those that
docs/firmware.md states; nothing of the example's own names or numbers is read here.
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
    NOT_CONVERGED,
    REJECTED,
    REPAIRED,
    REST,
    RESTARTED,
    SETTLE,
    SHOWS,
    TRIP,
    ZERO,
    ampere,
    caught,
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
    above, below = (tuple(f * ampere(board, TRIP) * value for value in side) for f in (1.001, 0.999))
    assert stops(board, 50, phase=below) == 0
    assert stops(board, 2, phase=above) == 0
    assert stops(board, 1, phase=below) == 0
    assert stops(board, 10, phase=above) == 3
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
        running(board)


@pytest.mark.parametrize(("status", "seconds"), [(REJECTED, BLIND), (DIVERGED, ADRIFT)])
def test_blind_or_diverged_for_too_long_stops_torque(board: Board, status: int, seconds: float) -> None:
    running(board)
    most = board.interrupts(seconds)
    assert stops(board, most, status=status) == 0
    assert board.torque
    assert stops(board, 1, status=0) == 0
    assert stops(board, 3 * most, status=status | NOT_CONVERGED) == most + 1
    running(board)
    assert stops(board, most, status=status) == 0, "counted from none after the rest"
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
    if good:
        assert spin(board, count - 1, omega, stop="0") == 0, "each window is judged for itself"
        assert spin(board, 1, omega, stop="0") == 0


@pytest.mark.parametrize(("drift", "good"), [(0.29, True), (0.31, False), (-0.29, True), (-0.31, False)])
def test_a_jolt_while_running(board: Board, drift: float, good: bool) -> None:
    running(board)
    count, tiny = board.interrupts(LOCKED), rate(board, LOCKED, 1e-4)
    spin(board, count - 1, tiny)
    assert spin(board, count, tiny, ratio=1 + drift / 1e-4, stop="0") == (0 if good else count)


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_turning_on_over_the_seam_of_the_angle_is_turning_on(board: Board, sense: float) -> None:
    running(board)
    assert spin(board, 5 * board.interrupts(LOCKED), sense * rate(board, LOCKED, 5.0), stop="0") == 0
    assert board.torque


def test_a_maximum_current_that_was_tuned_is_what_comes_back(board: Board) -> None:
    if not board.variant:
        return
    running(board)
    tuned = 0.7 * board.drive.control.max_current
    board.interrupt(tuned=tuned)
    board.now.tuned = 0.0
    assert stops(board, 1, status=RESTARTED) == 1
    omega = caught(board)
    spin(board, 1, omega)
    assert board.now.gain_max == 0
    assert until_torque(board, 10_000, omega)
    assert board.now.gain_max == pytest.approx(tuned)
    assert stops(board, 1, status=RESTARTED) == 1
    running(board)
    assert board.now.gain_max == pytest.approx(tuned)


def test_torque_comes_back_after_catches_that_failed(board: Board) -> None:
    omega = caught(board)
    for _ in range(2):
        assert spin(board, 10_000, omega, status=DIVERGED, stop="0")
        omega = caught(board)
    assert until_torque(board, 10_000, omega) == board.interrupts(LOCKED) + 1
    if board.variant:
        assert board.now.gain_max == pytest.approx(board.drive.control.max_current)


def test_the_limits_themselves_are_within(board: Board) -> None:
    """A current that is exactly the limit, as float32 has it."""
    zero, shows, trip = (float(np.float32(ampere(board, share))) for share in (ZERO, SHOWS, TRIP))
    assert board.until("1", 10_000, phase=(zero, -zero)) == board.interrupts(REST)
    board.interrupt(5, phase=(shows, shows))
    assert board.gates
    assert "s" not in board.interrupt(phase=(0.0, shows))
    board.interrupt(phase=(trip, 0.0))
    assert board.gates
    assert "s" in board.interrupt(phase=(trip, -trip))
    assert stops(board, 2 * board.interrupts(SETTLE), phase=(trip, -trip)) == 0


def test_without_a_reference_forward_is_guessed(board: Board) -> None:
    board.now.reference = 0.0
    omega = caught(board)
    board.interrupt()
    assert list(board.now.x)[2] == pytest.approx(omega, rel=1e-5)


# --- what goes to and fro every sample


def test_each_sample_reads_steps_writes_and_acknowledges(board: Board) -> None:
    running(board)
    events = board.interrupt(phase=(0.2, 0.3), duty_wanted=(0.1, 0.2, 0.3)).replace("t", "")
    assert events == ("pswa" if board.variant else "pslvwa")
    assert list(board.now.duty) == pytest.approx([0.1, 0.2, 0.3])
    if board.variant:
        assert list(board.now.y) == pytest.approx([0.2, 0.3])
        assert list(board.now.command) == pytest.approx([board.now.reference, board.now.link])
    else:
        i = [0.2, (0.2 + 2 * 0.3) / math.sqrt(3)]
        assert list(board.now.y) == pytest.approx(i)
        spin(board, 1, 12.5)
        board.now.theta = -0.1
        board.interrupt(v_wanted=(5.0, -6.0))
        assert list(board.now.loop) == pytest.approx([*i, 12.5, 1 - 0.1 / (2 * math.pi)], rel=1e-5)
        assert list(board.now.svgen) == pytest.approx([5.0, -6.0, board.now.link])


def test_the_filter_gets_the_voltage_of_two_interrupts_ago(board: Board) -> None:
    if board.variant:
        return
    running(board)
    given = []
    for k in range(6):
        board.interrupt(v_wanted=(float(k + 1), float(-k - 1)))
        given.append(tuple(board.now.u))
    assert given == [(0.0, 0.0), (0.0, 0.0), (1.0, -1.0), (2.0, -2.0), (3.0, -3.0), (4.0, -4.0)]


def test_telemetry_is_four_words_50_times_a_second(board: Board) -> None:
    every = board.interrupts(1 / 50)
    assert board.until("t", 2 * every, phase=(1e6, 0.0)) == every, "from power-up on"
    assert board.now.word_count == 4
    assert list(board.now.words)[3] == 0
    running(board)
    omega = rate(board, LOCKED, 0.5)
    board.now.theta = 0.0
    assert spin(board, every, omega, status=NOT_CONVERGED, stop="t")
    passed = spin(board, 2 * every, omega, status=REPAIRED, stop="t")
    assert passed == every
    words = list(board.now.words)[:4]
    turns = board.now.theta / (2 * math.pi) % 1.0
    hertz = omega * board.drive.motor.pole_pairs / (2 * math.pi)
    assert words == pytest.approx([omega, turns, hertz, REPAIRED], rel=1e-4, abs=1e-6)
    for theta, turn in ((-0.1, 1 - 0.1 / (2 * math.pi)), (3.0, 3.0 / (2 * math.pi)), (0.0, 0.0)):
        board.setup()
        running(board)
        board.interrupt(status=0, moves=1, omega=0.0, theta=theta)
        sent = 0
        while not sent and board.gates:
            sent = "t" in board.interrupt()
        if sent:
            assert list(board.now.words)[1] == pytest.approx(turn, abs=1e-6)


# --- power-up


def test_a_failed_self_test_is_told_and_nothing_enabled(board: Board) -> None:
    assert board.setup(filter_code=1203) == -1203
    assert "1" not in board.events
    assert board.setup() == 0
    assert board.events.startswith("0")
    assert next(iter(board.now.tolerance)) == 0.0, "this host has IEEE division and root: bits"
    if board.variant:
        assert board.events == "0fc"
        assert board.setup(controller_code=411) == 411
        assert "1" not in board.events
        assert board.setup(filter_code=7, controller_code=411) == -7
        assert list(board.now.tolerance) == [0.0, 0.0]
    else:
        assert board.events == "0f"


def test_power_up_begins_anew_whatever_went_before(board: Board) -> None:
    running(board)
    board.interrupt(10)
    assert board.setup() == 0
    assert not board.gates
    assert "s" not in board.interrupt()
    assert board.until("t", 10 * board.interrupts(1 / 50)) == board.interrupts(1 / 50) - 1


@pytest.mark.parametrize("code", [0, 1203])
@pytest.mark.parametrize(("status", "counted"), [(0, "tsecm"), (REJECTED | DIVERGED, "tsrdem")])
def test_a_second_power_up_forgets_what_was_counted(board: Board, status: int, counted: str, code: int) -> None:
    """In the middle of a catch that was turned round, with a current beyond the limit for one sample."""
    omega = caught(board)
    spin(board, 2 * board.interrupts(SETTLE), omega, ratio=-1.0, status=status)
    board.interrupt(phase=(1.01 * ampere(board, TRIP), 0.0))
    assert board.gates
    assert board.counting() == counted
    assert board.setup(filter_code=code) == -code
    assert not board.gates
    assert board.counting() == ""
