"""A CSV file as scopes, loggers and spreadsheets write it: find the header and the dialect, then read fast.

Comma, semicolon, tab or blanks between cells; decimal point or comma; comment lines (# % //), lines before the header,
a line of units after it, quotes, a byte order mark, any line ends.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.recorded.units import is_unit, split_unit
from runtime.system.errors import UserError

Array = NDArray[Any]

COMMENT = re.compile(r"\s*(#|%|//)\s*")
#: Separators by preference: a line with tabs may hold commas as decimals, never the other way round.
SEPARATORS = ("\t", ";", ",", " ")
#: The header is looked for in so much of the file.
HEAD = 1 << 18


@dataclass(frozen=True)
class CsvTable:
    """A CSV file with its header understood. ``units``: as written beside the names, "" where there is none."""

    path: Path
    names: tuple[str, ...]
    units: tuple[str, ...]
    separator: str
    body: str
    first_line: int

    def columns(self, chosen: Sequence[int]) -> list[Array]:
        """Read columns by their numbers.

        Parameters
        ----------
        chosen : sequence of int

        Raises
        ------
        UserError
            Naming line and column of the first cell that is not a number.
        """
        text = self.body.replace(",", ".") if self.separator != "," and "," in self.body else self.body
        if any(mark in text for mark in ("#", "%", "//")):
            text = re.sub(r"(?m)^[ \t]*(#|%|//).*$", "", text)
        try:
            table = np.loadtxt(
                io.StringIO(text.replace('"', "")),
                delimiter=None if self.separator == " " else self.separator,
                usecols=list(chosen),
                comments=None,
                ndmin=2,
            )
        except (ValueError, IndexError) as error:
            raise UserError(self._first_fault(chosen) or f"'{self.path}' cannot be read as a table: {error}") from None
        return list(table.T)

    def _first_fault(self, chosen: Sequence[int]) -> str | None:
        for number, line in enumerate(self.body.split("\n"), self.first_line):
            if not line.strip() or COMMENT.match(line):
                continue
            row = cells(line, self.separator)
            if len(row) <= max(chosen):
                return (
                    f"'{self.path}' line {number} has {len(row)} columns, the header has {len(self.names)}: "
                    "was the file cut off there? Remove or complete the line."
                )
            for column in chosen:
                if not is_number(row[column], self.separator):
                    what = f"is '{row[column]}', not a number" if row[column] else "is empty"
                    return (
                        f"'{self.path}' line {number}, column '{self.names[column]}' {what}; "
                        "write nan where a sample is missing."
                    )
        return None


def read_csv(path: Path) -> CsvTable:
    """Find header and dialect of a file; the numbers are read by :meth:`CsvTable.columns`.

    Parameters
    ----------
    path : Path

    Raises
    ------
    UserError
        If it is not text, holds no numbers, or has no header.
    """
    text = _decoded(path)
    lines = text[:HEAD].split("\n")
    found = next(((k, separator) for k, line in enumerate(lines) if (separator := _separator(line))), None)
    if found is None:
        raise UserError(f"'{path}' has no row of numbers (at least two columns, separated by comma, semicolon or tab).")
    first, separator = found
    width = len(cells(lines[first], separator))
    names, units = _header(path, lines[:first], separator, width)
    body = text[sum(len(line) + 1 for line in lines[:first]) :]
    return CsvTable(path, names, units, separator, body, first + 1)


def _decoded(path: Path) -> str:
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise UserError(f"'{path}' cannot be read as recorded data: {error.strerror}.") from None
    if raw[:2] in {b"\xff\xfe", b"\xfe\xff"}:
        text = raw.decode("utf-16", errors="replace")
    elif b"\x00" in raw[:HEAD]:
        raise UserError(f"'{path}' is not text: recorded data is .npz, or .csv with a header.")
    else:
        try:
            text = raw.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = raw.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def cells(line: str, separator: str) -> list[str]:
    """Split a line into cells, without quotes and blanks.

    Parameters
    ----------
    line : str
    separator : str
    """
    if separator == " ":
        return line.replace('"', "").split()
    return [cell.strip().strip('"').strip() for cell in line.split(separator)]


def is_number(cell: str, separator: str) -> bool:
    """Whether NumPy's reader will take a cell as a number.

    Parameters
    ----------
    cell : str
    separator : str
        Between cells; a comma as decimal mark is read where it is another.
    """
    try:
        float(cell if separator == "," else cell.replace(",", "."))
    except ValueError:
        return False
    return "_" not in cell


def _separator(line: str) -> str | None:
    """The separator of a row of numbers; None if the line is not one."""
    if COMMENT.match(line):
        return None
    for separator in SEPARATORS:
        row = [cell for cell in cells(line, separator) if cell]
        numbers = sum(is_number(cell, separator) for cell in row)
        if numbers >= 2 and 2 * numbers > len(row):
            return separator
    return None


def _header(path: Path, before: Sequence[str], separator: str, width: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names and units: the nearest line above the numbers with names in it, a commented one if there is no other."""
    unit_row: list[str] = []
    for row in _header_rows(before, separator):
        filled = [cell for cell in row if cell]
        if len(filled) < 2 or len(filled) > width:
            continue
        if not unit_row and all(is_unit(cell) for cell in filled):
            unit_row = row
            continue
        split = [split_unit(cell) for cell in row[:width]] + [("", "")] * (width - len(row))
        beside = [cell.strip("()[] ") for cell in unit_row] + [""] * width
        return tuple(name for name, _ in split), tuple(u or v for (_, u), v in zip(split, beside, strict=False))
    raise UserError(
        f"'{path}' has no header: its first line names the {width} columns, such as t,u_alpha,u_beta,i_alpha,i_beta."
    )


def _header_rows(before: Sequence[str], separator: str) -> Iterator[list[str]]:
    """Lines above the numbers from the nearest on, cut into cells: plain ones first, then what comments hold."""
    filled = [line for line in reversed(before) if line.strip()]
    yield from (cells(line, separator) for line in filled if not COMMENT.match(line))
    yield from (cells(COMMENT.sub("", line, count=1), separator) for line in filled if COMMENT.match(line))
