"""The command ``page``: a filter in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from runtime.commands.paths import writes_folder
from runtime.commands.terminal import say
from runtime.commands.words import DRIVE


def page(
    drive: Annotated[str, typer.Argument(metavar="DRIVE", help=DRIVE)],
    out: Annotated[Path, writes_folder("Where index.html goes.", show_default=False)],
    filter_kind: Annotated[
        str | None, typer.Option("--filter", metavar="KIND", help="Default: ickf where there is one.")
    ] = None,
) -> None:
    """Write a page that runs the filter, the firmware's bits, on a recording dropped into it; no server.

    Needs clang and wasm-ld.
    """
    from runtime.browser.page import write_browser_page
    from runtime.folders.resolve import drive_folder, find_drive

    folder = drive_folder(drive)
    written = write_browser_page(folder, folder.chosen(filter_kind), find_drive(drive), out)
    say(f"Page: {written}")
