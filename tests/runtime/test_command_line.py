"""The command line as a whole: its groups, --quiet, progress in a log, completion, and what doctor says."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import runtime.commands.terminal as terminal
from runtime.cli import GROUPS, load_command, main
from runtime.system.needs import DISTRIBUTION, EXTRAS, PROGRAMS, extra_lacks

ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def _loud_again() -> Iterator[None]:
    yield
    terminal.be_quiet(False)


def ended(*words: str) -> int:
    with pytest.raises(SystemExit) as end:
        main(list(words))
    return int(end.value.code or 0)


def test_every_command_is_in_a_group_and_takes_quiet(capsys: pytest.CaptureFixture[str]) -> None:
    shown: list[tuple[str, ...]] = []
    for word in (word for words in GROUPS.values() for word in words):
        of = load_command(word).registered_commands
        names = [str(info.name or info.callback.__name__) for info in of if info.callback]
        shown += [(word,)] if names == [word] else [(word, name) for name in names]
    assert {("generate",), ("export", "fmu"), ("study", "map")} <= set(shown)
    for words in shown:
        assert ended(*words, "--help") == 0
        assert "--quiet" in capsys.readouterr().out, words
    assert ended("--help") == 0
    out = capsys.readouterr().out
    assert [out.index(f"─ {group} ─") for group in GROUPS] == sorted(out.index(f"─ {group} ─") for group in GROUPS)


def test_a_log_has_a_line_a_minute(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    now = [100.0]
    monkeypatch.setattr("runtime.commands.terminal.time.monotonic", lambda: now[0])
    monkeypatch.setattr(terminal, "console", terminal.Terminal(width=140))
    with terminal.working() as tell:
        for k in range(600):
            now[0] += 0.5
            tell(f"piece {k}")
    assert capsys.readouterr().out.split("\n")[:-1] == [f"piece {k}" for k in (119, 239, 359, 479, 599)]


def test_how_often_is_a_variable(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("PMSM_ICKF_LOG_EVERY", "0")
    monkeypatch.setattr(terminal, "console", terminal.Terminal(width=140))
    with terminal.working() as tell:
        tell("[at once]")
    assert capsys.readouterr().out == "[at once]\n"
    monkeypatch.setenv("PMSM_ICKF_LOG_EVERY", "often")
    assert ended("generate", "paper_spmsm", "--check") == 2
    assert capsys.readouterr().err == "pmsm-ickf: PMSM_ICKF_LOG_EVERY: 'often' is not a number.\n"


def test_quiet_is_quiet(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(terminal, "LOG_EVERY", 0.0)
    monkeypatch.setattr(terminal, "console", terminal.Terminal(width=140))
    for quiet in (False, True):
        terminal.be_quiet(quiet)
        with terminal.working() as tell, terminal.counting("work") as count:
            tell("a piece of work")
            count(advance=1)
        assert ("a piece of work" in capsys.readouterr().out) == (not quiet)
    assert ended("generate", "paper_spmsm", "--check", "--quiet") == 0
    assert terminal._quiet


def test_completes_the_names_of_commands() -> None:
    words = {"_PMSM_ICKF_COMPLETE": "complete_bash", "COMP_WORDS": "pmsm-ickf ver", "COMP_CWORD": "1"}
    program = Path(sys.executable).with_name("pmsm-ickf")
    done = subprocess.run([program], env=os.environ | words, capture_output=True, text=True, check=False)
    assert done.stdout.split() == ["verify"]


def test_a_typo_gets_the_nearest_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert ended("verfy") == 2
    assert "'verify'" in capsys.readouterr().err


# --- doctor ----------------------------------------------------------------------------------------------------


def test_doctor_says_what_is_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert ended("doctor", "--json", str(tmp_path / "d.json")) == 0
    facts = json.loads((tmp_path / "d.json").read_text("utf-8"))
    assert facts["programs"]["cc"]
    assert facts["problems"] == []
    out = capsys.readouterr().out
    for program in PROGRAMS:
        assert program.name in out
        assert (facts["programs"][program.name] is None) == (f"{program.debian[0]}" in out.partition("apt-get")[2])


def test_doctor_without_programs(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PMSM_ICKF_CACHE", str(tmp_path / "cache"))
    assert ended("doctor") == 1
    out = capsys.readouterr().out
    line = next(line for line in out.splitlines() if line.startswith("apt-get install"))
    assert set(line.split()[2:]) == {name for program in PROGRAMS for name in program.debian}
    assert "no C compiler found" in out


def test_doctor_without_extras(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("runtime.commands.doctor.extra_lacks", lambda extra: ["asammdf"] if extra == "mdf" else [])
    assert ended("doctor") == 0
    out = capsys.readouterr().out
    assert "missing: asammdf" in out
    assert "pip install 'pmsm-ickf[mdf]'" in out


def test_doctor_on_a_mac(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("sys.platform", "darwin")
    monkeypatch.setattr("platform.system", lambda: "Darwin")
    monkeypatch.setattr("runtime.commands.doctor.program_found", lambda program: None)
    assert ended("doctor") == 0
    out = capsys.readouterr().out
    assert re.search(r"^brew install gcc make arm-none-eabi-gcc qemu", out, re.MULTILINE)
    assert "Homebrew has no frama-c." in out
    assert "on Linux alone" in out


def test_extras_are_the_projects() -> None:
    stated = (ROOT / "pyproject.toml").read_text("utf-8")
    section = stated.partition("[project.optional-dependencies]")[2].partition("\n[")[0]
    assert set(EXTRAS) | {"test", "dev", "bench"} == set(re.findall(r"^(\w+) = \[", section, re.MULTILINE))
    assert extra_lacks("mat") == []
    assert extra_lacks("study") == []
    assert DISTRIBUTION in stated


def test_the_readmes_packages_are_doctors() -> None:
    """One list: what README, CONTRIBUTING and the continuous integration install is what doctor looks for."""
    ours = {name for program in PROGRAMS for name in program.debian}
    pythons = {"python3", "python3-venv"}
    for name in ("README.md", "CONTRIBUTING.md"):
        text = (ROOT / name).read_text("utf-8")
        told = {word for line in re.findall(r"apt-get install ([a-z0-9 +-]+)", text) for word in line.split()}
        assert told - pythons == ours, name
    ci = (ROOT / ".ci" / "run").read_text("utf-8")
    assert {word for line in re.findall(r"missing\+=\(([^)]*)\)", ci) for word in line.split()} - pythons == ours
