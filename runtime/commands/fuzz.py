"""The command ``fuzz``: arbitrary bits into the generated C."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from model.drives.load import shipped_drives
from runtime.commands.paths import writes_folder
from runtime.commands.terminal import console, work_bar
from runtime.commands.words import Drives, Json
from runtime.system.files import write_facts
from runtime.system.verdicts import all_hold


def fuzz(
    drives: Drives = None,
    executions: Annotated[
        int,
        typer.Option(
            min=1, max=10**12, help="Of each filter; with its lane form beside it, and its controller, get a tenth."
        ),
    ] = 10_000_000,
    corpus: Annotated[
        Path | None,
        writes_folder(
            "Begin with the inputs kept there, and keep those that show something new.",
        ),
    ] = None,
    json: Json = None,
) -> None:
    """Arbitrary bits for state, tuning and inputs of every filter and controller, under libFuzzer and sanitizers.

    A step must leave finite numbers, theta in [-pi, pi) and no negative pivot, or say that it restarted; a Q or R that
    is no number must not pass in silence; duty cycles stay within 0 .. 1 whatever happens. Exit code 1: something was
    found; the shortest input that shows it is printed.
    """
    from runtime.endurance.fuzz import fuzz as search
    from runtime.endurance.tables import campaign_facts, campaigns_table, finding_lines
    from runtime.endurance.target import targets

    chosen = [target for drive in drives or shipped_drives() for target in targets(drive)]
    tasks = [(target, max(1, executions // 10) if target.form else executions) for target in chosen]
    with work_bar("executions", sum(runs for _, runs in tasks)) as tell:
        campaigns = search(tasks, corpus, tell)
    console.print(campaigns_table(campaigns))
    for line in finding_lines(campaigns):
        console.print(f"[red]{escape(line)}[/red]", highlight=False, soft_wrap=True)
    if json is not None:
        write_facts(json, campaign_facts(campaigns))
    if not all_hold(campaign.good for campaign in campaigns):
        raise typer.Exit(1)
