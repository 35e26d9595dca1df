"""The command ``pil``: the filter on a board, step by step beside the host."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from runtime.board.pil import PilResult
from runtime.commands.numbers import within
from runtime.commands.serial import Baud, Port
from runtime.commands.terminal import console, counting
from runtime.commands.words import DRIVE, Json
from runtime.system.errors import UserError

TicksHz = Annotated[
    float | None,
    typer.Option(
        "--ticks-hz", metavar="HZ", callback=within(1.0, 1e12), help="Rate of the board's timer, to give times."
    ),
]
Timeout = Annotated[
    float | None,
    typer.Option(metavar="S", callback=within(1e-3, 1e3), help="Silence after which a request is sent again."),
]


def pil(
    port: Port,
    drive: Annotated[
        str | None,
        typer.Argument(metavar="DRIVE", help=f"{DRIVE} Default: the drive the board says it runs."),
    ] = None,
    baud: Baud = 115200,
    kind: Annotated[
        str | None, typer.Option("--filter", metavar="KIND", help="Refuse a board that runs another filter.")
    ] = None,
    steps: Annotated[int, typer.Option(min=1, max=10**9, help="How many steps, at most.")] = 2000,
    data: Annotated[
        Path | None, typer.Option(metavar="F", help="Recorded data (npz, csv) as input. Default: a start under load.")
    ] = None,
    tolerance: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="bits, or certificate: the drive's float32 certificate, for a chip that divides otherwise.",
        ),
    ] = "bits",
    mode: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="free: both run on their own bits; single: each step from the board's state before it. "
            "Default: free for bits, single for certificate.",
        ),
    ] = None,
    backend: Annotated[str, typer.Option(metavar="NAME", help="The host's side: numpy or c.")] = "numpy",
    ticks_hz: TicksHz = None,
    timeout: Timeout = None,
    attempts: Annotated[int, typer.Option(min=1, max=10**6, help="How often a step is sent before it is lost.")] = 20,
    json: Json = None,
) -> None:
    """Link G: step the filter on your board over a serial line, compare each step with the host, measure its time.

    The board needs the loop of its generated folder, board/pmsm_pil.c; docs/board.md tells how. Exit code 0: every
    step was compared and agreed; 1: one did not, or was lost on the line; 2: no board, or not this one.
    """
    from runtime.board.session import LineSettings, write_json
    from runtime.board.session import pil as run
    from runtime.board.tables import pil_tables

    line = LineSettings(port, baud, timeout, attempts)
    with counting("stepping the board", total=steps) as tell:
        result = run(
            line, drive, kind, data, steps, mode, tolerance, backend,
            lambda done, of: tell(completed=done, total=of),
        )  # fmt: skip
    console.print(pil_tables(result, ticks_hz), highlight=False)
    if json is not None:
        write_json(result, ticks_hz, json)
    _verdict(result)


def _verdict(result: PilResult) -> None:
    """One line, and the exit code."""
    name = f"{result.identity.drive}/{result.identity.kind}"
    if result.divergence is not None:
        line = f"pil {name}, link G: {result.divergence}; {result.different:,} steps differ"
        console.print(f"[red]{escape(line)}[/red]", highlight=False, soft_wrap=True)
    if result.interrupted:
        console.print(f"interrupted after {result.compared:,} steps", highlight=False)
        raise typer.Exit(1 if result.divergence is not None else 130)
    if result.ended:
        raise UserError(f"{result.ended} {result.compared} of {result.wanted} steps were compared.")
    if not result.passed:
        reason = "the board differs" if result.divergence is not None else f"{len(result.lost)} steps were lost"
        console.print(f"{name}: [bold red]NOT proved[/bold red], {reason}", highlight=False)
        raise typer.Exit(1)
    what = "bit for bit" if result.tolerance == "bits" else "within the certificate"
    console.print(f"{name}: [green]the board agrees {what}[/green], {result.compared:,} steps", highlight=False)
