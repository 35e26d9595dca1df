"""The two shapes of table in the terminal: columns under a line of names, and pairs of name and value."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from rich.table import Table


def columns_table(*columns: str, left: Collection[int] = (0,), whole: Collection[int] = ()) -> Table:
    """An empty table; numbers stand to the right.

    Parameters
    ----------
    *columns : str
        Their names.
    left : collection of int
        Columns of words, which stand to the left.
    whole : collection of int
        Columns that are not broken into lines.
    """
    table = Table(header_style="", show_edge=False, pad_edge=False)
    for k, column in enumerate(columns):
        table.add_column(column, justify="left" if k in left else "right", overflow="fold", no_wrap=k in whole)
    return table


def pairs_table(rows: Iterable[tuple[str, str]]) -> Table:
    """A line for each name and what there is to say of it."""
    table = Table(show_header=False, show_edge=False, pad_edge=False, box=None)
    table.add_column(style="dim")
    table.add_column(overflow="fold")
    for name, value in rows:
        table.add_row(name, value)
    return table
