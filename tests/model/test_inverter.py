"""What an inverter takes from a voltage: the numbers, the function of the current, the drive file's words for it."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np
import pytest

from model.drives.load import load_drive, parse_drive
from model.inverter import fading_current, lost_voltage, seeing_current, takes_voltage
from model.loop.controller import Gains, design
from model.machines.state_space import StateSpaceModel, build
from model.schema import Drive, DriveError, Inverter, Tolerance
from runtime.proof.control import gains_of
from runtime.proof.inverter import make_inverter
from runtime.proof.motors import make_motor
from tests.conftest import variant
from tests.model.accepted import ADAPTIVE, MACHINES, draw_drive

pytestmark = pytest.mark.unit


def lossy(adaptive: bool = False, **inverter: Any) -> Drive:
    """The paper's motor with its load torque behind an inverter, V_d a state or not."""
    drive = load_drive("spmsm_load_torque")
    drive = drive.model_copy(update={"inverter": Inverter(**({"dead_time": 2e-6} | inverter))})
    if not adaptive:
        return drive
    f = drive.filter
    tuning = {"initial_covariance": [*f.initial_covariance, 1.0], "process_noise": [*f.process_noise, 1e-6]}
    return variant(drive, model={"adaptive": ["dead_time_voltage"]}, filter=tuning)


def applied(model: StateSpaceModel, name: str, x: Any, u: Any) -> np.ndarray:
    """What the model makes of a commanded voltage."""
    made = ca.vertcat(*model.applied(ca.vertsplit(model.x), ca.vertsplit(model.u))[0][name])
    return np.array(ca.Function("applied", [model.x, model.u], [model.numeric(made)])(x, u)).ravel()


def taken(i: Any, **inverter: Any) -> np.ndarray:
    """g: what is taken of a voltage at a current (2,), in units of V_d."""
    drive = lossy(**inverter)
    return -applied(build(drive), "v", [*i, 0, 0, 0], [0, 0]) / lost_voltage(drive)


def test_what_a_leg_loses_is_dead_time_a_period_and_a_drop() -> None:
    assert lost_voltage(lossy()) == pytest.approx(311.0 * 2e-6 / 100e-6)
    assert lost_voltage(lossy(switching_frequency=20e3)) == pytest.approx(311.0 * 2e-6 * 20e3)
    assert lost_voltage(lossy(switch_drop=1.5)) == pytest.approx(311.0 * 2e-6 / 100e-6 + 1.5)
    assert lost_voltage(load_drive("spmsm_load_torque")) == 0.0


def test_the_signs_fade_below_what_the_sensor_and_the_largest_current_say() -> None:
    assert fading_current(lossy()) == pytest.approx(3 * 0.05)
    quiet = variant(lossy(), filter={"measurement_noise": [1e-6, 1.6e-6]})
    assert fading_current(quiet) == pytest.approx(0.005 * 20.0)
    assert fading_current(load_drive("spmsm_load_torque")) == 0.3, "the paper's constant where nothing is said"
    assert seeing_current(lossy()) == pytest.approx(1.0)


def test_the_fading_that_is_stated_counts_in_model_controller_and_hand_alike() -> None:
    drive = lossy(fading_current=0.7)
    assert fading_current(drive) == design(drive).dead_current == 0.7
    apart = lossy(fading_current=0.7, compensation_current=0.4)
    assert (fading_current(apart), design(apart).dead_current) == (0.7, 0.4)
    assert gains_of(apart.model_dump(), 0)[7] == 0.4
    hand = make_inverter(drive.model_dump())
    assert hand is not None
    for i in ([0.3, -0.2], [2.0, 0.4]):
        np.testing.assert_allclose(taken(i, fading_current=0.7), hand.shortfall(np.array(i)), atol=1e-13)
    np.testing.assert_allclose(taken([0.35, 0.0], fading_current=0.7), [0.5, 0.0], atol=1e-13)
    untold = lossy(dead_time=0.0, fading_current=0.7)
    assert fading_current(untold) == 0.3, "nothing is taken, so nothing fades"
    assert "fading_current" not in lossy().stated["inverter"]
    assert drive.stated["inverter"]["fading_current"] == 0.7


def test_beyond_the_fading_every_leg_counts_whole() -> None:
    """The vector is 4/3 long, points where the legs' signs say, and jumps where a leg's current passes zero."""
    for degrees in np.arange(1.5, 360, 7):
        i = 50 * np.exp(1j * math.radians(degrees))
        g = complex(*taken([i.real, i.imag]))
        legs = [math.copysign(1, (i * np.exp(-2j * math.pi * k / 3)).real) for k in range(3)]
        wanted = 2 / 3 * sum(sign * np.exp(2j * math.pi * k / 3) for k, sign in enumerate(legs))
        assert g == pytest.approx(wanted, abs=1e-12), degrees
        assert abs(g) == pytest.approx(4 / 3)
        assert (g * np.conj(i)).real > 0, "it stands against the current"


def test_about_zero_it_is_the_current_itself() -> None:
    fading = fading_current(lossy())
    for i in ([0.0, 0.0], [0.3 * fading, -0.5 * fading], [-0.7 * fading, 0.1 * fading]):
        np.testing.assert_allclose(taken(i), np.array(i) / fading, atol=1e-13)


def doubtful(**model: Any) -> Drive:
    """Behind an inverter whose V_d is known to a third."""
    return variant(lossy(), model=model).model_copy(update={"tolerance": Tolerance(dead_time=0.3)})


def test_it_is_unsure_by_what_it_lacks_of_its_greatest_length() -> None:
    """And sure to the last bit where every leg carries current enough, as no legs by hand see it otherwise."""
    drive = doubtful()
    model, inverter, fading = build(drive), make_inverter(drive.model_dump()), fading_current(drive)
    assert inverter is not None
    rng, sure = np.random.default_rng(4), 0
    for i in rng.normal(0, 1, (200, 2)) * fading * 10 ** rng.uniform(-2, 2, (200, 1)):
        *g, unsure = applied(model, "g", [*i, 0, 0, 0], [0, 0])
        z, legs = complex(*i), np.exp(2j * math.pi / 3 * np.arange(3))
        whole = bool(np.all(np.abs((z * legs.conj()).real) >= fading))
        assert (unsure == 0) == whole
        assert unsure**2 == pytest.approx(1 - (g[0] ** 2 + g[1] ** 2) * 9 / 16, abs=1e-14)
        assert unsure == pytest.approx(inverter.unsure(i)[0], rel=1e-9, abs=1e-12)
        sure += whole
    assert 20 < sure < 180
    assert applied(model, "g", np.zeros(5), [0, 0])[2] == 1.0


@pytest.mark.parametrize("theta", [0.0, 0.4, -2.0])
def test_what_is_unsure_is_noise_of_the_voltage_alike_on_both_axes(theta: float) -> None:
    """V_d^2 (16/9 - |g|^2) / 2 on each, alike for k samples, whichever way the rotor looks."""
    drive = doubtful(discretization="euler")
    model, per_volt = build(drive), drive.model.sample_time / drive.motor.inductance_d
    assert set(model.G) == {"V_d", "loss_along", "loss_across"}
    at = [0.0, 0.0, 40.0, theta, 0.0], [3.0, -5.0], [0.9, 0.2, math.sqrt(1 - 0.85 * 9 / 16)]
    columns = [model.numeric(model.G[letter][:2]) for letter in ("loss_along", "loss_across")]
    G = np.array(ca.Function("G", model.arguments, [ca.horzcat(*columns)])(*at))
    variance = 2 * 4 * lost_voltage(drive) ** 2 * (16 / 9 - 0.85) / 2
    np.testing.assert_allclose(G @ G.T, per_volt**2 * variance * np.eye(2), rtol=1e-12, atol=1e-15)


def test_it_is_odd_bounded_and_a_number_for_any_current() -> None:
    rng = np.random.default_rng(1)
    for i in rng.normal(0, 1, (50, 2)) * 10 ** rng.uniform(-12, 12, (50, 1)):
        g = taken(i)
        np.testing.assert_allclose(taken(-i), -g, atol=1e-13)
        assert np.hypot(*g) <= 4 / 3 + 1e-12


def test_without_an_inverter_or_with_one_that_takes_nothing_the_model_is_as_it_was() -> None:
    plain, ideal = load_drive("spmsm_load_torque"), lossy(dead_time=0.0)
    for drive in (plain, ideal):
        model = build(drive)
        assert not takes_voltage(drive)
        assert model.lost is None
        assert list(model.inputs) == ["u"]
        assert design(drive).dead_share == 0.0
        assert "dead_share" in Gains.names(drive)
    assert "inverter" not in plain.stated
    assert ideal.stated["inverter"] == {"dead_time": 0.0, "switching_frequency": None, "switch_drop": 0.0}


def test_a_small_current_says_nothing_of_the_voltage_that_is_a_state() -> None:
    """Below a twentieth of the largest current the estimate moves nothing, and f is that of a V_d that is known."""
    drive = lossy(adaptive=True)
    model, seen = build(drive), seeing_current(drive)
    for size, share in ((0.5, 0.0), (1.0, 0.0), (1.2, 0.44), (1.5, 1.0), (10.0, 1.0)):
        x = [size * seen, 0.0, 0.0, 0.0, 0.0, 7.0]
        np.testing.assert_allclose(applied(model, "g", x, [3, 4]), [share * 4 / 3, 0], atol=1e-12)
        np.testing.assert_allclose(applied(model, "v", x, [3, 4]), [3 - (1 - share) * 7 * 4 / 3, 4], atol=1e-12)


def test_at_its_own_voltage_the_state_changes_nothing() -> None:
    known, learnt = build(lossy()), build(lossy(adaptive=True))
    rng = np.random.default_rng(2)
    steps = [ca.Function("f", [m.x, m.u], [m.numeric(m.f_commanded)]) for m in (known, learnt)]
    for size in (0.05, 0.5, 1.2, 10.0):
        x, u = np.array([*rng.normal(0, size, 2), 50.0, 1.0, 3.0]), rng.normal(0, 50, 2)
        one, other = steps[0](x, u), steps[1]([*x, lost_voltage(lossy())], u)
        np.testing.assert_allclose(np.array(other)[:5], np.array(one), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("machine", MACHINES)
@pytest.mark.parametrize("adaptive", ADAPTIVE, ids=["none", "psi", "R and V_d", "all"])
def test_it_is_what_phasors_by_hand_say_on_accepted_motors(machine: str, adaptive: list[str]) -> None:
    rng = np.random.default_rng(3)
    drawn = 0
    for _ in range(12):
        drive = draw_drive(rng, machine, "load_torque", "exact", adaptive)
        model, hand, inverter = build(drive), make_motor(drive.model_dump()), make_inverter(drive.model_dump())
        assert (inverter is None) == (model.lost is None) == (not takes_voltage(drive))
        if inverter is None:
            continue
        drawn += 1
        for size in (1e-3, 0.3, 1.0, 3.0, 1e3):
            i, theta = rng.normal(0, 1, 2) * size * fading_current(drive), rng.uniform(-3, 3)
            z = i if machine != "salient_flux" else _flux(drive, i, theta)
            own = [lost_voltage(drive) * rng.uniform(0.5, 2) if word.startswith("dead") else 1.0 for word in adaptive]
            x, u = np.array([*z, 1.0, theta, 0.0, *own]), rng.normal(0, 100, 2)
            i = hand.h(x)
            shown = inverter.shown(i)
            off = inverter.voltage(x) * inverter.shortfall(i)
            volts = np.abs(u).max() + float(np.max(np.abs(off)))
            blurred = 1e-9 if machine == "salient_flux" else 1e-12  # a current is what is left of two flux linkages
            if "g" in model.inputs:
                np.testing.assert_allclose(applied(model, "g", x, u), shown * inverter.shortfall(i), atol=blurred)
                off = (1 - shown) * off
            np.testing.assert_allclose(applied(model, "v", x, u), u - off, atol=blurred * volts)
    assert drawn >= 4


def _flux(drive: Drive, i: np.ndarray, theta: float) -> np.ndarray:
    m = drive.motor
    i_dq = complex(*i) * np.exp(-1j * theta)
    psi_m = 1.0 if "magnet_flux" in drive.model.adaptive else m.magnet_flux
    psi = (psi_m + m.inductance_d * i_dq.real + 1j * m.inductance_q * i_dq.imag) * np.exp(1j * theta)
    return np.array([psi.real, psi.imag])


@pytest.mark.parametrize(
    ("section", "said"),
    [
        ({"dead_time": 2.0}, r"inverter.dead_time = 2.0 s is outside 0 .. 0.0001 s.* Did you mean 2 us = 2e-06"),
        ({"dead_time": -1e-6}, "inverter.dead_time = -1e-06 s is outside"),
        ({"deadtime": 1e-6}, "unknown key inverter.deadtime. Did you mean .dead_time"),
        ({"switch_drop": 50.0}, "inverter.switch_drop = 50.0 V is outside 0 .. 20 V"),
        ({"fading_current": 2e5}, "inverter.fading_current = 200000.0 A is outside 1e-05 .. 100000 A"),
        ({"switching_frequency": 10.0}, r"inverter.switching_frequency = 10.0 Hz is outside 100 .. 1e\+06 Hz"),
        ({"dead_time": 3e-5}, "more than a quarter of a switching period at 10000 Hz"),
        ({"dead_time": 2e-6, "switching_frequency": 2e5}, "more than a quarter of a switching period at 200000 Hz"),
    ],
)
def test_a_wrong_inverter_is_one_line(section: dict[str, Any], said: str) -> None:
    data = load_drive("spmsm_load_torque").model_dump(exclude={"sha256", "machine_text"})
    with pytest.raises(DriveError, match=said):
        parse_drive({**data, "inverter": section}, "mine.toml")


def test_a_drive_file_says_it() -> None:
    data = load_drive("spmsm_load_torque").model_dump(exclude={"sha256", "machine_text"})
    drive = parse_drive({**data, "inverter": {"dead_time": 1e-6, "switch_drop": 0.8}}, "mine.toml")
    assert drive.inverter == Inverter(dead_time=1e-6, switch_drop=0.8)
    assert drive.switching_frequency == pytest.approx(10e3)
