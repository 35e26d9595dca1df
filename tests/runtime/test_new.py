"""The facts asked for one by one: every fact once, each answer judged as the facts file would be, nothing lost."""

from __future__ import annotations

import os
import signal
import tomllib
from collections.abc import Sequence
from dataclasses import fields
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from model.drives.load import load_drive
from runtime.design.facts import EXAMPLE, SECTIONS, Facts, FactsFile, parse_facts, read_facts
from runtime.design.questions import default, every_question, meaning, read_answer, refusal, unit_of
from runtime.design.tables import IN_SI, facts_table
from runtime.design.write import facts_text
from runtime.system.errors import UserError
from tests import forked
from tests.runtime.processes import finish, start

FACTS = sorted((Path(__file__).parents[1] / "data" / "facts").glob("*.toml"))


# --- what is asked


@pytest.mark.unit
def test_every_fact_is_asked_for_once_with_its_meaning_and_unit() -> None:
    asked = [(question.section, key) for question in every_question() for way in question.ways for key in way]
    assert sorted(asked) == sorted((title, key) for title, section in SECTIONS.items() for key in section.model_fields)
    assert set(SECTIONS) == set(FactsFile.model_fields) - {"name"}
    said = [meaning(*place) for place in (*asked, ("", "name"))]
    assert all(words and unit_of(*place) in words for words, place in zip(said, asked, strict=False))
    assert len({*said}) == len(said)
    ways = {question.ways[0]: len(question.ways) for question in every_question() if len(question.ways) > 1}
    assert ways == {
        ("stator_resistance",): 2, ("inductance_d", "inductance_q"): 2, ("magnet_flux",): 3, ("pole_pairs",): 2,
        ("speed_rpm",): 2, ("torque",): 2, ("sample_time",): 2,
    }  # fmt: skip


@pytest.mark.unit
def test_defaults_are_what_a_facts_file_takes_that_leaves_them_out() -> None:
    """Everything that may be left out, stated as its question offers it: the facts are the same."""
    offered = {
        title: {key: default(title, key) for key in section.model_fields if default(title, key) is not None}
        for title, section in SECTIONS.items()
    }
    assert set(offered["motor"]) == {"friction"}
    assert offered["rated"] == {}
    stated = {"name": "x"} | {title: offered[title] | EXAMPLE.get(title, {}) for title in SECTIONS}
    assert parse_facts(stated, "x") == parse_facts(EXAMPLE | {"name": "x"}, "x")


@pytest.mark.unit
@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("0.6", "ohm", 0.6), ("600 mohm", "ohm", 0.6), ("600m\u03a9", "ohm", 0.6), ("250 \u00b5H", "H", 2.5e-4),
        ("835uH", "H", 835e-6), ("1.5e-5", "kg m^2", 1.5e-5), ("20%", "of the value", 0.2), ("16 kHz", "Hz", 16000.0),
        ("3000 rpm", "r/min", 3000), ("150 mNm", "N m", 0.15), ("500 ns", "s", 5e-7), ("12", "bits", 12),
        (".5", "V", 0.5), ("2.2 kW", "W", 2200.0), ("-3", "A", -3), ("4.0", "pairs", 4.0),
        ("12 V", "A", "12 V"), ("3,5", "A", "3,5"), ("a few", "A", "a few"), ("unknown", "degrees", "unknown"),
        ("5 %", "ohm", "5 %"), ("1e9999", "A", "1e9999"), ("nan", "A", "nan"), ("\u0663", "A", "\u0663"),
    ],
)  # fmt: skip
def test_answers_are_numbers_with_a_unit_or_without(text: str, unit: str, value: object) -> None:
    assert read_answer(text, unit) == value
    assert type(read_answer(text, unit)) is type(value)


@pytest.mark.unit
@pytest.mark.parametrize(
    ("section", "key", "value"),
    [
        ("motor", "stator_resistance", 3000.0),
        ("motor", "magnet_flux", "a few"),
        ("motor", "pole_pairs", 4.5),
        ("motor", "inertia", -1),
        ("rated", "max_current", 1e9),
        ("tolerance", "inertia", 20),
        ("inverter", "dc_link", 0),
        ("sensor", "bits", 99),
        ("start", "angle", "anywhere"),
        ("load", "step_every", "often"),
    ],
)
def test_nonsense_is_refused_in_the_words_of_the_facts_file(section: str, key: str, value: object) -> None:
    with pytest.raises(UserError) as whole:
        parse_facts(EXAMPLE | {section: EXAMPLE.get(section, {}) | {key: value}}, "x.toml")
    assert refusal({"name": "x", section: {key: value}}, section, key) == str(whole.value).removeprefix(
        "facts 'x.toml': "
    )


@pytest.mark.unit
def test_what_does_not_go_together_is_refused_at_the_end_of_its_section_alone() -> None:
    tables = {"name": "x", "inverter": {"dc_link": 24.0, "sample_time": 1e-4, "dead_time": 5e-5}}
    assert "more than a fifth" in (refusal(tables, "inverter", "dead_time", last=True) or "")
    assert refusal(tables, "inverter", "dead_time") is None
    tables["inverter"] = {"dc_link": 24.0}
    assert refusal(tables, "inverter", "dc_link") is None
    assert refusal(tables, "inverter", "sample_time") == "inverter.sample_time is missing (1e-06 .. 0.01 s)."
    assert "name = 'My Motor'" in (refusal({"name": "My Motor"}, "", "name") or "")


# --- what is written and shown


@pytest.mark.unit
@pytest.mark.parametrize("path", FACTS, ids=[path.stem for path in FACTS])
def test_a_facts_file_that_is_written_says_the_same(path: Path, tmp_path: Path) -> None:
    tables = tomllib.loads(path.read_text())
    text = facts_text(tables)
    (tmp_path / path.name).write_text(text)
    assert read_facts(tmp_path / path.name) == read_facts(path)
    for line in text.splitlines():
        key, equals, rest = line.partition(" = ")
        if equals and key != "name":
            section = next(title for title, keys in tables.items() if isinstance(keys, dict) and key in keys)
            assert rest.endswith(f"# {meaning(section, key)}") or unit_of(section, key) in rest


@pytest.mark.unit
def test_what_was_understood_is_shown_whole_and_in_si() -> None:
    motor = {"line_resistance": 0.6, "line_inductance": 5e-4, "kv_rpm_per_v": 100.0, "poles": 14, "inertia": 1e-5}
    rated = {"speed_rpm": 3000, "power": 47.1, "max_current": 10.0}
    facts = parse_facts(EXAMPLE | {"motor": motor, "rated": rated, "start": {"angle": "unknown"}}, "x")
    assert set(IN_SI) == {field.name for field in fields(Facts)} - {"name"}
    shown = StringIO()
    Console(file=shown, width=140).print(facts_table(facts))
    rows = [[cell.strip() for cell in line.split("\u2502")] for line in shown.getvalue().splitlines()]
    for row in (
        ["resistance of a phase", "0.3", "ohm"],
        ["inductance of a phase along the magnets, L_d", "0.00025", "H"],
        ["flux linkage of the magnets, psi_m", "0.00787613", "Wb"],  # 60 / (sqrt(3) 2 pi 7 100)
        ["pole pairs", "7", "pairs"],
        ["rated speed", "314.159", "rad/s"],
        ["rated torque", "0.149924", "N m"],
    ):
        assert row in rows
    assert any(row[1:] == ["180", "degrees"] for row in rows)
    assert len({row[0] for row in rows}) == len(rows), "each fact once"


# --- the command

#: The outrunner of tests/data/facts, answered at a keyboard.
ANSWERS = (
    *("2", "100 mohm", "2", "60 uH", "3", "900", "1", "7", "2e-5", ""),
    *("1", "6000", "1", "0.12", "15"),
    *("", "", "", ""),
    *("11.1", "2", "20 kHz", "1 us"),
    *("30", "", "", "", ""),
)


def call(*arguments: str, cwd: Path, answers: Sequence[str]) -> tuple[int, str, str]:
    done = forked.call(*arguments, cwd=cwd, answers="".join(f"{line}\n" for line in answers))
    assert "Traceback" not in done.stderr
    return done.returncode, done.stdout, done.stderr


def test_answers_make_a_facts_file_and_what_design_makes_of_it(tmp_path: Path) -> None:
    code, out, err = call("new", "mine", "--draws", "8", cwd=tmp_path, answers=ANSWERS)
    assert code in {0, 1}, out + err
    facts = read_facts(tmp_path / "mine_facts.toml")
    assert (facts.R, facts.L_d, facts.p, facts.T, facts.dead_time) == (0.05, 3e-5, 7, 5e-5, 1e-6)
    again, told, _ = call("design", "mine_facts.toml", "--out", "two.toml", "--draws", "8", cwd=tmp_path, answers=())
    assert again == code
    assert out.endswith(told.replace("two.toml", "mine.toml"))
    assert (tmp_path / "two.toml").read_text() == (tmp_path / "mine.toml").read_text()
    assert load_drive(tmp_path / "mine.toml").name == "mine"
    assert {path.name for path in tmp_path.iterdir()} == {"mine_facts.toml", "mine.toml", "two.toml"}


def test_nonsense_is_asked_for_again_and_an_end_keeps_what_was_answered(tmp_path: Path) -> None:
    nonsense = ("My Motor", "mine", "", "3", "2", "", "a few", "9000", "0.6", "1", "0.2 mH", "300", "0.3 mH")
    code, out, err = call("new", "--facts-out", "f.toml", cwd=tmp_path, answers=nonsense)
    assert code == 2
    (line,) = err.splitlines()
    assert "the answers end before the facts are whole. What was answered lies in f.part.toml" in line
    for said in (
        "name = 'My Motor'",
        "'' is none of 1, 2.",
        "'3' is none of 1, 2.",
        "motor.line_resistance is missing (2e-05 .. 2000 ohm).",
        "motor.line_resistance = 'a few': input should be a valid number",
        "motor.line_resistance = 9000 ohm is outside 2e-05 .. 2000 ohm.",
        "motor.inductance_q = 300 H is outside 1e-07 .. 0.5 H. Did you mean 300 mH = 0.3?",
    ):
        assert said in out
    kept = tomllib.loads((tmp_path / "f.part.toml").read_text())
    assert kept == {"name": "mine", "motor": {"line_resistance": 0.6, "inductance_d": 2e-4, "inductance_q": 3e-4}}
    assert [path.name for path in tmp_path.iterdir()] == ["f.part.toml"]


def test_files_are_not_overwritten_without_asking(tmp_path: Path) -> None:
    for name in ("mine_facts.toml", "mine.toml"):
        for path in tmp_path.iterdir():
            path.unlink()
        (tmp_path / name).write_text("hers")
        for answer in ("", "n", "what\nNo"):
            code, out, err = call("new", "mine", cwd=tmp_path, answers=[answer, *ANSWERS])
            assert code == 2
            assert f"'{name}' stays as it is" in err
            assert f"{name} is there already. Overwrite it? (y/n) [n]" in out
        code, out, err = call("new", "mine", cwd=tmp_path, answers=["y"])
        assert code == 2
        assert err == "pmsm-ickf: the answers end before the facts are whole.\n"
        assert [path.read_text() for path in tmp_path.iterdir()] == ["hers"]


def test_a_name_that_is_none_is_bad_input(tmp_path: Path) -> None:
    code, out, err = call("new", "My Motor", cwd=tmp_path, answers=ANSWERS)
    assert (code, out, len(err.splitlines())) == (2, "", 1)
    assert "name = 'My Motor'" in err


@pytest.mark.slow
def test_ctrl_c_at_a_terminal_keeps_what_was_answered(tmp_path: Path) -> None:
    ours, theirs = os.openpty()
    process = start("-m", "runtime", "new", "mine", cwd=tmp_path, stdin=theirs)
    os.write(ours, b"1\n0.3\n")
    assert process.stdout is not None
    shown = ""
    while "2  inductance" not in shown:
        shown += process.stdout.readline()
    os.killpg(process.pid, signal.SIGINT)
    code, out, err = finish(process)
    for end in (ours, theirs):
        os.close(end)
    assert (code, err) == (130, "pmsm-ickf: interrupted\n")
    assert "What was answered lies in mine_facts.part.toml" in out
    kept = tomllib.loads((tmp_path / "mine_facts.part.toml").read_text())
    assert kept == {"name": "mine", "motor": {"stator_resistance": 0.3}}
