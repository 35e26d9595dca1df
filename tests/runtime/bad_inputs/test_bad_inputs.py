"""Bad inputs over all commands: one line, exit code 2, no traceback, and every file as it was."""

from __future__ import annotations

import io
import os
import shlex
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, get_args

import pytest

from runtime.commands.paths import OUTPUTS
from tests.conftest import thoroughly
from tests.runtime.bad_inputs.own import OWN, SLOW, own_cases
from tests.runtime.bad_inputs.place import COMMANDS, contents, make_place
from tests.runtime.bad_inputs.table import NEEDS, NO_DATA, NO_DRIVES
from tests.runtime.hostile import command as run

Case = tuple[list[str], str]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    """The folder in which the commands run, as it is before they do."""
    before, folder = Path.cwd(), tmp_path_factory.mktemp("bad")
    make_place(folder)
    os.chdir(folder)
    try:
        yield contents(folder)
    finally:
        os.chdir(before)


@pytest.fixture(autouse=True)
def _no_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Standard input is empty."""
    monkeypatch.setattr("sys.stdin", io.StringIO())


def wrong(words: list[str], part: str) -> str:
    """What is wrong with how a command refuses its words; nothing where it does so in a line that holds ``part``."""
    try:
        code, said = run(*words)
    except Exception as error:  # what a user would see as a traceback
        return f"{words}: {type(error).__name__}: {error}"
    lines = [line for line in said.splitlines() if "caution: " not in line]
    if code != 2 or len(lines) != 1 or not lines[0].startswith("pmsm-ickf: ") or not lines[0].isprintable():
        return f"{words}: exit code {code}, {said[-300:]!r}"
    if part not in lines[0] or len(lines[0]) > 640:
        return f"{words}: not {part!r} but {lines[0]!r}"
    return ""


def check(place: dict[str, str], cases: Iterable[Case]) -> None:
    """All refused, each in a line that says so, and nothing is written or lost."""
    found = []
    for words, part in cases:
        found.append(wrong(words, part))
        now = contents(Path.cwd())
        if now != place:
            found.append(f"{words}: wrote {[name for name in now if now[name] != place.get(name)]}")
            found[-1] += f", lost {set(place) - set(now)}" if set(place) - set(now) else ""
            place.clear()
            place |= now
    assert not list(filter(None, found)), "\n" + "\n".join(line[:400] for line in found if line)


def test_every_command_has_cases() -> None:
    assert set(OWN) == set(COMMANDS)
    assert len(own_cases(OWN)) >= 200


@pytest.mark.parametrize("command", OWN)
def test_what_each_command_has_of_its_own(place: dict[str, str], command: str) -> None:
    check(place, [([*name.split(), *words], said) for name, words, said in own_cases(OWN) if name == command])


@pytest.mark.thorough
def test_what_takes_seconds_until_it_is_refused(place: dict[str, str]) -> None:
    check(place, [([*name.split(), *words], said) for name, words, said in own_cases(SLOW)])


# --- drives and data, to every command that takes them: some in make test, all of them in make thorough ----------


def arguments(command: Any) -> set[str]:
    return {param.name for param in command.params}


def a_part_of(cases: list[Case], parts: int) -> list[Any]:
    """Every so-manieth case, and thoroughly the others."""
    return [cases[::parts], *thoroughly(*((cases[k::parts],) for k in range(1, parts)))]


TAKE_DRIVE = [name for name, command in COMMANDS.items() if {"drive", "drives"} & arguments(command)]
TAKE_DRIVE.remove("commission")  # its --drive is what it writes
DRIVES = [
    ([*command.split(), *shlex.split(word), *shlex.split(NEEDS.get(command, ""))], said)
    for word, said in NO_DRIVES
    for command in TAKE_DRIVE
    if (command, word) != ("identify", "facts.toml")
]
DATA = [
    ([*before, *shlex.split(word)], said)
    for word, said in NO_DATA
    for before in (["replay", "paper_spmsm"], ["identify", "paper_spmsm"], ["pil", "--port", "simulated", "--data"])
    if before[0] != "pil" or word not in {"backwards.npz", "still.npz", "timeless.npz", "slow.npz"}  # it reads no t
]


@pytest.mark.parametrize("cases", a_part_of(DRIVES, 9))
def test_a_drive_that_is_none(place: dict[str, str], cases: list[Case]) -> None:
    check(place, cases)


@pytest.mark.parametrize("cases", a_part_of(DATA, 5))
def test_data_that_are_none(place: dict[str, str], cases: list[Case]) -> None:
    check(place, cases)


# --- every option ------------------------------------------------------------------------------------------------


def options(*kinds: type) -> list[tuple[list[str], Any]]:
    """Options of all commands that take a value of some types, each behind its command's words."""
    return [
        (name.split(), param)
        for name, command in COMMANDS.items()
        for param in command.params
        if param.param_type_name == "option" and param.type_descriptor.annotation in kinds
    ]


NO_NUMBERS = ("x", "", " ", "1 V", "1,5", "0x10", "[/b]", "9" * 5000, "-" + "9" * 400, "1e999", "--", "½", "\udcff")
NO_WHOLE = (*NO_NUMBERS, "1.5", "1e3", "nan", "inf", "1e308", "999999999999999999999999")
NO_FLOATS = (*NO_NUMBERS, "nan", "-inf", "1e308", "-1e308")
VALUES = [
    ([*words, f"{param.opts[0]}={text}"], param.opts[0])
    for kind, texts in ((int, NO_WHOLE), (float, NO_FLOATS))
    for words, param in options(kind)
    for text in texts
]


@pytest.mark.parametrize("cases", a_part_of(VALUES, 5))
def test_a_number_that_is_none(place: dict[str, str], cases: list[Case]) -> None:
    check(place, cases)


#: What a script leaves where a variable was never set, to every path that is read or written, behind what comes before.
EMPTY = [
    ([*name.split(), *([param.opts[0]] if param.param_type_name == "option" else ["paper_spmsm"] * place), ""], said)
    for name, command in COMMANDS.items()
    for place, param in enumerate(command.params)
    if Path in {param.type_descriptor.annotation, *get_args(param.type_descriptor.annotation)}
    for said in [f"{param.opts[0] if param.param_type_name == 'option' else param.metavar} is empty"]
]


def test_an_empty_path_is_not_the_current_folder(place: dict[str, str]) -> None:
    assert len(EMPTY) >= 50
    assert {words[0] for words, said in EMPTY if not said.startswith("--")} == {"design", "replay", "identify"}
    check(place, EMPTY)


WRITTEN = {*OUTPUTS, "corpus", "write"}
NO_PLACES = ("a_file/x", "a_file/x/y.toml", "/proc/x.toml", "x" * 300, "/proc/self/nothing/x.npz")
PLACES = [
    ([*words, f"{param.opts[0]}={text}"], f"{param.opts[0]} '")
    for words, param in options(Path)
    if param.name in WRITTEN
    for text in NO_PLACES
]


@pytest.mark.parametrize("cases", a_part_of(PLACES, 3))
def test_a_place_to_write_that_is_none(place: dict[str, str], cases: list[Case]) -> None:
    assert {words[-1].partition("=")[0] for words, _ in PLACES} == {f"--{name.replace('_', '-')}" for name in WRITTEN}
    check(place, cases)
