"""The task of a drive suits its motor, whatever the motor; formulas against the controller's and a search."""

from __future__ import annotations

import math

import numpy as np
import pytest

from model.drives.load import load_drive, shipped_drives
from model.rating import base_speed, mtpa_current, mtpa_currents, mtpa_torque, rating, sensor_noise
from model.schema import Drive, Rated
from tests.model.accepted import MACHINES, draw_drive

pytestmark = pytest.mark.unit

DRAWS = 400


def drawn(seed: int) -> Drive:
    rng = np.random.default_rng(seed)
    return draw_drive(rng, str(rng.choice(MACHINES)), "load_torque", "exact", [])


@pytest.mark.parametrize("name", [name for name in shipped_drives() if load_drive(name).rated is None])
def test_shipped_drives_keep_the_usual_task(name: str) -> None:
    task = rating(load_drive(name))
    assert task.speed * 30 / math.pi == pytest.approx(1000.0)
    assert task.torque == 5.0
    assert task.ramp(load_drive(name).motor.inertia, 0.15) == 0.15


def test_a_stated_task_is_taken() -> None:
    drive = load_drive("ipmsm").model_copy(update={"rated": Rated(speed=33.0, torque=1.25)})
    task = rating(drive)
    assert (task.speed, task.torque) == (33.0, 1.25)
    assert mtpa_torque(drive, task.current) == pytest.approx(1.25, rel=1e-12)


def test_no_other_angle_of_the_current_makes_more_torque() -> None:
    """Against a search over the circle, for motors of either saliency."""
    angles = np.linspace(0.0, math.pi, 20_001)
    for seed in range(DRAWS):
        drive = drawn(seed)
        m, current = drive.motor, drive.control.max_current
        i_d, i_q = current * np.cos(angles), current * np.sin(angles)
        best = np.max(1.5 * m.pole_pairs * (m.magnet_flux + (m.inductance_d - m.inductance_q) * i_d) * i_q)
        assert mtpa_torque(drive, current) == pytest.approx(best, rel=1e-7)
        assert math.hypot(*mtpa_currents(drive, current)) == pytest.approx(current, rel=1e-12)


def test_the_current_of_a_torque_makes_it() -> None:
    for seed in range(DRAWS):
        drive = drawn(seed)
        torque = mtpa_torque(drive, drive.control.max_current) * np.random.default_rng(seed).uniform(1e-6, 1.0)
        assert mtpa_torque(drive, mtpa_current(drive, torque)) == pytest.approx(torque, rel=1e-9)
    assert mtpa_current(load_drive("ipmsm"), 0.0) == 0.0


def test_base_speed_takes_the_whole_voltage() -> None:
    """By the steady voltage equations on the d and q axis, complex: R i + j omega_e psi."""
    for seed in range(DRAWS):
        drive = drawn(seed)
        m, task = drive.motor, rating(drive)
        omega = base_speed(drive, task.current)
        i = complex(*mtpa_currents(drive, task.current))
        psi = m.magnet_flux + m.inductance_d * i.real + 1j * m.inductance_q * i.imag
        volts = abs(m.stator_resistance * i + 1j * m.pole_pairs * omega * psi)
        assert volts == pytest.approx(drive.control.dc_link / math.sqrt(3), rel=1e-6)
    drive = load_drive("ipmsm")
    assert base_speed(drive, 1.001 * drive.control.dc_link / math.sqrt(3) / drive.motor.stator_resistance) == 0.0


def test_every_accepted_drive_has_a_task_within_its_limits() -> None:
    for seed in range(DRAWS):
        drive = drawn(seed)
        task, box = rating(drive), drive.operating_box
        assert 0.0 < task.speed <= min(0.8 * box.speed, 0.8001 * task.base_speed)
        assert task.speed * drive.motor.pole_pairs * drive.model.sample_time <= 0.3301
        assert 0.0 < task.torque <= min(0.8 * box.load_torque, 0.5001 * task.largest_torque)
        assert task.current <= min(drive.control.max_current, 0.8 * box.current)
        assert drive.motor.friction * task.speed <= 0.3001 * task.largest_torque


def test_sensor_noise_is_the_usual_one_or_less() -> None:
    drive = load_drive("paper_spmsm")  # tuned for 0.1 A
    assert sensor_noise(drive.filter.measurement_noise) == 0.05
    assert sensor_noise([1e-6, 2e-6]) == pytest.approx(1e-3)
