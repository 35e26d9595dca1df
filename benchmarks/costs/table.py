"""A table as data: printed with Rich, written as JSON. What could not be measured says why, in its row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from costs.counting import Figure, Missing

Cell = str | Figure
Row = dict[str, Cell]


@dataclass(frozen=True)
class Table:
    """``rows`` hold a cell a column; ``notes`` say how it was counted."""

    name: str
    title: str
    rows: Sequence[Row]
    notes: Sequence[str] = field(default_factory=tuple)

    @property
    def columns(self) -> list[str]:
        return list(dict.fromkeys(column for row in self.rows for column in row if column != "note"))

    def show(self, console: Console) -> None:
        """Print it; reasons for what is missing stand below, named by their row."""
        table = RichTable(header_style="", show_edge=False, pad_edge=False)
        for k, column in enumerate(self.columns):
            table.add_column(column, justify="left" if k == 0 else "right")
        remarks: list[str] = []
        for row in self.rows:
            table.add_row(*(_spelled(column, row.get(column, "")) for column in self.columns))
            remarks += _remarks(str(row[self.columns[0]]), row)
        console.print(Text(self.title, style="bold"))
        console.print(table)
        for line in [*remarks, *self.notes]:
            console.print(Text(line, style="yellow" if "not measured" in line else "dim"))
        console.print()

    def facts(self) -> dict[str, Any]:
        """For JSON: a missing figure is ``{"not_measured": why}``."""
        rows = [
            {key: {"not_measured": cell.why} if isinstance(cell, Missing) else cell for key, cell in row.items()}
            for row in self.rows
        ]
        return {"title": self.title, "rows": rows, "notes": list(self.notes)}


def _remarks(label: str, row: Row) -> list[str]:
    found: dict[str, list[str]] = {}
    for column, cell in row.items():
        if isinstance(cell, Missing):
            found.setdefault(cell.why, []).append(column)
    lines = [f"{label}: not measured ({', '.join(columns)}): {why}" for why, columns in found.items()]
    return lines + ([f"{label}: {row['note']}"] if row.get("note") else [])


def _spelled(column: str, cell: Cell) -> str:
    if isinstance(cell, Missing):
        return "not measured"
    if isinstance(cell, str):
        return cell
    if "sigma" in column:
        return f"{cell:.0e}"
    if " / " in column:
        return f"{cell:.2f}" if cell < 10 else f"{cell:,.0f}"
    return f"{cell:.3g}" if abs(cell) < 100 and cell != int(cell) else f"{cell:,.0f}"


def ratio(over: Cell, under: Cell) -> Figure:
    """A quotient; what is missing of either stays missing."""
    for value in (over, under):
        if isinstance(value, Missing):
            return value
    assert not isinstance(over, str | Missing)
    assert not isinstance(under, str | Missing)
    return float(over) / float(under)


@dataclass(frozen=True)
class Wanted:
    """A figure that is looked for, and its bound."""

    what: str
    found: Cell
    bound: float
    at_least: bool = False

    @property
    def row(self) -> Row:
        found = self.found
        if isinstance(found, Missing):
            verdict = "not measured"
        else:
            good = float(found) >= self.bound if self.at_least else float(found) <= self.bound
            verdict = "reached" if good else "not reached"
        return {
            "figure": self.what,
            "here": _spelled(" / " if self.bound < 1 else "", found),
            "wanted": f"{'>=' if self.at_least else '<='} {self.bound:g}",
            "verdict": verdict,
            **({"note": f"not measured: {found.why}"} if isinstance(found, Missing) else {}),
        }


def chosen(rows: Sequence[Row], label: str) -> Mapping[str, Cell]:
    """The row that begins with a label."""
    return next(row for row in rows if str(next(iter(row.values()))).startswith(label))
