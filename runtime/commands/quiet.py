"""``--quiet``, which every command takes."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Annotated, Any

import typer

from runtime.commands.paths import check_apart, check_stated, read_paths
from runtime.commands.terminal import be_quiet

_Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress: results and errors alone.")]


def with_quiet(command: Callable[..., Any]) -> Callable[..., Any]:
    """A command that takes ``--quiet``, too.

    Parameters
    ----------
    command : callable
        As Typer takes it.
    """
    own = inspect.signature(command, eval_str=True)
    read_paths(own)
    quiet = inspect.Parameter("quiet", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=_Quiet)

    @functools.wraps(command)
    def called(*args: Any, quiet: bool = False, **keys: Any) -> Any:
        be_quiet(quiet)
        check_stated(keys, own)
        check_apart(keys, own)
        return command(*args, **keys)

    called.__signature__ = own.replace(parameters=[*own.parameters.values(), quiet])  # type: ignore[attr-defined]
    called.__annotations__ = {name: entry.annotation for name, entry in own.parameters.items()} | {"quiet": _Quiet}
    return called
