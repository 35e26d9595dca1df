"""STARTING: torque on a rotor that stood, and a second filter that is followed where it expects the currents better.

Both filters are scripted (`board.c`). Seen from the example interrupt; times and limits are those of docs/firmware.md.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import numpy as np
import pytest

from codegen.render.drive import default_kind
from model.drives.load import load_drive, shipped_drives
from model.machines.state_space import default_initial_state
from model.schema import Drive
from runtime.estimator.folder import GENERATED
from tests.codegen.board import Board
from tests.codegen.modes import (
    ATTEMPTS,
    BLIND,
    DIVERGED,
    LOCKED,
    MAX_WINDOWS,
    NAN,
    NOT_CONVERGED,
    PREFERENCE,
    PROBE,
    REJECTED,
    RESTARTED,
    RIVALS,
    SHOWS,
    START_SHARE,
    TRIP,
    ampere,
    begun,
    electrical,
    flux,
    probing,
    rate,
    set_up,
    spin,
    stops,
)


@pytest.fixture(params=RIVALS, ids=lambda item: f"{item[0]}-{item[1]}")
def board(request: pytest.FixtureRequest) -> Iterator[Board]:
    with set_up(*request.param) as made:
        yield made


def start_torque(drive: Drive) -> float:
    """The largest torque of the current that a start is allowed, N m: the best of all its directions."""
    m, angle = drive.motor, np.linspace(0.0, math.pi, 100_001)
    size = start_share(drive) * drive.control.max_current
    i_d, i_q = size * np.cos(angle), size * np.sin(angle)
    torque = 1.5 * m.pole_pairs * (m.magnet_flux + (m.inductance_d - m.inductance_q) * i_d) * i_q
    return float(np.max(torque))


def start_share(drive: Drive) -> float:
    """Of the largest current: so little that a wrong filter's reluctance torque does not undo the magnet's."""
    m = drive.motor
    difference = abs(m.inductance_d - m.inductance_q)
    return min(START_SHARE, m.magnet_flux / difference / drive.control.max_current) if difference else START_SHARE


def window(drive: Drive) -> int:
    """Samples of a window in which nothing turns: the rotor's time for a radian, from rest; 20 ms at least."""
    radian = math.sqrt(2.0 * drive.motor.inertia / (drive.motor.pole_pairs * start_torque(drive)))
    return round(max(20e-3, radian) / drive.model.sample_time)


def variances(board: Board, speed: float) -> np.ndarray:
    """Of a filter that begins at a guess: the guess's speed, 0.3 rad, and motor data that are not learnt yet."""
    expected = np.array(board.drive.filter.initial_covariance)
    expected[2], expected[3] = speed**2, 0.3**2
    if flux(board):
        expected[:2] = (0.3 * board.drive.motor.magnet_flux) ** 2
    adaptive = len(board.drive.model.adaptive)
    expected[len(expected) - adaptive :] *= 1e-3
    return np.diag(expected)


def unseen(board: Board) -> float:
    """The speed of which the probe sees nothing, rad/s."""
    m = board.drive.motor
    grown = 1.0 - math.exp(-m.stator_resistance * PROBE / m.inductance_q)
    e = ampere(board, SHOWS) * m.stator_resistance / grown
    return e / (m.magnet_flux * m.pole_pairs)


def apart(one: float, other: float) -> float:
    """Of two angles, in -pi .. pi."""
    return math.remainder(one - other, 2 * math.pi)


def turn(board: Board, stated: float = 1.0, turned: float = 1.0, count: int = 4) -> None:
    """So many radians in ``count`` steps, and so many by the speed; the window ends if that is its end."""
    spin(board, count, rate(board, board.T, stated / count), ratio=(1 + 1e-4) * turned / stated)


def slowest(drive: Drive) -> float:
    """What a start goes for at least, rad/s: a radian in its longest window."""
    return 1.0 / (drive.motor.pole_pairs * window(drive) * drive.model.sample_time)


# --- whether it begins


@pytest.mark.parametrize("reference", [0.0, -0.0, NAN, 0.0099, -0.0099])
def test_no_start_while_no_motion_is_asked_for(board: Board, reference: float) -> None:
    """Zero voltage, no attempt that fails, for as long as it takes; and then at once."""
    board.now.reference = reference * slowest(board.drive)
    probing(board)
    assert not board.until("s", board.interrupts(1.0))
    assert (board.mode, board.kept("failures"), board.gates) == ("PROBING", 0, 1)
    assert list(board.now.duty) == [0.5, 0.5, 0.5]
    board.now.reference = math.copysign(0.0101 * slowest(board.drive), reference)
    board.interrupt(phase=(0.0, 0.0))
    assert board.mode == "STARTING"


def test_a_rotor_that_is_turned_meanwhile_is_noticed(board: Board) -> None:
    board.now.reference = 0.0
    probing(board)
    board.interrupt(board.interrupts(0.3), phase=(0.0, 0.0))
    board.interrupt(phase=(1.01 * ampere(board, SHOWS), 0.0))
    assert (board.mode, board.gates) == ("WAITING", 0)


@pytest.mark.parametrize(("share", "asked"), [(0.02, 1.0), (-0.02, -1.0), (0.99, 1.0), (-1.01, -1.01), (3.0, 3.0)])
def test_a_start_turns_fast_enough_to_tell(board: Board, share: float, asked: float) -> None:
    """However slow the reference is; and in RUNNING as it says. Seen where the controller is the drive's."""
    if not board.variant:
        return
    board.now.reference = share * slowest(board.drive)
    begun(board)
    assert board.mode == "STARTING"
    assert board.now.command[0] == pytest.approx(asked * slowest(board.drive), rel=1e-3)
    for _ in range(20):
        if board.mode == "RUNNING":
            break
        spin(board, 1, rate(board, board.T, 0.3))
    spin(board, 1, 0.0)
    assert board.mode == "RUNNING"
    assert board.now.command[0] == pytest.approx(board.now.reference)


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("then", [0.0, -0.0, 0.0099, -0.0099])
def test_a_start_goes_on_as_it_began_once_no_motion_is_asked_for(board: Board, way: float, then: float) -> None:
    """Zero and noise about it point nowhere; what asks for motion the other way turns it round.

    The controller is given a command an interrupt after it was asked for.
    """
    if not board.variant:
        return
    board.now.reference = 0.02 * way * slowest(board.drive)
    begun(board)
    for reference, asked in ((then, way), (-0.0101 * way, -way), (then, -way), (0.0101 * way, way)):
        board.now.reference = reference * slowest(board.drive)
        board.interrupt(2, phase=(0.0, 0.0))
        assert board.mode == "STARTING"
        assert board.now.command[0] == pytest.approx(asked * slowest(board.drive), rel=1e-3)


# --- where both begin


def test_two_filters_begin_half_a_turn_apart(board: Board) -> None:
    """At rest, as far as the probe tells; tuned alike, at the measured currents, and with no voltage behind them."""
    board.tune(0.0125)
    board.now.reference = -5.0
    probing(board)
    board.interrupt(board.interrupts(PROBE), phase=(0.3, -0.1))
    assert (board.mode, board.kept("fresh"), board.kept("anew")) == ("STARTING", 1, 1)
    events = board.interrupt(v_wanted=(3.0, 4.0)).replace("t", "")
    assert events == ("prswa" if board.variant else "prslvwa")
    theta = default_initial_state(board.drive)[3]
    for x, P, at in ((board.now.x, board.P, theta), (board.now.rival_x, board.rival_P, theta + math.pi)):
        assert x[2] == 0.0
        assert apart(x[3], at) == pytest.approx(0.0, abs=1e-5)
        assert list(x)[:2] == pytest.approx(electrical(board, (0.3, -0.1), at), rel=1e-4, abs=1e-5)
        assert np.allclose(P, variances(board, unseen(board)), rtol=1e-5)
    assert board.now.tuning == board.now.rival_tuning == pytest.approx(0.0125)
    assert board.share == pytest.approx(START_SHARE)
    if not board.variant:
        assert list(board.now.rival_u) == list(board.now.u) == [0.0, 0.0]
        board.interrupt(2, v_wanted=(5.0, 6.0))
        assert list(board.now.rival_u) == list(board.now.u) == [3.0, 4.0]
    else:
        assert list(board.now.v_acting) == list(board.now.rival_u) == [0.0, 0.0]


@pytest.mark.parametrize("name", shipped_drives())
def test_share_and_window_are_the_drives_own(name: str) -> None:
    drive = load_drive(name)
    stem = GENERATED / name / f"{name}_{default_kind(drive.filter.kinds)}_supervisor"
    header, source = (stem.with_suffix(end).read_text() for end in (".h", ".c"))
    shares, windows = re.findall(r"_START_SHARE (\S+)f$", header, re.M), re.findall(r"WINDOW_SAMPLES (\d+)", source)
    if drive.model.sample_time < 50e-6:
        assert (shares, windows) == ([], [])
        return
    assert float(shares[0]) == pytest.approx(start_share(drive), rel=1e-6)
    assert int(windows[0]) == pytest.approx(window(drive), abs=1)


# --- windows


def test_two_windows_in_a_row_that_turn_as_stated_end_a_start(board: Board) -> None:
    begun(board)
    for k in range(2):
        assert board.mode == "STARTING"
        assert (board.kept("windows"), board.kept("good")) == (k, k)
        turn(board)
    assert board.mode == "RUNNING"
    events = spin(board, 1, 0.0) or board.events
    assert "r" not in str(events), "the rival is done with"
    assert board.share == pytest.approx(1.0)
    adaptive = len(board.drive.model.adaptive)
    expected = board.drive.filter.initial_covariance[len(board.now.x) - adaptive :]
    assert np.allclose(np.diag(board.P)[len(board.now.x) - adaptive :], expected, rtol=1e-5), "learnt again"


def test_good_windows_count_in_a_row(board: Board) -> None:
    begun(board)
    for stated, good in ((1.0, 1), (2.2, 0), (1.0, 1)):
        turn(board, stated=stated)
        assert (board.mode, board.kept("good")) == ("STARTING", good)
    turn(board)
    assert board.mode == "RUNNING"


@pytest.mark.parametrize(("stated", "good"), [(1.9, 1), (2.1, 0), (0.68, 1), (0.65, 0), (-1.0, 0)])
def test_as_stated_is_within_half_of_what_is_stated(board: Board, stated: float, good: int) -> None:
    begun(board)
    turn(board, stated=stated)
    assert (board.kept("windows"), board.kept("good")) == (1, good)


@pytest.mark.parametrize(("turned", "good"), [(0.52, 1), (0.48, 0)])
def test_a_window_that_time_ends_needs_half_a_radian(board: Board, turned: float, good: int) -> None:
    begun(board)
    count = window(board.drive)
    turn(board, stated=turned, turned=turned, count=10)
    spin(board, count - 12, 0.0)
    assert board.kept("windows") == 0
    spin(board, 1, 0.0)
    assert (board.kept("windows"), board.kept("good")) == (1, good)


@pytest.mark.parametrize("stated", [1.0, 2.2])
def test_after_a_window_that_turned_the_rival_is_half_a_turn_from_the_filter(board: Board, stated: float) -> None:
    """The other way round, whether the angle turned as stated or not; a copy otherwise, judged from now on."""
    begun(board)
    board.tune(0.0125)
    board.now.nis, board.now.rival_nis = 3.0, 3.01
    board.now.phase[:] = 0.3, -0.1
    turn(board, stated=stated)
    omega, theta = board.now.omega, board.now.theta
    spin(board, 1, omega)
    assert board.now.rival_x[2] == pytest.approx(-omega)
    assert apart(board.now.rival_x[3], theta + math.pi) == pytest.approx(0.0, abs=1e-5)
    assert list(board.now.rival_x)[:2] == pytest.approx(
        electrical(board, (0.3, -0.1), board.now.rival_x[3]), rel=1e-4, abs=1e-5
    )
    assert np.allclose(board.rival_P, variances(board, 0.25 * board.drive.operating_box.speed), rtol=1e-5)
    assert board.now.rival_tuning == pytest.approx(0.0125)
    assert board.now.found_nis == board.now.rival_found_nis == 0.0
    assert (board.now.x[2], board.kept("anew")) == (omega, 0), "the filter and the regulators go on"


def test_where_nothing_turned_the_rival_is_a_quarter_aside_on_either_side_in_turn(board: Board) -> None:
    begun(board)
    count = window(board.drive)
    spin(board, count - 2, 0.0)
    sides = []
    for _ in range(3):
        spin(board, 1, 0.0)
        spin(board, 1, 0.0)
        sides.append(apart(board.now.rival_x[3], board.now.theta) / (math.pi / 2))
        assert board.now.rival_x[2] == 0.0
        assert np.allclose(board.rival_P, variances(board, unseen(board)), rtol=1e-5)
        spin(board, count - 2, 0.0)
    assert sides == pytest.approx([1.0, -1.0, 1.0], abs=1e-5)


def test_a_start_of_too_many_windows_has_failed(board: Board) -> None:
    begun(board)
    turned = sum(1 for _ in iter(lambda: (turn(board, stated=2.2), board.kept("windows") < MAX_WINDOWS)[1], False))
    assert turned == MAX_WINDOWS - 1
    assert (board.mode, board.kept("windows")) == ("STARTING", MAX_WINDOWS)
    spin(board, 1, 0.0)
    assert (board.mode, board.reason, board.kept("failures")) == ("RESTING", "NOT_STARTED", 1)
    assert not board.gates
    board.interrupt(status=0, moves=0)
    begun(board)
    assert board.kept("windows") == 0


def test_starts_that_fail_end_in_fault(board: Board) -> None:
    for _ in range(ATTEMPTS):
        begun(board)
        assert stops(board, 1, status=RESTARTED) == 1
        board.interrupt(status=0)
    assert (board.mode, board.reason) == ("FAULT", "RESTARTED")


# --- who is followed


def test_the_rival_is_followed_once_it_has_expected_the_currents_better_for_a_while(board: Board) -> None:
    """3 ms after its window began, and by more than a twentieth."""
    begun(board)
    first = list(board.now.rival_x)
    board.now.nis, board.now.rival_nis = 2.0, 2.0 - PREFERENCE - 0.01
    spin(board, board.interrupts(LOCKED) - 2, 0.0)
    assert board.kept("windows") == 0
    spin(board, 1, 0.0)
    assert (board.mode, board.kept("windows"), board.kept("anew")) == ("STARTING", 1, 1)
    board.now.moves = 0
    board.now.nis = board.now.rival_nis = 2.0
    board.interrupt()
    assert list(board.now.x)[2:4] == first[2:4], "what was the rival"
    assert apart(board.now.rival_x[3], default_initial_state(board.drive)[3]) == pytest.approx(0.0, abs=1e-5)
    assert board.now.found_nis == pytest.approx(2.0 - PREFERENCE - 0.01)
    assert board.kept("windows") == 1


def test_a_rival_that_is_little_better_is_not_followed(board: Board) -> None:
    begun(board)
    board.now.nis, board.now.rival_nis = 2.0, 2.0 - PREFERENCE + 0.01
    spin(board, 3 * board.interrupts(LOCKED), 0.0)
    assert (board.kept("windows"), board.kept("anew")) == (0, 0)


def test_a_rival_that_is_followed_needs_two_good_windows_of_its_own(board: Board) -> None:
    begun(board)
    turn(board)
    assert board.kept("good") == 1
    board.now.nis, board.now.rival_nis = 2.0, 1.0
    spin(board, board.interrupts(LOCKED), 0.0)
    assert (board.kept("good"), board.kept("windows")) == (0, 2)
    board.now.rival_nis = 2.0
    board.now.theta = math.remainder(board.now.theta + math.pi, 2 * math.pi)
    turn(board)
    assert board.mode == "STARTING"
    turn(board)
    assert board.mode == "RUNNING"


@pytest.mark.parametrize(("load", "exchanged"), [(0.35, False), (0.45, True), (-0.45, True)])
def test_a_load_counts_against_a_filter(board: Board, load: float, exchanged: bool) -> None:
    """0.3 for the largest torque, by its square: 0.05 for 0.41 of it. Where a filter has none, nothing counts."""
    begun(board)
    board.now.nis = board.now.rival_nis = 2.0
    board.now.load = load * start_torque(board.drive)
    spin(board, board.interrupts(LOCKED) - 1, 0.0)
    has_load = "load_torque" in board.module.STATES
    assert board.kept("windows") == int(exchanged and has_load)
    board.setup()
    begun(board)
    board.now.rival_load = board.now.load
    spin(board, board.interrupts(LOCKED), 0.0)
    assert board.kept("windows") == 0, "both alike"


# --- what ends a start at once


def test_what_stops_a_start(board: Board) -> None:
    high = (1.001 * ampere(board, TRIP), 0.0)
    for given, count, reason in (
        ({"phase": high}, 3, "CURRENT"),
        ({"status": REJECTED}, board.interrupts(BLIND), "BLIND"),
        ({"status": RESTARTED | NOT_CONVERGED}, 1, "RESTARTED"),
    ):
        begun(board)
        assert stops(board, 10 * count, **given) == count
        assert (board.mode, board.reason) == ("RESTING", reason)
        board.interrupt(status=0, phase=(0.0, 0.0), moves=0)


def test_a_filter_that_diverges_is_no_reason_to_stop_a_start(board: Board) -> None:
    """One of both is half a turn off: that is what the rival is for."""
    begun(board)
    assert stops(board, window(board.drive) + 10, status=DIVERGED) == 0
    assert board.mode == "STARTING"
