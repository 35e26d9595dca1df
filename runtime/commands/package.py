"""The command ``package``: a drive as a folder for a build system."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from runtime.commands.paths import writes_folder
from runtime.commands.terminal import say
from runtime.commands.words import DRIVE


class System(StrEnum):
    """Build systems."""

    cmake = "cmake"
    arduino = "arduino"
    zephyr = "zephyr"
    ccs = "ccs"
    platformio = "platformio"


def package(
    drive: Annotated[str, typer.Argument(metavar="DRIVE", help=DRIVE)],
    system: Annotated[System, typer.Option("--for", help="Build system.", show_default=False)],
    out: Annotated[Path, writes_folder("The folder to write.", show_default=False)],
    filter_kind: Annotated[
        str | None, typer.Option("--filter", metavar="KIND", help="Default: ickf where there is one.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite a package that was edited by hand.")] = False,
) -> None:
    """Write a folder with the drive's C, build files, and a first program, for a build system.

    It is written whole or not at all, and never over what you have edited unless --force says so.
    """
    from codegen.output.folder import write_folder
    from runtime.folders.resolve import drive_folder
    from runtime.packages.package import BUILD_SYSTEMS, package_files

    folder = drive_folder(drive)
    files = package_files(folder, folder.chosen(filter_kind), system.value)
    write_folder(out, files, force)
    say(f"Written: {out}, {len(files)} files for {BUILD_SYSTEMS[system.value].title}. Read its README.md.")
    say(BUILD_SYSTEMS[system.value].built)
