"""Whether the angle is seen: what the drive's status says in C, beside what docs/firmware.md states."""

from __future__ import annotations

import math

import numpy as np
import pytest

from model.drives.load import load_drive
from runtime.drive.scenario import Scenario
from runtime.drive.simulation import Conditions, Simulator
from runtime.estimator.folder import GENERATED, GeneratedFolder
from runtime.recorded.units import RPM
from tests.codegen.board import on_board

UNOBSERVABLE = 0x40


@pytest.mark.parametrize("name", ["paper_spmsm", "ipmsm_flux", "ipmsm_adaptive"])
def test_the_variance_is_that_of_the_whole_covariance(name: str) -> None:
    module, rng = GeneratedFolder(GENERATED / name, checked=False).module, np.random.default_rng(7)
    for _ in range(50):
        words = rng.uniform(0.1, 2.0, module.WORDS)
        (found,) = module.angle_variance(tuple(words), module.MATH["float64"])
        theta = module.STATES.index("theta")
        assert found == pytest.approx(module.unpack(words)[theta, theta], rel=1e-12)


def least_speed(name: str) -> float:
    """rad/s: the back-EMF is a twentieth of R times the largest current."""
    drive = load_drive(name)
    m = drive.motor
    return 0.05 * m.stator_resistance * drive.control.max_current / (m.magnet_flux * m.pole_pairs)


def test_a_round_rotor_is_not_seen_below_a_speed_nor_a_salient_one_beyond_thirty_degrees() -> None:
    for name, salient in (("paper_spmsm", False), ("spmsm_adaptive", False), ("ipmsm_flux", True)):
        module = GeneratedFolder(GENERATED / name, checked=False).module
        assert pytest.approx(math.radians(30) ** 2) == module.MOST_VARIANCE
        assert hasattr(module, "LEAST_SPEED_SQUARED") != salient
        assert salient or pytest.approx(least_speed(name) ** 2) == module.LEAST_SPEED_SQUARED


@pytest.mark.parametrize(("share", "said"), [(0.0, True), (0.9, True), (-0.9, True), (1.1, False), (-1.1, False)])
def test_the_status_says_it_at_speeds_about_the_least_one(share: float, said: bool) -> None:
    """The filter is scripted: the example interrupt's telemetry has the drive's status."""
    with on_board("paper_spmsm", 1) as board:
        board.now.link, board.now.reference = board.drive.control.dc_link, 10.0
        board.setup()
        board.until("s", 10_000)
        board.now.moves, board.now.omega = 1, share * least_speed("paper_spmsm")
        while "t" not in board.interrupt():
            assert board.torque
        assert bool(int(board.now.words[3]) & UNOBSERVABLE) == said


class Held(Scenario):
    """To its speed, and back to rest: a drive that never turned has no torque, and waits."""

    def speed_reference(self, t: np.ndarray) -> np.ndarray:
        return np.asarray(super().speed_reference(t) * np.clip((0.3 - t) / 0.1, 0.0, 1.0))


def test_a_surface_motor_that_is_held_says_so_and_a_salient_one_does_not() -> None:
    for name, held in (("spmsm_load_torque", True), ("ipmsm", False)):
        folder = GeneratedFolder(GENERATED / name)
        simulator, supervised = Simulator(folder, "ckf"), Conditions(supervised=True, delay=1)
        run = simulator.run(Held("held", 300.0, 0.05, 0.0, 0.5, 0.5), supervised)
        torque = run.status[run.t > 0.4]
        assert np.all((torque & UNOBSERVABLE) != 0) == held
        assert np.any((torque & UNOBSERVABLE) != 0) == held
        fast = simulator.run(Scenario("fast", 1000.0, 0.1, 0.0, 0.1, 0.2), supervised)
        turning = np.abs(fast.x[:, 2]) * RPM > 300
        assert not np.any(fast.status[turning] & UNOBSERVABLE)
