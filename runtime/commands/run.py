"""The command ``run``: the main result in a minute, and everything."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from runtime.commands.paths import writes_folder
from runtime.commands.terminal import console, working
from runtime.commands.words import Fresh, show_remarks, show_summary, show_written
from runtime.report.run import MAIN, Ran
from runtime.report.run import run as run_drives
from runtime.system.verdicts import all_hold

#: The chapters that the second floor adds.
SECOND = "every drive, emulated processors, static checks (compilers, MISRA, EVA), peers, ablation, sample times"


def run(
    drives: Annotated[
        list[str] | None,
        typer.Argument(metavar="DRIVE", help=f"With each, everything about it. Default: the main result, {MAIN}."),
    ] = None,
    everything: Annotated[bool, typer.Option("--all", help=f"Everything: {SECOND}.")] = False,
    build: Annotated[Path, writes_folder("Where the report page goes.", "--build")] = Path("build"),
    fresh: Fresh = False,
) -> None:
    """The main result in a minute: the paper's drive generated, proved, simulated, and build/report/index.html."""
    from runtime.drive.tables import runs_table
    from runtime.firmware.tables import checks_table

    with working() as progress:
        ran = run_drives(drives or [], build, everything, fresh, progress)
    show_written(ran.written)
    for chapter in ran.chapters:
        show_summary(chapter.proof)
        console.print(runs_table(chapter.runs))
        if chapter.firmware is not None:
            console.print(checks_table(chapter.firmware.checks))
            show_remarks(chapter.firmware.checks)
    _conclude(ran)
    if not all_hold(chapter.good for chapter in ran.chapters):
        raise typer.Exit(1)


def _conclude(ran: Ran) -> None:
    """The verdict, on what it rests, what was not looked at, and where to read on."""

    def line(text: str) -> None:
        console.print(text, highlight=False, soft_wrap=True)

    failures = [failure for chapter in ran.chapters for failure in chapter.failures()]
    for failure in failures:
        line(f"[red]{escape(failure)}[/red]")
    links = sorted({link.name for chapter in ran.chapters for link in chapter.proof.links})
    names = ", ".join(chapter.drive.name for chapter in ran.chapters)
    verdict = "[bold red]FAILED[/]" if failures or not ran.chapters else "[green]GOOD[/]"
    line(f"{verdict}: {names}: generated; links {', '.join(links)}; simulated")
    unrun = [check for c in ran.chapters if c.firmware for check in c.firmware.checks if check.state == "not run"]
    if unrun:
        line(f"[yellow]Not run here: {len(unrun)} firmware checks whose tools are missing (see above).[/yellow]")
    if not ran.whole:
        line(f"Not shown: {SECOND}. Run: pmsm-ickf run --all")
    line(f"Report: {ran.page}")
