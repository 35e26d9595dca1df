"""A drive from power-up until it has caught the rotor, or found that it stands; seen from the example interrupt.

The filter is scripted (`board.c`): its status and its angle are the test's. Times and limits are those that
docs/firmware.md states; see test_modes_run for what comes after, and test_modes_rival for a start from any angle.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from model.machines.state_space import default_initial_state
from tests.codegen.board import Board
from tests.codegen.modes import (
    BOARDS,
    CATCH,
    COMMAND,
    DIVERGED,
    LOCKED,
    NAN,
    NOT_CONVERGED,
    PROBE,
    REJECTED,
    REPAIRED,
    REST,
    RESTARTED,
    SETTLE,
    SHOWS,
    TRIP,
    ZERO,
    ampere,
    begun,
    caught,
    electrical,
    flux,
    gap,
    probing,
    rate,
    running,
    set_up,
    spin,
    until_torque,
)


@pytest.fixture(params=BOARDS, ids=lambda item: f"{item[0]}-{item[1]}")
def board(request: pytest.FixtureRequest) -> Iterator[Board]:
    with set_up(*request.param) as made:
        yield made


# --- power-up, resting, probing


def test_nothing_is_enabled_before_the_currents_read_zero(board: Board) -> None:
    assert board.events.startswith("0")
    assert "1" not in board.events
    assert not board.gates
    zero, count = ampere(board, ZERO), board.interrupts(REST)
    for phase in ((1.001 * zero, 0.0), (0.0, -1.001 * zero), (NAN, 0.0), (0.0, NAN), (-50 * zero, 50 * zero)):
        assert board.until("1", count - 1, phase=(0.0, 0.0)) == 0
        assert board.until("1", 2 * count, phase=phase) == 0, phase
    assert board.until("1", 2 * count, phase=(0.999 * zero, -0.999 * zero)) == count
    assert board.gates


def test_zero_voltage_and_no_filter_while_the_rotor_is_looked_for(board: Board) -> None:
    for _ in range(board.interrupts(REST + PROBE) - 1):
        board.now.duty[:] = 0.0, 0.0, 0.0
        events = board.interrupt(phase=(0.0, 0.0))
        assert list(board.now.duty) == [0.5, 0.5, 0.5]
        assert events.count("w") == 1
        assert "s" not in events
        assert events[-1] == "a"
        assert events[0] == "p"
    assert board.gates


def test_a_rotor_that_stands_starts_as_the_drive_file_says(board: Board) -> None:
    """Without a second filter; test_modes_rival has what two do."""
    if board.rivals:
        return
    running(board)
    drive = board.drive
    assert np.allclose(board.now.x, default_initial_state(drive), rtol=1e-6)
    assert np.allclose(board.P, np.diag(drive.filter.initial_covariance), rtol=1e-6)
    if board.variant:
        assert board.now.gain_max == pytest.approx(drive.control.max_current)
        assert board.now.delay == 1, "a voltage computed now begins to act at the next sample"


@pytest.mark.parametrize("phase", [(1.001 * TRIP, 0.0), (0.0, -1.001 * TRIP), (NAN, 0.0), (0.0, NAN)])
def test_probing_ends_at_a_current_no_probe_makes(board: Board, phase: tuple[float, float]) -> None:
    probing(board)
    high = tuple(ampere(board, value) for value in phase)
    assert "0" in board.interrupt(phase=high)
    assert not board.gates
    assert (board.mode, board.reason) == ("RESTING", "CURRENT")
    assert "s" not in board.interrupt(3 * board.interrupts(PROBE), phase=high)
    assert not board.gates


@pytest.mark.parametrize("phase", [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)])
def test_a_tenth_of_the_maximum_shows_the_rotor(board: Board, phase: tuple[float, float]) -> None:
    """That it turns at the first time, and which way at the second: then the filter runs, without torque."""
    probing(board)
    below, above = (tuple(f * ampere(board, SHOWS) * value for value in phase) for f in (0.99, 1.01))
    board.interrupt(5, phase=below)
    assert "0" in board.interrupt(phase=above)
    assert board.until("1", 2 * gap(board), phase=(0.0, 0.0)) == gap(board)
    board.interrupt(5, phase=below)
    assert board.gates
    assert "0" in board.interrupt(phase=above[::-1])
    assert "1" in board.interrupt(phase=(0.0, 0.0))
    assert "s" in board.interrupt(phase=(0.0, 0.0))
    assert not board.torque


def test_a_trip_threshold_current_is_still_a_probes(board: Board) -> None:
    probing(board)
    high = 0.999 * ampere(board, TRIP)
    for mode, phase in (("PROBING", (high, 0.0)), ("CATCHING", (0.0, high))):
        board.interrupt(phase=phase)
        assert board.mode == "WAITING"
        board.interrupt(gap(board), phase=(0.0, 0.0))
        assert board.mode == mode


# --- catching


@pytest.mark.parametrize("sense", [1, -1])
def test_the_probe_tells_speed_and_angle(board: Board, sense: int) -> None:
    """In each octant, and whichever way it turns. The angle is good to 0.004 rad."""
    m, speed = board.drive.motor, board.drive.operating_box.speed
    for number, theta in enumerate(np.arange(-math.pi + 0.2, math.pi, math.pi / 4)):
        assert board.setup() == 0
        count = 2 + number % 3
        omega = caught(board, float(theta), count, sense)
        assert "s" in board.interrupt(phase=(0.0, 0.0), status=0, moves=0)
        x = list(board.now.x)
        assert x[2] == pytest.approx(omega, rel=1e-5)
        assert abs(math.remainder(x[3] - theta, 2 * math.pi)) < 0.0045
        assert x[:2] == pytest.approx(electrical(board, (0.0, 0.0), x[3]), rel=1e-4, abs=1e-5)
        expected = np.array(board.drive.filter.initial_covariance)
        expected[2], expected[3] = (0.5 * speed) ** 2, 0.01
        if flux(board):
            expected[:2] = 0.01 * m.magnet_flux**2
        adaptive = len(board.drive.model.adaptive)
        expected[len(expected) - adaptive :] *= 1e-3
        assert np.allclose(board.P, np.diag(expected), rtol=1e-5)


def test_a_caught_rotor_gets_torque_once_it_turned_as_stated_for_3_ms(board: Board) -> None:
    caught(board)
    assert until_torque(board, 10_000, 0.2 * board.drive.operating_box.speed) == board.interrupts(LOCKED) + 1
    assert np.allclose(
        np.diag(board.P)[len(board.now.x) - len(board.drive.model.adaptive) :],
        board.drive.filter.initial_covariance[len(board.now.x) - len(board.drive.model.adaptive) :],
        rtol=1e-5,
    ), "motor data are learnt again"


def test_a_bad_status_begins_the_3_ms_anew(board: Board) -> None:
    for status in (REJECTED, DIVERGED):
        board.setup()
        omega = caught(board)
        spin(board, 2, omega)
        first = board.interrupts(SETTLE) + 7
        spin(board, first - 2, omega)
        spin(board, 1, omega, status=status)
        assert until_torque(board, 10_000, omega) == board.interrupts(LOCKED) + 1


@pytest.mark.parametrize("status", [NOT_CONVERGED, REPAIRED, COMMAND])
def test_what_is_no_reason_to_wait(board: Board, status: int) -> None:
    omega = caught(board)
    assert until_torque(board, 10_000, omega, status=status) == board.interrupts(LOCKED) + 1


def test_catching_ends_after_10_ms(board: Board) -> None:
    omega = caught(board)
    assert spin(board, 10_000, omega, status=RESTARTED, stop="0") == board.interrupts(CATCH)
    assert not board.gates


def test_half_a_turn_off_is_turned_round_once(board: Board) -> None:
    omega = caught(board)
    settled = board.interrupts(SETTLE)
    board.now.phase[:] = 1.0, -0.2
    spin(board, 2 * settled, omega, ratio=-1.0)
    before = board.now.theta
    spin(board, 1, -omega)
    x = list(board.now.x)
    assert x[2] == pytest.approx(-omega, rel=1e-6)
    assert abs(math.remainder(x[3] - before - math.pi, 2 * math.pi)) < 1e-5
    assert x[:2] == pytest.approx(electrical(board, (1.0, -0.2), x[3]), rel=1e-4, abs=1e-5), "the currents at hand"
    assert board.P[2, 2] == pytest.approx((0.5 * board.drive.operating_box.speed) ** 2, rel=1e-5)
    spin(board, 2 * settled - 1, -omega, ratio=-1.0)
    spin(board, 1, -omega, ratio=-1.0)
    assert list(board.now.x)[2] == pytest.approx(-omega, rel=1e-6), "not a second time"
    assert spin(board, 10_000, -omega, ratio=-1.0, stop="0") == board.interrupts(CATCH) - 2 * settled - 1


def test_what_is_turned_round_is_caught_as_before(board: Board) -> None:
    omega = caught(board)
    spin(board, 2 * board.interrupts(SETTLE), omega, ratio=-1.0)
    assert until_torque(board, 10_000, -omega) == board.interrupts(LOCKED) + 1


@pytest.mark.parametrize(("ratio", "good"), [(0.46, True), (0.42, False), (1.54, True), (1.58, False)])
def test_how_far_from_stated_the_angle_may_be_when_caught(board: Board, ratio: float, good: bool) -> None:
    """Half of what is stated, and 0.1 rad: sqrt(0.2^2 + 0.1^2) = 0.224 of 0.4 rad. The first millisecond is free."""
    caught(board)
    omega, settled = rate(board, SETTLE, 0.4), board.interrupts(SETTLE)
    spin(board, settled, omega, ratio=5.0)
    spin(board, settled, omega, ratio=ratio)
    spin(board, 1, omega)
    found = list(board.now.x)[2]
    assert found == pytest.approx(omega if good else -omega, rel=1e-5)


@pytest.mark.parametrize(("drift", "good"), [(0.095, True), (0.105, False), (-0.095, True), (-0.105, False)])
def test_a_jolt_when_caught(board: Board, drift: float, good: bool) -> None:
    caught(board)
    tiny, settled = rate(board, SETTLE, 1e-4), board.interrupts(SETTLE)
    spin(board, settled, tiny)
    spin(board, settled, tiny, ratio=1 + drift / 1e-4)
    spin(board, 1, tiny)
    assert list(board.now.x)[2] == pytest.approx(tiny if good else -tiny, rel=1e-3)


def test_regulators_begin_with_nothing(board: Board) -> None:
    """Whatever voltages were acting and queued, and integrators held, when torque was lost."""
    running(board)
    board.interrupt(3, v_wanted=(3.0, 4.0))
    spin(board, 1, 0.0, status=RESTARTED)
    omega = caught(board)
    _nothing_is_left(board)
    assert not board.torque
    board.interrupt(3)
    assert spin(board, 10_000, omega, status=DIVERGED, stop="0")
    begun(board)
    board.interrupt(3)
    spin(board, 1, 0.0, status=RESTARTED)
    probing(board)
    assert not board.until("s", board.interrupts(PROBE), status=0, moves=0)
    _nothing_is_left(board)


def _nothing_is_left(board: Board) -> None:
    """The next two steps have no voltage behind them, and regulators begin anew at the first of them."""
    assert (board.kept("fresh"), board.kept("anew")) == (1, 1)
    spin(board, 1, 0.0)
    assert (board.kept("fresh"), board.kept("anew")) == (0, 0)
    if board.variant:
        assert [*board.now.integrator, *board.now.v_acting, *board.now.v_queued] == [0.0] * 8
        return
    assert list(board.now.u) == [0.0, 0.0]
    assert board.now.anew == 1
    spin(board, 1, 0.0)
    assert list(board.now.u) == [0.0, 0.0]
    assert board.now.anew == 0


def test_turned_round_is_anew_with_the_voltages_that_are_under_way(board: Board) -> None:
    omega = caught(board)
    board.now.v_wanted[:] = 3.0, 4.0
    spin(board, 2 * board.interrupts(SETTLE), omega, ratio=-1.0)
    assert (board.mode, board.kept("mirrored")) == ("CATCHING", 1)
    assert (board.kept("fresh"), board.kept("anew")) == (0, 1)
    spin(board, 1, -omega)
    if board.variant:
        assert list(board.now.integrator) == [0.0] * 4
        assert [*board.now.v_acting, *board.now.v_queued] == [7.0] * 4
    else:
        assert list(board.now.u) == [3.0, 4.0]
        assert board.now.anew == 1
