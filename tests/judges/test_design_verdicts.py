"""Verdicts, figures, exit codes and words of ``design`` and ``new``, on trials made by hand."""

from __future__ import annotations

import io
import json
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import runtime.design.cost
import runtime.design.trial
from codegen.targets.find import default_target
from runtime.design.facts import EXAMPLE, parse_facts
from runtime.design.known import filter_bandwidth, rated_point, unknown_share, unsaid_share
from runtime.design.rules import Choice, Design, design
from runtime.design.tables import trial_facts, trial_table
from runtime.design.trial import Draws, Point, Trial, load_step, package
from runtime.design.write import edit_drive, facts_text
from tests.judges.made import cells_of, command, read_json

pytestmark = pytest.mark.unit

FACTS = parse_facts(EXAMPLE, "x")
DESIGN = design(FACTS)


def point(share: float, locked: Sequence[int], reached: Sequence[int], angle: Any = 0.0, off: Any = 0.0) -> Point:
    of = np.ones(len(locked))
    speed = 3000 * share
    honest = np.linspace(0.5, 1.0, len(of))
    return Point(share, speed, np.array(locked) > 0, np.array(reached) > 0, angle * of, off * of, honest)


GOOD, BAD = [1] * 8, [0] * 8
#: 100 draws: angles 1 .. 100 degrees, speeds 3 .. 300 r/min off, the last infinitely.
MANY = point(
    1.0, [1] * 75 + [0] * 25, [0] * 40 + [1] * 60, np.arange(1.0, 101.0), np.r_[3.0 * np.arange(1, 100), np.inf]
)


# --- table and JSON


def test_the_table_and_the_figures_of_a_trial() -> None:
    trial = Trial(FACTS, [point(0.1, [1] * 100, [1] * 100), MANY], {1.0: ["inertia"]})
    first, second = cells_of(trial_table(trial))
    held = ["10%", "300", "100", "100.0%", "100.0%", "0.0\u00b0", "75.0%", "0.0% of rated", "[green]holds[/green]"]
    assert first == held
    # the 96th of a hundred in order is the first that 95 % are below: 96 degrees, 288 of 3000 r/min
    assert second[:8] == ["100%", "3e+03", "100", "75.0%", "60.0%", "96.0\u00b0", "75.0%", "9.6% of rated"]
    told = trial_facts(trial, DESIGN)
    assert told["holds"] is False
    assert trial_facts(Trial(FACTS, [point(0.1, GOOD, GOOD)]), DESIGN)["holds"] is True
    small, large = told["points"]
    assert (small["holds"], small["held"], small["hurts"]) == (True, 1.0, [])
    assert small["within_3_sigma"] == pytest.approx(0.75)
    assert (large["holds"], large["locked"], large["reached"], large["held"]) == (False, 0.75, 0.6, 0.35)
    assert (large["angle_95"], large["speed_error_95"], large["hurts"]) == (96.0, 288.0, ["inertia"])
    lost = point(0.5, BAD, BAD, np.inf, np.inf)
    assert trial_facts(Trial(FACTS, [lost]), DESIGN)["points"][0]["angle_95"] is None
    assert json.dumps(trial_facts(Trial(FACTS, [lost]), DESIGN), allow_nan=False)


# --- who is to blame, where the loop is a table of who mends what

LOST = point(0.1, [0] * 10 + [1] * 10, [1] * 20)


def mended_by(monkeypatch: pytest.MonkeyPatch, luck: float, **shares: float) -> list[str]:
    """The facts to blame if each, known exactly, mends such a share of ten draws, and other noise ``luck`` of them."""
    motors = Draws({name: np.full(20, 1.1) for name in ("R", "L_d", "L_q", "psi_m", "J")}, np.full(20, 0.3))
    asked: list[list[int]] = []

    def found(
        loop: Any,
        facts: Any,
        scenario: Any,
        share: float,
        again: Draws,
        which: list[int],
        tell: Any,
        seeds: int,
    ) -> Point:
        asked.append(which)
        known = {name for name, factor in again.factors.items() if np.all(factor == 1)}
        known |= set() if np.any(again.theta) else {"theta"}
        by = {"R": "stator_resistance", "L_d": "inductance", "L_q": "inductance", "psi_m": "magnet_flux"}
        causes = {by.get(name, {"J": "inertia", "theta": "angle"}.get(name, "")) for name in known}
        mends = luck if seeds else shares.get(causes.pop(), 0.0) if causes else 0.0
        return point(share, np.arange(len(which)) < mends * len(which), [1] * len(which))  # type: ignore[arg-type]

    monkeypatch.setattr(runtime.design.trial, "_point", found)
    named = runtime.design.trial._to_blame(None, FACTS, None, LOST, motors)  # type: ignore[arg-type]
    assert {tuple(which) for which in asked} == {tuple(range(10))}, "what held needs no mending"
    return named


def test_blame_is_for_what_mends_and_for_no_more_than_two(monkeypatch: pytest.MonkeyPatch) -> None:
    one = mended_by(monkeypatch, 0.0, stator_resistance=0.9, inductance=0.3)
    assert one == ["stator_resistance"]
    assert mended_by(monkeypatch, 0.0, stator_resistance=0.4) == [], "less than half"
    assert mended_by(monkeypatch, 0.7, stator_resistance=0.9) == [], "hardly more than by luck"
    assert mended_by(monkeypatch, 0.0, stator_resistance=1.0, inertia=0.6) == ["stator_resistance"], "beside the best"
    assert mended_by(monkeypatch, 0.0, magnet_flux=0.8, inertia=0.9) == ["magnet_flux", "inertia"]
    assert mended_by(monkeypatch, 0.0, magnet_flux=0.8, inertia=0.9, angle=0.9) == [], "whatever is done"


# --- the command


def tried(monkeypatch: pytest.MonkeyPatch, trial: Trial, remarks: Sequence[str] = ()) -> None:
    monkeypatch.setattr(runtime.design.trial, "package", lambda drafted: None)
    monkeypatch.setattr(runtime.design.cost, "priced", lambda drafted, made: replace(drafted, remarks=list(remarks)))
    monkeypatch.setattr(runtime.design.trial, "try_out", lambda *given, **keys: trial)


def facts_file(path: Path, tables: dict[str, Any] = EXAMPLE) -> str:
    path.write_text(facts_text(tables))
    return str(path)


def test_exit_code_and_words_follow_the_verdict(monkeypatch: pytest.MonkeyPatch, here: Path) -> None:
    facts = facts_file(here / "facts.toml")
    for good in (True, False):
        low = point(0.05, BAD, BAD)
        tried(monkeypatch, Trial(FACTS, [low, point(0.1, GOOD, GOOD if good else BAD)]), ["something to remark"])
        code, said = command("design", facts, "--out", "mine.toml", "--json", "f.json")
        assert code == (0 if good else 1)
        assert ("example: holds at a tenth" in said, "example: does NOT hold" in said) == (good, not good)
        assert "something to remark" in said
        assert "Drive file: mine.toml" in said
        assert read_json("f.json")["holds"] is good
        assert tomllib.loads(Path("mine.toml").read_text()) == DESIGN.tables()


def test_words_that_do_not_go_together_are_refused(monkeypatch: pytest.MonkeyPatch, here: Path) -> None:
    facts = facts_file(here / "facts.toml")
    tried(monkeypatch, Trial(FACTS, [point(0.1, GOOD, GOOD)]))
    for words in ((), ("--check", "--out", "x.toml"), ("--check", "--write", "x.toml")):
        code, said = command("design", facts, *words)
        assert (code, len(said.splitlines())) == (2, 1)
    assert command("design", facts, "--check")[0] == 0
    assert [path.name for path in here.iterdir()] == ["facts.toml"]


# --- questions, answered here

#: Up to the section [inverter], which is left open.
HALF = ("2", "0.6", "2", "0.5 mH", "1", "7e-3", "1", "4", "1e-5", "", "1", "3000", "1", "0.15", "10", *[""] * 4, "24")


def answered(monkeypatch: pytest.MonkeyPatch, *answers: str, words: Sequence[str] = ("mine",)) -> tuple[int, str]:
    monkeypatch.setattr("sys.stdin", io.StringIO("".join(f"{line}\n" for line in answers)))
    tried(monkeypatch, Trial(FACTS, [point(0.1, GOOD, GOOD)]))
    return command("new", *words)


def test_what_is_answered_becomes_the_facts_file(monkeypatch: pytest.MonkeyPatch, here: Path) -> None:
    code, said = answered(monkeypatch, *HALF, "1", "100us", "1 us", "20", "", "", "", "")
    assert code == 0, said
    assert {path.name for path in here.iterdir()} == {"mine_facts.toml", "mine.toml"}
    stated = parse_facts(tomllib.loads(Path("mine_facts.toml").read_text()), "x")
    assert stated == replace(FACTS, name="mine", dead_time=1e-6)


def test_a_dead_time_of_half_a_sample_is_asked_for_again(monkeypatch: pytest.MonkeyPatch, here: Path) -> None:
    code, said = answered(monkeypatch, *HALF, "1", "100us", "50 us", "1 us", "20", "", "", "", "")
    assert code == 0
    assert said.count("Dead time (s) [0]:") == 2
    assert "inverter.dead_time = 5e-05 s is more than a fifth of the sample time" in said


def test_nonsense_is_not_kept_and_an_end_loses_nothing(monkeypatch: pytest.MonkeyPatch, here: Path) -> None:
    code, said = answered(monkeypatch, "2", "a few", "0.6", "2", "300")
    assert code == 2
    assert "motor.line_inductance = 300 H is outside" in said
    assert "What was answered lies in mine_facts.part.toml" in said
    assert Path("mine_facts.part.toml").is_file()
    assert tomllib.loads(Path("mine_facts.part.toml").read_text()) == {
        "name": "mine",
        "motor": {"line_resistance": 0.6},
    }


def test_a_file_stays_without_a_yes(monkeypatch: pytest.MonkeyPatch, here: Path) -> None:
    Path("mine.toml").write_text("hers")
    for answer in ("", "no", "perhaps"):
        code, said = answered(monkeypatch, answer)
        assert code == 2
        assert ("stays as it is" in said) == (answer != "perhaps")
        assert said.count("Overwrite it?") == (2 if answer == "perhaps" else 1)
    assert Path("mine.toml").read_text() == "hers"


# --- rules by another way


def test_facts_of_one_motor_each_at_its_place() -> None:
    """Numbers that are all different, as they are kept."""
    motor = {"stator_resistance": 0.5, "inductance_d": 2e-3, "inductance_q": 3e-3, "magnet_flux": 0.1, "poles": 6}
    tables = EXAMPLE | {
        "motor": motor | {"inertia": 1e-3, "friction": 2e-4},
        "tolerance": {"stator_resistance": 0.11, "inductance": 0.12, "magnet_flux": 0.13, "inertia": 0.14},
        "sensor": {"range": 40.0, "bits": 10, "noise": 0.05},
        "inverter": {"dc_link": 300.0, "sample_time": 1e-4},
    }
    f = parse_facts(tables, "x")
    assert (f.L_d, f.L_q, f.p, f.D, f.max_current) == (2e-3, 3e-3, 3, 2e-4, 10.0)
    assert (f.d_R, f.d_L, f.d_psi, f.d_J) == (0.11, 0.12, 0.13, 0.14)
    # three legs at half of the link make phase voltages on a hexagon, whose inner circle touches the middle of a side
    corners = [2 / 3 * 300.0 * np.exp(1j * np.pi / 3 * k) for k in range(2)]
    assert f.voltage == pytest.approx(abs(sum(corners)) / 2)
    codes = np.random.default_rng(1).uniform(-40, 40, 200_000)
    rounding = codes - np.round(codes / (80 / 2**10)) * (80 / 2**10)
    assert f.sigma == pytest.approx(np.hypot(0.05, np.std(rounding)), rel=1e-2)
    turns = np.unwrap(np.angle(np.exp(1j * f.p * f.speed * np.linspace(0, 1, 20_000))))
    assert f.omega_e == pytest.approx(turns[-1])


def test_kappa_by_its_parts() -> None:
    """Each part alone, from volts: of R i, of the back-EMF, of L's drop at rated speed, of the dead time's mean."""
    f = replace(FACTS, d_R=0.0, d_L=0.0, d_psi=0.0, L_q=3 * FACTS.L_d)
    at = rated_point(f)
    none = unknown_share(f, at)

    def volts(**changes: float) -> float:
        return float(np.sqrt(unknown_share(replace(f, **changes), at) ** 2 - none**2)) * f.dc_link / np.sqrt(3)

    peak = 2 / np.sqrt(3)  # of what is spread over a period of six pulses
    assert volts(d_R=0.01) == pytest.approx(peak * 0.01 * f.R * at.current)
    assert volts(d_psi=0.1) == pytest.approx(peak * 0.3 * 0.1 * f.p * f.speed * f.psi_m)
    assert volts(d_L=0.1) == pytest.approx(peak * 0.3 * 0.1 * f.p * f.speed * f.L_q * at.current)
    assert volts(dead_time=1e-6) == pytest.approx(0.8 * f.dc_link * 1e-6 / f.T / 2)
    assert unsaid_share(replace(f, d_R=0.2, dead_time=1e-6)) == unknown_share(replace(f, dead_time=1e-6), at)
    adapted = replace(f, d_R=0.9, R=10 * f.R)  # more than the back-EMF at a tenth of rated speed
    exact = np.sqrt(unknown_share(adapted, at) ** 2 - none**2) * f.dc_link / np.sqrt(3)
    assert exact == pytest.approx(0.6 * peak * 0.9 * 10 * f.R * at.current)


def test_the_filter_follows_as_a_kalman_filter_of_a_double_integrator_does() -> None:
    """Its bandwidth is that of the poles of the continuous Riccati equation's solution."""
    from scipy.linalg import solve_continuous_are

    for facts in (FACTS, replace(FACTS, p=9, T=5e-5, J=3e-4, torque=0.4, step_every=1.0)):
        at = rated_point(facts)
        r = (unknown_share(facts, at) * facts.voltage / facts.psi_m) ** 2 * facts.T
        q = 5 * (facts.p * facts.torque / facts.J) ** 2 / facts.step_every  # of the electrical acceleration
        A, C = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[1.0, 0.0]])
        P = solve_continuous_are(A.T, C.T, np.diag([0.0, q]), np.array([[r]]))
        poles = np.linalg.eigvals(A - P @ C.T @ C / r)
        assert filter_bandwidth(facts, at) == pytest.approx(np.abs(poles[0]), rel=1e-6)


def test_sensor_box_and_saliency() -> None:
    assert not [line for line in DESIGN.remarks if "does not cover" in line]
    assert any("does not cover" in line for line in design(replace(FACTS, max_current=30.0)).remarks)
    box = DESIGN.sections["operating_box"]["current"].value
    assert box >= 2 * FACTS.max_current
    for L_d, L_q, machine in ((1e-3, 1e-3, "surface"), (1e-3, 2e-3, "salient_flux"), (2e-3, 1e-3, "salient_flux")):
        assert design(replace(FACTS, L_d=L_d, L_q=L_q)).sections["model"]["machine"].value == machine
    assert design(replace(FACTS, R=0.123456)).sections["motor"]["stator_resistance"].value == 0.123456
    at = rated_point(replace(FACTS, L_q=3 * FACTS.L_d))
    assert at.i_d < 0 < at.i_q


def test_a_load_step_lasts_half_an_electrical_turn_at_least() -> None:
    drive = package(DESIGN).drive
    for share in (0.005, 0.01, 0.1):
        scenario = load_step(drive, share)
        watched = scenario.duration - scenario.load_at
        assert watched >= min(1.0, np.pi / (FACTS.p * share * FACTS.speed)) * 0.999


# --- what is written


def made_design(reason: str, value: Any = 0.3) -> Design:
    return Design("d", {"motor": {"stator_resistance": Choice(value, reason)}})


def test_her_comment_stays_and_a_new_reason_follows_it(tmp_path: Path) -> None:
    path = tmp_path / "d.toml"
    path.write_text('name = "d"\n[motor]\nstator_resistance = 0.1 # by Anna\n')
    path.write_text(edit_drive(made_design("first"), path))
    assert "stator_resistance = 0.3 # by Anna; now: first" in path.read_text()
    path.write_text(edit_drive(made_design("second", 0.4), path))
    assert "stator_resistance = 0.4 # by Anna; now: second" in path.read_text()
    same = path.read_text()
    assert edit_drive(made_design("third", 0.4), path) == same


def test_every_value_has_its_reason_in_the_file() -> None:
    from runtime.design.write import drive_text

    for reason in ("short", "long " * 30):
        text = drive_text(made_design(reason.strip()), "facts.toml").splitlines()
        at = next(k for k, line in enumerate(text) if line.startswith("stator_resistance = 0.3"))
        assert any(f"# {reason.strip()}" in line for line in text[at - 1 : at + 1])


def test_cost_of_a_design_by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """150 cycles a microsecond; half of a sample where that is enough, else all; words in steps of 32, upwards."""
    for spent, budget, said in ((7000, 7500, ""), (9000, 15000, "9000 of 15000"), (16000, None, "of 107 us or more")):
        operations = {"copied": spent - default_target().prices.interrupt}  # type: ignore[union-attr]
        account = SimpleNamespace(controller=SimpleNamespace(operations=operations), filter=SimpleNamespace(words=65))
        monkeypatch.setattr(runtime.design.cost, "count", lambda drive, files, account=account: {"ckf": account})
        drive = SimpleNamespace(model=SimpleNamespace(sample_time=1e-4), target_name="f28335")
        made = SimpleNamespace(drive=drive, files={})
        chosen = runtime.design.cost.priced(replace(DESIGN, remarks=[]), made)  # type: ignore[arg-type]
        stated = chosen.sections["budget"].get("controller_cycles")
        assert (stated.value if stated else None) == budget
        assert chosen.sections["budget"]["ram_words"].value == 96
        assert said in "".join(chosen.remarks)
        assert len(chosen.remarks) == bool(said)
