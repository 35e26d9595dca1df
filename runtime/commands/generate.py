"""The command ``generate``: folders from drive files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from codegen.targets.find import target_names
from runtime.commands.terminal import say, working
from runtime.commands.words import Drives, caution, show_written
from runtime.folders.generate import generate_drives
from runtime.system.values import output_folder


def generate(
    drives: Drives = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Write DIR/<drive>. Default: the project's generated/ for shipped drives, else ./generated.",
        ),
    ] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Write nothing; exit 1 with a diff if a folder is stale.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Overwrite a folder that was edited by hand.")] = False,
    form: Annotated[
        str, typer.Option(metavar="NAME", help="fast (what is shipped), or literal: the paper's shape, for reading.")
    ] = "fast",
    target: Annotated[
        str | None,
        typer.Option(metavar="NAME", help=f"Processor, in the place of the drive file's: {', '.join(target_names())}."),
    ] = None,
    constant_time: Annotated[
        bool,
        typer.Option(
            "--constant-time",
            help="A filter's step takes the same path whatever its numbers, as [target] constant_time = true.",
        ),
    ] = False,
) -> None:
    """Generate C for the drive's target, host C and Python from drive files."""
    if out is not None and not check:
        output_folder(out, "--out")
    caution(drives)
    with working() as progress:
        written = generate_drives(drives or [], out, check, force, form, progress, target, constant_time)
    if check:
        for item in written:
            if item.diff:
                say(item.diff)
    show_written(written)
    if any(item.state == "stale" for item in written):
        raise typer.Exit(1)
