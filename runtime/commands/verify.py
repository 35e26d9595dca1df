"""The command ``verify``: the proof."""

from __future__ import annotations

import typer

from runtime.commands.terminal import console, working
from runtime.commands.words import Drives, Fresh, Json, show_summary
from runtime.proof.drives import verify_drives
from runtime.system.verdicts import all_hold


def verify(
    drives: Drives = None,
    json: Json = None,
    fresh: Fresh = False,
) -> None:
    """Prove that reference, generated Python and generated C are the same filter, by equation number."""
    from runtime.proof.tables import proof_tables

    with working() as progress:
        results = verify_drives(drives or [], json, progress, fresh)
    for proof, _ in results:
        console.rule(f"[bold]{proof.drive}[/bold]", align="left")
        console.print(proof_tables(proof))
        show_summary(proof)
    if not all_hold(proof.passed for proof, _ in results):
        raise typer.Exit(1)
