"""Field weakening: what its equations promise, of motors drawn over all that is accepted; the drive beyond it."""

from __future__ import annotations

import math
from functools import cache
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from model.drives.load import load_drive
from model.filters.program import BlockBuilder
from model.loop.controller import design
from model.loop.references import Reach, current_reference, within_reach
from model.loop.weakening import DEEPEST, ROOM, room_left
from model.quantities import Constants
from runtime.drive.scenario import find_scenario
from runtime.drive.simulation import Conditions, Run, Simulator
from runtime.estimator.folder import GENERATED, GeneratedFolder
from tests.conftest import thoroughly
from tests.model.test_controller import draw, motor_of

DRAWS = 300


def references(motor: Any, torque_share: float, z: float, omega_e: float) -> dict[str, float]:
    """Of one motor: the torque limit, D, and the reference currents at a share of that limit."""
    b, constants = BlockBuilder("b", ""), Constants(named=False)
    drive: Any = SimpleNamespace(motor=motor)
    reach: Reach = within_reach(b, drive, constants, ca.SX(motor.max_current), ca.SX(z), ca.SX(omega_e))
    i_d, i_q = current_reference(b, drive, constants, torque_share * reach.torque, reach)
    names = ("limit", "D", "i_d", "i_q")
    return {name: float(value) for name, value in zip(names, (reach.torque, reach.deepest, i_d, i_q), strict=True)}


@pytest.fixture(scope="module")
def drawn() -> list[tuple[Any, float, float, float]]:
    """Motor, share of the torque limit, z (A), electrical speed (rad/s): z down to where it is held."""
    rng = np.random.default_rng(3)
    motors, made = draw(rng, DRAWS), []
    for k in range(DRAWS):
        m = motor_of(motors, k)
        corner = m.stator_resistance / m.inductance_d
        omega_e = float(corner * 10 ** rng.uniform(-3, 4) * rng.choice([-1, 1]))
        made.append((m, float(rng.uniform(-1, 1)), float(-1.95 * m.max_current * rng.random() ** 2), omega_e))
    return made


def test_both_currents_stay_within_the_largest_and_make_no_more_than_is_left(drawn: Any) -> None:
    deep = 0
    for m, share, z, omega_e in drawn:
        found = references(m, share, z, omega_e)
        assert math.hypot(found["i_d"], found["i_q"]) <= 1.003 * m.max_current * (1 + 1e-9)
        assert found["i_d"] >= -found["D"] * (1 + 1e-12)
        assert 0 <= found["limit"] <= references(m, share, 0.0, omega_e)["limit"] * (1 + 1e-12)
        deep += found["i_d"] < -0.5 * m.max_current
    assert deep > DRAWS / 20


def test_a_round_rotors_field_is_weakened_no_further_than_its_voltage_falls(drawn: Any) -> None:
    """Every ampere up to D takes voltage off the terminals of a motor without torque; one more would add to it."""
    ends = 0
    for m, _, _, omega_e in drawn:
        D = references(m, 0.0, 0.0, omega_e)["D"]

        def volts(i_d: Any, m: Any = m, omega_e: float = omega_e) -> Any:
            return np.abs(m.stator_resistance * i_d + 1j * omega_e * (m.magnet_flux + m.inductance_d * i_d))

        if m.inductance_q < m.inductance_d:  # reluctance goes further only where L_q is the larger
            along = volts(-D * np.linspace(0, 1, 50))
            assert np.all(np.diff(along) <= 1e-9 * along[0])
            if DEEPEST * m.max_current * (1 - 1e-9) > D:
                ends += 1
                assert volts(-1.01 * D) >= volts(-D) * (1 - 1e-9)
    assert ends > DRAWS / 20


def test_without_a_need_it_is_as_it_was_to_the_last_digit(drawn: Any) -> None:
    """z of 0: D and speed are of no consequence."""
    for m, share, _, omega_e in drawn:
        fast, still = references(m, share, 0.0, omega_e), references(m, share, 0.0, 0.0)
        assert {key: fast[key] for key in ("limit", "i_d", "i_q")} == {
            key: still[key] for key in ("limit", "i_d", "i_q")
        }


@pytest.mark.parametrize(
    ("v", "z", "falls"), [(0.0, -1.0, False), (0.9, -1.0, False), (1.0, 0.0, True), (50.0, -3.45, True)]
)
def test_the_integrator_goes_by_what_the_regulators_ask(v: float, z: float, falls: bool) -> None:
    """``v`` in units of the largest voltage."""
    drive = load_drive("ipmsm")
    V, gain = drive.control.dc_link / math.sqrt(3), design(drive).weakening
    found = room_left(
        Constants(named=False), gain, drive.control.dc_link, ca.SX(0.6 * v * V), ca.SX(0.8 * v * V), ca.SX(z), 3.5
    )
    after = float(found["integral_weakening_next"])
    wanted = z + gain * max((ROOM * V) ** 2 - (v * V) ** 2, -((ROOM * V) ** 2))
    assert after == pytest.approx(min(0.0, max(-3.5, wanted)))
    assert (after < z) == falls
    nothing = room_left(Constants(named=False), gain, 540.0, ca.SX(math.nan), ca.SX(0.0), ca.SX(z), 3.5)
    assert float(nothing["integral_weakening_next"]) == pytest.approx(max(-3.5, z - gain * (ROOM * V) ** 2))


# --- the drive


@cache
def simulator(name: str) -> Simulator:
    return Simulator(GeneratedFolder(GENERATED / name), load_drive(name).filter.kinds[0])


def to(name: str, speed: float, load: float, **conditions: Any) -> Run:
    scenario = find_scenario("load_step", load_drive(name), speed=speed, load=load)
    return simulator(name).run(scenario, Conditions(**conditions))


BEYOND = [("ipmsm", 3000.0, 3.0), *thoroughly(("ipmsm_flux", 3000.0, 3.0), ("traction_70kw", 9000.0, 60.0))]


@pytest.mark.slow
@pytest.mark.parametrize("inverter", ["averaged", "pwm"])
@pytest.mark.parametrize(("name", "speed", "load"), BEYOND)
def test_beyond_base_speed(name: str, speed: float, load: float, inverter: str) -> None:
    """Either way, the current within its limit: a regulator's overshoot and the sensors' noise more.

    The voltage commanded is the room that is left, and what dead time takes.
    """
    for sign in (1, -1):
        run = to(name, sign * speed, sign * load, inverter=inverter)
        assert run.good, run.verdict
        most = float(np.max(np.hypot(*run.i.T)))
        assert most <= 1.05 * load_drive(name).control.max_current
        room = ROOM * load_drive(name).control.dc_link / math.sqrt(3)
        assert np.mean(np.hypot(*run.u[run.late].T)) == pytest.approx(room, rel=0.05)


@pytest.mark.slow
def test_what_cannot_be_reached_is_not_lost() -> None:
    """The surface motor has 2500 r/min at most: R times the current that would take it further is all the voltage."""
    run = to("spmsm_load_torque", 3500.0, 1.0)
    assert run.locked
    assert not run.reached
    assert 2300 < run.omega[-1] * 30 / math.pi < 2500
