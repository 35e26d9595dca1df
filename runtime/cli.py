"""pmsm-ickf: the command line. It assembles the commands of :mod:`runtime.commands`.

Exit codes: 0 good, 1 a check failed, 2 bad input, 130 Ctrl-C, 141 nobody reads the output, 143 SIGTERM.
"""

from __future__ import annotations

import errno
import sys
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from importlib import import_module
from io import TextIOWrapper
from typing import Annotated, Any

import typer
from typer.core import TyperGroup
from typer.main import get_command

from codegen.output.version import __version__
from runtime.commands.quiet import with_quiet
from runtime.commands.terminal import console
from runtime.system.collector import loading
from runtime.system.errors import UserError, end_interrupted, was_interrupted
from runtime.system.streams import UNREAD, UnreadError, reader_is_gone

#: Commands in groups, both in the order in which one comes to use them; each lies in the module of its name.
GROUPS = {
    "Begin": ("run", "new", "doctor"),
    "Make": ("design", "generate", "package", "export"),
    "Prove": ("verify", "firmware"),
    "See": ("simulate", "replay", "compare", "page"),
    "Choose": ("identify", "study"),
    "Board": ("pil", "record", "commission"),
    "Stress": ("starts", "faults", "fuzz", "soak"),
}


@cache
def load_command(word: str) -> typer.Typer:
    """One command, or one with words of its own; the others' libraries, which take longer to load, stay where they are.

    Parameters
    ----------
    word : str
        One of :data:`GROUPS`.
    """
    with loading():
        module = import_module(f"runtime.commands.{word}")
    loaded: typer.Typer = getattr(module, "app", None) or typer.Typer()
    panel = next(group for group, words in GROUPS.items() if word in words)
    if loaded.registered_commands:
        loaded.info.rich_help_panel = panel
    else:
        loaded.command(rich_help_panel=panel)(getattr(module, word))
    for info in loaded.registered_commands:
        info.callback = with_quiet(info.callback) if info.callback else None
    return loaded


@cache
def _command(word: str) -> Any:
    """A command as Typer parses its words, assembled once a process."""
    loaded = load_command(word)
    loaded._add_completion = False  # which is the whole program's
    return get_command(loaded)


class Commands(TyperGroup):
    """The commands, each loaded when it is asked for; an interrupted one ends with 130, whatever Typer makes of it."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        # Typer asks it for names alone, in their order.
        self.commands = dict.fromkeys(word for words in GROUPS.values() for word in words)  # type: ignore[assignment]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Load a command; None if there is none of that name."""
        return _command(cmd_name) if cmd_name in self.commands else None

    def invoke(self, ctx: Any) -> Any:
        """Run a command; Ctrl-C ends it with 130."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise typer.Exit(130) from None
        except BrokenPipeError as error:
            if isinstance(error, UnreadError) or reader_is_gone():
                raise
            raise UserError(f"a program or board that this command writes to has gone: {error.strerror}.") from None


app = typer.Typer(
    cls=Commands,
    name="pmsm-ickf",
    help="Write the motor once, as mathematics; "
    "get firmware, a Python runtime, and the proof that they are the same filter.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@app.callback(invoke_without_command=True)
def _root(version: Annotated[bool, typer.Option("--version", help="Print the version and leave.")] = False) -> None:
    if version:
        console.print(__version__, highlight=False)
        raise typer.Exit


@cache
def _commands() -> Any:
    """All commands, none of them loaded yet."""
    return get_command(app)


#: Letters of a line that somebody will still read.
LONGEST = 600


#: What the command line is called, however it was started: in its help, its errors, and for completion.
PROGRAM = "pmsm-ickf"
#: The base of what Typer, and Click in older ones, raises for a command line that it does not understand.
_UsageError: type[Exception] = typer.BadParameter.__bases__[0]


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point: what the user can mend becomes one line on stderr and exit code 2."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a name that the terminal cannot show
    try:
        code = _commands().main(arguments, prog_name=PROGRAM, standalone_mode=False)
    except KeyboardInterrupt:
        end_interrupted()
    except SystemExit as end:  # so Rich and Typer end where nobody reads any more, with 1: no check has failed
        sys.exit(UNREAD if isinstance(end.__context__, BrokenPipeError) else end.code)
    except Exception as error:
        if was_interrupted():  # a library has made another error of the KeyboardInterrupt, CasADi a SystemError
            end_interrupted()
        code = _explained(error)
    if code == 130 or was_interrupted():
        end_interrupted()
    sys.exit(code or 0)


def _explained(error: Exception) -> int:
    """Say in a line what the user can mend, and return the exit code; what is no user's fault is raised again."""
    from codegen.evidence.budget import BudgetError
    from codegen.evidence.programs import ProgramError
    from codegen.ir.graph import UnsupportedOperationError
    from codegen.output.folder import FolderError
    from model.schema import DriveError

    if isinstance(error, OSError):  # a disk, a right, a limit
        _say(f"{error.filename}: {error.strerror}" if error.filename else _unnamed(error))
    elif isinstance(error, BudgetError):
        _say(error)
        return 1
    elif isinstance(error, UserError | DriveError | FolderError | ProgramError | UnsupportedOperationError):
        _say(error)
    elif isinstance(error, _UsageError):
        _say(_usage(error))
    elif isinstance(error, typer.Abort):
        _say("the answer is missing.")
    else:
        raise error
    return 2


def _unnamed(error: OSError) -> str:
    """What the system refuses, where it does not say of which file: where it may be."""
    if error.errno not in (errno.ENOSPC, errno.EDQUOT):
        return str(error)
    return f"{error.strerror}: where the output of the command goes, or its temporary files (TMPDIR)."


def _usage(error: Any) -> str:
    """What is wrong with the command line, and whose help says what is right."""
    words = " ".join(str(error.format_message()).split()) or "Say which command."
    command = error.ctx.command_path if getattr(error, "ctx", None) else PROGRAM
    return f"{words}{'' if words[-1] in '.?' else '.'} See {command} --help."


def _say(error: object) -> None:
    """One line, whatever is in the names and values it quotes."""
    text = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in str(error))
    if len(text) > LONGEST:  # the beginning says where, the end what would be right
        text = f"{text[: LONGEST * 2 // 3]} ... {text[-LONGEST // 4 :]}"
    with suppress(OSError):  # the exit code tells it where stderr is full
        print(f"pmsm-ickf: {text}", file=sys.stderr)


if __name__ == "__main__":
    main()
