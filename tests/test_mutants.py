"""A sample of the mutants, and that the machinery cannot flatter. All of them: python -m tests.mutants."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import jinja2
import pytest

from tests.mutants.__main__ import SAMPLE, drawn
from tests.mutants.around import around_mutants
from tests.mutants.catalogue import SOURCES, data_mutants
from tests.mutants.emitted import C_OPERATORS, Code, emitted_mutants, next_float
from tests.mutants.flow import flow_mutants
from tests.mutants.judged import JUDGES, SORTS, judged_mutants, places
from tests.mutants.mutant import ROOT, Mutant, Outcome, StaleMutantError, mutated_source
from tests.mutants.table import KINDS, page, rows


@pytest.mark.thorough
def test_a_sample_is_killed(tmp_path: Path) -> None:
    """In a process of its own: a mutated module must be the first of its name."""
    command = [sys.executable, "-m", "tests.mutants", "--sample", "--jobs", "2", "--json", f"{tmp_path}/mutants.json"]
    found = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert found.returncode == 0, found.stdout + found.stderr
    fates = json.loads((tmp_path / "mutants.json").read_text(encoding="utf-8"))["mutants"]
    assert len(fates) >= len(SAMPLE)
    assert all(entry["fate"] == "killed" for entry in fates)


def test_no_mutant_is_stale() -> None:
    for mutant in SOURCES:
        if mutant.file.endswith(".j2"):
            jinja2.Environment(trim_blocks=True, lstrip_blocks=True).parse(mutated_source(mutant))
        else:
            compile(mutated_source(mutant), mutant.file, "exec")
    with pytest.raises(StaleMutantError, match="0 times"):
        mutated_source(replace(SOURCES[0], old="no such text"))


def test_every_test_that_must_notice_exists() -> None:
    """Those that a check names; where ``-k`` chooses none, the run itself ends with an error."""
    named = {word for m in SOURCES for check in m.checks for word in check.split() if ".py" in word}
    defined = {file: _functions(ROOT / file) for file in {word.partition("::")[0] for word in named}}
    wanted = {tuple(word.partition("[")[0].split("::")) for word in named if "::" in word}
    assert len(wanted) > 80
    assert [(file, test) for file, test in wanted if test not in defined[file]] == []


def _functions(file: Path) -> set[str]:
    tree = ast.parse(file.read_text(encoding="utf-8"))
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


@pytest.fixture(scope="module")
def emitted() -> list[Mutant]:
    return [*emitted_mutants(), *flow_mutants(), *around_mutants()]


@pytest.mark.thorough
def test_no_two_are_the_same_and_every_kind_has_some(emitted: list[Mutant]) -> None:
    assert {mutant.kind for mutant in (*SOURCES, *emitted, *judged_mutants())} | {"data"} == set(KINDS)
    assert len({(m.file, m.old, m.new) for m in SOURCES}) == len(SOURCES)
    assert len({(m.file, m.text) for m in emitted}) == len(emitted)


@pytest.mark.thorough
def test_fewer_are_a_part_of_more_and_hold_every_sort(emitted: list[Mutant]) -> None:
    made = [*data_mutants(), *emitted]
    sorts = {(m.kind, m.sort) for m in made}
    few, more = ({m.digest for m in drawn(made, each)} for each in (1, 2))
    assert len(few) == len(sorts)
    assert few < more
    assert drawn(made, None) == made


@pytest.mark.thorough
def test_judges_are_turned_where_they_judge() -> None:
    """A drawn mutant is another text of the same file that compiles; texts, looks and functions left alone are not."""
    for mutant in judged_mutants():
        compile(mutated_source(mutant), mutant.file, "exec")
        assert mutated_source(mutant) != (ROOT / mutant.file).read_text(encoding="utf-8")
    assert {mutant.file for mutant in judged_mutants()} == set(JUDGES)
    assert {mutant.sort for mutant in judged_mutants()} == set(SORTS)
    text = 'def a(x):\n    """1 < 2"""\n    plot(x <= 1.0, lw=2 * x)\n\ndef b(x):\n    return max(x)\n'
    assert [new for _, _, new in places(text, "comparison turned")] == ["(x > 1.0)"]
    assert places(text, "other arithmetic") == []
    assert [new for _, _, new in places(text, "other aggregate")] == ["min"]
    assert places(text, "other aggregate", alone=("b",)) == []


def test_a_crash_is_no_kill() -> None:
    mutant = Mutant("model", "one", ("model paper_spmsm",))
    outcomes = [Outcome(mutant, "link model"), Outcome(mutant, crash="NameError: x"), Outcome(mutant)]
    assert rows(outcomes) == [("model", 3, 1, "link model 1")]
    text = page([*outcomes, Outcome(replace(mutant, equivalent="a tie"))], {"model": 3}, "a command")
    assert "**1 of 3 killed.**" in text
    assert "NameError" in text
    assert "a tie" in text


def test_places_are_code() -> None:
    text = (
        '#include "a.h"\n/* a - b */\nstatic float32 smaller(float32 a, float32 b)\n{\n    return (a < b) ? a : b;\n}\n'
    )
    text += "static void f(void)\n{\n    const float32 c = a - b; /* a - b */\n}\n"
    (edit,) = C_OPERATORS["plus for minus"](Code.c(text))
    assert text[: edit[0]].endswith("c = a")
    assert not list(C_OPERATORS["< for <=, > for >="](Code.c(text)))
    assert next_float("0.1f") == "0.100000009f"
