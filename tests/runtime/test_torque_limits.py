"""The largest torque and the largest power that a drive file may state: proved, kept, and absent where not stated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from codegen.generate import generate_bare
from codegen.output.folder import write_folder
from model.drives.load import cautions, load_drive
from model.loop.controller import Gains
from model.rating import mtpa_torque, rating
from model.schema import Drive
from runtime.drive.scenario import Scenario
from runtime.drive.simulation import Conditions, Simulator
from runtime.estimator.folder import GeneratedFolder
from runtime.proof.link_drive import link_drive
from runtime.proof.link_foc import link_control
from runtime.proof.link_modes import link_modes
from runtime.proof.second import second_motor
from tests.conftest import thoroughly, variant

RPM = 30.0 / np.pi

#: Shares of the rated torque and power; None: not stated. At the rated point the power is what limits, at rest torque.
STATED = [
    pytest.param("ipmsm", 1.5, 1.1, id="both"),
    pytest.param("spmsm_load_torque", None, 1.2, id="power"),
    *thoroughly(("ipmsm_flux", 1.5, None), ("spmsm_adaptive", None, 1.2), ("hub_36v", 1.2, 1.05)),
]


def limited(name: str, torque: float | None, power: float | None) -> Drive:
    drive = load_drive(name)
    task, limits = rating(drive), dict[str, float]()
    if torque is not None:
        limits["max_torque"] = torque * task.torque
    if power is not None:
        limits["max_power"] = power * task.torque * task.speed
    return variant(drive, control=limits, filter={"kinds": ["ckf"]})


def written(drive: Drive, folder: Path) -> GeneratedFolder:
    write_folder(folder / drive.name, generate_bare(drive).files)
    return GeneratedFolder(folder / drive.name, checked=False)


@pytest.mark.parametrize(("name", "torque", "power"), STATED)
def test_the_links_hold(name: str, torque: float | None, power: float | None, tmp_path: Path) -> None:
    drive = limited(name, torque, power)
    folder, motor, data = written(drive, tmp_path), second_motor(drive), drive.model_dump()
    links = link_control(folder, "ckf", "cubature", data, motor)
    links += [link_modes(folder, "ckf", "cubature", data, motor)] if torque is not None else []  # a start's window
    links += link_drive(folder, "ckf", "cubature", data, (20, 40))
    for link in links:
        assert link.passed, (link.claim, [str(row) for row in link.rows if not row.passed])


@pytest.mark.parametrize(("name", "torque", "power"), STATED)
def test_torque_and_power_stay_within(name: str, torque: float | None, power: float | None, tmp_path: Path) -> None:
    """A run-up that asks for all, with and against the limit: both are reached, and neither is passed."""
    drive = limited(name, torque, power)
    task, c = rating(load_drive(name)), drive.control
    duration = 3 * rating(drive).ramp(drive.motor.inertia, 0.05)
    asked = Scenario("jump", speed=task.speed * RPM, ramp=1e-3, duration=duration)
    run = Simulator(written(drive, tmp_path), "ckf").run(asked, Conditions(sensored=True, noise=0.0))
    settled = run.t > 10 / c.current_bandwidth
    made, speed = run.torque[settled], run.omega[settled]
    late = round(1 / c.current_bandwidth / drive.model.sample_time)  # by so much torque follows what is asked for
    if c.max_torque is not None:
        assert np.max(made) == pytest.approx(c.max_torque, rel=0.03)
    else:
        assert np.max(made) > 0.9 * min(mtpa_torque(drive, c.max_current), (c.max_power or np.inf) / task.speed)
    if c.max_power is not None:
        assert np.max(made[late:] * speed[:-late]) == pytest.approx(c.max_power, rel=0.03)
    free = Simulator(written(variant(load_drive(name), filter={"kinds": ["ckf"]}), tmp_path / "free"), "ckf")
    without = free.run(asked, Conditions(sensored=True, noise=0.0))
    assert np.max(without.torque * without.omega) > 1.2 * np.max(made * speed)


def test_a_file_that_states_none_has_none() -> None:
    drive = load_drive("ipmsm")
    assert Gains.names(drive)[-1] == "weakening"
    assert "max_torque" not in drive.stated["control"]
    assert Gains.names(limited("ipmsm", None, 1.1))[-1] == "max_power"
    assert Gains.names(limited("ipmsm", 1.5, 1.1))[-2:] == ["max_torque", "max_power"]


def test_the_task_is_within_the_limits() -> None:
    """A drive that states no task gets one that its limits allow; one that states more than they allow is told."""
    free = load_drive("paper_spmsm")
    assert free.rated is None
    usual = rating(free)
    small = variant(free, control={"max_torque": 0.5 * usual.torque, "max_power": 0.1 * usual.torque * usual.speed})
    task = rating(small)
    assert task.torque <= task.largest_torque <= 0.1 * usual.torque * usual.speed / task.speed * (1 + 1e-12)
    assert not cautions(limited("hub_36v", 1.2, 1.05))
    torque, power = cautions(limited("hub_36v", 0.9, 0.8))
    assert "rated.torque = 9 N m is beyond control.max_torque = 8.1 N m" in torque
    assert "is beyond control.max_power" in power
