"""A design tried in the closed loop: what holds is said to hold, and a planted fault is seen and named."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from codegen.generate import Package
from model.drives.load import load_drive
from model.inverter import lost_voltage
from runtime.design.cost import priced
from runtime.design.facts import Facts, read_facts
from runtime.design.known import COMPENSATION_SAMPLES, fading_current
from runtime.design.rules import Choice, Design, design
from runtime.design.tables import verdict_of
from runtime.design.trial import ENOUGH, Point, Trial, blame, draw, judge, load_step, package, simulator, try_out
from runtime.design.write import drive_text
from runtime.drive.scenario import Scenario
from runtime.drive.simulation import Conditions, Run
from tests import forked
from tests.conftest import thoroughly

DATA = Path(__file__).parents[1] / "data" / "facts"


@pytest.fixture(scope="module")
def outrunner() -> tuple[Facts, Design]:
    facts = read_facts(DATA / "outrunner.toml")
    return facts, design(facts)


@pytest.fixture(scope="module")
def generated(outrunner: tuple[Facts, Design]) -> Package:
    return package(outrunner[1])


def test_a_design_holds_within_its_tolerances(outrunner: tuple[Facts, Design], generated: Package) -> None:
    facts, chosen = outrunner
    told: list[tuple[int, int]] = []
    trial = try_out(facts, chosen, generated, 16, 1, (0.1, 1.0), progress=lambda *done: told.append(done))
    assert trial.holds
    assert trial.success == 1.0
    assert (trial.hurts, blame(trial)) == ({}, [])
    assert sorted(told) == [(k, 32) for k in range(1, 33)]
    again = try_out(facts, chosen, generated, 16, 1, (0.1, 1.0))
    for one, other in zip(trial.points, again.points, strict=True):
        np.testing.assert_array_equal(one.angle, other.angle)


@pytest.mark.parametrize(
    ("motor", "width", "most", "cause"),
    [("gimbal", "d_psi", 0.4, "magnet_flux"), *thoroughly(("lift", "d_R", 0.6, "stator_resistance"))],
)
def test_facts_that_are_worse_than_stated_are_found_and_named(motor: str, width: str, most: float, cause: str) -> None:
    """The design is told one tolerance, the motors have another; all else they are exactly."""
    facts = read_facts(DATA / f"{motor}.toml")
    chosen = design(facts)
    exact = replace(facts, d_R=0.0, d_L=0.0, d_psi=0.0, d_J=0.0, angle=0.0)
    made = package(chosen)
    assert try_out(exact, chosen, made, 24, 1, (0.1,)).holds
    trial = try_out(replace(exact, **{width: most}), chosen, made, 24, 1, (0.1,))
    assert not trial.holds
    assert trial.hurts == {0.1: [cause]}
    (line,) = blame(trial)
    speed = 0.1 * facts.speed * 30 / np.pi
    assert line.startswith(f"{cause} within {most:.0%} is not enough up to {speed:.3g} r/min: identify it")


def test_a_filter_that_expects_no_load_is_seen_to_fail(outrunner: tuple[Facts, Design]) -> None:
    facts, chosen = outrunner
    q = list(chosen.sections["filter"]["process_noise"].value)
    q[4] *= 1e-6
    sections = {**chosen.sections, "filter": {**chosen.sections["filter"], "process_noise": Choice(q, "planted")}}
    planted = replace(chosen, sections=sections)
    assert try_out(facts, planted, package(planted), 16, 1, (0.1,), blamed=False).success < 0.5


def test_draws_fill_their_tolerances_and_a_round_rotor_stays_round(outrunner: tuple[Facts, Design]) -> None:
    facts = replace(outrunner[0], d_R=0.11, d_L=0.12, d_psi=0.13, d_J=0.14)
    drawn = draw(facts, 4000, 3)
    for name, width in (("R", facts.d_R), ("L_d", facts.d_L), ("psi_m", facts.d_psi), ("J", facts.d_J)):
        off = drawn.factors[name] - 1
        assert 0.98 * width < np.max(np.abs(off)) <= width
        assert abs(np.mean(off)) < 0.1 * width
    np.testing.assert_array_equal(drawn.factors["L_d"], drawn.factors["L_q"])
    assert 0.98 * facts.angle < np.max(np.abs(drawn.theta)) <= facts.angle
    salient = draw(read_facts(DATA / "traction_70kw.toml"), 100, 3)
    assert np.any(salient.factors["L_d"] != salient.factors["L_q"])
    known = drawn.exactly(("R", "theta"))
    assert not np.any(known.theta)
    assert np.all(known.factors["R"] == 1)
    np.testing.assert_array_equal(known.factors["J"], drawn.factors["J"])


def test_the_scenario_suits_the_share_of_speed(outrunner: tuple[Facts, Design], generated: Package) -> None:
    facts, drive = outrunner[0], generated.drive
    for share in (0.01, 0.1, 1.0):
        scenario = load_step(drive, share)
        assert scenario.speed == pytest.approx(share * facts.speed * 60 / (2 * np.pi), rel=1e-5)
        assert scenario.load == pytest.approx(facts.torque)
        turned = facts.p * share * facts.speed * (scenario.duration - scenario.load_at)
        assert turned >= np.pi or scenario.duration - scenario.load_at >= 1.0
    assert load_step(drive, 1.0).ramp > load_step(drive, 0.1).ramp


def test_the_generated_controller_makes_up_for_the_dead_time_by_itself(
    outrunner: tuple[Facts, Design], generated: Package
) -> None:
    """What is tried is what is generated: no datum of the firmware is set by hand."""
    facts, chosen = outrunner
    assert lost_voltage(generated.drive) == pytest.approx(facts.dc_link * facts.dead_time / facts.T, rel=1e-5)
    with simulator(generated, chosen.kind) as loop:
        gain = dict(zip(loop.module.GAIN_NAMES, loop._gain(Conditions(inverter="pwm")), strict=True))
        assert gain["compensation"] == 1.0
        assert gain["dead_current"] == pytest.approx(fading_current(facts, COMPENSATION_SAMPLES))
        assert loop._machine(Conditions()).dead_time == pytest.approx(facts.dead_time, rel=1e-5)


def test_an_inverter_whose_dead_time_is_another_is_seen_to_fail() -> None:
    """The same design behind twice the dead time that it was told of."""
    facts = read_facts(DATA / "gimbal.toml")
    chosen = design(facts)
    told, actual, made = facts, replace(facts, dead_time=2 * facts.dead_time), package(chosen)
    success = [try_out(of, chosen, made, 12, 1, (0.1,), blamed=False).success for of in (told, actual)]
    assert success[0] == 1.0
    assert success[1] < 0.5


# --- verdicts, on evidence made by hand


def run_of(angle: float, speed: float, estimate: float = 0.0) -> Run:
    """A run of 1 s at 100 r/min whose angle is wrong by degrees and whose speed ends at ``speed`` r/min."""
    t = np.linspace(0.0, 1.0, 1001)
    still, omega = np.zeros_like(t), np.full_like(t, speed * np.pi / 30)
    x = np.column_stack([still, still, omega + estimate, np.full_like(t, np.radians(angle))])
    pair = np.zeros((len(t), 2))
    scenario = Scenario("made", 100.0, 0.1, 1.0, 0.5, 1.0)
    status = np.zeros(len(t), dtype=int)
    truth = (omega, still, still, still)
    sigma = np.where(t < 0.25, 0.6, 0.7)
    return Run(scenario, "ckf", ("i_alpha", "i_beta", "omega", "theta"), t, pair, pair, *truth, x, sigma, pair, status)


@pytest.mark.parametrize(
    ("angle", "speed", "locked", "reached"),
    [(29.0, 100.0, 1, 1), (31.0, 100.0, 0, 1), (0.0, 109.0, 1, 1), (0.0, 111.0, 1, 0), (float("nan"), 100.0, 0, 1)],
)
def test_a_run_is_judged_by_angle_and_speed(angle: float, speed: float, locked: int, reached: int) -> None:
    found = judge(run_of(angle, speed))
    assert found[:2] == (locked, reached)
    assert found[2] == pytest.approx(angle) if np.isfinite(angle) else np.isinf(found[2])


def test_errors_count_from_the_load_step_on() -> None:
    run = run_of(2.0, 100.0, estimate=3 * np.pi / 30)
    run.x[:400, 2:] += [20.0, 0.9]  # the load steps at 500
    assert judge(run)[2:4] == pytest.approx((2.0, 3.0))


def test_three_sigmas_of_p_count_from_the_first_sample_on() -> None:
    """2 degrees off, where P says 0.6 degrees for the first quarter of the samples and 0.7 then; NaN is off."""
    assert judge(run_of(2.0, 100.0))[4] == pytest.approx(751 / 1001)
    assert judge(run_of(float("nan"), 100.0))[4] == 0.0


def point(share: float, held: int, of: int = 100, locked: int | None = None) -> Point:
    truth = np.arange(of) < held
    lock = truth if locked is None else np.arange(of) < locked
    return Point(share, 3000 * share, lock, truth, *np.zeros((3, of)))


def test_a_trial_holds_where_enough_draws_do_and_never_over_nothing(outrunner: tuple[Facts, Design]) -> None:
    facts, _ = outrunner
    assert ENOUGH == 0.99
    assert Trial(facts, [point(0.05, 0), point(0.1, 99), point(1.0, 100)]).holds
    assert not Trial(facts, [point(0.1, 98), point(1.0, 100)]).holds
    assert not Trial(facts, [point(0.05, 100)]).holds
    assert not Trial(facts, []).holds
    assert not point(1.0, 0, 0).holds
    assert Trial(facts, [point(0.05, 0), point(0.1, 99), point(1.0, 50)]).success == 0.5
    assert verdict_of(point(0.1, 99))[0] == "holds"
    assert verdict_of(point(0.1, 50)) == ("loses the rotor (more than 30 degrees off)", "red")
    assert verdict_of(point(0.05, 50, locked=100)) == ("keeps the rotor, does not keep the speed", "yellow")


def test_blame_names_the_highest_speed_a_fact_is_short_of(outrunner: tuple[Facts, Design]) -> None:
    facts, _ = outrunner
    points = [point(0.01, 0), point(0.05, 0), point(0.1, 99)]
    lines = blame(Trial(facts, points, {0.01: ["stator_resistance"], 0.05: ["stator_resistance", "inductance"]}))
    assert lines == [
        "stator_resistance within 20% is not enough up to 150 r/min: identify it, or adapt it.",
        "inductance within 10% is not enough up to 150 r/min: identify it.",
    ]
    assert "no single fact explains what is lost at 30 r/min" in blame(Trial(facts, points, {0.01: []}))[0]


def test_a_budget_is_set_where_the_step_fits_and_said_where_not(outrunner: tuple[Facts, Design]) -> None:
    facts, _ = outrunner
    budgets = {}
    for T in (200e-6, 50e-6, 10e-6):
        chosen = design(replace(facts, T=T, dead_time=0.0))
        dear = priced(chosen, package(chosen))
        budgets[T] = (dear.sections["budget"], dear.remarks[len(chosen.remarks) :])
    assert budgets[200e-6][0]["controller_cycles"].value == 15_000
    assert budgets[200e-6][1] == []
    assert budgets[50e-6][0]["controller_cycles"].value == 7500
    assert "of 7500 cycles" in budgets[50e-6][1][0]
    assert "controller_cycles" not in budgets[10e-6][0]
    assert "a faster processor" in budgets[10e-6][1][0]


# --- the command


def call(*arguments: str, cwd: Path) -> Any:
    return forked.call(*arguments, cwd=cwd, environment={})


def test_the_command_writes_a_file_that_generates(tmp_path: Path) -> None:
    facts = str(DATA / "outrunner.toml")
    done = call("design", facts, "--out", "mine.toml", "--draws", "8", "--json", "f.json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr + done.stdout
    assert "outrunner: holds" in done.stdout
    drive = load_drive(tmp_path / "mine.toml")
    assert drive.name == "outrunner"
    found = json.loads((tmp_path / "f.json").read_text())
    assert found["holds"]
    assert [p["share_of_speed"] for p in found["points"]] == [0.01, 0.05, 0.1, 0.5, 1.0]
    assert found["choices"]["filter"]["process_noise"]["value"] == list(drive.filter.process_noise)
    generated = call("generate", "mine.toml", cwd=tmp_path)
    assert generated.returncode == 0, generated.stderr


def test_check_writes_nothing_and_bad_words_are_bad_input(tmp_path: Path) -> None:
    facts = str(DATA / "servo_400w.toml")
    done = call("design", facts, "--check", "--draws", "8", cwd=tmp_path)
    assert done.returncode == 0, done.stderr + done.stdout
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "bad.toml").write_text("name = 'x'")
    for words in ([facts], [facts, "--check", "--out", "x.toml"], ["bad.toml", "--check"], ["none.toml", "--check"]):
        refused = call("design", *words, cwd=tmp_path)
        assert refused.returncode == 2, words
        assert len(refused.stderr.splitlines()) == 1


def test_a_design_that_does_not_hold_ends_with_1(tmp_path: Path) -> None:
    """A voltage that ends before the rated speed."""
    text = (DATA / "servo_400w.toml").read_text().replace("dc_link = 310.0", "dc_link = 77.5")
    (tmp_path / "servo.toml").write_text(text)
    done = call("design", "servo.toml", "--out", "mine.toml", "--draws", "8", cwd=tmp_path)
    assert done.returncode == 1, done.stdout
    assert "does NOT hold" in done.stdout
    assert (tmp_path / "mine.toml").is_file()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["fan", *thoroughly("wind")])
def test_a_design_is_proved(name: str, tmp_path: Path) -> None:
    """Surface with an adaptive resistance; L_d above L_q. Their generated filters are the same filter, too."""
    from runtime.folders.generate import generate_drives
    from runtime.folders.resolve import find_drive
    from runtime.proof.verify import prove
    from tests.runtime.test_proof import QUICK

    facts = read_facts(DATA / f"{name}.toml")
    path = tmp_path / "mine.toml"
    path.write_text(drive_text(design(facts), "x"))
    (written,) = generate_drives([str(path)], tmp_path)
    proof, _ = prove(find_drive(written.folder), QUICK, lambda text: None, current=True)
    assert proof.passed, proof.failures()


def test_every_facts_file_says_what_it_is() -> None:
    names = [path.stem for path in sorted(DATA.glob("*.toml"))]
    assert len(names) >= 18
    for name in names:
        text = (DATA / f"{name}.toml").read_text()
        assert text.startswith("# ")
        assert tomllib.loads(text)["name"] == name
