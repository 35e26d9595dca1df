"""Options that name what is to be written: looked at before the work, so that its result is not lost after it."""

from __future__ import annotations

import inspect
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any, get_args

import typer
from typer.models import ArgumentInfo, ParameterInfo

from runtime.system.errors import UserError
from runtime.system.values import output_file, output_folder, read_path


def writes_file(help: str, *names: str, metavar: str = "F", endings: tuple[str, ...] = (), **more: Any) -> Any:
    """An option for a file that can be written.

    Parameters
    ----------
    help : str
    *names : str
        Of the option; none: the parameter's own.
    metavar : str, optional
    endings : tuple of str, optional
        What the file's name may end in, with the dot; none: any.
    **more
        As ``typer.Option`` takes them.
    """

    def check(param: typer.CallbackParam, path: Path | None) -> Path | None:
        return None if path is None else output_file(path, param.opts[0], endings)

    return typer.Option(*names, metavar=metavar, callback=check, help=help, **more)


def writes_folder(help: str, *names: str, **more: Any) -> Any:
    """An option for a folder that is there or can be made.

    Parameters
    ----------
    help : str
    *names : str
        Of the option; none: the parameter's own.
    **more
        As ``typer.Option`` takes them.
    """

    def check(param: typer.CallbackParam, path: Path | None) -> Path | None:
        return None if path is None else output_folder(path, param.opts[0])

    return typer.Option(*names, metavar="DIR", callback=check, help=help, **more)


def read_paths(command: inspect.Signature) -> None:
    """Have every path of a command read by :func:`runtime.system.values.read_path`, whoever declared it.

    Parameters
    ----------
    command : inspect.Signature
        What Typer knows of its parameters is changed.
    """
    for parameter in command.parameters.values():
        info = _info(parameter)
        if info is not None and Path in {*_kinds(parameter.annotation)}:
            info.parser = partial(read_path, what=_shown(parameter))


def _kinds(annotation: Any) -> Iterable[Any]:
    """The types within an annotation: of ``list[Path] | None`` they are Path and None."""
    within = get_args(annotation)
    yield from [kind for part in within for kind in _kinds(part)] if within else [annotation]


def _info(parameter: inspect.Parameter) -> ParameterInfo | None:
    """What Typer knows of a parameter; None where nothing but its type is stated."""
    return next((item for item in get_args(parameter.annotation) if isinstance(item, ParameterInfo)), None)


#: Parameters of the commands that name what is written anew.
OUTPUTS = ("json", "out", "facts_out", "plots", "build")


def check_apart(words: dict[str, Any], command: inspect.Signature) -> None:
    """No two outputs of a command are one file, and none is a file that it reads.

    Parameters
    ----------
    words : dict
        A command's parameters by name, as it was called.
    command : inspect.Signature

    Raises
    ------
    UserError
        One would be written over.
    """
    options = {name: _shown(command.parameters[name]) for name in words}
    outputs = {name: words[name] for name in OUTPUTS if isinstance(words.get(name), Path)}
    places: dict[Path, str] = {}
    for name, path in outputs.items():
        place = path.resolve()
        if place in places and not place.is_relative_to("/dev"):
            raise UserError(f"{options[name]} and {places[place]} both write '{path}'.")
        places[place] = options[name]
    for path in _read(words):
        if path.is_file() and path.resolve() in places:
            raise UserError(f"{places[path.resolve()]} would write over '{path}', which the command reads.")


def check_stated(words: dict[str, Any], command: inspect.Signature) -> None:
    """No word is empty, as a variable of a shell script is that was never set.

    Parameters
    ----------
    words : dict
        A command's parameters by name, as it was called.
    command : inspect.Signature

    Raises
    ------
    UserError
        One is.
    """
    for name, value in words.items():
        entries = value if isinstance(value, list | tuple) else [value]
        if "" in entries and command.parameters[name].default != "":
            raise UserError(f"{_shown(command.parameters[name])} is empty: a word is missing.")


def _shown(parameter: inspect.Parameter) -> str:
    """What the user calls a parameter: --filter, DRIVE."""
    info = _info(parameter)
    if isinstance(info, ArgumentInfo):
        return info.metavar or parameter.name.upper()
    declared = [info.default, *(info.param_decls or ())] if info else []  # within Annotated the first one is a name
    names = [word for word in declared if isinstance(word, str) and word.startswith("--")]
    return names[0] if names else f"--{parameter.name.replace('_', '-')}"


def _read(words: dict[str, Any]) -> Iterable[Path]:
    for name, value in words.items():
        if name not in OUTPUTS:
            for entry in value if isinstance(value, list | tuple) else [value]:
                if isinstance(entry, Path) or (isinstance(entry, str) and "\0" not in entry):
                    yield Path(entry)
