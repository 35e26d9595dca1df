"""Exit codes, options and files of the commands simulate, compare and generate."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import runtime.compare.subject
import runtime.drive.simulate
import runtime.folders.generate
from model.drives.load import load_drive
from runtime.drive.motor import parse_factors
from runtime.drive.simulation import Conditions, Run
from runtime.estimator.folder import find_folder
from runtime.folders.generate import InMemory
from runtime.system.errors import UserError
from tests.conftest import shipped_accounts
from tests.judges.made import POINTS, RPM, Kept, command, read_json, run

T = 1e-3
TIME = T * np.arange(1, 401)


@pytest.mark.parametrize("bad", [None, 0, 1, 3])
def test_simulate_ends_with_1_if_one_run_lost_lock(
    bad: int | None, here: Path, monkeypatch: pytest.MonkeyPatch, kept: Kept
) -> None:
    made: list[Run] = []

    def played(drive: str, scenario: str, kinds: Any, *rest: Any) -> list[Run]:
        found = [run(scenario, kind, angle_error=90.0 if len(made) + k == bad else 1.0) for k, kind in enumerate(kinds)]
        made.extend(found)
        return found

    monkeypatch.setattr(runtime.drive.simulate, "simulate", played)
    code, said = command("simulate", "paper_spmsm", "--json", "s.json", "--out", "o")
    facts = read_json("s.json")
    assert code == (bad is not None), said
    assert said.count("LOST LOCK") == (bad is not None)
    assert [entry["locked"] for entry in facts["runs"]] == [k != bad for k in range(4)]
    order = [(entry["scenario"], entry["filter"]) for entry in facts["runs"]]
    assert order == [(s, k) for s in ("no_load", "load_step") for k in ("ckf", "ickf")]
    assert "start, ICKF" in said, "the paper's drive has the paper's claims"
    assert sorted(path.name for path in Path("o").iterdir()) == sorted(
        [*(f"{s}_{k}.npz" for s, k in order), "no_load.svg", "load_step.svg"]
    )
    with np.load("o/no_load_ckf.npz") as file:
        np.testing.assert_allclose(file["omega"] * RPM, 1000.0)


@pytest.mark.parametrize(
    "words", [{"theta": math.nan}, {"noise": math.inf}, {"dead_time": math.nan}, {"range": -math.inf}]
)
def test_conditions_that_are_no_numbers(words: dict[str, float]) -> None:
    with pytest.raises(UserError, match="is not a finite number"):
        Conditions(**words)  # type: ignore[arg-type]
    with pytest.raises(UserError, match="--offset nan is not a finite number"):
        Conditions(offset=(math.nan, 0.0))


@pytest.mark.parametrize("text", ["R", "R=a", "R=nan", "R=0", "R=-1", "R=inf", "D=1.1", "R=1.1,L=x"])
def test_factors_that_are_none(text: str) -> None:
    with pytest.raises(UserError, match="--factors"):
        parse_factors(text)
    assert parse_factors("") == {}
    assert parse_factors(" psi_m = 0.9, L_q=1.2 ") == {"psi_m": 0.9, "L_q": 1.2}


def test_simulate_hands_its_options_on(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(runtime.drive.simulate, "simulate", lambda *rest: asked.append(rest) or [run()])
    monkeypatch.setattr(runtime.drive.simulate, "sample_time_sweep", lambda *rest, **keys: POINTS)
    arguments = "--scenario load_step --filters ekf --inverter pwm --dead-time 1e-6 --delay 1 --noise 0.2 --bits 10"
    arguments += " --speed 700 --load 2.5 --ramp 0.3 --factors R=1.1,L=0.9 --switch-drop 1.5 --min-pulse 3e-6"
    arguments += " --offset 0.3 --sensored --theta 0.5 --seed 9 --controller numpy --sweep --json s.json"
    code, said = command("simulate", "ipmsm", *arguments.split())
    assert code == 0, said
    ((drive, scenario, kinds, setting, controller, _, task),) = asked
    assert task == {"speed": 700.0, "load": 2.5, "ramp": 0.3}
    assert (drive, scenario, list(kinds), controller) == ("ipmsm", "load_step", ["ekf"], "numpy")
    wrong = {"R": 1.1, "L_d": 0.9, "L_q": 0.9}
    others = {"theta": 0.5, "seed": 9, "factors": wrong, "switch_drop": 1.5, "min_pulse": 3e-6}
    assert setting == Conditions("pwm", 1e-6, 1, 0.2, (0.3, 0.0), 10, sensored=True, **others)
    sweep = read_json("s.json")["sweep"]
    assert [(p["sample_time"], p["discretization"], p["locked"]) for p in sweep] == [
        (p.sample_time, p.discretization, p.locked) for p in POINTS
    ]
    assert "loses lock" in said
    assert "start, ICKF" not in said


@pytest.mark.parametrize("bad", [None, (0, 0), (1, 1)])
def test_compare_ends_with_1_if_one_lost_lock(
    bad: Any, here: Path, monkeypatch: pytest.MonkeyPatch, kept: Kept
) -> None:
    count = iter(range(9))

    def played(label: str, folder: Any, progress: Any) -> tuple[Run, ...]:
        k = next(count)
        return tuple(run("load_step", "ckf", angle_error=90.0 if (k, j) == bad else 1.0) for j in range(2))

    monkeypatch.setattr(runtime.compare.subject, "_runs", played)
    code, said = command("compare", "paper_spmsm", "spmsm_load_torque", "--json", "c.json", "--out", "p")
    assert Path("p/index.html").is_file()
    assert code == (bad is not None), said
    assert said.count("LOST") == (bad is not None)
    facts = read_json("c.json")["accuracy"]
    found = [[entry["locked"] for entry in facts[name]] for name in ("paper_spmsm", "spmsm_load_torque")]
    assert found == [[(k, j) != bad for j in range(2)] for k in range(2)]


def test_generate_check_ends_with_1_on_any_difference(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One stale folder of two; a file too many, too few, or with another text; and nothing is written."""
    files = {"a.c": "one\n", "manifest.json": "{}\n"}
    names = ["paper_spmsm", "ipmsm"]
    generate = runtime.folders.generate
    monkeypatch.setattr(generate, "_generate_all", lambda *rest: [InMemory(name, dict(files)) for name in names])
    arguments = ["generate", *names, "--out", "g"]
    assert command(*arguments, "--check")[0] == 1
    assert not Path("g").exists()
    code, said = command(*arguments)
    assert (code, said.count("new")) == (0, 2), said
    code, said = command(*arguments, "--check")
    assert (code, said.count("unchanged"), "stale" in said) == (0, 2, False), said
    path = Path("g/ipmsm/a.c")
    for change in (lambda: path.write_text("two\n"), path.unlink):
        change()
        code, said = command(*arguments, "--check")
        assert (code, said.count("stale"), said.count("unchanged")) == (1, 1, 1), said
        assert "a.c" in said
    assert not path.exists()


def test_generate_says_what_takes_longer_than_the_sample_time(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the drive that it is true of, with the shares; nothing fails for it, and nothing is said of the other."""
    generate = runtime.folders.generate
    remarks = {}
    for name in ("paper_spmsm", "spmsm_load_torque"):
        remarks[name] = generate._too_long(load_drive(name), shipped_accounts(name))
    made = [InMemory(name, {"a.c": "one\n", "manifest.json": "{}\n"}, remark) for name, remark in remarks.items()]
    monkeypatch.setattr(generate, "_generate_all", lambda *rest: made)
    code, said = command("generate", *remarks, "--out", "g")
    assert (code, said.count("longer than its sample time")) == (0, 1), said
    shares = find_folder("paper_spmsm").manifest["filters"]["ickf"]["interrupt"]
    assert "drive 'paper_spmsm': longer than its sample time on the TI TMS320F28335, at the worst" in said
    for mode, facts in shares.items():
        assert f"ickf, {mode} {100 * facts['share_of_sample']:.0f} %" in said
