"""A verdict over nothing does not hold: no drive, no run, no step, no execution ends a command with 0."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import runtime.commands.run
import runtime.compare.subject
import runtime.drive.simulate
import runtime.endurance.fuzz
import runtime.endurance.soak
import runtime.faults.survey
import runtime.firmware.gates
import runtime.proof.drives
from runtime.endurance.fuzz import Campaign
from runtime.report.page import write_page
from runtime.report.run import Ran
from runtime.system.verdicts import all_hold
from tests.judges.made import command, outcome, read_json, soak


def test_all_hold_by_truth_table() -> None:
    table = {(): False, (True,): True, (False,): False, (True, True): True, (True, False): False, (False, True): False}
    for verdicts, held in table.items():
        assert all_hold(iter(verdicts)) is held


def _play(monkeypatch: pytest.MonkeyPatch, module: Any, name: str, answer: Any) -> None:
    monkeypatch.setattr(module, name, lambda *rest, **keys: answer)


def test_no_proof_is_no_proof(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _play(monkeypatch, runtime.proof.drives, "_verify_all", [])
    assert command("verify", "paper_spmsm", "--json", "v.json")[0] == 1
    assert read_json("v.json") == {"passed": False, "drives": []}


def test_no_gate_is_no_gate(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _play(monkeypatch, runtime.firmware.gates, "check_ready", None)
    _play(monkeypatch, runtime.firmware.gates, "share", [])
    assert command("firmware", "paper_spmsm", "ipmsm", "--json", "f.json")[0] == 1
    assert read_json("f.json") == {"passed": False, "drives": []}


def test_no_chapter_is_no_result(monkeypatch: pytest.MonkeyPatch) -> None:
    _play(monkeypatch, runtime.commands.run, "run_drives", Ran([], [], Path("page.html"), True))
    code, said = command("run")
    assert (code, "GOOD" in said, "FAILED" in said) == (1, False, True), said


def test_a_page_without_chapters_passes_nothing(tmp_path: Path) -> None:
    write_page(tmp_path / "index.html", [])
    assert "all links" not in (tmp_path / "index.html").read_text(encoding="utf-8")


def test_no_run_is_no_lock(monkeypatch: pytest.MonkeyPatch) -> None:
    _play(monkeypatch, runtime.drive.simulate, "simulate", [])
    assert command("simulate", "ipmsm")[0] == 1
    _play(monkeypatch, runtime.compare.subject, "_runs", ())
    assert command("compare", "paper_spmsm", "ipmsm")[0] == 1


def test_no_fault_is_survived_by_nobody(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert not outcome().recovered
    _play(monkeypatch, runtime.faults.survey, "survey", [])
    assert command("faults", "paper_spmsm")[0] == 1


def test_no_step_is_no_soak(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert soak().failures() == ["d/ickf: no step was compared"]
    for made in ([], [soak()]):
        _play(monkeypatch, runtime.endurance.soak, "soak", made)
        code, said = command("soak", "paper_spmsm", "--json", "s.json")
        assert (code, read_json("s.json")["passed"], "held over" in said) == (1, False, False), said


def test_no_execution_is_no_campaign(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ran = Campaign("ran", executions=1)
    assert (ran.good, Campaign("idle").good) == (True, False)
    for made, code in (([], 1), ([Campaign("idle")], 1), ([ran, Campaign("idle")], 1), ([ran], 0)):
        _play(monkeypatch, runtime.endurance.fuzz, "fuzz", made)
        assert command("fuzz", "paper_spmsm", "--json", "z.json")[0] == code
        assert read_json("z.json")["passed"] is (code == 0)
