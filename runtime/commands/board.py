"""Commands that talk to a board over a serial line: ``pil`` and ``record``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from runtime.board.pil import PilResult
from runtime.commands.terminal import console
from runtime.errors import UserError

Port = Annotated[
    str,
    typer.Option("--port", metavar="PORT", help="/dev/ttyUSB0, COM3, ...; 'simulated': a board made of this machine."),
]
Baud = Annotated[int, typer.Option("--baud", min=300, help="Bits a second, as the board's firmware sets them.")]


def pil(
    port: Port,
    drive: Annotated[
        str | None,
        typer.Argument(
            metavar="DRIVE", help="A shipped name or a generated folder. Default: the drive the board says it runs."
        ),
    ] = None,
    baud: Baud = 115200,
    kind: Annotated[
        str | None, typer.Option("--filter", metavar="KIND", help="Refuse a board that runs another filter.")
    ] = None,
    steps: Annotated[int, typer.Option(min=1, help="How many steps, at most.")] = 2000,
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
    ticks_hz: Annotated[
        float | None,
        typer.Option("--ticks-hz", metavar="HZ", min=1.0, help="Rate of the board's timer, to give times."),
    ] = None,
    timeout: Annotated[
        float | None, typer.Option(metavar="S", min=0.001, help="Silence after which a request is sent again.")
    ] = None,
    attempts: Annotated[int, typer.Option(min=1, help="How often a step is sent before it is lost.")] = 20,
    json: Annotated[Path | None, typer.Option("--json", metavar="F", help="Write every figure to this file.")] = None,
) -> None:
    """Link G: step the filter on your board over a serial line, compare each step with the host, measure its time.

    The board needs the loop of its generated folder, board/pmsm_pil.c; docs/board.md tells how. Exit code 0: every
    step was compared and agreed; 1: one did not, or was lost on the line; 2: no board, or not this one.
    """
    from runtime.board.session import LineSettings, write_json
    from runtime.board.session import pil as run
    from runtime.report.board_tables import pil_tables

    line = LineSettings(port, baud, timeout, attempts)
    columns = (TextColumn("stepping the board"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=steps)
        result = run(
            line, drive, kind, data, steps, mode, tolerance, backend,
            lambda done, of: bar.update(task, completed=done, total=of),
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


def record(
    port: Port,
    drive: Annotated[
        str | None, typer.Argument(metavar="DRIVE", help="Of a simulated board; a real one is not asked.")
    ] = None,
    baud: Baud = 115200,
    out: Annotated[Path, typer.Option(metavar="FILE", help="Recorded data: .npz or .csv.")] = Path("recorded.npz"),
    seconds: Annotated[
        float | None, typer.Option(metavar="S", min=0.1, help="How long. Default: until Ctrl-C.")
    ] = None,
    plot: Annotated[bool, typer.Option("--plot", help="Live curves, where there is a display.")] = False,
) -> None:
    """Record what the board sends (board/pmsm_telemetry.c): voltages, currents and its estimates, gaps marked.

    Ctrl-C ends it and keeps what came. The file's columns: t, u_alpha, u_beta, i_alpha, i_beta as replay wants them,
    and omega_estimate, theta_estimate, sample, lost_before.
    """
    from runtime.board.session import LineSettings, record_data
    from runtime.report.board_tables import recording_table
    from runtime.report.live import live_view

    if out.exists():
        raise UserError(f"'{out}' exists; move it away or choose another --out.")
    with live_view(console, plot) as show:
        recording = record_data(LineSettings(port, baud), drive, out, seconds, show)
    console.print(recording_table(recording, last=False), highlight=False)
    if recording.ended:
        raise UserError(f"{recording.ended} {recording.rows} samples are in '{out}'.")
    if not recording.rows:
        out.unlink(missing_ok=True)
        raise UserError("nothing was received: does the board poll pmsm_telemetry, at this --baud?")
    console.print(f"Recorded: {out}", highlight=False, soft_wrap=True)
