"""The resistance that is learnt at standstill: its loop has the stated bandwidth, and its limit is the drive file's."""

from __future__ import annotations

import numpy as np
import pytest

from model.drives.load import load_drive
from model.loop.injection import injected_voltage
from model.loop.resistance import LEARNING, learning_gain, most_resistance
from model.rating import mtpa_currents, rating
from model.schema import Drive, Tolerance
from tests.conftest import variant

SALIENT = ("ipmsm", "ipmsm_flux", "ipmsm_adaptive", "traction_70kw")


def bandwidth(drive: Drive, most: float) -> float:
    """Angle error and learnt resistance, sample by sample, with no other correction: how they swing, rad/s.

    The ripple comes from the pulse turned to the true axis, divided by that axis' inductances, and turned back.

    Parameters
    ----------
    drive : Drive
    most : float
        A frequency that it may have, rad/s: two and a half of its half periods are looked at.
    """
    m, T, V = drive.motor, drive.model.sample_time, injected_voltage(drive)
    _, i_q = mtpa_currents(drive, rating(drive).current)
    off = 1e-3 * m.stator_resistance
    learnt, delta, found = 0.0, 0.0, []
    for _ in range(round(2.5 * np.pi / (most * T))):
        pulse = V * T / 2 * np.exp(-1j * delta)
        ripple = np.exp(1j * delta) * complex(pulse.real / m.inductance_d, pulse.imag / m.inductance_q)
        learnt -= learning_gain(drive) * V * ripple.imag * i_q
        delta += T * (learnt - off) * i_q / m.magnet_flux
        found.append(learnt - off)
    changes = np.flatnonzero(np.diff(np.sign(found)))
    assert len(changes) == 2
    return float(np.pi / (T * np.diff(changes)[0]))


@pytest.mark.parametrize("name", SALIENT)
def test_the_gain_makes_a_loop_of_the_stated_bandwidth(name: str) -> None:
    drive = load_drive(name)
    stated = LEARNING * drive.control.speed_bandwidth
    assert bandwidth(drive, stated) == pytest.approx(stated, rel=0.02)


@pytest.mark.parametrize("off", [None, 0.05])
@pytest.mark.parametrize("apart", [0.9, 1.02])
@pytest.mark.parametrize("name", ["ipmsm", "ipmsm_flux"])
def test_axes_that_are_hardly_apart_teach_slowly(name: str, apart: float, off: float | None) -> None:
    """By as much as the difference of 1 / L is below what inductances that are off leave of it: 10 % if unstated."""
    shipped = variant(load_drive(name), motor={"inductance_q": apart * load_drive(name).motor.inductance_d})
    drive = shipped.model_copy(update={"tolerance": Tolerance(inductance=off) if off else None})
    share = abs(1 - 1 / apart) / ((off or 0.1) * np.hypot(1, 1 / apart))
    stated = min(1.0, share) * LEARNING * drive.control.speed_bandwidth
    assert bandwidth(drive, stated) == pytest.approx(stated, rel=0.02)


@pytest.mark.parametrize("name", SALIENT)
def test_the_limit_is_what_the_file_states(name: str) -> None:
    drive = load_drive(name)
    assert most_resistance(drive) == pytest.approx(0.2 * drive.motor.stator_resistance)
    assert drive.tolerance is None or most_resistance(
        drive.model_copy(update={"tolerance": drive.tolerance.model_copy(update={"stator_resistance": 0.07})})
    ) == pytest.approx(0.07 * drive.motor.stator_resistance)
