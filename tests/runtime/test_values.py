"""Words from outside: what is no number, no form, or no path is refused in one line; square brackets are letters."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import get_args, get_type_hints

import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from runtime.cli import GROUPS, app, load_command
from runtime.drive.motor import parse_factors
from runtime.study.statement import parse_range
from runtime.system.errors import UserError
from runtime.system.values import MOST, read_number
from tests.runtime.processes import PAPER
from tests.runtime.test_cli import call


def options() -> Iterator[tuple[str, ...]]:
    """Every option of every command that takes a float, as the words that name it."""
    for command in (word for words in GROUPS.values() for word in words):
        for info in load_command(command).registered_commands:
            assert info.callback is not None
            name = info.name or info.callback.__name__.replace("_", "-")
            path = (command,) if name == command else (command, name)
            for word, hint in get_type_hints(info.callback, include_extras=True).items():
                kind, *_ = get_args(hint) or (hint,)
                if float in (kind, *get_args(kind)):
                    yield *path, f"--{word.replace('_', '-')}"


NUMBERS = list(options())


def test_options_are_found() -> None:
    assert {("simulate", "--noise"), ("replay", "--theta0"), ("faults", "--speed"), ("pil", "--timeout")} <= {*NUMBERS}


@pytest.mark.parametrize("text", ["nan", "inf", "-inf", "1e308", "1e400"])
@pytest.mark.parametrize("words", NUMBERS, ids=" ".join)
def test_what_is_no_number_is_refused_by_the_options_own_name(words: tuple[str, ...], text: str) -> None:
    done = CliRunner().invoke(app, [*words[:-1], f"{words[-1]}={text}"])
    assert isinstance(done.exception, UserError), done.output
    (line,) = str(done.exception).splitlines()
    assert line.startswith(f"{words[-1]} ")


def number_or_line(text: str) -> float | str:
    try:
        return read_number(text, "--noise", 0.0)
    except UserError as error:
        return str(error)


@given(st.text(max_size=30) | st.floats().map(str))
def test_any_text_is_a_number_within_or_one_line(text: str) -> None:
    found = number_or_line(text)
    assert 0.0 <= found <= MOST if isinstance(found, float) else len(found.splitlines()) == 1


@pytest.mark.parametrize("text", ["0", "1e-6", " 2.5 ", "1e9", "1_000"])
def test_numbers_are_numbers(text: str) -> None:
    assert number_or_line(text) == float(text)


@pytest.mark.parametrize("text", ["R=nan", "R=1e308", "R=0", "R=-1", "J=1e-9", "R=", "R"])
def test_factors_on_the_motor_are_numbers_that_can_be_meant(text: str) -> None:
    with pytest.raises(UserError, match="--factors"):
        parse_factors(text)


@pytest.mark.parametrize("text", ["R=1e308", "R=nan", "R=0.8:inf", "load=1e300", "noise=-1", "theta=x"])
def test_ranges_are_of_numbers_that_can_be_meant(text: str) -> None:
    with pytest.raises(UserError, match="--vary"):
        parse_range(text)


#: To Rich an end of a style that never began, and a style that is none.
BRACKETS = "a[/b]c[red]"


def test_square_brackets_in_a_path_are_letters(tmp_path: Path) -> None:
    text = PAPER.replace("paper_spmsm", "mine")
    (tmp_path / f"{BRACKETS}.toml").parent.mkdir(parents=True)
    (tmp_path / f"{BRACKETS}.toml").write_text(text)
    made = call("generate", f"{BRACKETS}.toml", "--out", f"{BRACKETS}/[/]", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    folder = f"{BRACKETS}/[/]/mine"
    assert (tmp_path / folder / "mine_ckf.c").is_file()
    assert folder in made.stdout.replace("\n", "")
    page = call("compare", folder, "paper_spmsm", "--out", f"{BRACKETS}.html", cwd=tmp_path)
    assert f"Page: {BRACKETS}.html" in page.stdout, page.stderr
    assert (tmp_path / f"{BRACKETS}.html").exists()


@pytest.mark.parametrize("arguments", [("generate", "--form", "slow"), ("generate", "--form", "", "--out", "x")])
def test_a_form_that_is_none_is_one_line(arguments: tuple[str, ...], tmp_path: Path) -> None:
    done = call(*arguments, "paper_spmsm", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("pmsm-ickf: no form '")
    assert not list(tmp_path.iterdir())
