"""The whole drive in the closed loop, from power-up: any angle, C and NumPy alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from model.drives.load import load_drive
from model.rating import rating
from runtime.drive.scenario import find_scenario
from runtime.drive.simulation import Conditions, Simulator
from runtime.estimator.folder import GENERATED, GeneratedFolder
from runtime.faults.standstill import standstill
from tests.features import fewest


def simulator(name: str, kind: str = "ckf") -> Simulator:
    return Simulator(GeneratedFolder(GENERATED / name, checked=False), kind)


@pytest.mark.parametrize("name", fewest())
def test_a_drive_starts_at_any_angle(name: str) -> None:
    made, scenario = simulator(name), find_scenario("load_step", load_drive(name))
    for theta in (-2.5, -1.0, 1.5, 3.0):
        run = made.run(scenario, Conditions(theta=theta, delay=1))
        assert run.good, (name, theta, run.verdict)


def test_the_controller_alone_does_not() -> None:
    """From half a turn off it may come back by itself, late; but it has no rest before and no rival."""
    made, scenario = simulator("ipmsm"), find_scenario("no_load", load_drive("ipmsm"))
    alone = made.run(scenario, Conditions(theta=2.5, supervised=False))
    whole = made.run(scenario, Conditions(theta=2.5))
    assert np.all(whole.duty[:19] == 0.5), "RESTING"
    assert np.any(alone.duty[:19] != 0.5)


@pytest.mark.parametrize("name", ["ipmsm", "paper_spmsm"])
def test_numpy_has_the_bits_of_the_whole_drive(name: str) -> None:
    """Power-up, probing, start with or without a rival, injection or none: 0.06 s of it."""
    made, drive = simulator(name), load_drive(name)
    scenario = find_scenario("no_load", drive)
    short = type(scenario)(**{**scenario.__dict__, "duration": 600 * drive.model.sample_time})
    c, twin = (made.run(short, Conditions(theta=2.0, delay=1), controller) for controller in ("c", "numpy"))
    for found, wanted in ((c.x, twin.x), (c.duty, twin.duty), (c.status, twin.status), (c.u, twin.u)):
        assert np.array_equal(found, wanted, equal_nan=True)
    assert len(np.unique(c.duty)) > 100


@pytest.mark.parametrize("delay", [0, 1])
@pytest.mark.parametrize("name", ["ipmsm", "ipmsm_flux"])
def test_at_rest_a_wrong_resistance_makes_neither_a_wrong_angle_nor_motion(name: str, delay: int) -> None:
    """Under rated load: not accounted for, it turned the angle by 1.5 degrees, and the rotor crept at 0.4 rad/s."""
    made, drive = simulator(name), load_drive(name)
    hold = standstill(drive, np.random.default_rng(1))
    scenario = replace(hold.scenario, load=rating(drive).torque, duration=1.1)
    for factor in (0.85, 1.15):
        run = made.run(scenario, Conditions(theta=1.0, delay=delay, factors={"R": factor}, supervised=True))
        last = run.t > 0.6
        assert abs(np.mean(run.angle_error[last])) < 1.2
        assert abs(np.mean(run.omega[last])) < 0.12
        assert np.max(np.abs(run.angle_error[last])) < 6.0
