"""Commands that put the generated C under stress: ``fuzz`` and ``soak``."""

from __future__ import annotations

import json as json_module
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from model.drive import shipped_drives
from runtime.commands.terminal import console, counting
from runtime.files import write_text

Drives = Annotated[
    list[str] | None,
    typer.Argument(metavar="DRIVE", help="A shipped name or a generated folder. Default: every shipped drive."),
]
Json = Annotated[Path | None, typer.Option("--json", metavar="F", help="Write every figure to this file.")]


def fuzz(
    drives: Drives = None,
    executions: Annotated[
        int, typer.Option(min=1, help="Of each filter; with its lane form beside it, and its controller, get a tenth.")
    ] = 10_000_000,
    corpus: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Begin with the inputs kept there, and keep those that show something new."),
    ] = None,
    json: Json = None,
) -> None:
    """Arbitrary bits for state, tuning and inputs of every filter and controller, under libFuzzer and sanitizers.

    A step must leave finite numbers, theta in [-pi, pi) and no negative pivot, or say that it restarted; a Q or R that
    is no number must not pass in silence; duty cycles stay within 0 .. 1 whatever happens. Exit code 1: something was
    found; the shortest input that shows it is printed.
    """
    from runtime.endurance.fuzz import fuzz as search
    from runtime.endurance.target import targets
    from runtime.report.endurance_tables import campaign_facts, campaigns_table, finding_lines

    chosen = [target for drive in drives or shipped_drives() for target in targets(drive)]
    tasks = [(target, max(1, executions // 10) if target.form else executions) for target in chosen]
    with _bar("executions", sum(runs for _, runs in tasks)) as tell:
        campaigns = search(tasks, corpus, tell)
    console.print(campaigns_table(campaigns))
    for line in finding_lines(campaigns):
        console.print(f"[red]{escape(line)}[/red]", highlight=False, soft_wrap=True)
    if json is not None:
        write_text(json, json_module.dumps(campaign_facts(campaigns), indent=2) + "\n")
    if any(campaign.findings for campaign in campaigns):
        raise typer.Exit(1)


def soak(
    drives: Drives = None,
    steps: Annotated[
        int, typer.Option(min=1, help="Of the first drive; the others make a tenth of them.")
    ] = 1_000_000_000,
    kind: Annotated[str, typer.Option("--filter", metavar="KIND", help="ckf or ickf.")] = "ickf",
    plots: Annotated[Path | None, typer.Option(metavar="DIR", help="Write soak.svg: deviations over steps.")] = None,
    json: Json = None,
) -> None:
    """Hours of drive time: the firmware's float32 filter beside float64, through reversals, standstill, weak field.

    Exit code 1: the two came apart, a status bit without a reason, or a lost lock. Default: paper_spmsm, then the other
    shipped drives.
    """
    from runtime.endurance.soak import soak as run
    from runtime.report.endurance_tables import soak_facts, soak_table, soaks_verdict

    if plots is not None:
        from runtime.report.endurance_figures import write_soak_figure
        from runtime.report.figures import pyplot

        pyplot()  # what is missing is said before the work
    shipped = sorted(shipped_drives(), key=lambda name: name != "paper_spmsm")
    names = drives or shipped
    runs = [(name, steps if k == 0 else max(1, steps // 10)) for k, name in enumerate(names)]
    with _bar("steps", sum(count for _, count in runs)) as tell:
        soaks = run(runs, kind, tell)
    for result in soaks:
        console.print(soak_table(result))
        console.print()
    for line, style in soaks_verdict(soaks):
        console.print(f"[{style}]{escape(line)}[/{style}]", highlight=False, soft_wrap=True)
    if plots is not None:
        console.print(f"Figure: {write_soak_figure(soaks, plots)}", highlight=False, soft_wrap=True)
    if json is not None:
        write_text(json, json_module.dumps(soak_facts(soaks), indent=2) + "\n")
    if any(result.failures() for result in soaks):
        raise typer.Exit(1)


@contextmanager
def _bar(what: str, total: int) -> Iterator[Callable[[str, int], None]]:
    """A progress bar, where there is a terminal, of so many executions or steps."""
    with counting(what, total=total) as update:
        yield lambda name, more: update(advance=more, description=escape(name))
