"""pmsm-ickf: the command line. It assembles the commands of :mod:`runtime.commands`.

Exit codes: 0 good, 1 a check failed, 2 bad input.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import cache
from io import TextIOWrapper
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from codegen.evidence.budget import BudgetError
from codegen.ir.graph import UnsupportedOperationError
from codegen.output.folder import FolderError
from codegen.output.version import __version__
from model.schema import DriveError
from runtime.commands.commission import commission
from runtime.commands.compare import compare
from runtime.commands.design import design
from runtime.commands.doctor import doctor
from runtime.commands.export import app as export
from runtime.commands.faults import faults
from runtime.commands.firmware import firmware
from runtime.commands.fuzz import fuzz
from runtime.commands.generate import generate
from runtime.commands.identify import identify
from runtime.commands.new import new
from runtime.commands.package import package
from runtime.commands.page import page
from runtime.commands.pil import pil
from runtime.commands.quiet import with_quiet
from runtime.commands.record import record
from runtime.commands.replay import replay
from runtime.commands.run import run
from runtime.commands.simulate import simulate
from runtime.commands.soak import soak
from runtime.commands.starts import starts
from runtime.commands.study import app as study
from runtime.commands.terminal import console
from runtime.commands.verify import verify
from runtime.system.errors import UserError, end_interrupted, was_interrupted


class Commands(TyperGroup):
    """The commands; an interrupted one ends with 130, whatever Typer's version makes of it."""

    def invoke(self, ctx: Any) -> Any:
        """Run a command; Ctrl-C ends it with 130."""
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
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
#: Commands in groups, both in the order in which one comes to use them.
GROUPS = {
    "Begin": (run, new, doctor),
    "Make": (design, generate, package, export),
    "Prove": (verify, firmware),
    "See": (simulate, replay, compare, page),
    "Choose": (identify, study),
    "Board": (pil, record, commission),
    "Stress": (starts, faults, fuzz, soak),
}
for group, commands in GROUPS.items():
    for command in commands:
        if isinstance(command, typer.Typer):
            app.add_typer(command, name=command.info.name, rich_help_panel=group)
            for info in command.registered_commands:
                info.callback = with_quiet(info.callback) if info.callback else None
        else:
            app.command(rich_help_panel=group)(with_quiet(command))


@app.callback(invoke_without_command=True)
def _root(version: Annotated[bool, typer.Option("--version", help="Print the version and leave.")] = False) -> None:
    if version:
        console.print(__version__, highlight=False)
        raise typer.Exit


@cache
def _commands() -> Any:
    """The commands, assembled once a process: that takes longer than most of them run where input is refused."""
    return typer.main.get_command(app)


#: Letters of a line that somebody will still read.
LONGEST = 600


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point: what the user can mend becomes one line on stderr and exit code 2."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a name that the terminal cannot show
    try:
        _commands()(arguments)
    except KeyboardInterrupt:
        end_interrupted()
    except SystemExit as end:
        if end.code == 130 or was_interrupted():
            end_interrupted()
        raise
    except Exception as error:
        if was_interrupted():  # a library has made another error of the KeyboardInterrupt, CasADi a SystemError
            end_interrupted()
        if isinstance(error, OSError):  # a disk, a right, a limit
            _say(f"{error.filename}: {error.strerror}" if error.filename else error)
            sys.exit(2)
        if isinstance(error, BudgetError):
            _say(error)
            sys.exit(1)
        if isinstance(error, UserError | DriveError | FolderError | UnsupportedOperationError):
            _say(error)
            sys.exit(2)
        raise


def _say(error: object) -> None:
    """One line, whatever is in the names and values it quotes."""
    text = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in str(error))
    if len(text) > LONGEST:  # the beginning says where, the end what would be right
        text = f"{text[: LONGEST * 2 // 3]} ... {text[-LONGEST // 4 :]}"
    print(f"pmsm-ickf: {text}", file=sys.stderr)


if __name__ == "__main__":
    main()
