"""Files that are the old one or the new one, whatever happens while they are written."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from runtime.system.errors import UserError, stop_if_interrupted
from runtime.system.streams import UnreadError


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """A binary file to write to, which takes the place of ``path`` once everything is in it.

    Devices and pipes (``/dev/stdout``) are written to as they are. A killed process leaves a hidden ``.<pid>.part``.

    Raises
    ------
    UserError
        If it cannot be written; what was at ``path`` is still there.
    UnreadError
        It is a pipe that nobody reads any more.
    KeyboardInterrupt
        A Ctrl-C that a library swallowed before: nothing is begun after it.
    """
    stop_if_interrupted()
    place = Path(os.path.realpath(path))
    part = place.with_name(f".{os.getpid()}.part")
    try:
        if path.parts[:2] == ("/", "dev") or (place.exists() and not place.is_file()):
            with path.open("wb") as file:
                yield file
            return
        try:
            with part.open("wb") as file:
                yield file
            os.replace(part, place)
        finally:
            part.unlink(missing_ok=True)
    except BrokenPipeError as error:
        raise UnreadError(*error.args) from None
    except OSError as error:
        raise UserError(f"cannot write '{path}': {error.strerror or error}.") from None


def write_text(path: Path, text: str) -> None:
    """A text file in UTF-8, by way of :func:`whole_file`."""
    with whole_file(path) as file:
        file.write(text.encode())


def write_facts(path: Path, facts: object) -> None:
    """Figures as a JSON file that every reader takes, by way of :func:`whole_file`: what is no number is null."""
    write_text(path, json.dumps(_as_json(facts), indent=2, allow_nan=False) + "\n")


def _as_json(facts: object) -> object:
    if isinstance(facts, dict):
        return {key: _as_json(value) for key, value in facts.items()}
    if isinstance(facts, list | tuple):
        return [_as_json(value) for value in facts]
    return None if isinstance(facts, float) and not math.isfinite(facts) else facts


def make_folder(path: Path) -> None:
    """A folder for output, and those above it; UserError if it cannot be made. Not after Ctrl-C."""
    stop_if_interrupted()
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"cannot write to '{path}': {error.strerror or error}.") from None
