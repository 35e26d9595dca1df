"""The resistance that is learnt at standstill: its loop has the stated bandwidth, and its limit is the drive file's."""

from __future__ import annotations

import numpy as np
import pytest

from model.drives.load import load_drive
from model.loop.injection import injected_voltage
from model.loop.resistance import LEARNING, learning_gain, most_resistance
from model.rating import mtpa_currents, rating

SALIENT = ("ipmsm", "ipmsm_flux", "ipmsm_adaptive", "traction_70kw")


@pytest.mark.parametrize("name", SALIENT)
def test_the_gain_makes_a_loop_of_the_stated_bandwidth(name: str) -> None:
    """Angle error and learnt resistance, sample by sample, with no other correction: they swing at that frequency.

    The ripple comes from the pulse turned to the true axis, divided by that axis' inductances, and turned back.
    """
    drive = load_drive(name)
    m, T, V = drive.motor, drive.model.sample_time, injected_voltage(drive)
    _, i_q = mtpa_currents(drive, rating(drive).current)
    off = 1e-3 * m.stator_resistance
    learnt, delta, found = 0.0, 0.0, []
    for _ in range(round(2.5 * np.pi / (LEARNING * drive.control.speed_bandwidth * T))):
        pulse = V * T / 2 * np.exp(-1j * delta)
        ripple = np.exp(1j * delta) * complex(pulse.real / m.inductance_d, pulse.imag / m.inductance_q)
        learnt -= learning_gain(drive) * V * ripple.imag * i_q
        delta += T * (learnt - off) * i_q / m.magnet_flux
        found.append(learnt - off)
    changes = np.flatnonzero(np.diff(np.sign(found)))
    assert len(changes) == 2
    assert np.pi / (T * np.diff(changes)[0]) == pytest.approx(LEARNING * drive.control.speed_bandwidth, rel=0.02)


@pytest.mark.parametrize("name", SALIENT)
def test_the_limit_is_what_the_file_states(name: str) -> None:
    drive = load_drive(name)
    assert most_resistance(drive) == pytest.approx(0.2 * drive.motor.stator_resistance)
    assert drive.tolerance is None or most_resistance(
        drive.model_copy(update={"tolerance": drive.tolerance.model_copy(update={"stator_resistance": 0.07})})
    ) == pytest.approx(0.07 * drive.motor.stator_resistance)
