"""The command ``run``: everything."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from runtime.commands.terminal import console, working
from runtime.commands.words import Drives, show_remarks, show_summary, show_written
from runtime.report.run import run_all


def run(
    drives: Drives = None,
    build: Annotated[Path, typer.Option("--build", metavar="DIR", help="Where the report page goes.")] = Path("build"),
) -> None:
    """Everything: regenerate, verify, simulate, and write build/report/index.html."""
    from runtime.drive.tables import runs_table
    from runtime.firmware.tables import checks_table

    with working() as progress:
        written, chapters, page = run_all(drives or [], build, progress)
    show_written(written)
    for chapter in chapters:
        proof = chapter.proof
        show_summary(proof)
        console.print(runs_table(chapter.runs))
        console.print(checks_table(chapter.firmware.checks))
        show_remarks(chapter.firmware.checks)
    console.print(f"Report: {page}", highlight=False, soft_wrap=True)
    if not all(chapter.good for chapter in chapters):
        raise typer.Exit(1)
