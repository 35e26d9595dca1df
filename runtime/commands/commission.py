"""The command ``commission``: the board turns an unknown motor within limits, and its data follow."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.progress import TaskProgressColumn, TextColumn

from runtime.commands.numbers import within
from runtime.commands.paths import writes_file
from runtime.commands.serial import Baud, Port
from runtime.commands.terminal import console, counting, say
from runtime.commands.words import Json
from runtime.system.errors import UserError
from runtime.system.files import write_facts, write_text

if TYPE_CHECKING:
    from runtime.commission.commission import Commissioned
    from runtime.commission.line import Bench as Board
    from runtime.commission.plan import Limits
    from runtime.commission.simulated import Truth
    from runtime.design.facts import Facts

FactsFile = Annotated[
    Path, typer.Option("--facts", metavar="F", help="Facts file: what is known, each half to one and a half times.")
]
OutFile = Annotated[Path, writes_file("Recorded data of all runs: .npz.")]
DriveFile = Annotated[
    Path | None,
    writes_file("Write a new drive file for what was found, by the rules of design."),
]
WriteTo = Annotated[
    Path | None,
    writes_file("A new facts file, or an existing facts or drive file, edited; comments stay.", endings=(".toml",)),
]
Motor = Annotated[
    Path | None,
    typer.Option(metavar="F", help="With --port simulated: facts file of the motor that is simulated."),
]
MaxCurrent = Annotated[
    float | None,
    typer.Option(metavar="A", callback=within(1e-3, 1e5), help="Gates off beyond it. Default: rated.max_current."),
]
MaxSpeed = Annotated[
    float | None,
    typer.Option(metavar="R/MIN", callback=within(0.1, 1e6), help="Default: 0.4 of the rated speed."),
]


def commission(
    port: Port,
    facts: FactsFile,
    out: OutFile = Path("commissioned.npz"),
    drive: DriveFile = None,
    write: WriteTo = None,
    motor: Motor = None,
    max_current: MaxCurrent = None,
    max_speed: MaxSpeed = None,
    baud: Baud = 115200,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask before the motor turns.")] = False,
    json: Json = None,
) -> None:
    """Find R, dead time, L_d, L_q, psi_m and J of a motor on its bench (board/pmsm_commission.c). THE MOTOR TURNS.

    Nothing may be coupled to its shaft. Ctrl-C switches the inverter off. Exit code 1: a datum is not told.
    """
    from runtime.commission.session import Place, Recording, carry_out, check_board, limits_of, open_board
    from runtime.design.facts import read_facts

    known = read_facts(facts)
    limits = limits_of(known, max_current, None if max_speed is None else max_speed * 2 * 3.141592653589793 / 60)
    place = Place(port, baud, _truth(port, motor, known, baud))
    _check_files(drive, write)
    recording = Recording(out)
    columns = (TaskProgressColumn(), TextColumn("{task.description}"))
    with open_board(place) as board:
        check_board(board, known, limits)
        _announce(known, limits, board)
        if not yes and place.truth is None:
            _ask()
        with counting("commissioning", *columns, total=1.0) as update:

            def tell(text: str, share: float) -> None:
                update(completed=share, description=escape(text))

            found = carry_out(board, known, limits, recording, tell)
    _show(found)
    _keep(found, drive, write, json)
    say(f"Recorded: {out}")
    if found.stopped:
        console.print("stopped: the inverter is off.", highlight=False)
        raise typer.Exit(130)
    if found.ended or any(word not in found.told or not found.told[word].surely for word in found.words):
        raise typer.Exit(1)


def _truth(port: str, motor: Path | None, known: Facts, baud: int) -> Truth | None:
    from runtime.board.simulated import NAME
    from runtime.commission.simulated import Truth
    from runtime.design.facts import read_facts

    if port != NAME:
        if motor is not None:
            raise UserError("--motor is of a simulated board: it goes with --port simulated.")
        return None
    truth = read_facts(motor) if motor is not None else known
    if abs(truth.T / known.T - 1) > 1e-3:
        raise UserError(f"--motor '{motor}' samples every {truth.T:g} s, the facts say {known.T:g} s.")
    shown = 0.002 * truth.range
    return Truth(truth, offset=(shown, -shown), theta=2.0, baud=baud)


def _check_files(drive: Path | None, write: Path | None) -> None:
    from runtime.identify.write import check_write

    if write is not None:
        check_write(write)
    if drive is not None:
        if drive.suffix != ".toml" or not drive.parent.is_dir():
            raise UserError(f"--drive '{drive}': a drive file ends in .toml, in a folder that is there.")
        if drive.exists():
            raise UserError(f"'{drive}' exists; move it away, choose another --drive, or edit it with --write.")


def _announce(known: Facts, limits: Limits, board: Board) -> None:
    from runtime.commission.plan import LEVELS

    rpm = limits.speed * 60 / (2 * 3.141592653589793)
    say(
        f"'{known.name}' will carry up to {LEVELS[-1] * limits.current:.3g} A at rest and turn both ways at up to "
        f"{rpm:.4g} r/min, in five runs. The gates go off beyond {limits.current:.3g} A of a phase, beyond "
        f"{1.25 * known.dc_link:.4g} V or below {0.5 * known.dc_link:.4g} V of the DC link, after "
        f"{board.hello.seconds:.4g} s of a run, and on Ctrl-C."
    )
    say("Nothing may be coupled to the shaft. Keep a switch at hand that takes the inverter's supply away.")


def _ask() -> None:
    if not sys.stdin.isatty():
        raise UserError("nobody is there to be asked whether the motor may turn: say --yes.")
    if not typer.confirm("May the motor turn?", default=False):
        raise UserError("nothing was turned.")


def _show(found: Commissioned) -> None:
    from runtime.commission.tables import estimates_table

    console.print(estimates_table(found), highlight=False)
    seconds = sum(ran.samples * ran.period for ran in found.runs)
    again = sum(not ran.whole for ran in found.runs)
    say(f"{len(found.runs)} runs, {seconds:.0f} s of the board's time" + (f"; {again} not whole" if again else ""))
    if found.ended:
        console.print(f"[bold red]{escape(found.ended)}[/bold red]", highlight=False, soft_wrap=True)


def _keep(found: Commissioned, drive: Path | None, write: Path | None, json: Path | None) -> None:
    """Everything that is written, but for the recording."""
    from runtime.commission.commission import found_facts
    from runtime.commission.tables import commissioned_facts, findings
    from runtime.identify.write import written_text

    if json is not None:
        write_facts(json, commissioned_facts(found))
    if write is not None:
        write_text(write, written_text(findings(found), write))
        say(f"Written: {write}")
    if drive is not None:
        from runtime.design.cost import priced
        from runtime.design.rules import design
        from runtime.design.trial import package
        from runtime.design.write import drive_text

        drafted = design(found_facts(found))
        write_text(drive, drive_text(priced(drafted, package(drafted)), f"{found.facts.name}, commissioned"))
        say(f"Drive file: {drive}")
