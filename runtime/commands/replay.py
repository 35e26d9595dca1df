"""The command ``replay``: recorded data through a generated filter."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.progress import TaskProgressColumn

from runtime.commands.numbers import ANGLE
from runtime.commands.paths import writes_file, writes_folder
from runtime.commands.recordings import Begins, DcLink, Offset, Rename, Resample, Scale, Wiring, read
from runtime.commands.terminal import console, counting, say
from runtime.commands.words import DRIVE, Json
from runtime.system.values import read_number

if TYPE_CHECKING:
    from runtime.replay.replay import Replay

Kind = Annotated[
    str | None, typer.Option("--filter", metavar="KIND", help="Default: the drive's ickf, else its first.")
]
Theta0 = Annotated[
    float | None,
    typer.Option(metavar="RAD", callback=ANGLE, help="Start at standstill, the rotor at this electrical angle."),
]


def replay(
    drive: Annotated[str, typer.Argument(metavar="DRIVE", help=DRIVE)],
    data: Annotated[
        Path, typer.Argument(metavar="DATA", help="Recorded data: .npz, .mat, .mf4 or a .csv from anywhere.")
    ],
    kind: Kind = None,
    backend: Annotated[str, typer.Option(metavar="NAME", help="c (the generated C) or numpy (its twin).")] = "c",
    dtype: Annotated[str, typer.Option(metavar="NAME", help="float32: the firmware's bits; or float64.")] = "float32",
    rename: Rename = None,
    scale: Scale = None,
    offset: Offset = None,
    wiring: Wiring = None,
    begins: Begins = False,
    dc_link: DcLink = None,
    resample: Resample = False,
    x0: Annotated[str | None, typer.Option(metavar="A,B,...", help="Start from this state, in state order.")] = None,
    theta0: Theta0 = None,
    out: Annotated[Path | None, writes_file("Write t, x, P, status.", metavar="F.npz")] = None,
    plots: Annotated[Path | None, writes_folder("Write estimate.svg and innovations.svg.")] = None,
    json: Json = None,
) -> None:
    """Run recorded data through a generated filter and judge whether it is right about them.

    DATA has columns t s; u_alpha, u_beta V, mean over the interval ending at t; i_alpha, i_beta A at t. Phase currents
    i_a, i_b[, i_c] and voltages u_a, u_b, u_c (to any common point) or u_ab, u_bc will do, as will duty_a, duty_b,
    duty_c and u_dc. With omega (rad/s, mechanical), theta (rad, electrical) or load_torque (N m) as truth, errors are
    shown. Exit code 1: the estimate did not stay a number, or most rows were rejected.
    """
    from runtime.folders.resolve import drive_folder
    from runtime.replay.replay import Settings, check_estimates
    from runtime.replay.replay import replay as run

    if out is not None:
        check_estimates(out)
    if plots is not None:
        from runtime.style.figures import pyplot

        pyplot()  # what is missing is said before the work
    folder = drive_folder(drive)
    settings = Settings(kind, backend, dtype, _numbers(x0), theta0)
    recorded = read(
        data,
        rename,
        scale,
        (offset, wiring, begins, dc_link),
        (folder.module.SAMPLE_TIME, folder.drive) if resample else None,
    )
    with counting("replaying", TaskProgressColumn(), total=1.0) as update:
        result = run(folder, recorded, settings, lambda share: update(completed=share))
    _show(result)
    _write(result, out, json, plots)
    if not result.finite:
        console.print("[bold red]the estimate did not stay a number[/bold red]", highlight=False)
    if result.unused:
        console.print("[bold red]most rows were rejected: an estimate of next to nothing[/bold red]", highlight=False)
    if result.unused or not result.finite:
        raise typer.Exit(1)


def _write(result: Replay, out: Path | None, json: Path | None, plots: Path | None) -> None:
    if out is not None:
        result.write_estimates(out)
    if json is not None:
        result.write_json(json)
    if plots is not None:
        from runtime.replay.figures import write_figures

        for path in write_figures(result, plots):
            say(f"Figure: {path}")


def _show(result: Replay) -> None:
    from runtime.replay.tables import replay_tables

    for note in result.notes:
        console.print(f"[yellow]note:[/yellow] {escape(note)}", highlight=False, soft_wrap=True)
    console.print(replay_tables(result), highlight=False)


def _numbers(text: str | None) -> tuple[float, ...] | None:
    if text is None:
        return None
    return tuple(read_number(part.strip(), f"--x0 '{text}':") for part in text.split(","))
