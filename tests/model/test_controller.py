"""The controller on every motor that a drive file may state, against the numerical optimum and in float32."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from codegen.ir.layout import Listing, lay_out
from model.drives.load import load_drive, parse_drive
from model.filters.program import BlockBuilder
from model.loop.controller import Gains, control_block, design
from model.loop.references import current_reference, within_reach
from model.quantities import Constants
from model.schema import DriveError
from runtime.proof.control import best_currents, of_current, torque_of
from tests.conftest import thoroughly

MOTORS, SHARES = 10_000, 24


def draw(rng: np.random.Generator, count: int) -> dict[str, np.ndarray]:
    """Motors over all that is accepted: L_d / L_q 0.05 .. 20, some nearly equal, psi_m 1e-5 .. 100 Wb, any current."""

    def between(low: float, high: float) -> np.ndarray:
        return np.exp(rng.uniform(np.log(low), np.log(high), count))

    L_q = between(2e-5, 0.025)
    ratio = between(0.05, 20.0)
    near = rng.random(count) < 0.2
    ratio[near] = 1 + rng.choice([-1, 1], near.sum()) * 10 ** rng.uniform(-15, -2, near.sum())
    return {
        "inductance_d": L_q * ratio,
        "inductance_q": L_q,
        "magnet_flux": between(1e-5, 100.0),
        "pole_pairs": rng.integers(1, 201, count).astype(float),
        "max_current": between(1e-3, 1e5),
        "stator_resistance": between(1e-5, 1e4),
    }


def motor_of(drawn: dict[str, np.ndarray], k: int) -> SimpleNamespace:
    return SimpleNamespace(**{name: float(values[k]) for name, values in drawn.items()})


def currents_of(motor: Any, share: Any) -> tuple[Any, Any, Any]:
    """Torque limit, N m, and currents, A, at a share of it, by the model's own expressions."""
    b, constants, drive = BlockBuilder("b", ""), Constants(named=False), SimpleNamespace(motor=motor)
    reach = within_reach(b, drive, constants, ca.SX(motor.max_current), ca.SX(0), ca.SX(0))
    return reach.torque, *current_reference(b, drive, constants, share * reach.torque, reach)


def references(motor: Any, share: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Of one motor, as ``generate`` states it: its data are numbers."""
    symbol = ca.SX.sym("share")
    found = ca.Function("found", [symbol], currents_of(motor, symbol)).map(len(share))(share[None, :])
    largest, d, q = (np.array(value).ravel() for value in found)
    return float(largest[0]), d, q


def references_of_all(m: Any, share: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of k motors, shares (k, c), at once: their data are symbols."""
    names = list(vars(m))
    data = {name: ca.SX.sym(name) for name in names}
    symbol = ca.SX.sym("share", 1, share.shape[1])
    function = ca.Function("found", [*data.values(), symbol], currents_of(SimpleNamespace(**data), symbol))
    found = function.map(len(share))(*(getattr(m, name).T for name in names), share.reshape(1, -1))
    limit, d, q = (np.array(value) for value in found)
    return limit.ravel(), d.reshape(share.shape), q.reshape(share.shape)


def most_torque(m: Any, current: np.ndarray) -> np.ndarray:
    """The most torque on circles of a current, by search over the angle: no formula of the optimum.

    Of one motor, ``current`` (c,); of k motors, each datum of ``m`` (k, 1) and ``current`` (k, c).
    """
    scale = 1.5 * m.pole_pairs

    def torque(beta: Any) -> np.ndarray:
        flux = m.magnet_flux + (m.inductance_d - m.inductance_q) * current * np.cos(beta)
        return scale * flux * current * np.sin(beta)

    angles = np.linspace(0, math.pi, 91)
    best = np.argmax([torque(angle) for angle in angles], axis=0)
    low, high = angles[np.maximum(best - 1, 0)], angles[np.minimum(best + 1, 90)]
    for _ in range(40):
        left, right = high - 0.618034 * (high - low), low + 0.618034 * (high - low)
        better = torque(left) > torque(right)
        low, high = np.where(better, low, left), np.where(better, right, high)
    return torque(0.5 * (low + high))


@pytest.mark.slow
def test_least_current_and_torque_limit_on_every_motor() -> None:
    """Current within 0.5 % of the least, torque exact, limit within 1 %: 10 000 motors, 24 torques each."""
    rng = np.random.default_rng(5)
    drawn, worst = draw(rng, MOTORS), {"current": 0.0, "limit": 0.0, "torque": 0.0}
    together = 500  # motors that are searched at once
    for first in range(0, MOTORS, together):
        some = slice(first, first + together)
        m = SimpleNamespace(**{name: values[some, None] for name, values in drawn.items()})
        sign, size = rng.choice([-1, 1], (together, SHARES)), 10 ** rng.uniform(-6, 0, (together, SHARES))
        share = sign * size
        share[:, :2] = 1.0, -1.0
        limit, i_d, i_q = references_of_all(m, share)
        for value, of_one in zip((limit[0], i_d[0], i_q[0]), references(motor_of(drawn, first), share[0]), strict=True):
            np.testing.assert_allclose(value, of_one, rtol=1e-12)
        asked = share * limit[:, None]
        current = np.hypot(i_d, i_q)
        torque = 1.5 * m.pole_pairs * (m.magnet_flux + (m.inductance_d - m.inductance_q) * i_d) * i_q
        # The most torque that this current makes is the torque asked for, to what 0.5 % of current changes.
        smaller = most_torque(m, current / 1.005)
        assert np.all(smaller <= np.abs(asked) * (1 + 1e-9)), np.argwhere(smaller > np.abs(asked) * (1 + 1e-9))[0]
        # Where reluctance is small, i_d is -r i_q^2 to second order: the circle is too flat there to tell.
        r = (m.inductance_q - m.inductance_d) / m.magnet_flux
        small = np.abs(r * i_q) < 0.02
        np.testing.assert_allclose(i_d[small], (-r * i_q**2)[small], rtol=2e-3)
        most = most_torque(m, np.hstack([current, m.max_current]))
        worst["torque"] = max(worst["torque"], float(np.max(np.abs(torque / asked - 1))))
        worst["limit"] = max(worst["limit"], float(np.max(np.abs(limit / most[:, -1] - 1))))
        worst["current"] = max(worst["current"], float(np.max(most[:, :-1] / np.abs(asked)) - 1))
    print(f"\nof {MOTORS} motors: {worst}")
    assert worst["torque"] <= 1e-9
    assert worst["limit"] <= 0.01


def test_the_second_statement_finds_the_same_optimum() -> None:
    """Bisection over the lead angle against the search over the circle."""
    drawn = draw(np.random.default_rng(6), 300)
    for k in range(300):
        m = motor_of(drawn, k)
        i = best_currents(vars(m), m.max_current, of_current)
        assert abs(i) == pytest.approx(m.max_current, rel=1e-9)
        most = float(most_torque(m, np.array([m.max_current]))[0])
        assert torque_of(vars(m), i) == pytest.approx(most, rel=1e-9)
        again = best_currents(vars(m), -0.3 * most, torque_of)
        assert torque_of(vars(m), again) == pytest.approx(-0.3 * most, rel=1e-9)
    assert best_currents(vars(m), 0.0, torque_of) == 0


def evaluate(block: Any, listing: Listing, order: list[int], inputs: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """A block's outputs in float32, operation by operation as the printed text has them."""
    given = {
        name: port[k] for port_ in block.inputs for k, name in enumerate(port_.names) for port in [inputs[port_.name]]
    }
    f, values = np.float32, dict[int, Any]()
    binary = {"add": np.add, "sub": np.subtract, "mul": np.multiply, "div": np.divide}
    for index in order:
        node = listing.graph[index]
        args = [values[arg] for arg in node.args]
        if node.op == "input":
            values[index] = f(given[node.name])
        elif node.op == "const":
            values[index] = f(node.value)
        elif node.op in binary:
            values[index] = binary[node.op](*args)
        elif node.op in {"min", "max"}:
            a, b = args
            values[index] = (a if a < b else b) if node.op == "min" else (a if a > b else b)
        else:
            values[index] = {"neg": np.negative, "sqrt": np.sqrt, "sin": np.sin, "cos": np.cos}[node.op](*args)
    return {name: np.array([values[n] for n in nodes]) for name, nodes in listing.outputs.items()}


@pytest.mark.parametrize("motors", [100, *thoroughly(300)])
def test_integrators_and_duties_stay_finite_in_float32(motors: int) -> None:
    """20 samples each from standstill without current on, torque asked for to the limit and beyond."""
    rng = np.random.default_rng(7)
    base, drawn = load_drive("ipmsm"), draw(rng, motors)
    for k in range(motors):
        m = motor_of(drawn, k)
        motor = base.motor.model_copy(
            update={name: getattr(m, name) for name in ("inductance_d", "inductance_q", "magnet_flux")}
            | {"pole_pairs": int(m.pole_pairs), "inertia": float(10 ** rng.uniform(-8, 3))}
            | {"stator_resistance": float(10 ** rng.uniform(-4, 3))}
        )
        control = base.control.model_copy(update={"max_current": m.max_current})
        drive = base.model_copy(update={"motor": motor, "control": control})
        constants = Constants(named=True)
        block = control_block(drive, constants)
        listing = lay_out(block, list(constants.items.values()), any_angle=True)  # NumPy's sine
        order = listing.graph.reachable(n for nodes in listing.outputs.values() for n in nodes)
        gain, integrator = np.array(design(drive).values), np.zeros(4)
        assert len(gain) == len(Gains.names())
        i, rotor, command = np.zeros(2), np.zeros(2), np.array([0.0, control.dc_link])
        for sample in range(20):
            given = {"i": i, "rotor": rotor, "command": command, "gain": gain, "integrator": integrator}
            with np.errstate(all="ignore"):
                out = evaluate(block, listing, order, given)
            assert np.all(np.isfinite(out["integrator"])), (m, sample)
            assert np.all(np.isfinite(out["v"])), (m, sample)
            assert np.all((out["duty"] >= 0) & (out["duty"] <= 1)), (m, sample)
            if not sample:
                np.testing.assert_array_equal(out["duty"], 0.5)  # zero torque asks for zero current
            integrator = out["integrator"]
            i = rng.uniform(-1.2, 1.2, 2) * m.max_current
            rotor = np.array([rng.uniform(-1, 1) * base.operating_box.speed, rng.uniform(-math.pi, math.pi)])
            command = np.array([rng.choice([-1, 0, 1]) * base.operating_box.speed, control.dc_link])


@pytest.mark.parametrize("sign", [1, -1])
def test_field_intensifying_motors_get_a_current_that_helps(sign: int) -> None:
    """L_d > L_q: i_d > 0, small and rising with torque; its mirror image i_d < 0."""
    m = SimpleNamespace(inductance_d=5e-3 + sign * 1e-3, inductance_q=5e-3 - sign * 1e-3, magnet_flux=0.1)
    m.pole_pairs, m.max_current, m.stator_resistance = 4.0, 20.0, 0.1
    _, i_d, i_q = references(m, np.array([0.0, 0.1, 0.5, 1.0, -1.0]))
    assert i_d[0] == i_q[0] == 0
    assert np.all(np.diff(sign * i_d[:4]) > 0)
    assert i_d[4] == i_d[3]
    assert i_q[4] == -i_q[3]
    assert sign * i_d[3] < 0.5 * i_q[3]


def test_a_traction_motor_gets_all_that_its_current_makes() -> None:
    """L_q 2.5 times L_d, 80 mWb, 400 A: 293 N m, where 1.5 p psi_m I is 192; 150 N m with 247 A."""
    m = SimpleNamespace(inductance_d=0.2e-3, inductance_q=0.5e-3, magnet_flux=0.08, pole_pairs=4.0, max_current=400.0)
    m.stator_resistance = 0.018
    limit, i_d, i_q = references(m, np.array([1.0]))
    assert limit == pytest.approx(293, abs=1)
    _, i_d, i_q = references(m, np.array([150 / limit]))
    assert float(np.hypot(i_d, i_q)[0]) == pytest.approx(247, abs=1.5)


def test_a_motor_without_magnets_is_refused_in_its_own_words() -> None:
    data = load_drive("ipmsm").model_dump(exclude={"sha256", "machine_text"})
    data["motor"]["magnet_flux"] = 0.0
    with pytest.raises(DriveError, match="a motor without magnets is not for this tool"):
        parse_drive(data, "x.toml")
    data["motor"]["magnet_flux"] = 4.7e-5  # one that is sold
    assert parse_drive(data, "x.toml").motor.magnet_flux == 4.7e-5
