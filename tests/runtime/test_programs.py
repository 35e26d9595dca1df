"""Programs of others that commands start: whatever becomes of them is one line."""

from __future__ import annotations

import re
import time
from pathlib import Path

import pytest

from runtime.firmware import callgrind, emulator, tools
from runtime.system.errors import UserError
from runtime.system.programs import run_to_end
from tests.test_architecture import ROOT, imported

#: Where else a program is started than in codegen/evidence/programs.py, which ends what it started.
OWN = {
    "runtime/estimator/compiler.py": "compilers: a line has their reason",
    "runtime/endurance/fuzz.py": "searches that end together",
    "runtime/board/simulated.py": "a board that runs beside the command",
    "runtime/commission/simulated.py": "a motor that runs beside the command",
}


def script(path: Path, text: str) -> str:
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return str(path)


@pytest.mark.unit
def test_every_program_is_started_where_its_end_is_told() -> None:
    found = {
        str(path.relative_to(ROOT))
        for room in ("model", "codegen", "runtime")
        for path in (ROOT / room).rglob("*.py")
        if "subprocess" in {name.partition(".")[0] for name in imported(path)}
    }
    assert found == {"codegen/evidence/programs.py", *OWN}


def test_a_program_that_hangs_ends_with_all_that_it_started(tmp_path: Path) -> None:
    hangs = script(tmp_path / "hangs", f"sleep 60 & echo $! > {tmp_path}/child; wait")
    with pytest.raises(UserError, match=r"^the tool did not end within 0.5 s on a\.c\.$"):
        run_to_end([hangs], "the tool", 0.5, on="a.c")
    child = Path("/proc", (tmp_path / "child").read_text().strip(), "stat")
    for _ in range(100):
        if not child.exists() or child.read_text().rpartition(")")[2].split()[0] == "Z":
            break
        time.sleep(0.05)
    else:
        pytest.fail("what it had started goes on")


def test_what_cannot_be_started_and_what_is_no_text(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=re.escape(f"{tmp_path}/none cannot be started: No such file or directory.")):
        run_to_end([f"{tmp_path}/none"])
    done = run_to_end([script(tmp_path / "says", r"printf '\377 a'; printf '\376' >&2; exit 3")])
    assert (done.code, done.out, done.err, done.crash) == (3, "\ufffd a", "\ufffd", "")


def test_an_emulator_that_crashes_or_hangs_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    crashes = script(tmp_path / "crashes", "echo S; kill -ABRT $$")
    with pytest.raises(UserError, match=r"^the board crashed: Aborted\.$"):
        emulator.emulate([crashes], tmp_path, "the board")
    monkeypatch.setattr(emulator, "PATIENCE", 0.2)
    with pytest.raises(UserError, match=r"^the board did not end within 0.2 s\.$"):
        emulator.emulate([script(tmp_path / "hangs", "sleep 60")], tmp_path, "the board")
    said = emulator.emulate([script(tmp_path / "says", r"printf '\033[0mS 1'; printf ' 2' >&2")], tmp_path, "the board")
    assert said == "S 1 2"


def test_callgrind_that_hangs_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(callgrind, "PATIENCE", 0.2)
    monkeypatch.setattr(callgrind.shutil, "which", lambda name: script(tmp_path / name, "sleep 60"))
    with pytest.raises(UserError, match=r"^callgrind on 'step' did not end within 0.2 s\.$"):
        callgrind.count_instructions(tmp_path / "step", "f")


def test_a_compiler_that_does_not_say_where_its_library_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("codegen.evidence.programs.PATIENCE", 0.2)
    compiler = script(tmp_path / "avr-gcc", "sleep 60")
    monkeypatch.setattr(tools.shutil, "which", lambda name: compiler)
    with pytest.raises(UserError, match=r"avr-gcc did not end within 0.2 s\.$"):
        tools.find_tool("avr-gcc")
