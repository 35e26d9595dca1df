"""Machines against each other: limits in which one must be another, and adaptive data at their motor's values."""

from __future__ import annotations

import itertools
from typing import Any

import casadi as ca
import numpy as np
import pytest

from model.drives.load import load_drive, parse_drive
from model.machines import MACHINES
from model.machines.adaptive import ADAPTIVE, own_value
from model.machines.base import Parameters, Rotor
from model.machines.state_space import build, default_initial_state
from model.quantities import ConstantError, Constants, united
from model.schema import Drive, DriveError, Inverter
from runtime.proof.identity import identical
from tests.conftest import variant

pytestmark = pytest.mark.unit

MODELS = list(itertools.product(["constant_speed", "load_torque"], ["euler", "exact"]))


def _images(drive: Drive, points: list[tuple[Any, Any]], **model: Any) -> list[np.ndarray]:
    built = build(variant(drive, model=model))
    f = ca.Function("f", [built.x, built.u], [built.numeric(built.f_commanded)])
    return [np.array(f(x, u)).ravel() for x, u in points]


def _points(states: int) -> list[tuple[np.ndarray, np.ndarray]]:
    rng = np.random.default_rng(5)
    scale = np.array([20.0, 20.0, 100.0, 2.0, 5.0])[:states]
    return [(rng.normal(0, scale), rng.normal(0, 100, 2)) for _ in range(50)]


@pytest.mark.parametrize(("mechanics", "discretization"), MODELS)
def test_salient_with_equal_inductances_is_surface(mechanics: str, discretization: str) -> None:
    drive = load_drive("spmsm_load_torque")
    points = _points(4 if mechanics == "constant_speed" else 5)
    settings = {"mechanics": mechanics, "discretization": discretization}
    surface, salient = (_images(drive, points, machine=name, **settings) for name in ("surface", "salient"))
    np.testing.assert_allclose(salient, surface, rtol=1e-13, atol=1e-12)


@pytest.mark.parametrize("discretization", ["euler", "exact"])
def test_salient_and_salient_flux_agree_to_the_rules_order(discretization: str) -> None:
    """One machine in two coordinates: a shorter sample brings them together, by 2 (Euler: first order, local error T^2
    over a step) or 3 orders."""
    drive = load_drive("ipmsm")
    gaps = []
    for T in (1e-4, 0.5e-4):
        short = variant(
            drive, model={"sample_time": T, "mechanics": "constant_speed", "discretization": discretization}
        )
        flux = MACHINES["salient_flux"](Parameters.numeric(short), Constants(named=False))
        x, u = np.array([3.0, -2.0, 80.0, 0.7]), np.array([60.0, -30.0])
        psi = flux.electrical_state((x[0], x[1]), Rotor.at(ca.SX(x[3])))
        start = np.array([float(psi[0]), float(psi[1]), *x[2:]])
        (currents,) = _images(short, [(x, u)], machine="salient")
        (fluxes,) = _images(short, [(start, u)], machine="salient_flux")
        i, _ = flux.currents((fluxes[0], fluxes[1]), Rotor.at(ca.SX(fluxes[3])))
        gaps.append(float(np.hypot(float(i[0]) - currents[0], float(i[1]) - currents[1])))
    order = np.log2(gaps[0] / gaps[1])
    assert order > (1.8 if discretization == "euler" else 2.7), (gaps, order)


@pytest.mark.parametrize("machine", ["surface", "salient", "salient_flux"])
@pytest.mark.parametrize(("mechanics", "discretization"), MODELS)
def test_adaptive_data_at_their_motors_values_change_nothing(machine: str, mechanics: str, discretization: str) -> None:
    drive = load_drive("spmsm_load_torque" if machine == "surface" else "ipmsm")
    drive = drive.model_copy(update={"inverter": Inverter(dead_time=2e-6, switch_drop=1.0)})
    points = _points(4 if mechanics == "constant_speed" else 5)
    settings = {"machine": machine, "mechanics": mechanics, "discretization": discretization}
    plain = _images(drive, points, **settings)
    words = list(ADAPTIVE)
    slow = [own_value(drive, word) for word in words]
    with_slow = [(np.array([*x, *slow]), u) for x, u in points]
    adaptive = _images(drive, with_slow, adaptive=words, **settings)
    for expected, found in zip(plain, adaptive, strict=True):
        np.testing.assert_allclose(found, [*expected, *slow], rtol=1e-12, atol=1e-11)


@pytest.mark.parametrize("machine", ["surface", "salient", "salient_flux"])
def test_adaptive_resistance_is_the_motor_with_that_resistance(machine: str) -> None:
    """To first order in its deviation: 20 % of T R / L = 0.01 leaves half of its square, 2e-6, times 100 V T / L."""
    drive = load_drive("ipmsm")
    if machine == "surface":
        drive = variant(drive, motor={"inductance_q": drive.motor.inductance_d})
    other = variant(drive, motor={"stator_resistance": 1.2 * drive.motor.stator_resistance})
    points = _points(5)
    found = _images(
        drive,
        [(np.array([*x, 1.2 * drive.motor.stator_resistance]), u) for x, u in points],
        machine=machine,
        adaptive=["stator_resistance"],
    )
    for expected, image in zip(_images(other, points, machine=machine), found, strict=True):
        np.testing.assert_allclose(image[:5], expected, rtol=2e-3, atol=1e-3)


def test_torque_of_the_salient_machine_is_power_over_speed() -> None:
    """Power that the motion takes from the terminals: torque times speed, at any current, by an identity."""
    par = Parameters.symbolic()
    salient, flux = (MACHINES[name](par, Constants(named=False)) for name in ("salient", "salient_flux"))
    i, rotor = (ca.SX.sym("i_a"), ca.SX.sym("i_b")), Rotor.at(ca.SX.sym("th"))
    from model.to_sympy import to_sympy

    ours = to_sympy(ca.SX(salient.torque(i, rotor)))[0, 0]
    theirs = to_sympy(ca.SX(flux.torque(flux.electrical_state(i, rotor), rotor)))[0, 0]
    assert identical(ours, theirs)


def test_adaptive_states_come_last_and_start_at_the_motors_values() -> None:
    drive = load_drive("ipmsm_adaptive")
    names = [state.name for state in build(drive).states]
    assert names[4:] == ["load_torque", "magnet_flux", "stator_resistance"]
    assert default_initial_state(drive)[5:] == [drive.motor.magnet_flux, drive.motor.stator_resistance]
    turned = variant(drive, model={"adaptive": ["stator_resistance", "magnet_flux"]})
    assert [state.name for state in build(turned).states][5:] == ["stator_resistance", "magnet_flux"]


def test_wrong_adaptive_words_are_one_line() -> None:
    data = load_drive("ipmsm_adaptive").model_dump(exclude={"sha256"})
    data["model"]["adaptive"] = ["magnet_flux", "magnet_flux"]
    with pytest.raises(DriveError, match="names 'magnet_flux' twice"):
        parse_drive(data, "mine.toml")
    data["model"]["adaptive"] = ["inertia"]
    with pytest.raises(DriveError, match=r"model.adaptive\[0\] = 'inertia' is none of 'magnet_flux', 'stator_res"):
        parse_drive(data, "mine.toml")


def test_a_name_stands_for_one_number() -> None:
    """Else one block takes the other's number, in C and in Python alike, and no link between them sees it."""
    constants, others = Constants(named=True), Constants(named=True)
    constants("K", ca.SX(2.0), "a")
    constants("K", ca.SX(2.0), "a, said again")
    with pytest.raises(ConstantError, match=r"constant K is a = 2\.0 and b = 3\.0"):
        constants("K", ca.SX(3.0), "b")
    others("K", ca.SX(3.0), "b")
    with pytest.raises(ConstantError, match="another name"):
        united(constants.items.values(), others.items.values())
