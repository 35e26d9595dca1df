"""[tolerance]: what a wrong datum does to a sample, on motors over all that a drive file accepts."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import mpmath
import numpy as np
import pytest

from model.drives.load import cautions, load_drive, parse_drive
from model.machines.state_space import StateSpaceModel, build
from model.machines.tolerance import DATA, deviations
from model.schema import Drive, DriveError, Tolerance
from runtime.proof.motors import make_motor
from runtime.proof.wrong_data import STEP, bounds, doubt, moved_motors
from tests.model.accepted import draw_tolerance
from tests.model.test_accepted_motors import EPS, by_complex_step, draw_point, drives, letters, value_of

pytestmark = pytest.mark.unit

ALL = Tolerance(stator_resistance=0.2, inductance=0.1, magnet_flux=0.05)
#: In which a V_d that is no state acts.
DIRECTION = np.array([0.7, -1.1])
#: How unsure that is.
UNSURE = 0.3


def tolerant(drive: Drive, tolerance: Tolerance | None = ALL) -> Drive:
    return drive.model_copy(update={"tolerance": tolerance})


def drawn(seed: int, each: int) -> list[Drive]:
    rng = np.random.default_rng(seed)
    return [tolerant(drive, draw_tolerance(rng)) for drive in drives(seed, each)]


def columns_at(model: StateSpaceModel, x: Any, u: Any) -> np.ndarray:
    """G at a point, (n, data); u is the voltage that arrives, so that a V_d that is a state takes nothing more off."""
    G = model.numeric(ca.densify(ca.horzcat(*model.G.values())))
    _, _, *directions = model.arguments
    g = np.zeros(2) if model.estimates_voltage else [*DIRECTION, UNSURE]
    return np.array(ca.Function("G", model.arguments, [G])(x, u, *(g for _ in directions)))


def test_a_wrong_datum_moves_f_as_the_motor_by_hand_says() -> None:
    """By a complex step of the datum in the hand-written f, on the scale of f's terms; an inverter's of the voltage."""
    rng, compared, doubted = np.random.default_rng(6), 0, 0
    for drive in drawn(4, 3):
        model = build(drive)
        if not model.G:
            continue
        x, u = draw_point(rng, drive, model)
        hand = make_motor(drive.model_dump())
        reach = np.where(np.arange(len(x)) == model.angle, 1.0, np.abs(x))
        by_x = np.abs(by_complex_step(lambda z, u=u, hand=hand: hand.f(z, u), x))
        by_u = np.abs(by_complex_step(lambda v, x=x, hand=hand: hand.f(x, v), u))
        scale = by_x @ reach + by_u @ np.abs(u) + 1e-250
        L_d, L_q = drive.motor.inductance_d, drive.motor.inductance_q
        allowed = 1e-14 * (10 + max(L_d / L_q, L_q / L_d))
        moved = moved_motors(drive.model_dump())
        assert len(moved) == len(deviations(drive))
        theirs = [size * motor.f(x, u).imag / STEP for motor, size in moved]
        by_hand = dict(zip(deviations(drive), theirs, strict=True))
        volts_off = doubt(drive.model_dump())
        if volts_off:
            off, noise = volts_off[0], volts_off[1] * UNSURE
            later = drive.model.sample_time / 2 if drive.model.discretization == "exact" else 0.0
            ahead = np.exp(1j * (x[model.angle] + later * drive.motor.pole_pairs * x[2]))
            volts = {"V_d": -off * DIRECTION}
            for name, way in (("loss_along", ahead), ("loss_across", 1j * ahead)):
                volts[name] = noise * np.array([way.real, way.imag])
            by_hand |= {name: hand.f(x, u + 1j * STEP * v).imag / STEP for name, v in volts.items()}
        for name, ours in zip(model.G, columns_at(model, x, u).T, strict=True):
            compared += 1
            reach = deviations(drive)[name] * scale if name in DATA else by_u.sum(axis=1) * np.linalg.norm(volts[name])
            assert np.all(np.abs(ours - by_hand[name]) <= allowed * reach + 1e-250), (name, drive.motor)
            doubted += name not in DATA
        for name in set(by_hand) - set(model.G):
            assert not np.any(by_hand[name]), name
    assert compared > 200
    assert doubted > 30


def test_each_share_is_the_derivative_of_its_constant() -> None:
    """Of the formula that is printed beside the constant, in 60 digits; some are differences."""
    seen = set()
    for drive in drawn(5, 2):
        relative = deviations(drive)
        with mpmath.workdps(60):
            known = letters(drive)
            constants = {constant.name: constant for constant in build(drive).constants}
            for name, letter in ((f"SIGMA_{a.upper()}_", a) for a in relative):
                for share in (c for c in constants.values() if c.name.startswith(name)):
                    of = constants.get(share.name.removeprefix(name))
                    if of is None or of.formula.startswith(("(1 + a", "1 / L_d -", "L_d - L_q")):
                        continue
                    seen.add(share.name)
                    size = relative[letter] * known[letter]

                    def formula(value: Any, of: Any = of, letter: str = letter, known: Any = known) -> Any:
                        return value_of(of.formula, known | {letter: value} | _named_after(letter, value, known))

                    true = size * mpmath.diff(formula, known[letter], h=known[letter] * mpmath.mpf(10) ** -20)
                    # Of exp(-z) the z roundings of its exponent show.
                    exponent = abs(math.log(abs(of.value))) if of.value else 0.0
                    allowed = (40 + exponent) * EPS * (abs(true) + relative[letter] * abs(of.value)) + 1e-300
                    assert abs(share.value - true) <= allowed, (share, float(true), drive.motor)
    assert {"SIGMA_R_DECAY_I", "SIGMA_L_D_GAIN_V", "SIGMA_PSI_M_GAIN_E", "SIGMA_L_Q_GAIN_HALF_Q"} <= seen


def _named_after(letter: str, value: Any, known: dict[str, Any]) -> dict[str, Any]:
    """What other words of a formula become with the letter."""
    words: dict[str, Any] = {"L": value} if letter == "L_d" else {}
    words |= {"magnet flux linkage": value} if letter == "psi_m" else {}
    R, L_q = ({"R": value, "L_q": value} | {letter: value}).get(letter), known["L_q"]
    if letter in {"R", "L_q"}:
        z = known["T"] * (R if letter == "R" else known["R"]) / (value if letter == "L_q" else L_q)
        words |= {"z": z, "a": mpmath.exp(-z)}
    return words


def test_data_that_f_does_not_hold_have_no_column() -> None:
    assert set(build(tolerant(load_drive("paper_spmsm"))).G) == {"R", "L_d", "psi_m"}


def test_adaptive_states_are_held_within_their_tolerance() -> None:
    """Each by itself and no other, as the bounds by hand say."""
    held = 0
    for drive in drawn(7, 2):
        model = build(drive)
        kept = ca.Function("kept", [model.x], [model.numeric(ca.vertcat(*model.kept(ca.vertsplit(model.x))))])
        own = np.array([0.1, 0.1, 1.0, 0.5, *([0.2] * (len(model.states) - 4))])
        expected = {len(own) + place: (least, most) for place, least, most in bounds(drive.model_dump())}
        for share in (-1e3, 0.999, 1.001, 1e3):
            x = own.copy()
            for place, (least, most) in expected.items():
                x[place] = (least if share < 1 else most) * share
            after = np.array(kept(x)).ravel()
            for place, value in enumerate(x):
                least, most = expected.get(place, (-np.inf, np.inf))
                assert after[place] == pytest.approx(min(max(value, least), most), rel=1e-14), (place, drive.tolerance)
            held += len(expected)
    assert held > 100


def test_without_a_tolerance_nothing_is_uncertain() -> None:
    drive = load_drive("paper_spmsm")
    for exact in (None, Tolerance(), Tolerance(correlation_time=1.0)):
        assert build(tolerant(drive, exact)).G == {}
    assert "tolerance" not in drive.model_dump()


@pytest.mark.parametrize(("name", "left"), [("spmsm_adaptive", {"L_d", "L_q"}), ("ipmsm_flux", set(DATA))])
def test_a_datum_that_is_a_state_has_its_uncertainty_in_P(name: str, left: set[str]) -> None:
    assert set(deviations(tolerant(load_drive(name)))) == left


@pytest.mark.parametrize("machine", ["paper_spmsm", "ipmsm"])
def test_R_matters_with_current_and_psi_with_speed(machine: str) -> None:
    model = build(tolerant(load_drive(machine), Tolerance(stator_resistance=0.2, magnet_flux=0.05)))
    x, u = np.zeros(len(model.states)), np.zeros(2)
    assert not np.any(columns_at(model, x, u))
    with_current, at_speed = x.copy(), x.copy()
    with_current[0], at_speed[2] = 5.0, 100.0
    by_current, by_speed = columns_at(model, with_current, u)[:2], columns_at(model, at_speed, u)[:2]
    assert abs(by_current[0, 0]) > 100 * abs(by_current[0, 1])
    assert np.linalg.norm(by_speed[:, 1]) > 50 * np.linalg.norm(by_speed[:, 0])
    assert columns_at(model, 2 * with_current, u)[0, 0] == pytest.approx(2 * by_current[0, 0])


def test_noise_of_a_voltage_does_not_hang_on_the_sample_time() -> None:
    """Q_p of a second is the same, however many samples there are in it."""
    per_second = []
    for T in (1e-5, 2e-5):
        drive = tolerant(load_drive("paper_spmsm"), Tolerance(stator_resistance=0.3, correlation_time=1e-3))
        drive = drive.model_copy(update={"model": drive.model.model_copy(update={"sample_time": T})})
        G = columns_at(build(drive), np.array([2.0, 1.0, 50.0, 0.3]), np.array([10.0, 20.0]))
        per_second.append((G @ G.T / T)[0, 0])
        sigma = 0.3 / math.sqrt(3) * drive.motor.stator_resistance  # of an even spread
        psd = 2 * 1e-3 * (sigma * 2.0 / drive.motor.inductance_d) ** 2
        assert per_second[-1] == pytest.approx(psd, rel=1e-12)


def test_cautions_say_where_a_tolerance_does_not_help() -> None:
    drive = load_drive("spmsm_load_torque")
    (line,) = cautions(tolerant(drive))
    assert "is 2.7 V at the rated load" in line
    assert "below 112 r/min" in line
    assert not cautions(tolerant(drive, Tolerance(stator_resistance=0.08, inductance=0.1, magnet_flux=0.05)))
    assert not cautions(tolerant(load_drive("spmsm_adaptive"), Tolerance(stator_resistance=0.2)))
    assert not cautions(tolerant(load_drive("ipmsm_adaptive"), Tolerance(magnet_flux=0.1)))
    assert not cautions(tolerant(load_drive("ipmsm_flux")))  # what acts in its h is doubted there


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ({"stator_resistance": -0.1}, "tolerance.stator_resistance = -0.1 is outside 0 .. 0.9"),
        ({"inductance": 1.5}, "tolerance.inductance = 1.5 is outside 0 .. 0.9"),
        ({"resistance": 0.1}, "unknown key tolerance.resistance. Did you mean 'stator_resistance'?"),
        ({"dead_time": 0.3}, "tolerance.dead_time says how far off [inverter] may be, and there is none"),
        ({"correlation_time": 0.0}, "tolerance.correlation_time = 0.0 s is outside 1e-06 .. 1 s"),
    ],
)
def test_a_wrong_section_is_one_line(keys: dict[str, float], says: str) -> None:
    data = load_drive("paper_spmsm").model_dump(exclude={"sha256"}) | {"tolerance": keys}
    with pytest.raises(DriveError) as error:
        parse_drive(data, "t.toml")
    assert says in str(error.value)
