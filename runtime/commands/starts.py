"""The command ``starts``: whether a drive finds its rotor, wherever it stands and however it turns."""

from __future__ import annotations

from typing import Annotated

import typer

from runtime.commands.terminal import console, working
from runtime.commands.words import Drives, Json
from runtime.system.verdicts import all_hold


def starts(
    drives: Drives = None,
    filters: Annotated[
        str | None, typer.Option(metavar="KINDS", help="Comma-separated, such as ckf,ickf. Default: the drive's own.")
    ] = None,
    runs: Annotated[
        int, typer.Option(min=1, max=1_000_000, metavar="N", help="Of each: motor, angle, load and noise are drawn.")
    ] = 100,
    turning: Annotated[bool, typer.Option("--turning", help="Also rotors that turn at power-up.")] = False,
    reverse: Annotated[bool, typer.Option("--reverse", help="Also reversals through zero speed under load.")] = False,
    still: Annotated[
        bool, typer.Option("--still", help="Also standstill under load: held, or what is promised of a round rotor.")
    ] = False,
    slow: Annotated[
        bool, typer.Option("--slow", help="Also starts to a crawl, long after power-up: 0.2 to 10 % of rated speed.")
    ] = False,
    json: Json = None,
) -> None:
    """Start drives from rest at an unknown angle, in either direction, under load: whether and how fast they lock.

    The generated example interrupt drives the generated motor. Exit code 1: a run did not lock, or a
    standstill was not as promised.
    """
    from model.drives.load import shipped_drives
    from runtime.faults.slow import SLOW
    from runtime.faults.standstill import STANDSTILL
    from runtime.faults.starts import FROM_REST, REVERSAL, TURNING, survey_starts, write_starts
    from runtime.faults.tables import SLOW_LEGEND, STANDSTILL_LEGEND, STARTS_LEGEND, starts_table
    from runtime.folders.resolve import drive_folder

    tasks = [
        FROM_REST,
        *([TURNING] if turning else []),
        *([REVERSAL] if reverse else []),
        *([STANDSTILL] if still else []),
        *([SLOW] if slow else []),
    ]
    folders = [drive_folder(drive) for drive in drives or shipped_drives()]
    with working() as progress:
        found = survey_starts(folders, filters.split(",") if filters else None, tasks, runs, progress)
    console.print(starts_table(found))
    console.print(STARTS_LEGEND, highlight=False)
    if still:
        console.print(STANDSTILL_LEGEND, highlight=False)
    if slow:
        console.print(SLOW_LEGEND, highlight=False)
    if json is not None:
        write_starts(found, json)
    if not all_hold(item.locked for item in found):
        raise typer.Exit(1)
