"""The command ``new``: the facts of a drive asked for one by one, then ``design``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from runtime.commands.design import Draws, Seed, carry_out
from runtime.commands.paths import writes_file
from runtime.commands.terminal import console, say
from runtime.commands.words import Json
from runtime.system.errors import UserError, take_interrupt
from runtime.system.files import write_text

if TYPE_CHECKING:
    from runtime.design.questions import Question, Tables

INTRODUCTION = (
    "What you know of the drive, a question at a time. A number alone is in the unit that is named; 0.25 mH and 20 % "
    "are understood, too. Enter takes what stands in brackets. Ctrl-C leaves, and keeps what was answered."
)


def new(
    name: Annotated[str | None, typer.Argument(metavar="NAME", help="Of the drive; asked for without it.")] = None,
    facts_out: Annotated[
        Path | None,
        writes_file("Write the facts file here. Default: NAME_facts.toml.", endings=(".toml",)),
    ] = None,
    out: Annotated[
        Path | None,
        writes_file("Write the drive file here. Default: NAME.toml.", endings=(".toml",)),
    ] = None,
    draws: Draws = 128,
    seed: Seed = 1,
    json: Json = None,
) -> None:
    """Ask for the facts of a drive, write them to a facts file, and make a drive file of it as design does.

    For those who come without a file. Ends as design does: with 1 where the drive does not hold.
    """
    from runtime.design.facts import parse_facts
    from runtime.design.questions import refusal
    from runtime.design.tables import facts_table
    from runtime.design.write import facts_text

    tables: Tables = {} if name is None else {"name": name}
    if name is not None and (why := refusal(tables, "", "name")):
        raise UserError(why)
    console.print(INTRODUCTION, highlight=False)
    try:
        if name is None:
            _ask_for(tables, "", "name")
        facts_out = facts_out or Path(f"{tables['name']}_facts.toml")
        out = out or Path(f"{tables['name']}.toml")
        for path in (facts_out, out):
            _may_be_written(path)
        _ask_for_all(tables)
    except EOFError:
        raise UserError(f"the answers end before the facts are whole.{_kept(tables, facts_out)}") from None
    except KeyboardInterrupt:
        take_interrupt()
        say(f"\n{_kept(tables, facts_out).strip()}")
        raise
    known = parse_facts(tables, facts_out.name)
    console.print(facts_table(known))
    write_text(facts_out, facts_text(tables))
    say(f"Facts file: {facts_out}. What is wrong there can be changed; then: pmsm-ickf design {facts_out} --out {out}")
    carry_out(known, facts_out.name, out, None, draws, seed, json)


def _ask_for_all(tables: Tables) -> None:
    from runtime.design.questions import every_question

    questions = every_question()
    for question, after in zip(questions, [*questions[1:], None], strict=True):
        if question.section not in tables:
            tables[question.section] = {}
            console.print(f"\n[bold]{question.section}[/bold]")
        last = after is None or after.section != question.section
        way = _way_of(question)
        for key in way:
            _ask_for(tables, question.section, key, last and key == way[-1])


def _way_of(question: Question) -> tuple[str, ...]:
    """Which of the alternatives the user has."""
    from runtime.design.questions import meaning

    if len(question.ways) == 1:
        return question.ways[0]
    say("Which of these do you know?")
    for number, way in enumerate(question.ways, start=1):
        say(f"  {number}  {' and '.join(meaning(question.section, key) for key in way)}")
    numbers = [str(number) for number in range(1, len(question.ways) + 1)]
    while (answer := _answer(f"{', '.join(numbers[:-1])} or {numbers[-1]}")) not in numbers:
        say(f"'{answer}' is none of {', '.join(numbers)}.")
    return question.ways[int(answer) - 1]


def _ask_for(tables: Tables, section: str, key: str, last: bool = False) -> None:
    """One fact, until it is one that a facts file may state."""
    from runtime.design.questions import default, meaning, read_answer, refusal, unit_of

    into: dict[str, Any] = tables[section] if section else tables
    taken = default(section, key)
    brackets = "" if taken is None else f" [{taken:g}]"
    words = meaning(section, key)
    while True:
        answer = _answer(f"{words[0].upper()}{words[1:]}{brackets}")
        value = read_answer(answer, unit_of(section, key)) if answer else taken
        if value is not None:
            into[key] = value
        why = refusal(tables, section, key, last)
        if why is None:
            return
        into.pop(key, None)
        say(why)


def _may_be_written(path: Path) -> None:
    """Ask before a file is overwritten."""
    while path.exists():
        answer = _answer(f"{path} is there already. Overwrite it? (y/n) [n]").lower()
        if answer in {"y", "yes"}:
            return
        if answer in {"", "n", "no"}:
            raise UserError(f"'{path}' stays as it is: another NAME, --facts-out or --out names another file.")


def _answer(question: str) -> str:
    """A line of standard input; EOFError after the last."""
    say(f"{question}:", end=" ")
    try:
        line = sys.stdin.readline()
    except UnicodeDecodeError:
        raise UserError("the answers are not UTF-8.") from None
    if not line:
        console.print()
        raise EOFError
    if not sys.stdin.isatty():  # so that what is shown reads as in a terminal
        say(line.strip())
    return line.strip()


def _kept(tables: Tables, facts_out: Path | None) -> str:
    """What was answered goes to a file beside the facts file that it would have become; said in a sentence."""
    from runtime.design.write import facts_text

    if facts_out is None or not any(tables.get(section) for section in tables if section != "name"):
        return ""
    part = facts_out.with_suffix(".part.toml")
    write_text(part, facts_text(tables))
    return f" What was answered lies in {part}: complete it (docs/design.md), then: pmsm-ickf design {part}"
