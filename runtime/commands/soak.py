"""The command ``soak``: hours of drive time."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from model.drives.load import shipped_drives
from runtime.commands.paths import writes_folder
from runtime.commands.terminal import console, say, work_bar
from runtime.commands.words import Drives, Json
from runtime.system.files import write_facts
from runtime.system.verdicts import all_hold


def soak(
    drives: Drives = None,
    steps: Annotated[
        int, typer.Option(min=1, max=10**12, help="Of the first drive; the others make a tenth of them.")
    ] = 1_000_000_000,
    kind: Annotated[
        str | None, typer.Option("--filter", metavar="KIND", help="Default: the drive's ickf, else its first.")
    ] = None,
    plots: Annotated[Path | None, writes_folder("Write soak.svg: deviations over steps.")] = None,
    json: Json = None,
) -> None:
    """Hours of drive time: the firmware's float32 filter beside float64, through reversals, standstill, weak field.

    Exit code 1: the two came apart, a status bit without a reason, or a lost lock. Default: paper_spmsm, then the other
    shipped drives.
    """
    from runtime.endurance.soak import soak as run
    from runtime.endurance.tables import soak_facts, soak_table, soaks_verdict

    if plots is not None:
        from runtime.endurance.figures import write_soak_figure
        from runtime.style.figures import pyplot

        pyplot()  # what is missing is said before the work
    shipped = sorted(shipped_drives(), key=lambda name: name != "paper_spmsm")
    names = drives or shipped
    runs = [(name, steps if k == 0 else max(1, steps // 10)) for k, name in enumerate(names)]
    with work_bar("steps", sum(count for _, count in runs)) as tell:
        soaks = run(runs, kind, tell)
    for result in soaks:
        console.print(soak_table(result))
        console.print()
    for line, style in soaks_verdict(soaks):
        console.print(f"[{style}]{escape(line)}[/{style}]", highlight=False, soft_wrap=True)
    if plots is not None:
        say(f"Figure: {write_soak_figure(soaks, plots)}")
    if json is not None:
        write_facts(json, soak_facts(soaks))
    if not all_hold(not result.failures() for result in soaks):
        raise typer.Exit(1)
