"""The command ``faults``: what a drive in operation survives."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from runtime.commands.numbers import ANY
from runtime.commands.paths import writes_folder
from runtime.commands.terminal import console, say, working
from runtime.commands.words import Drives, Json
from runtime.system.verdicts import all_hold


def faults(
    drives: Drives = None,
    filters: Annotated[
        str | None, typer.Option(metavar="KINDS", help="Comma-separated, such as ckf,ickf. Default: the drive's own.")
    ] = None,
    only: Annotated[str | None, typer.Option(metavar="NAMES", help="Comma-separated: some of the faults.")] = None,
    seeds: Annotated[
        int, typer.Option(min=1, max=1_000_000, metavar="N", help="Runs of each fault: noise, instant, garbage.")
    ] = 20,
    load: Annotated[float | None, typer.Option(metavar="NM", callback=ANY, help="Load torque; default: rated.")] = None,
    speed: Annotated[
        float | None, typer.Option(metavar="RPM", callback=ANY, help="Speed reference; default: rated.")
    ] = None,
    json: Json = None,
    out: Annotated[Path | None, writes_folder("Write a figure a drive (svg).")] = None,
) -> None:
    """Inject faults at speed under load: sensors, converter, DC link, power: whether and how fast the drive recovers.

    The generated example interrupt drives the generated motor. Exit code 1: a run did not recover.
    """
    from model.drives.load import shipped_drives
    from runtime.faults.catalogue import find_faults
    from runtime.faults.survey import survey, write_outcomes
    from runtime.faults.tables import LEGEND, fault_table
    from runtime.folders.resolve import drive_folder

    if out is not None:
        from runtime.faults.figures import write_fault_figures
        from runtime.style.figures import pyplot

        pyplot()  # what is missing is said before the work
    chosen = find_faults(only)
    folders = [drive_folder(drive) for drive in drives or shipped_drives()]
    with working() as progress:
        outcomes = survey(folders, filters.split(",") if filters else None, seeds, load, speed, chosen, progress)
    for drive, kind in dict.fromkeys((outcome.drive, outcome.kind) for outcome in outcomes):
        console.rule(f"[bold]{drive}, {kind}[/bold]", align="left")
        console.print(fault_table([outcome for outcome in outcomes if (outcome.drive, outcome.kind) == (drive, kind)]))
    console.print(LEGEND, highlight=False)
    if json is not None:
        write_outcomes(outcomes, json)
    if out is not None:
        for path in write_fault_figures(outcomes, out):
            say(f"Figure: {path}")
    if not all_hold(outcome.recovered for outcome in outcomes):
        raise typer.Exit(1)
