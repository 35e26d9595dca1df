"""The command ``compare``: drives side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from runtime.commands.paths import writes_folder
from runtime.commands.terminal import console, say, working
from runtime.commands.words import DRIVE, Json
from runtime.system.verdicts import all_hold


def compare(
    drives: Annotated[
        list[str],
        typer.Argument(metavar="DRIVE DRIVE...", help=DRIVE),
    ],
    out: Annotated[Path | None, writes_folder("Write index.html and its figures (svg).")] = None,
    json: Json = None,
) -> None:
    """Put drives side by side: files, equations, structure of F and H, cost, certificate, accuracy in the loop.

    Exit code 1: one of them lost lock.
    """
    from runtime.compare.facts import write_json
    from runtime.compare.subject import collect
    from runtime.compare.tables import compare_tables

    if out is not None:
        from runtime.compare.page import write_comparison
        from runtime.style.figures import pyplot

        pyplot()  # what is missing is said before the work
    with working() as progress:
        subjects = collect(drives, progress)
    console.print(compare_tables(subjects), highlight=False)
    if json is not None:
        write_json(subjects, json)
    if out is not None:
        say(f"Page: {write_comparison(subjects, out)}")
    if not all_hold(run.good for subject in subjects for run in subject.runs):
        raise typer.Exit(1)
