"""The command ``identify``: motor data from recordings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.progress import TaskProgressColumn, TextColumn

from runtime.commands.paths import writes_file, writes_folder
from runtime.commands.recordings import Begins, DcLink, Offset, Rename, Resample, Scale, Wiring, read
from runtime.commands.terminal import console, counting, say
from runtime.commands.words import Json
from runtime.system.files import write_facts, write_text

if TYPE_CHECKING:
    from runtime.identify.identify import Identified
    from runtime.identify.redesign import Compared

DriveOrFacts = Annotated[
    str, typer.Argument(metavar="DRIVE_OR_FACTS", help="A facts file, a drive file, a shipped name, or a folder.")
]
Data = Annotated[list[Path], typer.Argument(metavar="DATA...", help="Recorded data of the motor, as for replay.")]
Free = Annotated[
    str | None,
    typer.Option(
        metavar="R,L_d,...",
        help="What to find: R, L (round rotor) or L_d and L_q, psi_m, J, D, V_dead, "
        "i_alpha_offset, i_beta_offset. Default: R, inductances, psi_m, J, V_dead.",
    ),
]
WriteTo = Annotated[
    Path | None,
    writes_file("A new facts file, or an existing facts or drive file, edited; comments stay.", endings=(".toml",)),
]


def identify(
    drive: DriveOrFacts,
    data: Data,
    free: Free = None,
    rename: Rename = None,
    scale: Scale = None,
    offset: Offset = None,
    wiring: Wiring = None,
    begins: Begins = False,
    dc_link: DcLink = None,
    resample: Resample = False,
    write: WriteTo = None,
    plots: Annotated[Path | None, writes_folder("Write a page, index.html, and its figures (svg).")] = None,
    json: Json = None,
) -> None:
    """Find motor data, dead time and noise from recordings, with 95 % intervals, and say what they cannot show.

    Guesses may be half or one and a half times the truth. Ctrl-C keeps the best so far. Exit code 1: nothing of what
    was asked for is shown by the recordings.
    """
    from runtime.identify.identify import identify as find
    from runtime.identify.redesign import compare
    from runtime.identify.subject import read_subject
    from runtime.identify.tables import INTERRUPTED
    from runtime.identify.write import check_write

    if plots is not None:
        from runtime.style.figures import pyplot

        pyplot()  # what is missing is said before the work
    if write is not None:
        check_write(write)
    subject = read_subject(drive, free)
    onto = (subject.drive.model.sample_time, subject.name) if resample else None
    recordings = [read(path, rename, scale, (offset, wiring, begins, dc_link), onto) for path in data]
    columns = (TaskProgressColumn(), TextColumn("{task.description}"))
    with counting("identifying", *columns, total=1.0) as update:

        def tell(text: str, share: float) -> None:
            update(completed=share, **({"description": escape(text)} if text else {}))

        found = find(subject, recordings, tell)
        compared = None if found.found.interrupted else compare(found, tell)
    _show(found, compared)
    _keep(found, compared, write, json, plots)
    if found.found.interrupted:
        say(INTERRUPTED)
        raise typer.Exit(130)
    if not any(estimate.told for estimate in found.result.estimates):
        raise typer.Exit(1)


def _keep(
    found: Identified, compared: Compared | None, write: Path | None, json: Path | None, plots: Path | None
) -> None:
    """Everything that is written."""
    from runtime.identify.tables import identified_facts
    from runtime.identify.write import Findings, written_text

    subject = found.problem.subject
    findings = Findings(subject.name, subject.facts, found.facts, found.result.estimates)
    text = written_text(findings, write) if write is not None else ""
    if json is not None:
        write_facts(json, identified_facts(found, compared))
    if plots is not None:
        from runtime.identify.figures import write_figures
        from runtime.identify.page import write_identified

        for path in write_figures(found, plots):
            say(f"Figure: {path}")
        say(f"Page: {write_identified(found, compared, plots)}")
    if write is not None:
        write_text(write, text)
        say(f"Written: {write}")


def _show(found: Identified, compared: Compared | None) -> None:
    from runtime.identify.tables import estimates_table, filters_table, notes_words, steps_words, summary

    for line in notes_words(found):
        console.print(f"[yellow]{escape(line)}[/yellow]", highlight=False, soft_wrap=True)
    console.print(estimates_table(found), highlight=False)
    say(summary(found))
    for line in steps_words(found):
        say(line)
    for line in found.result.words:
        console.print(f"[yellow]{escape(line)}[/yellow]", highlight=False, soft_wrap=True)
    if compared is not None:
        console.print()
        console.print(filters_table(compared), highlight=False)
