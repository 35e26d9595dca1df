"""Static gates, their tools played: states, figures and remarks of what compilers, cppcheck and EVA would say."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from runtime.firmware.static import compilers, eva, misra


def _folder(place: Path, *names: str) -> Path:
    folder = place / "d"
    (folder / "host").mkdir(parents=True)
    (folder / "board").mkdir()
    for name in names:
        (folder / name).write_text("int x;\n")
    return folder


def _played(monkeypatch: pytest.MonkeyPatch, module: Any, code: int, said: str) -> list[list[str]]:
    asked: list[list[str]] = []

    def run(command: Any, cwd: Any = None) -> tuple[int, str]:
        asked.append(list(command))
        return code, said

    monkeypatch.setattr(module, "run", run)
    monkeypatch.setattr(module, "missing", lambda *rest: None)
    return asked


@pytest.mark.parametrize(
    ("code", "said", "state"),
    [
        (0, "", "passed"),
        (0, "a.c:1: warning: unused\n", "failed"),
        (1, "a.c:1: error: no\n", "failed"),
        (1, "", "failed"),
        (0, "note: nothing\n", "passed"),
    ],
)
def test_compilers_verdict(code: int, said: str, state: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = _folder(tmp_path, "a.c", "board/b.c", "host/c.c", "example_isr.c")
    asked = _played(monkeypatch, compilers, code, said)
    checks = compilers.compiler_checks(folder)
    assert {one.state for one in checks} == {state}
    assert [one.name for one in checks] == ["warnings, GCC", "warnings, Clang", "hidden double"]
    told = [one[-1] for one in asked[:4]]
    assert told == ["a.c", "board/b.c", "example_isr.c", "example_isr.c"], (
        "not the host's; the example in both its ways"
    )
    assert sum("-DWHOLE_CONTROLLER=0" in one for one in asked) == 3
    assert all("-Werror" in one and "-std=c89" in one for one in asked)
    assert checks[0].figure == f"{0 if state == 'passed' else 4} warnings in 3 files"
    assert len(checks[0].detail) == (0 if state == "passed" else 4)


def _cppcheck(*findings: tuple[str, str]) -> str:
    return "".join(f"/x/a.c|{k + 3}|{severity}|{rule}|words\n" for k, (severity, rule) in enumerate(findings))


def test_misra_verdict(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = _folder(tmp_path, "a.c")
    required = next(rule for rule, facts in misra.rules().items() if facts["category"] == "required")
    advisory = next(r for r, f in misra.rules().items() if f["category"] == "advisory" and r not in misra.deviations())
    explained = next(iter(misra.deviations()))
    for findings, state, figure in (
        ([], "passed", "0 required, 0 advisory"),
        ([("style", f"misra-c2012-{explained}")], "passed", "0 required, 1 advisory"),
        ([("style", f"misra-c2012-{advisory}")], "failed", "0 required, 1 advisory"),
        (
            [("style", f"misra-c2012-{required}"), ("style", f"misra-c2012-{explained}")],
            "failed",
            "1 required, 1 advisory",
        ),
        ([("style", "misra-c2012-99.9")], "failed", "1 required, 0 advisory"),
        ([("error", "syntaxError")], "failed", "0 required, 0 advisory"),
        ([("warning", "uninitvar")], "failed", "0 required, 0 advisory"),
        ([("style", "unusedVariable")], "passed", "0 required, 0 advisory"),
    ):
        _played(monkeypatch, misra, 0, _cppcheck(*findings))
        (found,) = misra.misra_checks(folder)
        assert (found.state, found.figure) == (state, f"{figure} in 1 files"), findings
        assert bool(found.detail) == (state == "failed" or bool(findings and "misra" in findings[0][1]))
        if state == "failed":
            assert found.detail[0].startswith("a.c:3: ")
    several = sorted(misra.deviations(), key=lambda rule: [int(part) for part in rule.split(".")])
    _played(monkeypatch, misra, 0, _cppcheck(*(("style", f"misra-c2012-{rule}") for rule in reversed(several))))
    (found,) = misra.misra_checks(folder)
    assert found.detail == (f"MISRA: advisory rules not followed: {', '.join(several)}; docs/misra.md has the reasons",)
    assert found.figure == f"0 required, {len(several)} advisory in 1 files"
    for code, said in ((1, "cppcheck: error: could not\n"), (1, "nothing that fits"), (1, "")):
        _played(monkeypatch, misra, code, said)
        assert misra.misra_checks(folder)[0].state == "failed"


def test_misra_reads_the_example_in_both_its_ways(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Once a finding however often it is met; and a folder without sources is none that is good."""
    for names, calls in ((("a.c",), 1), (("a.c", "example_isr.c"), 2), (("example_isr.c",), 2), ((), 0)):
        folder = _folder(tmp_path / f"of_{len(names)}_{calls}", *names)
        asked = _played(monkeypatch, misra, 0, _cppcheck(("style", f"misra-c2012-{next(iter(misra.deviations()))}")))
        (found,) = misra.misra_checks(folder)
        assert len(asked) == calls
        assert ["-DWHOLE_CONTROLLER=0" in one for one in asked] == [False, True][:calls]
        assert [sum(word.endswith(".c") for word in one) for one in asked] == [len(names), 1][:calls]
        assert found.figure == f"0 required, {min(calls, 1)} advisory in {len(names)} files"
        assert found.state == ("passed" if names else "failed")


ALARM = "[eva:alarm] d.c:12: Warning:\n  division by zero. assert b != 0;\n"
REACHED = "[eva] 90 statements reached (out of 100)\n"


@pytest.mark.parametrize(
    ("code", "said", "state", "alarms"),
    [
        (0, REACHED, "passed", 0),
        (0, ALARM + REACHED, "not proved", 1),
        (0, 4 * ALARM + REACHED, "not proved", 4),
        (0, ALARM.replace("division by zero", "function sin_cos: postcondition") + REACHED, "passed", 0),
        (0, ALARM.replace("division by zero", "assertion 'range'") + REACHED, "passed", 0),
        (0, "", "failed", 0),
        (1, REACHED, "failed", 0),
        (1, ALARM + REACHED, "failed", 1),
        (0, "NON TERMINATING FUNCTION\n" + REACHED, "failed", 0),
    ],
)
def test_evas_verdict(code: int, said: str, state: str, alarms: int) -> None:
    found = eva._verdict(code, said, 2.0)
    assert (eva._state(found), len(found.alarms)) == (state, alarms)
    assert found.proved is (state == "passed")
    assert (found.reached, found.statements) == ((90, 100) if REACHED in said else (0, 0))
    detail = eva._detail("d_ckf", found)
    assert bool(detail) is (state != "passed")
    if state == "not proved":
        assert detail[0].startswith(f"d_ckf: not proved. Intervals alone cannot exclude {alarms} errors")
        assert detail[1:] == ("d.c:12: division by zero. assert b != 0;",) * min(alarms, 3)
    failure = eva._verdict(1, "[kernel] User Error: no such file\n", 1.0).failure
    assert failure == "[kernel] User Error: no such file"
