"""Words that several commands share: their argument DRIVE, and what they say of drives, folders, checks, proofs."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from model.drives.load import cautions
from runtime.commands.terminal import console
from runtime.firmware.static.check import Check
from runtime.folders.generate import Written
from runtime.folders.resolve import find_drive
from runtime.proof.result import Proof
from runtime.style.tables import columns_table

DRIVE = "A shipped name, a TOML file, or a generated folder."
Drives = Annotated[list[str] | None, typer.Argument(metavar="DRIVE", help=f"{DRIVE} Default: every shipped drive.")]
Fresh = Annotated[
    bool, typer.Option("--fresh", help="Make everything anew, also what an earlier run found of the same sources.")
]
Json = Annotated[Path | None, typer.Option("--json", metavar="F", help="Write every figure to this file.")]


#: Said of what was not made by this run.
KEPT = " (kept from an earlier run of the same sources with the same tools; --fresh makes it anew)"


def caution(drives: list[str] | None) -> None:
    """Warnings about entries that are likely a mistake go to stderr, before the work."""
    for name in drives or []:
        for line in cautions(find_drive(name).drive):
            print(f"pmsm-ickf: caution: {line}", file=sys.stderr)


def show_written(written: list[Written]) -> None:
    """Print what was written."""
    table = columns_table("drive", "files", "folder", "", left=range(4))
    for item in written:
        style = {"stale": "red", "unchanged": "dim"}.get(item.state, "green")
        table.add_row(item.drive, str(item.files), escape(str(item.folder)), f"[{style}]{item.state}[/{style}]")
    console.print(table)
    for item in written:
        if item.remark:
            console.print(f"[yellow]{escape(item.remark)}[/yellow]", highlight=False, soft_wrap=True)


def show_summary(proof: Proof) -> None:
    """Print the verdict of a proof."""
    for line in proof.failures():
        console.print(f"[red]{escape(line)}[/red]", highlight=False, soft_wrap=True)
    style = "bold red" if not proof.passed else "yellow" if proof.unchecked else "green"
    compared = f", {sum(link.compared for link in proof.links):,} numbers compared" if proof.passed else ""
    kept = KEPT if proof.kept else ""
    console.print(f"{proof.drive}: [{style}]{proof.verdict}[/{style}]{compared}{kept}", highlight=False, soft_wrap=True)


def show_remarks(checks: Iterable[Check]) -> None:
    """Print what checks have to say."""
    from runtime.firmware.tables import remarks

    for line, style in remarks(checks):
        console.print(f"[{style}]{escape(line)}[/{style}]", highlight=False, soft_wrap=True)
