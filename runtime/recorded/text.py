"""A CSV file as scopes, loggers and spreadsheets write it: find the header and the dialect.

Comma, semicolon, tab or blanks between cells; decimal point or comma; comment lines (# % //), lines before the header,
a line of units after it, quotes, a byte order mark, any line ends; the time as start and increment. Columns without a
header have numbers for names.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from runtime.recorded.cells import COMMENT, Dialect, cells, is_mark, is_number, read_cells
from runtime.recorded.source import Array, Source
from runtime.recorded.units import is_unit, split_unit
from runtime.system.errors import UserError

#: Separators by preference: a line with tabs may hold commas as decimals, never the other way round.
SEPARATORS = ("\t", ";", ",", " ")
#: The header is looked for in so many bytes.
HEAD = 1 << 18
#: What stands in a line of units above a column that counts samples.
_COUNT = re.compile(r"sequence|samples?|index|#|point|pts", re.IGNORECASE)
_START = re.compile(r"start|t0", re.IGNORECASE)
_STEP = re.compile(r"increment|t_?inc|dt|delta", re.IGNORECASE)
_GIVEN = re.compile(r"(\w+)\s*=\s*([-+.\deE]+)\s*s?")


@dataclass(frozen=True)
class Header:
    """Cells above the numbers: ``given`` are numbers that the header itself holds, by the name they stand under.

    ``counter`` is the column that counts the samples, None if there is none.
    """

    written: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    given: Mapping[str, float] = field(default_factory=dict)
    counter: int | None = None


def read_text(path: Path) -> Source:
    """Find header and dialect of a text file; its numbers are read when columns are asked for.

    Parameters
    ----------
    path : Path

    Raises
    ------
    UserError
        If it is not text or holds no row of numbers.
    """
    encoding, lines = _head(path)
    first, separator = _first_row(path, lines)
    width = len(cells(lines[first], separator))
    header = _header(lines[:first], separator, width)
    known = [_split(cell, header.written) for cell in header.written]
    names = tuple(name for name, _ in known) or tuple(str(k + 1) for k in range(width))
    units = tuple(beside or below for (_, beside), below in zip(known, header.units, strict=True)) or ("",) * width
    written = header.written or names
    dialect = Dialect(path, encoding, separator, names, first + 1)
    hint = "" if header.written else _no_header(path, width)
    start, step = _time(header.given)
    if step is None:
        return Source(path, names, units, lambda chosen: read_cells(dialect, chosen), written, hint=hint)
    return _counted(Source(path, names, units, lambda _: [], written), dialect, header.counter, start, step)


def _counted(source: Source, dialect: Dialect, counter: int | None, start: float, step: float) -> Source:
    """A file whose header holds when its samples begin and how far they are apart."""
    time = len(source.names) if counter is None else counter

    def load(chosen: Sequence[int]) -> list[Array]:
        read = read_cells(dialect, [k for k in chosen if k != len(source.names)] or [0])
        columns = dict(zip([k for k in chosen if k != len(source.names)], read, strict=False))
        if counter is None:
            columns[time] = np.arange(len(read[0]), dtype=float)
        return [start + step * columns[k] if k == time else columns[k] for k in chosen]

    names, units = list(source.names), list(source.units)
    if counter is None:
        names, units = [*names, "t"], [*units, ""]
    units[time] = ""
    what = f"{start:.9g} s + {step:.9g} s a row, as the header says"
    note = f"t: {what}" if counter is None else f"'{names[time]}' counts rows; as a time it is {what}"
    written = (*source.written, *(["t"] if counter is None else []))
    return Source(source.path, tuple(names), tuple(units), load, written, [note])


def _time(given: Mapping[str, float]) -> tuple[float, float | None]:
    """Start and increment of the time, s; no increment where the header holds none."""
    start = next((value for name, value in given.items() if _START.fullmatch(name)), 0.0)
    step = next((value for name, value in given.items() if _STEP.fullmatch(name)), None)
    return start, step if step is not None and np.isfinite(step) and step > 0.0 and np.isfinite(start) else None


def _no_header(path: Path, width: int) -> str:
    return (
        f"'{path}' has no header: its first line names the {width} columns, such as t,u_alpha,u_beta,i_alpha,i_beta; "
        "or name them by number: --rename 1=t."
    )


def _split(cell: str, row: Sequence[str]) -> tuple[str, str]:
    """Name and unit of a cell; the whole cell where others would have the same name without what is behind it."""
    name, unit = split_unit(cell)
    if name != cell and sum(split_unit(other)[0] == name for other in row) > 1:
        return cell, ""
    return name, unit


def _head(path: Path) -> tuple[str, list[str]]:
    """Encoding and first lines."""
    try:
        with path.open("rb") as file:
            raw = file.read(HEAD)
    except OSError as error:
        raise UserError(f"'{path}' cannot be read as recorded data: {error.strerror}.") from None
    if raw[:2] in {b"\xff\xfe", b"\xfe\xff"}:
        encoding = "utf-16"
    elif b"\x00" in raw:
        raise UserError(f"'{path}' is not text: recorded data is .npz, .mat, .mf4, or .csv with a header.")
    else:
        encoding = "utf-8-sig"
        whole = raw if len(raw) < HEAD else raw[: max(raw.rfind(b"\n"), raw.rfind(b"\r")) + 1]
        try:
            whole.decode(encoding)
        except UnicodeDecodeError:
            encoding = "latin-1"
    text = raw.decode(encoding, errors="replace").replace("\r\n", "\n").replace("\r", "\n")
    return encoding, text.split("\n")


def _first_row(path: Path, lines: Sequence[str]) -> tuple[int, str]:
    """The first line of numbers, and its separator."""
    rows = ((k, separator) for k, line in enumerate(lines) if (separator := _separator(line)))
    for k, separator in rows:
        below = (cells(line, separator) for line in lines[k + 1 :] if line.strip())
        here, after, later = cells(lines[k], separator), next(below, []), next(below, [])
        if _is_unit_row(after) and not _is_unit_row(later):
            continue  # names that are numbers
        if k and _is_unit_row(here) and not _is_unit_row(after):
            continue  # numbers among the units
        above = any(sum(map(bool, row)) > 1 for row in _header_rows(lines[:k], separator))
        words = (not is_number(a, separator) and not is_mark(a) for a in here)
        if not above and any(word and is_number(b, separator) for word, b in zip(words, after, strict=False)):
            continue  # a word above numbers is a name
        return k, separator
    where = f" in its first {HEAD:,} bytes, where it is looked for" if path.stat().st_size > HEAD else ""
    raise UserError(
        f"'{path}' has no row of numbers{where} (at least two columns, separated by comma, semicolon or tab)."
    )


def _separator(line: str) -> str | None:
    """The separator of a row of numbers; None if the line is not one."""
    if COMMENT.match(line):
        return None
    for separator in SEPARATORS:
        row = [cell for cell in cells(line, separator) if cell]
        numbers = sum(is_number(cell, separator) for cell in row)
        if numbers >= 2 and 2 * (numbers + sum(map(is_mark, row))) > len(row):
            return separator
    return None


def _is_unit_row(row: Sequence[str]) -> bool:
    """Units alone, or what counts samples, or numbers that belong to the header; of units at least one."""
    filled = [cell for cell in row if cell]
    units = [is_unit(cell) for cell in filled]
    others = (_COUNT.fullmatch(cell) or is_number(cell, ",") for cell in filled)
    return any(units) and all(unit or other for unit, other in zip(units, others, strict=True))


def _header(before: Sequence[str], separator: str, width: int) -> Header:
    """Names and units: the nearest line above the numbers with names in it, a commented one if there is no other."""
    below: list[str] = []
    for row in _header_rows(before, separator):
        if not below and _is_unit_row(row):
            below = row
            continue
        given = {
            name: float(cell.replace(",", "."))
            for name, cell in zip(row, below, strict=False)
            if name and is_number(cell, separator)
        }
        given |= {m[1]: float(m[2]) for cell in row if (m := _GIVEN.fullmatch(cell)) and is_number(m[2], separator)}
        filled = [k for k, cell in enumerate(row) if cell and cell not in given and not _GIVEN.fullmatch(cell)]
        if len(filled) < 2 or max(filled) >= width:
            continue
        written = [row[k] if k in filled else "" for k in range(min(width, len(row)))]
        written += [""] * (width - len(written))
        beside = [cell.strip("()[] ") for cell in below] + [""] * width
        units = tuple(unit if is_unit(unit) else "" for unit in beside[:width])
        counter = next((k for k in filled if k < len(below) and _COUNT.fullmatch(below[k])), None)
        return Header(tuple(written), units, given, counter)
    return Header()


def _header_rows(before: Sequence[str], separator: str) -> Iterator[list[str]]:
    """Lines above the numbers from the nearest on, cut into cells: plain ones first, then what comments hold."""
    filled = [line for line in reversed(before) if line.strip()]
    yield from (cells(line, separator) for line in filled if not COMMENT.match(line))
    yield from (cells(COMMENT.sub("", line, count=1), separator) for line in filled if COMMENT.match(line))
