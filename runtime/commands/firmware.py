"""The command ``firmware``: the generated C away from the host."""

from __future__ import annotations

from typing import Annotated

import typer

from runtime.commands.terminal import console, working
from runtime.commands.words import KEPT, Drives, Fresh, Json, show_remarks
from runtime.system.verdicts import all_hold


def firmware(
    drives: Drives = None,
    json: Json = None,
    allow_missing: Annotated[
        bool, typer.Option("--allow-missing", help="Exit 0 although something could not be run here.")
    ] = False,
    fresh: Fresh = False,
) -> None:
    """Check the generated C: the same bits on emulated processors; compilers, bans, divisions, MISRA, EVA.

    An EVA check that is "not proved" does not fail the command: intervals could not decide it.
    """
    from runtime.firmware.gates import check_firmware
    from runtime.firmware.tables import checks_table

    with working() as progress:
        results = check_firmware(drives or [], json, progress, fresh)
    for result in results:
        console.rule(f"[bold]{result.drive}[/bold]{KEPT if result.kept else ''}", align="left")
        console.print(checks_table(result.checks))
        show_remarks(result.checks)
    if not all_hold(result.good(allow_missing) for result in results):
        raise typer.Exit(1)
