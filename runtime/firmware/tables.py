"""The table of firmware checks."""

from __future__ import annotations

from collections.abc import Iterable

from rich.table import Table
from rich.text import Text

from runtime.firmware.static.check import Check
from runtime.style.tables import columns_table

STYLES = {"passed": "green", "failed": "bold red", "not run": "yellow", "not proved": "yellow"}


def checks_table(checks: Iterable[Check]) -> Table:
    """One row a check."""
    table = columns_table("check", "on", "figure", "how", "", left=range(5))
    for check in checks:
        state = Text(check.state, style=STYLES[check.state])
        table.add_row(check.name, check.subject, check.figure, check.how, state)
    return table


def remarks(checks: Iterable[Check]) -> list[tuple[str, str]]:
    """The remarks of checks beyond their row, each text once, with its style."""
    said = {
        line: "dim" if check.state == "passed" else STYLES[check.state] for check in checks for line in check.detail
    }
    return list(said.items())
