"""pmsm-ickf: the command line. Words and exit codes only; the work is in :mod:`runtime.tasks`.

Exit codes: 0 good, 1 a check failed, 2 bad input.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from io import TextIOWrapper
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table
from typer.core import TyperGroup

from codegen import __version__
from codegen.evidence.budget import BudgetError
from codegen.folder import FolderError
from codegen.ir.graph import UnsupportedOperationError
from model.drive import DriveError, cautions, load_drive
from runtime.commands.board import pil, record
from runtime.commands.compare import compare
from runtime.commands.endurance import fuzz, soak
from runtime.commands.faults import faults
from runtime.commands.replay import replay
from runtime.commands.study import app as study
from runtime.commands.terminal import console, working
from runtime.errors import UserError, end_interrupted, was_interrupted
from runtime.firmware.check import Check
from runtime.proof.result import Proof
from runtime.tasks import Written, generate_drives, run_all, simulate_drive, verify_drives


class Commands(TyperGroup):
    """The commands; an interrupted one ends with 130, whatever Typer's version makes of it."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise typer.Exit(130) from None


app = typer.Typer(
    cls=Commands,
    name="pmsm-ickf",
    help="Write the motor once, as mathematics; "
    "get firmware, a Python runtime, and the proof that they are the same filter.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command()(pil)
app.command()(record)
app.command()(replay)
app.command()(compare)
app.command()(faults)
app.command()(fuzz)
app.command()(soak)
app.add_typer(study, name="study")

Drives = Annotated[
    list[str] | None,
    typer.Argument(metavar="DRIVE", help="A shipped name or the path of a TOML file. Default: every shipped drive."),
]


@app.callback(invoke_without_command=True)
def _root(version: Annotated[bool, typer.Option("--version", help="Print the version and leave.")] = False) -> None:
    if version:
        console.print(__version__, highlight=False)
        raise typer.Exit


@app.command()
def run(
    drives: Drives = None,
    build: Annotated[Path, typer.Option("--build", metavar="DIR", help="Where the report page goes.")] = Path("build"),
) -> None:
    """Everything: regenerate, verify, simulate, and write build/report/index.html."""
    from runtime.report.drive_tables import runs_table
    from runtime.report.firmware_table import checks_table

    with working() as progress:
        written, chapters, page = run_all(drives or [], build, progress)
    _show_written(written)
    for chapter in chapters:
        proof = chapter.proof
        _show_summary(proof)
        console.print(runs_table(chapter.runs))
        console.print(checks_table(chapter.firmware.checks))
        _show_remarks(chapter.firmware.checks)
    console.print(f"Report: {page}", highlight=False, soft_wrap=True)
    if not all(chapter.good for chapter in chapters):
        raise typer.Exit(1)


@app.command()
def generate(
    drives: Drives = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Write DIR/<drive>. Default: the project's generated/ for shipped drives, ./generated for TOML files.",
        ),
    ] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Write nothing; exit 1 with a diff if a folder is stale.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Overwrite a folder that was edited by hand.")] = False,
    form: Annotated[
        str, typer.Option(metavar="NAME", help="fast (what is shipped), or literal: the paper's shape, for reading.")
    ] = "fast",
) -> None:
    """Generate C for the F28335, host C and Python from drive files."""
    _caution(drives)
    with working() as progress:
        written = generate_drives(drives or [], out, check, force, form, progress)
    if check:
        for item in written:
            if item.diff:
                console.print(item.diff, markup=False, highlight=False, soft_wrap=True)
    _show_written(written)
    if any(item.state == "stale" for item in written):
        raise typer.Exit(1)


@app.command()
def simulate(
    drive: Annotated[
        str, typer.Argument(metavar="DRIVE", help="A shipped name or the path of a TOML file.")
    ] = "paper_spmsm",
    scenario: Annotated[str, typer.Option(metavar="NAME", help="no_load, load_step, or all.")] = "all",
    filters: Annotated[str, typer.Option(metavar="KINDS", help="Comma-separated: ckf,ickf,ekf,ukf.")] = "ckf,ickf",
    inverter: Annotated[str, typer.Option(metavar="NAME", help="averaged or pwm.")] = "averaged",
    dead_time: Annotated[float, typer.Option(metavar="S", min=0, max=1e-4, help="Dead time in s (pwm).")] = 0.0,
    delay: Annotated[int, typer.Option(min=0, max=1, help="Samples from measuring to acting.")] = 0,
    noise: Annotated[float, typer.Option(metavar="A", min=0, help="Current sensor noise, rms.")] = 0.05,
    bits: Annotated[int, typer.Option(min=0, max=24, help="Converter resolution; 0: no quantisation.")] = 0,
    offset: Annotated[float, typer.Option(metavar="A", help="Offset of phase a's current sensor.")] = 0.0,
    sensored: Annotated[bool, typer.Option("--sensored", help="Close the loops with true speed and angle.")] = False,
    theta: Annotated[float, typer.Option(metavar="RAD", help="Rotor's electrical angle at the start.")] = 0.0,
    seed: Annotated[int, typer.Option(min=0, help="Of the sensor noise.")] = 1,
    controller: Annotated[str, typer.Option(metavar="NAME", help="c (the generated C) or numpy (its twin).")] = "c",
    sweep: Annotated[bool, typer.Option("--sweep", help="Also sweep the sample time, Euler and exact.")] = False,
    json: Annotated[Path | None, typer.Option("--json", metavar="F", help="Write every figure to this file.")] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write recorded data (npz) and figures (svg).")
    ] = None,
) -> None:
    """Close the loop: the generated controller drives the motor, sensorless from standstill."""
    from runtime.report.drive_tables import claims, claims_table, runs_table, sweep_table

    conditions = {"inverter": inverter, "dead_time": dead_time, "delay": delay, "noise": noise, "bits": bits}
    conditions |= {"offset": (offset, 0.0), "sensored": sensored, "theta": theta, "seed": seed}
    _caution([drive])
    with working() as progress:
        result = simulate_drive(drive, scenario, filters.split(","), conditions, controller, sweep, json, out, progress)
    console.print(runs_table(result.runs))
    if drive == "paper_spmsm" and claims(result.runs):
        console.print()
        console.print(claims_table(claims(result.runs)))
    if result.sweep:
        console.print("\nLargest speed error after a step of the speed reference, by sample time:")
        console.print(sweep_table(result.sweep))
    if not all(run.locked for run in result.runs):
        raise typer.Exit(1)


@app.command()
def verify(
    drives: Drives = None,
    json: Annotated[Path | None, typer.Option("--json", metavar="F", help="Write every figure to this file.")] = None,
) -> None:
    """Prove that reference, generated Python and generated C are the same filter, by equation number."""
    from runtime.report.tables import proof_tables

    with working() as progress:
        results = verify_drives(drives or [], json, progress)
    for proof, _ in results:
        console.rule(f"[bold]{proof.drive}[/bold]", align="left")
        console.print(proof_tables(proof))
        _show_summary(proof)
    if not all(proof.passed for proof, _ in results):
        raise typer.Exit(1)


@app.command()
def firmware(
    drives: Drives = None,
    json: Annotated[Path | None, typer.Option("--json", metavar="F", help="Write every check to this file.")] = None,
    allow_missing: Annotated[
        bool, typer.Option("--allow-missing", help="Exit 0 although something could not be run here.")
    ] = False,
) -> None:
    """Check the generated C: the same bits on two emulated processors; compilers, bans, divisions, MISRA, EVA.

    An EVA check that is "not proved" does not fail the command: intervals could not decide it.
    """
    from runtime.firmware.tasks import check_firmware
    from runtime.report.firmware_table import checks_table

    with working() as progress:
        results = check_firmware(drives or [], json, progress)
    for result in results:
        console.rule(f"[bold]{result.drive}[/bold]", align="left")
        console.print(checks_table(result.checks))
        _show_remarks(result.checks)
    if not all(result.good(allow_missing) for result in results):
        raise typer.Exit(1)


def _show_remarks(checks: Iterable[Check]) -> None:
    from runtime.report.firmware_table import remarks

    for line, style in remarks(checks):
        console.print(f"[{style}]{escape(line)}[/{style}]", highlight=False, soft_wrap=True)


def _caution(drives: list[str] | None) -> None:
    """What is allowed but likely a mistake goes to stderr, before the work."""
    for name in drives or []:
        for line in cautions(load_drive(name)):
            print(f"pmsm-ickf: caution: {line}", file=sys.stderr)


def _show_written(written: list[Written]) -> None:
    table = Table(show_edge=False, pad_edge=False, header_style="")
    for column in ("drive", "files", "folder", ""):
        table.add_column(column, overflow="fold")
    for item in written:
        style = {"stale": "red", "unchanged": "dim"}.get(item.state, "green")
        table.add_row(item.drive, str(item.files), str(item.folder), f"[{style}]{item.state}[/{style}]")
    console.print(table)


def _show_summary(proof: Proof) -> None:
    for line in proof.failures():
        console.print(f"[red]{escape(line)}[/red]", highlight=False, soft_wrap=True)
    style = "bold red" if not proof.passed else "yellow" if proof.unchecked else "green"
    compared = f", {sum(link.compared for link in proof.links):,} numbers compared" if proof.passed else ""
    console.print(f"{proof.drive}: [{style}]{proof.verdict}[/{style}]{compared}", highlight=False, soft_wrap=True)


#: Letters of a line that somebody will still read.
LONGEST = 600


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point: what the user can mend becomes one line on stderr and exit code 2."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a name that the terminal cannot show
    try:
        app(arguments)
    except KeyboardInterrupt:
        end_interrupted()
    except SystemExit as end:
        if end.code == 130 or was_interrupted():
            end_interrupted()
        raise
    except (UserError, DriveError, FolderError, UnsupportedOperationError) as error:
        _say(error)
        sys.exit(2)
    except OSError as error:  # a disk, a right, a limit
        _say(f"{error.filename}: {error.strerror}" if error.filename else error)
        sys.exit(2)
    except BudgetError as error:
        _say(error)
        sys.exit(1)


def _say(error: object) -> None:
    """One line, whatever is in the names and values it quotes."""
    text = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in str(error))
    if len(text) > LONGEST:  # the beginning says where, the end what would be right
        text = f"{text[: LONGEST * 2 // 3]} ... {text[-LONGEST // 4 :]}"
    print(f"pmsm-ickf: {text}", file=sys.stderr)


if __name__ == "__main__":
    main()
