"""The command ``record``: what a board sends, into a file of recorded data."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from runtime.commands.numbers import within
from runtime.commands.paths import writes_file
from runtime.commands.serial import Baud, Port
from runtime.commands.terminal import console, say
from runtime.system.errors import UserError


def record(
    port: Port,
    drive: Annotated[
        str | None, typer.Argument(metavar="DRIVE", help="Of a simulated board; a real one is not asked.")
    ] = None,
    baud: Baud = 115200,
    out: Annotated[Path, writes_file("Recorded data: .npz or .csv.", metavar="FILE")] = Path("recorded.npz"),
    seconds: Annotated[
        float | None, typer.Option(metavar="S", callback=within(0.1, 1e6), help="How long. Default: until Ctrl-C.")
    ] = None,
    plot: Annotated[bool, typer.Option("--plot", help="Live curves, where there is a display.")] = False,
) -> None:
    """Record what the board sends (board/pmsm_telemetry.c): voltages, currents and its estimates, gaps marked.

    Ctrl-C ends it and keeps what came. The file's columns: t, u_alpha, u_beta, i_alpha, i_beta as replay wants them,
    and omega_estimate, theta_estimate, sample, lost_before.
    """
    from runtime.board.live import live_view
    from runtime.board.session import LineSettings, record_data
    from runtime.board.tables import recording_table

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
    say(f"Recorded: {out}")
