"""Every formula of model/ on motors over all that a drive file accepts, against what is known by another way."""

from __future__ import annotations

import itertools
import math
from typing import Any

import casadi as ca
import mpmath
import numpy as np
import pytest
from scipy.linalg import expm

from model.loop.controller import clarke_block
from model.machines import MACHINES as CLASSES
from model.machines.adaptive import own_value
from model.machines.base import Parameters, Rotor
from model.machines.mechanics import MECHANICS
from model.machines.state_space import StateSpaceModel, build
from model.quantities import Constants
from model.schema import Drive, Inverter
from runtime.proof.inverter import LossyInverter, make_inverter
from runtime.proof.motors import make_motor
from tests.model.accepted import ADAPTIVE, MACHINES, draw_drive, draw_motor, evenly

pytestmark = pytest.mark.unit

KINDS = list(itertools.product(MACHINES, ["constant_speed", "load_torque"], ["euler", "exact"], ADAPTIVE))
EPS = np.finfo(float).eps


def drives(seed: int, each: int) -> list[Drive]:
    rng = np.random.default_rng(seed)
    return [draw_drive(rng, *kind) for kind in KINDS for _ in range(each)]


# --- the folded constants: what is printed beside each is a formula, and the number must be its value


def letters(drive: Drive) -> dict[str, Any]:
    m, mpf = drive.motor, mpmath.mpf
    known = {"R": m.stator_resistance, "L": m.inductance_d, "L_d": m.inductance_d, "L_q": m.inductance_q}
    known |= {"psi_m": m.magnet_flux, "p": m.pole_pairs, "J": m.inertia, "D": m.friction, "T": drive.model.sample_time}
    found: dict[str, Any] = {name: mpf(value) for name, value in known.items()}
    z = found["T"] * found["R"] / found["L_q"]
    in_words = {"magnet flux linkage": found["psi_m"], "sample time": found["T"]}
    in_words |= {"the motor's stator resistance": found["R"], "the motor's stator_resistance": found["R"]}
    in_words["the motor's magnet_flux"] = found["psi_m"]
    stated = drive.inverter or Inverter()
    inverter = {"V_dc": drive.control.dc_link, "t_d": stated.dead_time, "V_drop": stated.switch_drop}
    inverter |= {"I_0": max(3.0, drive.control.max_current / 200), "I_1": drive.control.max_current / 20}
    found |= {name: mpf(value) for name, value in inverter.items()}
    found["f_sw"] = mpf(stated.switching_frequency) if stated.switching_frequency else 1 / found["T"]
    in_words["the drive's dead_time_voltage"] = found["V_dc"] * found["t_d"] * found["f_sw"] + found["V_drop"]
    return found | {"z": z, "a": mpmath.exp(-z), "exp": mpmath.exp} | in_words


def value_of(formula: str, known: dict[str, Any]) -> Any:
    """``1.5 p psi_m, N m/A`` in 60 digits: blanks between factors are products."""
    formula = formula.split(",")[0]
    if formula in known:
        return known[formula]
    text = formula
    for spelt in ("+", "-", "*", "/"):
        text = text.replace(f" {spelt} ", spelt)
    text = text.replace(" ", "*").replace("1.5", "(mpf(3)/2)")
    return eval(text, {"__builtins__": {}, "mpf": mpmath.mpf}, known)


def test_every_folded_constant_is_its_formula_to_the_last_digits() -> None:
    """What a fast and what a slow winding lose in a sample, and what a magnet's turn leaves, do not cancel."""
    seen: set[str] = set()
    for drive in drives(1, 3):
        with mpmath.workdps(60):
            known = letters(drive)
            for constant in build(drive).constants:
                seen.add(constant.name)
                if constant.name == "RETURN":  # to a power of two
                    share = constant.value * drive.model.adaptive_time / drive.model.sample_time
                    assert math.frexp(constant.value)[0] == 0.5
                    assert 0.7 < share < 1.42
                    continue
                true = value_of(constant.formula, known)
                size = abs(true)
                if constant.formula.startswith("1 - T"):  # eq. 7 itself subtracts a rounded term from one
                    size += known["T"] * (
                        known["R"] / known["L"] if "R" in constant.formula else known["D"] / known["J"]
                    )
                elif constant.formula.startswith("1 / L_d -"):  # what it is added to, 1 / L_q, is rounded as well
                    size += 1 / known["L_q"]
                elif constant.formula.startswith("exp"):  # of a rounded argument
                    size *= 1 - mpmath.log(true)
                assert abs(constant.value - true) <= 4 * EPS * size + 1e-300, (constant, float(true), drive.motor)
    assert {
        "DECAY_I",
        "GAIN_V",
        "GAIN_HALF_Q",
        "LOSS_D",
        "MAGNET_TURN",
        "SALIENCY",
        "ADVANCE",
        "GAIN_OMEGA",
        "V_DEAD",
        "SIGN_PER_A",
    } <= seen


# --- f, h and their Jacobians against the motors by hand


def draw_point(rng: np.random.Generator, drive: Drive, model: StateSpaceModel) -> tuple[Any, Any]:
    """Currents about psi_m / L, up to a third of a turn a sample, voltages about those of the magnet."""
    m, T = drive.motor, drive.model.sample_time
    turn = evenly(rng, 1e-6, 2.0) * rng.choice([-1, 1])
    omega, theta = turn / T / m.pole_pairs, rng.uniform(-math.pi, math.pi)
    z = m.magnet_flux * rng.normal(0, 1, 2) * evenly(rng, 1e-3, 10)
    if drive.model.machine == "salient_flux":
        z = z + m.magnet_flux * np.array([math.cos(theta), math.sin(theta)])
    else:
        z = z / m.inductance_d
    torque = 1.5 * m.pole_pairs * m.magnet_flux**2 / m.inductance_q
    slow = [(own_value(drive, word) or 1.0) * rng.uniform(0.5, 1.5) for word in drive.model.adaptive]
    load = [torque * rng.normal()] if drive.model.mechanics == "load_torque" else []
    return np.array([*z, omega, theta, *load, *slow]), m.magnet_flux / T * rng.normal(0, 1, 2)


def by_complex_step(function: Any, x: np.ndarray) -> np.ndarray:
    """df/dx to rounding: a step of 1e-30 of each entry along the imaginary axis, where nothing is subtracted."""
    size = np.maximum(np.abs(x), 1e-3)
    columns = [function(x + 1e-30j * size[k] * np.eye(len(x))[k]).imag / (1e-30 * size[k]) for k in range(len(x))]
    return np.array(columns).T


def test_f_h_and_their_jacobians_are_those_of_the_motors_by_hand() -> None:
    """On the scale of a row's terms; the derivatives of the hand-written f and h are taken by complex steps.

    Where one axis has many times the other's inductance, terms that much larger cancel on the way.
    """
    rng = np.random.default_rng(2)
    for drive in drives(3, 4):
        model, hand = build(drive), make_motor(drive.model_dump())
        outputs = [model.numeric(ca.densify(e)) for e in (model.f, model.h, model.F, model.H)]
        x, u = draw_point(rng, drive, model)
        inverter = make_inverter(drive.model_dump()) or LossyInverter(0.0, 1.0, None, 1.0, 1.0)
        g = inverter.shortfall(hand.h(x)) if "g" in model.inputs else np.zeros(2)
        arrives = {"u": u, "g": g, "v": u}
        given = [arrives[name] for name in model.inputs]
        f, h, F, H = (np.array(value) for value in ca.Function("model", model.arguments, outputs)(x, *given))
        reach = np.where(np.arange(len(x)) == model.angle, 1.0, np.abs(x))
        L_d, L_q = drive.motor.inductance_d, drive.motor.inductance_q
        allowed = 1e-14 * (10 + max(L_d / L_q, L_q / L_d))
        by_u = by_complex_step(lambda v, x=x, hand=hand: hand.f(x, v), u)
        size = np.abs(u) + np.abs(inverter.voltage(x) * g)
        for ours, jacobian, function, driven in (
            (f, F, lambda x, u=u, g=g, by=inverter, hand=hand: hand.f(x, u - by.voltage(x) * g), np.abs(by_u) @ size),
            (h, H, hand.h, 0.0),
        ):
            theirs = by_complex_step(function, x)
            scale = np.abs(theirs) @ reach + driven + 1e-250  # nothing is left of a speed after 600 time constants
            assert np.all(np.abs(ours.ravel() - function(x)) <= allowed * scale), (drive.motor, drive.model)
            assert np.all(np.abs(jacobian - theirs) * reach <= allowed * scale[:, None]), (drive.motor, drive.model)


# --- machines: flux linkage and energy say what voltage and torque must be

COUNT = 2000


def flux_linkage(m: dict[str, Any], i: Any, theta: Any) -> Any:
    """Alpha-beta, Wb: the inductance turns by twice the angle, the magnet by the angle."""
    mean, half = (m["L_d"] + m["L_q"]) / 2, (m["L_d"] - m["L_q"]) / 2
    c, s = np.cos(2 * theta), np.sin(2 * theta)
    return np.array(
        [
            (mean + half * c) * i[0] + half * s * i[1] + m["psi_m"] * np.cos(theta),
            half * s * i[0] + (mean - half * c) * i[1] + m["psi_m"] * np.sin(theta),
        ]
    )


def coenergy(m: dict[str, Any], i: Any, theta: Any) -> Any:
    """J, of amplitude-invariant quantities: 1.5 times the integral of the flux linkage along the current."""
    magnet = flux_linkage(m, 0 * i, theta)
    return 1.5 * np.sum(i * (flux_linkage(m, i, theta) + magnet) / 2, axis=0)


def many_motors(machine: str) -> tuple[dict[str, Any], Any, Any, Any, Any]:
    """Data of many motors with currents (A), speeds (electrical rad/s), angles (rad) and voltages (V)."""
    rng = np.random.default_rng(4)
    drawn = [draw_motor(rng, machine) for _ in range(COUNT)]
    words = {"R": "stator_resistance", "L_d": "inductance_d", "L_q": "inductance_q", "psi_m": "magnet_flux"}
    words |= {"p": "pole_pairs", "J": "inertia", "D": "friction"}
    m = {letter: np.array([float(motor[word]) for motor in drawn]) for letter, word in words.items()}
    m["T"] = np.ones(COUNT)
    sizes = 10 ** rng.uniform(-2, 2, (3, COUNT))
    i = rng.normal(0, 1, (2, COUNT)) * sizes[0] * m["psi_m"] / m["L_q"]
    omega_e = rng.choice([-1, 1], COUNT) * 10 ** rng.uniform(0, 5, COUNT)
    v = rng.normal(0, 1, (2, COUNT)) * sizes[1] * m["psi_m"] * np.abs(omega_e)
    return m, i, omega_e, rng.uniform(-math.pi, math.pi, COUNT), v


def of_many(machine: str, method: Any, m: dict[str, Any], *arguments: Any) -> np.ndarray:
    """A method of the machine, given its data and arguments as letters, on all motors."""
    data = {name: ca.SX.sym(name) for name in m}
    said = CLASSES[machine](Parameters(**data), Constants(named=False))
    given = [ca.SX.sym(f"a{k}", *np.atleast_2d(value).shape[:1]) for k, value in enumerate(arguments)]
    function = ca.Function("of_many", [*data.values(), *given], [ca.vertcat(*method(said, *given))])
    return np.array(function.map(COUNT)(*(value[None] for value in m.values()), *map(np.atleast_2d, arguments)))


@pytest.mark.parametrize("machine", MACHINES)
def test_torque_is_what_the_coenergy_gains_as_the_rotor_turns(machine: str) -> None:
    m, i, _, theta, _ = many_motors(machine)

    def torque(said: Any, i: Any, theta: Any) -> list[Any]:
        rotor = Rotor.at(theta)
        return [said.torque(said.electrical_state((i[0], i[1]), rotor), rotor)]

    gained = m["p"] * coenergy(m, i, theta + 1e-30j).imag / 1e-30
    size = np.hypot(*i)
    flux = m["psi_m"] + np.maximum(m["L_d"], m["L_q"]) * size
    if machine == "salient_flux":  # a flux linkage is rounded, and the current is what that makes of it
        size = size + flux / np.minimum(m["L_d"], m["L_q"])
    off = np.abs(of_many(machine, torque, m, i, theta)[0] - gained) / (1.5 * m["p"] * size * flux)
    assert off.max() <= 2e-15


@pytest.mark.parametrize("machine", MACHINES)
def test_voltage_is_the_drop_and_what_the_flux_linkage_changes(machine: str) -> None:
    """Faraday's law along the trajectory: d psi/dt by a complex step in time; currents and states are inverse."""
    m, i, omega_e, theta, v = many_motors(machine)

    def slope(said: Any, i: Any, v: Any, omega_e: Any, theta: Any) -> list[Any]:
        rotor = Rotor.at(theta)
        state = said.electrical_state((i[0], i[1]), rotor)
        back, _ = said.currents(state, rotor)
        return [*said.derivative(state, (v[0], v[1]), omega_e, rotor), *back]

    found = of_many(machine, slope, m, i, v, omega_e, theta)
    terms = [v, m["R"] * i, omega_e * flux_linkage(m, i, theta)]
    scale = sum(np.hypot(*term) for term in terms)
    if machine == "salient_flux":  # its state is the flux linkage, so that only the currents can be wrong
        change, resolution = found[:2], np.hypot(*flux_linkage(m, i, theta)) / np.minimum(m["L_d"], m["L_q"])
        scale = scale + m["R"] * resolution
        assert np.all(np.hypot(*(found[2:] - i)) <= 2e-14 * (resolution + np.hypot(*i)))
    else:
        change = flux_linkage(m, i + 1e-30j * found[:2], theta + 1e-30j * omega_e).imag / 1e-30
        scale = scale * np.maximum(m["L_d"] / m["L_q"], m["L_q"] / m["L_d"])
        np.testing.assert_array_equal(found[2:], i)
    assert np.all(np.hypot(*(v - m["R"] * i - change)) <= 2e-14 * scale)


def test_park_and_clarke_are_rotations_and_projections() -> None:
    rng = np.random.default_rng(6)
    theta, z = rng.uniform(-50, 50, COUNT), rng.normal(0, 100, (2, COUNT))
    angle, pair = ca.SX.sym("theta"), ca.SX.sym("z", 2)
    rotor, parts = Rotor.at(angle), (pair[0], pair[1])
    both = ca.vertcat(*rotor.to_rotor(parts), *rotor.to_stator(parts))
    found = np.array(ca.Function("park", [angle, pair], [both]).map(COUNT)(theta[None], z))
    phasor = z[0] + 1j * z[1]
    for pair_found, expected in ((found[:2], phasor * np.exp(-1j * theta)), (found[2:], phasor * np.exp(1j * theta))):
        np.testing.assert_allclose(pair_found[0] + 1j * pair_found[1], expected, rtol=0, atol=1e-12)
    block = clarke_block()
    clarke = ca.Function("clarke", [ca.vertcat(*block.inputs[0].entries)], [ca.vertcat(*block.outputs[0].entries)])
    phases = np.array([phasor.real, (phasor * np.exp(-2j * math.pi / 3)).real])
    np.testing.assert_allclose(np.array(clarke.map(COUNT)(phases)), z, rtol=0, atol=1e-12)


# --- discretisation: the electrical equations at constant speed are linear in the rotor's frame


def solved(chi: np.ndarray, w: np.ndarray, z: tuple[float, float], turn: float) -> np.ndarray:
    """L i / psi_m on the rotor's axes one sample later, by the matrix exponential.

    In units of the sample time and the magnet's flux linkage: d chi/dt = w - z chi - turn J (chi + e_d), and the
    voltage, which stands still in the stator, turns back by ``turn``.
    """
    M = np.zeros((5, 5))
    M[0] = [-z[0], turn, 1, 0, 0]
    M[1] = [-turn, -z[1], 0, 1, -turn]
    M[2, 3], M[3, 2] = turn, -turn
    return np.asarray((expm(M) @ np.array([*chi, *w, 1.0]))[:2])


#: Twice the worst that was measured over 3000 motors each.
RULE = {"surface": 0.01, "salient": 0.45, "salient_flux": 0.36}


@pytest.mark.parametrize("machine", MACHINES)
def test_the_exact_rule_is_of_second_order_on_every_motor(machine: str) -> None:
    """Its error over a sample is at most C turn (turn + min(T R / L, 1)), times the saliency where currents are states.

    At standstill it is none.
    """
    rng, worst = np.random.default_rng(7), 0.0
    for k in range(160):
        m, T = draw_motor(rng, machine), evenly(rng, 1e-6, 1e-2)
        least, most = sorted((m["inductance_d"], m["inductance_q"]))
        saliency = most / least
        if saliency > 20:  # of currents as states the error then hides what the others make
            m["inductance_q"] = m["inductance_d"] * evenly(rng, 0.05, 1)
            m["inductance_d"] = max(m["inductance_d"], 1e-6)
            least, most = sorted((m["inductance_d"], m["inductance_q"]))
            saliency = most / least
        R = min(m["stator_resistance"], 1e5 * least / T)  # as far as the matrix exponential is exact
        L = np.array([m["inductance_d"], m["inductance_q"]])
        psi_m, p = m["magnet_flux"], m["pole_pairs"]
        turn = 0.0 if k % 4 == 0 else evenly(rng, 1e-5, 0.1) * rng.choice([-1, 1])
        theta = rng.uniform(-math.pi, math.pi)
        chi, w = (rng.normal(0, 1, 2) * evenly(rng, 0.01, 10) for _ in range(2))
        par = Parameters(*(ca.SX(value) for value in (R, *L, psi_m, p, 1.0, 0.0, T)))
        said = CLASSES[machine](par, Constants(named=False))
        here, there = Rotor.at(ca.SX(theta)), Rotor.at(ca.SX(theta + turn))
        v = here.to_stator(tuple(w * psi_m / T))
        start = said.electrical_state(here.to_stator(tuple(chi * psi_m / L)), here)
        end = said.currents(said.exact(start, v, turn / T, theta).z, there)[0]
        found = np.array([float(value) for value in there.to_rotor(end)]) * L / psi_m
        size = np.abs(chi).sum() + np.abs(w).sum() + 1
        error = float(np.max(np.abs(found - solved(chi, w, tuple(T * R / L), turn)))) / size
        rounding = 1e-12 * saliency
        bound = abs(turn) * (abs(turn) + min(T * R / least, 1)) * (saliency if machine == "salient" else 1)
        assert error <= RULE[machine] * bound + rounding, (m, T, turn, error / bound)
        worst = max(worst, (error - rounding) / bound if turn else 0.0)
    print(f"\n{machine}: error at most {worst:.2g} of turn (turn + T R / L)")


# --- mechanics


def test_speed_and_angle_are_those_of_a_torque_that_is_held() -> None:
    """In 60 digits: the speed exact, the angle exact where friction alone acts, else within the trapezoid's share."""
    rng = np.random.default_rng(8)
    for _ in range(400):
        m, T = draw_motor(rng, "surface"), evenly(rng, 1e-6, 1e-2)
        J, D, p = m["inertia"], m["friction"], m["pole_pairs"]
        omega, theta, T_e, T_L = rng.normal(0, [100, 3, 10, 10])
        par = Parameters(*(ca.SX(value) for value in (1.0, 1.0, 1.0, 1.0, p, J, D, T)))
        with mpmath.workdps(60):
            z = mpmath.mpf(T) * D / J
            lasting = mpmath.exp(-z)
            settled = (1 - lasting) / z if z else mpmath.mpf(1)
            pushed = mpmath.mpf(T) / J * (mpmath.mpf(T_e) - T_L)
            for word, push in (("constant_speed", mpmath.mpf(0)), ("load_torque", pushed)):
                said = MECHANICS[word](par, Constants(named=False))
                state = [omega, theta, T_L][: len(said.states)]
                after = [float(v) for v in said.exact(state, p * omega, lambda T_e=T_e: ca.SX(T_e))[0]]
                speed = lasting * omega + settled * push
                turned = settled * omega + ((1 - settled) / z if z else mpmath.mpf(1) / 2) * push
                moved = p * T * (abs(omega) + abs(float(push)) + abs(float(speed)))
                assert abs(after[0] - speed) <= 8 * EPS * (abs(omega) + abs(push)), (m, T)
                trapezoid = min(float(z) / 12, 0.5) * p * T * abs(float(speed) - omega) if push else 0.0
                assert abs(after[1] - theta - p * T * turned) <= trapezoid + 8 * EPS * (abs(theta) + moved), (m, T)
                assert after[2:] == state[2:]


def test_friction_and_torque_settle_where_they_balance() -> None:
    """Energy: at the speed where friction takes what the torque gives, a sample changes nothing, whatever T D / J."""
    rng = np.random.default_rng(9)
    for _ in range(200):
        m, T = draw_motor(rng, "surface"), evenly(rng, 1e-6, 1e-2)
        D = max(m["friction"], 1e-9)
        par = Parameters(*(ca.SX(value) for value in (1.0, 1.0, 1.0, 1.0, 1, m["inertia"], D, T)))
        said = MECHANICS["load_torque"](par, Constants(named=False))
        (omega, _, _), _ = said.exact([3.0 / D, 0.0, 2.0], 3.0 / D, lambda: ca.SX(5.0))
        assert float(omega) == pytest.approx(3.0 / D, rel=1e-14)
