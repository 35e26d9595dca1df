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


def best_within(m: Any, omega_e: float, volts: float) -> float:
    """The largest torque, N m, of all that current and voltage allow: a grid, then finer ones about the best."""
    centre, size, best = np.zeros(2), m.max_current, 0.0
    for _ in range(10):
        i_d, i_q = np.meshgrid(*(np.linspace(at - size, at + size, 121) for at in centre), indexing="ij")
        drop = m.stator_resistance * (i_d + 1j * i_q)
        v = drop + 1j * omega_e * (m.magnet_flux + m.inductance_d * i_d + 1j * m.inductance_q * i_q)
        allowed = (np.hypot(i_d, i_q) <= m.max_current) & (np.abs(v) <= volts)
        reluctance = (m.inductance_d - m.inductance_q) * i_d
        torque = np.where(allowed, 1.5 * m.pole_pairs * (m.magnet_flux + reluctance) * i_q, -np.inf)
        at = np.unravel_index(np.argmax(torque), torque.shape)
        best, centre, size = float(torque[at]), np.array([i_d[at], i_q[at]]), 0.3 * size
    return best


def left_by_weakening(m: Any, omega_e: float, volts: float) -> tuple[float, float]:
    """Torque, N m, and d current, A, where the weakening settles: the regulators ask for the voltage that is there."""
    z, asked = [ca.SX.sym(name) for name in ("z", "asked")]
    b, constants = BlockBuilder("b", ""), Constants(named=False)
    drive: Any = SimpleNamespace(motor=m)
    reach = within_reach(b, drive, constants, ca.SX(m.max_current), z, ca.SX(omega_e))
    makes = ca.Function("makes", [z, asked], current_reference(b, drive, constants, asked * reach.torque, reach))
    tried = np.linspace(0.0, -1.95 * m.max_current, 4001)
    i_d, i_q = (np.array(values).ravel() for values in makes.map(len(tried))(tried, np.ones(len(tried))))
    v = m.stator_resistance * (i_d + 1j * i_q) + 1j * omega_e * (
        m.magnet_flux + m.inductance_d * i_d + 1j * m.inductance_q * i_q
    )
    k = int(np.argmax(np.abs(v) <= volts))
    assert abs(v[k]) <= volts, "with z at its limit the voltage suffices"
    return 1.5 * m.pole_pairs * (m.magnet_flux + (m.inductance_d - m.inductance_q) * i_d[k]) * i_q[k], i_d[k]


def beyond_the_circle(rng: np.random.Generator, ratio: float, fastest: float) -> tuple[Any, float, float]:
    """A motor whose field can be cancelled, psi_m / L_d < I, its speed beyond base speed (rad/s), and its voltage."""
    most, L_d = float(10 ** rng.uniform(0, 2.5)), float(10 ** rng.uniform(-4.5, -2))
    volts, psi = float(10 ** rng.uniform(1, 2.8)), float(rng.uniform(0.2, 0.9)) * most * L_d
    m = SimpleNamespace(
        pole_pairs=int(rng.integers(1, 12)),
        inductance_d=L_d,
        inductance_q=ratio * L_d,
        magnet_flux=psi,
        stator_resistance=float(rng.uniform(0, 0.1)) * volts / most,
        max_current=most,
    )
    return m, float(rng.uniform(1.2, fastest)) * volts / math.hypot(psi, m.inductance_q * most), volts


def test_a_round_rotor_makes_all_torque_that_voltage_and_current_allow() -> None:
    """Maximum torque per volt: where psi_m / L_d < I, speed has no end, and no other currents make more torque."""
    rng, bound, shares = np.random.default_rng(11), 0, []
    for _ in range(60):
        m, omega_e, volts = beyond_the_circle(rng, 1.0, 10.0)
        made, i_d = left_by_weakening(m, omega_e, volts)
        shares.append(made / best_within(m, omega_e, volts))
        corner = (m.stator_resistance / m.inductance_d) ** 2
        bound += i_d == pytest.approx(-m.magnet_flux / m.inductance_d * omega_e**2 / (omega_e**2 + corner))
    assert bound > 30, "it is the bound that holds i_d there, not the current"
    assert 0.995 < min(shares) <= max(shares) < 1.001


@pytest.mark.parametrize(("ratio", "least"), [(1.5, 0.94), (2.5, 0.95), (0.7, 0.72)])
def test_reluctance_leaves_most_of_it_up_to_twice_base_speed(ratio: float, least: float) -> None:
    """i_d on the curve of maximum torque per ampere, and as much more as the magnet takes: near the best, not it."""
    rng, shares = np.random.default_rng(12), []
    for _ in range(40):
        m, omega_e, volts = beyond_the_circle(rng, ratio, 2.0)
        shares.append(left_by_weakening(m, omega_e, volts)[0] / best_within(m, omega_e, volts))
    assert least < min(shares) <= max(shares) < 1.006, "the curve may take 1.003 of the current"
    assert np.median(shares) > 0.945


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
