"""Where words from outside become values: numbers, words out of a list, places to write; or one line that refuses."""

from __future__ import annotations

import difflib
import math
import os
from collections.abc import Iterable
from pathlib import Path

from runtime.system.errors import UserError

#: Beyond it a number is a slip of the finger, whatever its unit.
MOST = 1e9


def read_number(text: str, what: str, low: float = -MOST, high: float = MOST) -> float:
    """A number that somebody wrote.

    Parameters
    ----------
    text : str
    what : str
        What it is to be, as the user knows it, such as "--noise"; errors begin with it.
    low, high : float, optional
        What it may be, ends included, in its own unit.

    Raises
    ------
    UserError
        It is no number, not finite, or outside.

    Examples
    --------
    >>> read_number("1e-6", "--dead-time", 0.0, 1e-4)
    1e-06
    """
    try:
        value = float(text)
    except ValueError:
        raise UserError(f"{what} {text!r} is not a number.") from None
    return checked_number(value, what, low, high)


def checked_number(value: float, what: str, low: float = -MOST, high: float = MOST) -> float:
    """The same of what is a float already.

    Parameters
    ----------
    value : float
    what : str
    low, high : float, optional
        As :func:`read_number` has them.

    Raises
    ------
    UserError
        It is not finite, or outside.
    """
    if not math.isfinite(value):
        raise UserError(f"{what} {value} is not a finite number.")
    if not low <= value <= high:
        raise UserError(f"{what} {value:g} is not between {low:g} and {high:g}.")
    return value


def read_word(word: str, what: str, known: Iterable[str]) -> str:
    """A word out of those there are.

    Parameters
    ----------
    word : str
    what : str
        What it names, such as "scenario"; errors begin with "no scenario".
    known : iterable of str

    Raises
    ------
    UserError
        There is no such word; the nearest one is named.

    Examples
    --------
    >>> read_word("load_stp", "scenario", ["no_load", "load_step"])
    Traceback (most recent call last):
    runtime.system.errors.UserError: no scenario 'load_stp'; there are: no_load, load_step. Did you mean 'load_step'?
    """
    words = list(known)
    if word in words:
        return word
    raise UserError(f"no {what} '{word}'; there are: {', '.join(words)}.{nearest(word, words)}")


def read_words(text: str, what: str, known: Iterable[str]) -> list[str]:
    """Words with commas between them, each once and out of those there are.

    Parameters
    ----------
    text : str
    what : str
    known : iterable of str
        As :func:`read_word` has them.

    Raises
    ------
    UserError
        There is no such word, or it stands twice.

    Examples
    --------
    >>> read_words("ckf, ekf", "filter", ["ckf", "ickf", "ekf"])
    ['ckf', 'ekf']
    """
    known = list(known)
    words = [read_word(word.strip(), what, known) for word in text.split(",")]
    for word in words:
        if words.count(word) > 1:
            raise UserError(f"{what} '{word}' is named twice in '{text}'.")
    return words


def nearest(word: str, known: Iterable[str]) -> str:
    """The hint at the end of an error: " Did you mean 'verify'?", or nothing where none is near.

    Parameters
    ----------
    word : str
    known : iterable of str
    """
    close = difflib.get_close_matches(word[:100], list(known), n=1)
    return f" Did you mean '{close[0]}'?" if close else ""


def read_path(word: str | Path, what: str) -> Path:
    """A path that somebody wrote; an empty word would be the current folder.

    Parameters
    ----------
    word : str or Path
        A Path, which is a default of the command's own, is handed back.
    what : str
        What the user calls it, such as "--out"; errors begin with it.

    Raises
    ------
    UserError
        The word is empty.

    Examples
    --------
    >>> read_path("", "--out")
    Traceback (most recent call last):
    runtime.system.errors.UserError: --out is empty: a word is missing.
    """
    if word == "":
        raise UserError(f"{what} is empty: a word is missing.")
    return Path(word)


def output_file(path: Path, what: str, endings: Iterable[str] = ()) -> Path:
    """A file to be written after the work, looked at before it.

    Parameters
    ----------
    path : Path
    what : str
        The option that names it.
    endings : iterable of str, optional
        What its name may end in.

    Raises
    ------
    UserError
        It is a folder, its folder is not there, or neither may be written.
    """
    ends = tuple(endings)
    _check_path(path, what)
    if ends and path.suffix not in ends:
        raise UserError(f"{what} '{path}': such a file ends in {' or '.join(ends)}.")
    try:
        if path.is_dir():
            raise UserError(f"{what} '{path}' is a folder, not a file.")
        if path.exists():
            may_be_written = os.access(path, os.W_OK) and (not path.is_file() or os.access(path.parent, os.W_OK))
        elif not path.parent.is_dir():
            reason = "is a file" if path.parent.exists() else "is not there"
            raise UserError(f"{what} '{path}': its folder '{path.parent}' {reason}.")
        else:
            may_be_written = os.access(path.parent, os.W_OK)
        long = len(os.fsencode(path.name)) > os.pathconf(path.parent, "PC_NAME_MAX")
    except OSError as error:
        raise UserError(f"{what} '{path}' cannot be written: {error.strerror}.") from None
    if long:
        raise UserError(f"{what} '{path}' cannot be written: its name is too long.")
    kernels = _is_kernels(path) and (path.is_file() or not path.exists())  # not so /dev/stdout, a pipe behind it
    if kernels or not may_be_written:
        raise UserError(f"{what} '{path}' cannot be written: {_reason(path.parent)}.")
    return path


def output_folder(path: Path, what: str) -> Path:
    """A folder to be made and filled after the work, looked at before it.

    Parameters
    ----------
    path : Path
    what : str
        The option that names it.

    Raises
    ------
    UserError
        It is a file, or lies in one, or may not be written.
    """
    _check_path(path, what)
    try:
        there = next(place for place in (path, *path.parents) if place.exists() or place.is_symlink())
        if not there.is_dir():
            kind = "is a link to nothing" if not there.exists() else "is a file, not a folder"
            raise UserError(f"{what} '{path}': '{there}' {kind}.")
        may_be_written = os.access(there, os.W_OK) and not _is_kernels(path)
        longest = os.pathconf(there, "PC_NAME_MAX")
    except OSError as error:
        raise UserError(f"{what} '{path}' cannot be written to: {error.strerror}.") from None
    if any(len(os.fsencode(part)) > longest for part in path.parts):
        raise UserError(f"{what} '{path}' cannot be written to: its name is too long.")
    if not may_be_written:
        raise UserError(f"{what} '{path}' cannot be written to: {_reason(there)}.")
    return path


def _check_path(path: Path, what: str) -> None:
    if "\0" in str(path):
        raise UserError(f"{what} {str(path)!r} holds a NUL, which no path does.")


def _reason(folder: Path) -> str:
    return "a read-only file system" if os.statvfs(folder).f_flag & os.ST_RDONLY else "no right to"


def _is_kernels(path: Path) -> bool:
    """Whether a path is below /proc or /sys, where nothing can be made, whoever asks."""
    return Path(os.path.realpath(path)).parts[1:2] in {("proc",), ("sys",)}
