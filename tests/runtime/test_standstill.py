"""Standstill under load: salient drives hold it, motor data off; round rotors do what is promised of them."""

from __future__ import annotations

import numpy as np
import pytest

from model.drives.load import load_drive
from model.rating import rating
from runtime.estimator.folder import find_folder
from runtime.faults.standstill import STANDSTILL, standstill
from runtime.faults.starts import survey_starts
from tests.conftest import EVERY_DRIVE, thoroughly

#: Degrees electrical, and the share of runs that may be beyond or lost, of salient drives that do not hold what is
#: asked. Of 500 runs 6 of ipmsm are beyond 10 degrees, 4 and 7 of ipmsm_flux (CKF, ICKF), 4 and 8 of ipmsm_adaptive,
#: at worst 11.8, 13.0 and 25.6 degrees. A few runs may have more of them.
WORST = {"ipmsm": (14.0, 0.05), "ipmsm_adaptive": (30.0, 0.05), "ipmsm_flux": (14.0, 0.05)}


@pytest.mark.parametrize("name", EVERY_DRIVE)
@pytest.mark.parametrize("runs", [6, *thoroughly(60)])
def test_standstill_is_as_promised(name: str, runs: int) -> None:
    angle, beyond = WORST.get(name, (10.0, 0.0))
    for item in survey_starts([find_folder(name)], None, [STANDSTILL], runs):
        lost = [k for k, run in enumerate(item.runs, start=1) if not run.locked]
        assert len(lost) <= np.ceil(beyond * runs), lost
        assert all(run.angle <= angle for run in item.runs if run.angle == run.angle)


@pytest.mark.parametrize("name", ["traction_70kw", "ipmsm", "servo_24v", "paper_spmsm"])
def test_what_is_drawn(name: str) -> None:
    drive, rng = load_drive(name), np.random.default_rng(1)
    task, shown = rating(drive), drive.motor.inductance_d != drive.motor.inductance_q
    drawn = [standstill(drive, rng) for _ in range(400)]
    loads = [hold.scenario.load / task.torque for hold in drawn]
    assert -1.0 <= min(loads) < -0.95
    assert 0.95 < max(loads) <= 1.0
    assert {np.sign(hold.scenario.speed) for hold in drawn} == {1.0, -1.0}
    assert max(abs(hold.motor.angle) for hold in drawn) > 3.0
    widths = {key: max(abs(hold.motor.factors[key] - 1.0) for hold in drawn) for key in ("R", "L_d", "L_q")}
    stated = drive.tolerance.stator_resistance if drive.tolerance else 0.0
    assert widths["R"] == pytest.approx(0.2 if shown else stated, rel=0.05)
    assert not shown or (widths["L_d"], widths["L_q"]) == pytest.approx((0.1, 0.1), rel=0.05)
    assert all(shown or hold.motor.factors["L_d"] == hold.motor.factors["L_q"] for hold in drawn)
    assert {(hold.shown, hold.rival) for hold in drawn} == {(shown, name != "paper_spmsm")}


def test_the_scenario() -> None:
    hold = standstill(load_drive("ipmsm"), np.random.default_rng(1))
    scenario, (begin, end) = hold.scenario, hold.held
    t = np.linspace(0.0, scenario.duration, 100001)
    speed, load = scenario.speed_reference(t) / hold.speed * np.sign(scenario.speed), scenario.load_torque(t)
    rest = (t > begin - 0.1) & (t < end)
    assert not np.any(speed[rest])
    assert speed[t < begin].max() == pytest.approx(0.2)
    assert speed[-1] == pytest.approx(1.0)
    assert np.all(load[(t >= begin)] == scenario.load)
    assert not np.any(load[t < begin - 0.05])
    assert end - begin > 0.5
    assert scenario.duration - end - scenario.ramp == pytest.approx(0.4)
