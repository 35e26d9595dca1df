"""A kept result is taken only where everything it depends on is the same; a failure never is."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime.cli import main
from runtime.estimator.compiler import cache_folder
from runtime.firmware import gates
from runtime.firmware.gates import Gated, check_firmware
from runtime.firmware.static.check import Check
from runtime.folders import kept
from runtime.folders.kept import keep
from runtime.proof import drives
from runtime.proof.drives import verify_drives
from runtime.proof.result import Link, Proof, Row
from runtime.proof.verify import Evidence

pytestmark = pytest.mark.unit


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PMSM_ICKF_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("PMSM_ICKF_FRESH")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "folder" / "host").mkdir(parents=True)
    (tmp_path / "folder" / "a.c").write_text("a")
    (tmp_path / "folder" / "host" / "b.c").write_text("b")
    return tmp_path / "folder"


class Maker:
    """Counts how often it is asked."""

    def __init__(self, result: object = "good") -> None:
        self.result, self.asked = result, 0

    def __call__(self) -> object:
        self.asked += 1
        return self.result


def taken(make: Maker, folder: Path, facts: tuple[str, ...] = ("x",), fresh: bool = False) -> tuple[Any, bool]:
    return keep("thing", folder, facts, make, lambda result: result != "bad", fresh)


def test_what_was_made_is_taken(folder: Path) -> None:
    make = Maker()
    assert [taken(make, folder) for _ in range(3)] == [("good", False), ("good", True), ("good", True)]
    assert make.asked == 1


def test_a_failure_is_made_again(folder: Path) -> None:
    make = Maker("bad")
    assert [taken(make, folder) for _ in range(2)] == [("bad", False)] * 2
    assert make.asked == 2


def test_everything_it_depends_on_counts(folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    make = Maker()
    taken(make, folder)
    changes = {
        "a fact": lambda: taken(make, folder, ("y",)),
        "a file": lambda: ((folder / "host" / "b.c").write_text("c"), taken(make, folder))[1],
        "one more file": lambda: ((folder / "d.c").write_text(""), taken(make, folder))[1],
        "no file": lambda: ((folder / "d.c").unlink(), taken(make, folder))[1],
        "sources, tools": lambda: (monkeypatch.setattr(kept, "surroundings", lambda: "other"), taken(make, folder))[1],
    }
    for what, change in changes.items():
        assert change() == ("good", False), what


@pytest.mark.parametrize("package", kept.PACKAGES)
def test_surroundings_see_every_source(package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A copy of the packages, one byte of one file changed."""
    for name in kept.PACKAGES:
        (tmp_path / name / "below").mkdir(parents=True)
        (tmp_path / name / "below" / "source.c").write_text("1")
    (tmp_path / "runtime" / "folders").mkdir()
    monkeypatch.setattr(kept, "__file__", str(tmp_path / "runtime" / "folders" / "kept.py"))
    found = kept.surroundings.__wrapped__()
    assert found == kept.surroundings.__wrapped__()
    (tmp_path / package / "below" / "source.c").write_text("2")
    assert found != kept.surroundings.__wrapped__()


@pytest.mark.parametrize("what", ["_version", "_processor", "tool"])
def test_surroundings_see_what_executes(what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    found = kept.surroundings.__wrapped__()
    monkeypatch.setattr(kept, what, lambda *name: "another")
    assert found != kept.surroundings.__wrapped__()


def test_surroundings_see_the_interpreter(monkeypatch: pytest.MonkeyPatch) -> None:
    found = kept.surroundings.__wrapped__()
    monkeypatch.setattr(sys, "version", "another")
    assert found != kept.surroundings.__wrapped__()


def test_an_upgraded_tool_is_another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = tmp_path / "some-tool"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    found = kept.tool("some-tool")
    os.utime(program, ns=(1, 1))
    assert kept.tool("some-tool") != found
    program.unlink()
    assert kept.tool("some-tool") == "some-tool: none"


def test_fresh_makes_it_again_and_forgets_what_no_longer_holds(folder: Path) -> None:
    assert taken(Maker("one"), folder) == ("one", False)
    assert taken(Maker("two"), folder, fresh=True) == ("two", False)
    assert taken(Maker("three"), folder) == ("two", True)
    assert taken(Maker("bad"), folder, fresh=True) == ("bad", False)
    assert taken(Maker("four"), folder) == ("four", False)


def test_the_environment_asks_for_fresh(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    taken(Maker("one"), folder)
    monkeypatch.setenv(kept.FRESH, "1")
    assert taken(Maker("two"), folder) == ("two", False)


def test_a_damaged_file_is_made_again(folder: Path) -> None:
    taken(Maker(), folder)
    (path,) = cache_folder().glob("*.pickle")
    path.write_bytes(path.read_bytes()[:-1])
    assert taken(Maker(), folder) == ("good", False)


def test_one_result_a_folder_is_kept(folder: Path) -> None:
    for fact in "abc":
        taken(Maker(), folder, (fact,))
    assert len(list(cache_folder().glob("*.pickle"))) == 1


# --- the commands


def proof_of(worst: float) -> tuple[Proof, Evidence]:
    row = Row("13", "S", "root", worst, 1e-10, 7)
    link = Link("A-B", "claim", "paper_spmsm", "ckf", "cubature", "data", (row,))
    return Proof("paper_spmsm", [link]), Evidence(np.zeros(1), {}, {}, None)  # type: ignore[arg-type]


@pytest.fixture
def proofs(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Deviations that the next proofs find, the last one for ever; a proof takes no time."""
    worst: list[float] = [0.0]
    monkeypatch.setattr(drives, "verify", lambda *a, **k: proof_of(worst.pop(0) if len(worst) > 1 else worst[0]))
    return worst


def test_a_proof_is_kept_and_says_so(proofs: list[float], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = []
    for _ in range(2):
        with pytest.raises(SystemExit) as end:
            main(["verify", "paper_spmsm", "--json", str(tmp_path / "f")])
        assert end.value.code == 0
        facts = json.loads((tmp_path / "f").read_text())
        said.append((facts["drives"][0]["kept"], "kept from an earlier run" in capsys.readouterr().out))
    assert said == [(False, False), (True, True)]


def test_a_broken_proof_is_never_kept(proofs: list[float]) -> None:
    proofs[:] = [1.0, 1.0, 0.0]
    for code in (1, 1, 0):
        with pytest.raises(SystemExit) as end:
            main(["verify", "paper_spmsm"])
        assert end.value.code == code


def test_fresh_finds_what_has_broken_meanwhile(proofs: list[float]) -> None:
    proofs[:] = [0.0, 1.0]
    for arguments, code in (([], 0), ([], 0), (["--fresh"], 1), ([], 1)):
        with pytest.raises(SystemExit) as end:
            main(["verify", "paper_spmsm", *arguments])
        assert end.value.code == code


def test_another_effort_is_another_proof(proofs: list[float], monkeypatch: pytest.MonkeyPatch) -> None:
    verify_drives(["paper_spmsm"], None, lambda text: None)
    monkeypatch.setattr(drives, "Effort", lambda: "more")
    ((proof, _),) = verify_drives(["paper_spmsm"], None, lambda text: None)
    assert not proof.kept


@pytest.mark.parametrize(
    ("state", "again"), [("passed", True), ("not proved", True), ("failed", False), ("not run", False)]
)
def test_gates_are_kept_where_all_was_run_and_held(state: Any, again: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    check = Check("MISRA", "a.c", state, "", "")
    monkeypatch.setattr(gates, "run_gates", lambda folder, progress: Gated(folder.drive, (check,)))
    monkeypatch.setattr(gates, "current_package", lambda *arguments: None)
    (first,) = check_firmware(["paper_spmsm"])
    (second,) = check_firmware(["paper_spmsm"])
    assert (first.kept, second.kept) == (False, again)
    assert second.checks == (check,)
    monkeypatch.setattr(gates, "tool", lambda name: f"{name}, upgraded")
    assert not check_firmware(["paper_spmsm"])[0].kept
