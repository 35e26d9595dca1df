"""The proof's trajectory: exact for any motor, within reach of its inverter, of a size that suits it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from codegen.evidence.box import held, sample_box
from codegen.generate import generate_bare
from codegen.output.folder import write_folder
from model.drives.load import load_drive, shipped_drives
from model.machines.state_space import build
from model.rating import inverter_voltage, rating
from model.schema import Drive
from runtime.proof.own_trajectory import motion_of, trajectory_of
from runtime.proof.trajectory import Motion, locus
from tests.conftest import variant
from tests.model.accepted import MACHINES, draw_drive
from tests.runtime.test_proof import _prover

#: A motor whose magnets are so weak that 5 N m on them alone would take 358 A, where the box ends at 30 A.
WEAK_MAGNETS = {"stator_resistance": 0.0173, "magnet_flux": 0.0031}


def drawn(seed: int) -> Drive:
    rng = np.random.default_rng(seed)
    return draw_drive(rng, str(rng.choice(MACHINES)), "load_torque", "exact", [])


def test_motion_obeys_the_mechanics() -> None:
    """Integrated another way: J domega/dt = T_e - T_L - D omega, by an adaptive method."""
    motion, J, D = Motion(80.0, 3.0, ramp=0.1, load_at=0.15, lag=2e-3, bandwidth=45.0), 0.01, 0.02
    t = np.linspace(0.0, 0.3, 601)
    omega, turned, torque = motion.at(t, J, D)

    def slope(now: float, state: np.ndarray) -> list[float]:
        load = motion.load if now >= motion.load_at else 0.0
        return [(np.interp(now, t, torque) - load - D * state[0]) / J, state[0]]

    first = solve_ivp(slope, (0.0, 0.15), [0.0, 0.0], rtol=1e-9, atol=1e-9, max_step=1e-3)
    second = solve_ivp(slope, (0.15, 0.3), first.y[:, -1], rtol=1e-9, atol=1e-9, max_step=1e-3)
    assert first.y[0, -1] == pytest.approx(omega[300], rel=1e-4)
    assert second.y[:, -1] == pytest.approx([omega[-1], turned[-1]], rel=1e-4)
    around = np.ravel([[at - 1e-9, at + 1e-9] for at in (0.1, 0.15)])
    before, after = motion.at(around, J, D)[2].reshape(2, 2).T
    np.testing.assert_allclose(before, after, atol=1e-5)  # no jump
    assert omega[-1] == pytest.approx(80.0, rel=0.05)


@pytest.mark.parametrize("name", shipped_drives())
def test_shipped_drives_go_to_their_rated_speed_and_load(name: str) -> None:
    drive = load_drive(name)
    motion, task = motion_of(drive), rating(drive)
    assert motion.load == task.torque
    assert 0.85 * task.speed <= motion.speed <= task.speed  # the traction machine's voltage ends before its speed
    assert motion.speed == task.speed or name == "traction_70kw"


@pytest.mark.parametrize("seed", range(25))
def test_trajectory_of_any_accepted_motor_is_within_reach(seed: int) -> None:
    drive = drawn(seed)
    data = trajectory_of(drive)
    assert all(np.isfinite(values).all() for values in (data.u, data.y, data.omega, data.theta, data.psi))
    assert np.hypot(*data.u.T).max() <= inverter_voltage(drive) * (1 + 1e-12)
    assert np.hypot(*data.y.T).max() <= drive.operating_box.current + 10 * 0.05
    assert np.abs(data.omega).max() <= drive.operating_box.speed


@pytest.mark.parametrize("seed", range(20))
def test_voltage_is_the_mean_over_each_interval(seed: int) -> None:
    """The voltage equation in the stator's frame, summed up: flux at the end less flux at the start, less the drop.

    Of an ideal inverter: what one takes is in the voltage commanded (tests/runtime/test_inverter.py).
    """
    drive = drawn(seed).model_copy(update={"inverter": None})
    data = trajectory_of(drive, noise=0.0)
    m, T = drive.motor, drive.model.sample_time
    turn = np.exp(1j * data.theta)
    i = (data.y[:, 0] + 1j * data.y[:, 1]) / turn
    psi = (m.magnet_flux + m.inductance_d * i.real + 1j * m.inductance_q * i.imag) * turn
    np.testing.assert_allclose(data.psi[:, 0] + 1j * data.psi[:, 1], psi, atol=1e-9 * np.abs(psi).max())
    ends = data.y @ [1, 1j]
    drop = data.u[1:] @ [1, 1j] - np.diff(psi) / T  # the mean over the interval; by the trapezoid for comparison
    bend = np.abs(np.diff(ends, 2, append=ends[-1])).max()
    allowed = m.stator_resistance * bend + 1e-9 * np.abs(psi).max() / T
    np.testing.assert_allclose(drop, m.stator_resistance * (ends[1:] + ends[:-1]) / 2, atol=allowed)


def test_currents_make_the_torque_on_the_curve_of_least_current() -> None:
    for seed in range(60):
        m = drawn(seed).motor
        torque = np.linspace(-1.0, 1.0, 301) * 1.5 * m.pole_pairs * m.magnet_flux * 7.0
        i_d, i_q = locus(m.model_dump(), torque)
        gain, saliency = 1.5 * m.pole_pairs, m.inductance_d - m.inductance_q
        np.testing.assert_allclose(gain * (m.magnet_flux + saliency * i_d) * i_q, torque, atol=1e-9 * torque.max())
        around = np.hypot(i_d, i_q)[:, None] * np.linspace(0.97, 1.03, 61)  # i_d elsewhere: no less current makes it
        other = i_d[:, None] + np.linspace(-0.3, 0.3, 61) * np.abs(around).max()
        carrying = m.magnet_flux + saliency * other
        needed = np.hypot(other, torque[:, None] / (gain * np.where(carrying > 0, carrying, np.nan)))
        assert np.nanmin(needed - np.hypot(i_d, i_q)[:, None]) >= -1e-5 * np.abs(around).max()


def test_weak_magnets_meet_a_load_that_they_can_carry() -> None:
    drive = variant(load_drive("ipmsm"), motor=WEAK_MAGNETS)
    motion = motion_of(drive)
    assert 0.5 < motion.load < 2.0
    assert motion.speed > 10.0
    faster = trajectory_of(drive, 100, motion=replace(motion, speed=2 * motion.speed))
    assert faster.omega[-1] == pytest.approx(2 * trajectory_of(drive, 100).omega[-1], rel=1e-9)


@pytest.mark.slow
def test_weak_magnets_are_proved(tmp_path: Path) -> None:
    """The whole trajectory, stage by stage: where it asked for 358 A inputs were rejected and nothing agreed."""
    drive = variant(load_drive("ipmsm"), motor=WEAK_MAGNETS, filter={"kinds": ["ekf"]})
    package = generate_bare(drive)
    write_folder(tmp_path / drive.name, package.files)
    prover = _prover(drive, package, tmp_path / drive.name)
    prover.trajectory = trajectory_of(drive, 2400)
    for link in prover.along_trajectory("ekf"):
        assert link.passed, str(link.divergence)


def test_samples_of_the_box_are_within_limits_that_float32_does_not_hold() -> None:
    """10.1 A and 71.3 V have no float32; a sample rounded above them would be one to reject."""
    drive = variant(load_drive("spmsm_load_torque"), operating_box={"current": 10.1, "voltage": 71.3})
    box = sample_box(drive, build(drive), 3000)
    assert np.abs(box.y).max() == held(10.1) < 10.1
    assert np.abs(box.u).max() <= held(71.3) < 71.3
    assert held(100.0) == 100.0
