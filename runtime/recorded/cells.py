"""The numbers of a text file, read piece by piece so that memory never holds the text of all of it."""

from __future__ import annotations

import csv
import io
import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np

from runtime.recorded.source import Array
from runtime.system.errors import UserError

COMMENT = re.compile(r"\s*(#|%|//)\s*")
#: Letters read at once.
PIECE = 1 << 22
#: What instruments and spreadsheets write where they have no sample: overloads, gaps, numbers that are none.
MARKS = (
    r"[-+]?∞|N/?A|#N/A|#NUM!|null|none|-{1,3}|\*+|\?+|OL|over(?:flow|load|range)?|"
    r"[-+]?1\.#(?:IND|QNAN|SNAN|INF)0*|[-+]?(?:nan|inf)(?:\([a-z]*\))?|[-+]?infinity"
)
_MARK = re.compile(rf"(?:{MARKS})\Z", re.IGNORECASE)


@dataclass(frozen=True)
class Dialect:
    """How a text file is written: ``first_line`` is the line of the first number, counted from 1."""

    path: Path
    encoding: str
    separator: str
    names: tuple[str, ...]
    first_line: int


def cells(line: str, separator: str) -> list[str]:
    """Split a line into cells, without quotes and blanks; a separator within quotes belongs to its cell.

    Parameters
    ----------
    line : str
    separator : str
    """
    if separator == " ":
        return [cell.strip('"') for cell in re.findall(r'"[^"]*"|[^\s"]+', line)]
    if '"' in line:
        try:
            row = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
        except csv.Error:
            row = line.split(separator)
    else:
        row = line.split(separator)
    return [cell.strip().strip('"').strip() for cell in row]


def is_number(cell: str, separator: str) -> bool:
    """Whether NumPy's reader will take a cell as a number.

    Parameters
    ----------
    cell : str
    separator : str
        Between cells; a comma as decimal mark is read where it is another, or within quotes.
    """
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return "_" not in cell


def is_mark(cell: str) -> bool:
    """Whether a cell says that a sample is missing.

    Parameters
    ----------
    cell : str
    """
    return not cell or _MARK.match(cell) is not None


def read_cells(dialect: Dialect, chosen: Sequence[int]) -> list[Array]:
    """Read columns by their numbers; a missing sample is NaN.

    Parameters
    ----------
    dialect : Dialect
    chosen : sequence of int

    Returns
    -------
    list of ndarray, (N,)
        float64.

    Raises
    ------
    UserError
        Naming line and column of the first cell that is neither a number nor missing.
    """
    pieces: list[list[Array]] = [[] for _ in chosen]
    for line, text in _pieces(dialect):
        table = _numbers(dialect, chosen, text, line)
        for kept, column in zip(pieces, table.T, strict=True):
            kept.append(column.copy())
    columns = []
    while pieces:  # a column's pieces are let go as soon as it is whole
        columns.append(np.concatenate(pieces.pop(0) or [np.empty(0)]))
    return columns


def _pieces(dialect: Dialect) -> Iterator[tuple[int, str]]:
    """Texts of whole lines, each with the number of its first line."""
    try:
        with dialect.path.open(encoding=dialect.encoding, errors="replace") as file:
            for _ in range(dialect.first_line - 1):
                file.readline()
            yield from _whole_lines(file, dialect.first_line)
    except OSError as error:
        raise UserError(f"'{dialect.path}' cannot be read as recorded data: {error.strerror}.") from None


def _whole_lines(file: TextIO, line: int) -> Iterator[tuple[int, str]]:
    rest = ""
    while text := file.read(PIECE):
        whole, end, begun = text.rpartition("\n")
        if not end:
            rest += text
            continue
        piece, rest = rest + whole + end, begun
        yield line, piece
        line += piece.count("\n")
    if rest.strip():
        yield line, rest


def _numbers(dialect: Dialect, chosen: Sequence[int], text: str, line: int) -> Array:
    """A table (rows, chosen) of a piece of text."""
    plain = _plain(text, dialect.separator)
    for marked in (False, True):  # the marks of missing samples are looked for where something is no number
        plain = _without_marks(plain, dialect.separator) if marked else plain
        if not plain.strip():
            return np.empty((0, len(chosen)))
        try:
            return _table(plain, dialect.separator, chosen)
        except (ValueError, IndexError) as error:
            said = error
    raise UserError(_first_fault(dialect, chosen, text, line) or f"'{dialect.path}' cannot be read as a table: {said}")


def _table(text: str, separator: str, chosen: Sequence[int]) -> Array:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return np.loadtxt(
            io.StringIO(text),
            delimiter=None if separator == " " else separator,
            usecols=list(chosen),
            comments=None,
            ndmin=2,
        )


def _plain(text: str, separator: str) -> str:
    """Without comment lines and quotes, the decimal mark a point."""
    if '"' in text:
        if separator == "," and re.search(r'"[^",\n]*,', text):
            text = re.sub(r'"([^"\n]*)"', lambda cell: cell[1].replace(",", "."), text)
        text = text.replace('"', "")
    if separator != "," and "," in text:
        text = text.replace(",", ".")
    if any(mark in text for mark in ("#", "%", "//")):
        text = re.sub(r"(?m)^[ \t]*(#|%|//).*$", "", text)
    return text


def _without_marks(text: str, separator: str) -> str:
    """Marks of missing samples and empty cells as nan."""
    if separator == " ":
        return re.sub(rf"(?im)(?<!\S)(?:{MARKS})(?!\S)", "nan", text)
    edge = re.escape(separator)
    text = re.sub(rf"(?im)(^|(?<={edge})) *(?:{MARKS})? *(?={edge}|$)", "nan", text)
    return re.sub(rf"(?m)^nan(?:{edge}nan)*$", "", text)  # a row of nothing is none


def _first_fault(dialect: Dialect, chosen: Sequence[int], text: str, line: int) -> str | None:
    for number, one in enumerate(text.split("\n"), line):
        if not one.strip() or COMMENT.match(one):
            continue
        row = cells(one, dialect.separator)
        if len(row) <= max(chosen):
            return (
                f"'{dialect.path}' line {number} has {len(row)} columns, the header has {len(dialect.names)}: "
                "was the file cut off there? Remove or complete the line."
            )
        for column in chosen:
            if not is_number(row[column], dialect.separator) and not is_mark(row[column]):
                return (
                    f"'{dialect.path}' line {number}, column '{dialect.names[column]}' is '{row[column][:40]}', "
                    "not a number; write nan where a sample is missing."
                )
    return None
