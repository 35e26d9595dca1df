"""The example interrupt's modes, seen from outside: gates, torque, what the filter begins with, what is sent.

The filter is scripted (`board.c`): its status and its angle are the test's. Times and limits are those that
docs/firmware.md states; nothing of the example's own names or numbers is read here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from model.machines.state_space import default_initial_state
from tests.codegen.board import Board, on_board

REJECTED, NOT_CONVERGED, COMMAND, REPAIRED, DIVERGED, RESTARTED = 1, 2, 4, 8, 16, 32
#: Seconds, and shares of the maximum current.
REST, PROBE, BLIND, ADRIFT, SETTLE, LOCKED, CATCH = 2e-3, 2e-3, 2e-3, 100e-3, 1e-3, 3e-3, 10e-3
ZERO, SHOWS, TRIP = 0.05, 0.1, 1.5
NAN = math.nan

BOARDS = (("paper_spmsm", 1), ("paper_spmsm", 0), ("ipmsm_flux", 1), ("ipmsm_adaptive", 1))


@pytest.fixture(params=BOARDS, ids=lambda item: f"{item[0]}-{item[1]}")
def board(request: pytest.FixtureRequest) -> Iterator[Board]:
    """Set up, gates off."""
    with on_board(*request.param) as made:
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


def running(board: Board) -> None:
    """On until the first step with torque has been made, of a rotor that stands."""
    probing(board)
    assert board.until("s", board.interrupts(PROBE) + 1) == board.interrupts(PROBE) + 1
    assert board.torque
    assert board.gates


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


def caught(board: Board, theta: float = 0.3, count: int = 3) -> float:
    """On until the rotor is caught; the speed it turns with. The next interrupt makes the first step."""
    probing(board)
    omega = half_of_the_maximum(board, count)
    assert "s" not in board.interrupt(count - 1)
    assert "s" not in board.interrupt(phase=short_circuit(board, omega, theta, count))
    board.now.phase[:] = 0.0, 0.0
    return omega


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


# --- power-up, resting, probing


def test_nothing_is_enabled_before_the_currents_read_zero(board: Board) -> None:
    assert board.events.endswith("0")
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
    assert "s" not in board.interrupt(3 * board.interrupts(PROBE), phase=high)
    assert not board.gates


@pytest.mark.parametrize("phase", [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)])
def test_a_tenth_of_the_maximum_shows_the_rotor(board: Board, phase: tuple[float, float]) -> None:
    probing(board)
    below, above = (tuple(f * ampere(board, SHOWS) * value for value in phase) for f in (0.99, 1.01))
    board.interrupt(5, phase=below)
    board.interrupt(phase=above)
    assert "s" in board.interrupt(phase=(0.0, 0.0))
    assert not board.torque


def test_a_trip_threshold_current_is_still_a_probes(board: Board) -> None:
    probing(board)
    board.interrupt(phase=(0.999 * ampere(board, TRIP), 0.0))
    assert board.gates
    assert "s" in board.interrupt(phase=(0.0, 0.0))


# --- catching


@pytest.mark.parametrize("sense", [1, -1])
def test_the_probe_tells_speed_and_angle(board: Board, sense: int) -> None:
    """In each octant, and whichever way it is meant to turn. The angle is good to 0.004 rad."""
    m, speed = board.drive.motor, board.drive.operating_box.speed
    board.now.reference = sense * 10.0
    for number, theta in enumerate(np.arange(-math.pi + 0.2, math.pi, math.pi / 4)):
        if number:  # lost, and from the beginning
            spin(board, 1, 0.0, status=RESTARTED)
            board.interrupt(board.interrupts(CATCH), phase=(0.0, 0.0), moves=0)
            assert board.setup() == 0
        probing(board)
        count = 2 + number % 3
        omega = sense * half_of_the_maximum(board, count)
        board.interrupt(count - 1)
        phase = short_circuit(board, omega, float(theta), count)
        board.interrupt(phase=phase)
        assert "s" in board.interrupt(phase=(0.0, 0.0))
        x = list(board.now.x)
        assert x[2] == pytest.approx(omega, rel=1e-5)
        assert abs(math.remainder(x[3] - theta, 2 * math.pi)) < 0.0045
        i = [phase[0], (phase[0] + 2 * phase[1]) / math.sqrt(3)]
        first = [m.magnet_flux * math.cos(theta), m.magnet_flux * math.sin(theta)] if flux(board) else i
        assert x[:2] == pytest.approx(first, rel=1e-5, abs=1e-5)
        expected = np.array(board.drive.filter.initial_covariance)
        expected[2], expected[3] = (0.5 * speed) ** 2, 0.01
        if flux(board):
            expected[:2] = 0.01 * m.magnet_flux**2
        adaptive = len(board.drive.model.adaptive)
        expected[len(expected) - adaptive :] *= 1e-3
        assert np.allclose(board.P, np.diag(expected), rtol=1e-5)


def flux(board: Board) -> bool:
    return board.drive.model.machine == "salient_flux"


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
    spin(board, 2 * settled, omega, ratio=-1.0)
    before = board.now.theta
    spin(board, 1, -omega)
    x = list(board.now.x)
    assert x[2] == pytest.approx(-omega, rel=1e-6)
    assert abs(math.remainder(x[3] - before - math.pi, 2 * math.pi)) < 1e-5
    if flux(board):
        m = board.drive.motor
        assert x[:2] == pytest.approx([-m.magnet_flux * math.cos(0.3), -m.magnet_flux * math.sin(0.3)], rel=1e-4)
    else:
        phase = short_circuit(board, omega, 0.3, 3)
        assert x[:2] == pytest.approx([phase[0], (phase[0] + 2 * phase[1]) / math.sqrt(3)], rel=1e-5)
    assert board.P[2, 2] == pytest.approx((0.5 * board.drive.operating_box.speed) ** 2, rel=1e-5)
    spin(board, 2 * settled - 1, -omega, ratio=-1.0)
    spin(board, 1, -omega, ratio=-1.0)
    assert list(board.now.x)[2] == pytest.approx(-omega, rel=1e-6), "not a second time"
    assert spin(board, 10_000, -omega, ratio=-1.0, stop="0") == board.interrupts(CATCH) - 2 * settled - 1


def test_what_is_turned_round_is_caught_as_before(board: Board) -> None:
    omega = caught(board)
    spin(board, 2 * board.interrupts(SETTLE), omega, ratio=-1.0)
    assert until_torque(board, 10_000, -omega) == board.interrupts(LOCKED) + 1


def rate(board: Board, seconds: float, angle: float) -> float:
    """Speed, rad/s, that turns the electrical angle by so much in a time."""
    return angle / (board.drive.motor.pole_pairs * board.T * board.interrupts(seconds))


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
    running(board)
    board.interrupt(3)
    spin(board, 1, 0.0, status=RESTARTED)
    probing(board)
    assert not board.until("s", board.interrupts(PROBE), status=0, moves=0)
    _nothing_is_left(board)
    assert board.torque


def _nothing_is_left(board: Board) -> None:
    """The next two steps have no voltage behind them."""
    spin(board, 1, 0.0)
    if board.variant:
        assert [*board.now.integrator, *board.now.v_acting, *board.now.v_queued] == [0.0] * 7
    else:
        assert list(board.now.u) == [0.0, 0.0]
        torque = board.now.torque
        spin(board, 1, 0.0)
        assert list(board.now.u) == [0.0, 0.0]
        board.now.torque = torque


# --- running: what stops torque


def stops(board: Board, most: int, **given: object) -> int:
    """Interrupts until the gates are off."""
    found = board.until("0", most, **given)
    assert board.gates == (found == 0)
    return found


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
    assert board.events.endswith("0")
    assert next(iter(board.now.tolerance)) == 0.0, "this host has IEEE division and root: bits"
    if board.variant:
        assert board.events == "fc0"
        assert board.setup(controller_code=411) == 411
        assert "1" not in board.events
        assert board.setup(filter_code=7, controller_code=411) == -7
        assert list(board.now.tolerance) == [0.0, 0.0]
    else:
        assert board.events == "f0"


def test_power_up_begins_anew_whatever_went_before(board: Board) -> None:
    running(board)
    board.interrupt(10)
    assert board.setup() == 0
    assert not board.gates
    assert "s" not in board.interrupt()
    assert board.until("t", 10 * board.interrupts(1 / 50)) == board.interrupts(1 / 50) - 1
