"""The command ``design``: a drive file from facts."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from runtime.commands.paths import writes_file
from runtime.commands.terminal import console, counting, say, working
from runtime.commands.words import Json
from runtime.system.errors import UserError
from runtime.system.files import write_facts, write_text

if TYPE_CHECKING:
    from runtime.design.facts import Facts

Draws = Annotated[int, typer.Option(min=8, max=100_000, help="Motors drawn within tolerance, at each speed.")]
Seed = Annotated[int, typer.Option(min=0, max=2**63, help="Of everything drawn.")]


def design(
    facts: Annotated[Path, typer.Argument(metavar="FACTS", help="A facts file (TOML): what you know of the drive.")],
    out: Annotated[Path | None, writes_file("Write the drive file here.", endings=(".toml",))] = None,
    write: Annotated[
        Path | None,
        writes_file("Edit this drive file; its comments and other keys stay.", endings=(".toml",)),
    ] = None,
    check: Annotated[bool, typer.Option("--check", help="Only the rules and the trial; write nothing.")] = False,
    draws: Draws = 128,
    seed: Seed = 1,
    json: Json = None,
) -> None:
    """Make a drive file from facts, and try it: motors within tolerance, a switching inverter, a load step.

    Ends with 1 where the design does not hold from a tenth of rated speed on; the file is written all the same.
    """
    from runtime.design.facts import read_facts

    if check and (out or write):
        raise UserError("--check writes nothing: leave out --out and --write, or --check.")
    if not check and not (out or write):
        raise UserError("say where the drive file goes: --out F, --write F to edit one, or --check to write none.")
    carry_out(read_facts(facts), facts.name, out, write, draws, seed, json)


def carry_out(
    known: Facts, where: str, out: Path | None, write: Path | None, draws: int, seed: int, json: Path | None
) -> None:
    """Rules, trial, and what they say; the drive file to ``out``, into ``write``, or to neither.

    Parameters
    ----------
    known : Facts
    where : str
        Name of the facts file.
    out, write, json : Path or None
    draws, seed : int
    """
    from runtime.design.cost import priced
    from runtime.design.rules import design as make
    from runtime.design.tables import trial_facts, trial_table
    from runtime.design.trial import blame, package, try_out
    from runtime.design.write import drive_text, edit_drive, read_document

    if write:
        read_document(write, known.name)  # what cannot be edited is said before the work
    with working() as progress:
        progress(f"{known.name}: rules")
        drafted = make(known)
        progress(f"{known.name}: generating")
        made = package(drafted)
        chosen = priced(drafted, made)
    text = drive_text(chosen, where)
    edited = edit_drive(chosen, write) if write else None
    for line in chosen.remarks:
        console.print(f"[yellow]{escape(line)}[/yellow]", highlight=False, soft_wrap=True)
    with counting("runs") as update:
        trial = try_out(known, chosen, made, draws, seed, progress=lambda done, of: update(completed=done, total=of))
    console.print(trial_table(trial))
    for line in blame(trial):
        console.print(f"[yellow]{escape(line)}[/yellow]", highlight=False, soft_wrap=True)
    if out:
        write_text(out, text)
    if write and edited is not None:
        write_text(write, edited)
    if json is not None:
        write_facts(json, trial_facts(trial, chosen))
    for path in (out, write):
        if path is not None:
            say(f"Drive file: {path}")
    style, word = ("green", "holds") if trial.holds else ("bold red", "does NOT hold")
    console.print(
        f"{known.name}: [{style}]{word}[/{style}] at a tenth of rated speed and above; "
        f"{trial.success:.1%} of the draws hold at all of these speeds",
        highlight=False,
        soft_wrap=True,
    )
    if not trial.holds:
        raise typer.Exit(1)
