"""Drives side by side, as Rich tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from codegen.evidence.ledger import OPERATIONS
from runtime.compare.differences import Row, constant_rows, equation_lines, file_rows, tuning_rows
from runtime.compare.facts import Cost, certificates, costs, kinds
from runtime.compare.subject import Subject
from runtime.drive.simulation import LOCKED
from runtime.style.tables import columns_table


def compare_tables(subjects: Sequence[Subject]) -> RenderableType:
    """Everything a comparison says."""
    labels = [subject.label for subject in subjects]
    parts: list[RenderableType] = []
    for title, rows in (
        ("Drive files", file_rows(subjects)),
        ("Tuning: x_0, P_0, Q per step", tuning_rows(subjects)),
        ("Constants", constant_rows(subjects)),
    ):
        parts += [_title(f"{title}; {alike(rows)}"), _rows_table(rows, labels), ""]
    parts += [_title("Equations: lines that differ"), _equations(subjects, labels), ""]
    legend = "Structure: . zero, 1 one, c another constant, x depends on state or input"
    parts += [_title(legend), _structure(subjects), ""]
    parts += [_title("A step on the chip (cycles computed from published ones, at k = 2.5 and 5), worst case")]
    parts += [_costs(costs(subjects)), ""]
    parts += [_title("Certificate: worst float32 error of one step over each drive's operating box")]
    parts += [_certificates(subjects), ""]
    parts += [_title("In the loop: error of the estimate, averaged inverter, 0.05 A rms of noise"), _accuracy(subjects)]
    return Group(*parts)


def alike(rows: Sequence[Row]) -> str:
    """How many rows are left out of a table of differences."""
    same = sum(not row.differs for row in rows)
    return f"{same} alike are left out" if same else "none is alike"


def shown(value: Any) -> str:
    """A value of a drive file."""
    if value is None:
        return "-"
    if isinstance(value, list):
        return ", ".join(shown(item) for item in value) or "none"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def accuracy_rows(subjects: Sequence[Subject]) -> list[tuple[str, ...]]:
    """Scenario, filter, drive, four figures, verdict."""
    rows: list[tuple[str, ...]] = []
    runs = [(subject.label, run) for subject in subjects for run in subject.runs]
    order = kinds(subjects)
    for label, run in sorted(runs, key=lambda item: (item[1].scenario.name != "no_load", order.index(item[1].kind))):
        f = run.figures()
        step = f"{f['load_step']:.2f}" if run.scenario.load else "-"
        figures = (f"{f['start']:.2f}", step, f"{f['steady_rms']:.3f}", f"{f['angle']:.3f}")
        rows.append((run.scenario.name, run.kind, label, *figures, run.verdict))
    return rows


def cost_cells(cost: Cost, first: Cost) -> tuple[str, ...]:
    """One line of the table of costs; ``first`` is what the ratio refers to."""
    operations = (f"{cost.operations[name]:,}" for name in OPERATIONS)
    measured = (f"{value:,}" if value is not None else "-" for value in (cost.stack, cost.text))
    return (
        cost.kind,
        cost.label,
        *operations,
        "/".join(f"{value:,}" for value in cost.cycles.values()) or "-",
        f"{cost.typical / first.typical:.2f}" if cost.typical and first.typical else "-",
        f"{cost.share:.0f} %" if cost.share is not None else "-",
        "/".join(f"{value:,}" for value in cost.interrupt.values()) or "-",
        str(cost.ram_words),
        *measured,
    )


COST_COLUMNS = (
    "filter", "drive", *OPERATIONS, "cycles", "ratio", "of T", "with controller",
    "RAM, words", "stack, B (M4F)", "code, B (M4F)",
)  # fmt: skip


def firsts(found: Sequence[Cost]) -> dict[str, Cost]:
    """The first drive's cost by filter."""
    by_kind: dict[str, Cost] = {}
    for cost in found:
        by_kind.setdefault(cost.kind, cost)
    return by_kind


def certificate_table(subjects: Sequence[Subject]) -> tuple[list[str], list[list[str]]]:
    """Columns and cells: every state that any drive has."""
    found = certificates(subjects)
    names = list(dict.fromkeys(name for _, _, values in found for name in values if not name.startswith("P,")))
    units = {state["name"]: state["unit"] for subject in subjects for state in subject.manifest["states"]}
    keys = [*names, "P, 99 %", "P, worst"]
    cells = [[kind, label, *(f"{v[k]:.1e}" if k in v else "-" for k in keys)] for label, kind, v in found]
    return ["filter", "drive", *(f"{key}, {units[key]}" if key in units else key for key in keys)], cells


def _title(text: str) -> Text:
    return Text(text, style="bold")


def _rows_table(rows: Sequence[Row], labels: Sequence[str]) -> RenderableType:
    differing = [row for row in rows if row.differs]
    if not differing:
        return Text("no difference", style="dim")
    table = columns_table("", *labels)
    for row in differing:
        table.add_row(row.key, *(shown(value) for value in row.values))
    return table


def _equations(subjects: Sequence[Subject], labels: Sequence[str]) -> RenderableType:
    lines = [line for line in equation_lines(subjects) if line.differs]
    if not lines:
        return Text("no difference", style="dim")
    table = columns_table("", "line", "", "drive", left=range(4))
    for line in lines:
        first = (line.function, str(line.left))
        for right, owners in line.variants:
            table.add_row(*first, str(right), ", ".join(labels[k] for k in owners))
            first = ("", "")
    return table


def _structure(subjects: Sequence[Subject]) -> Table:
    """F above H, one drive a column."""
    table = Table(show_edge=False, pad_edge=False, header_style="")
    table.add_column("")
    for subject in subjects:
        table.add_column(subject.label)
    for name in ("F", "H"):
        counts = [sum(len(row) - row.count(".") for row in s.patterns[name]) for s in subjects]
        cells = [
            "\n".join(" ".join(row) for row in s.patterns[name]) + f"\n{count} of {sum(map(len, s.patterns[name]))}\n"
            for s, count in zip(subjects, counts, strict=True)
        ]
        table.add_row(name, *(Text(cell) for cell in cells))
    return table


def _costs(found: Sequence[Cost]) -> Table:
    table = columns_table(*COST_COLUMNS, left=range(2), whole=(1, 10, 13))
    first = firsts(found)
    for cost in found:
        table.add_row(*cost_cells(cost, first[cost.kind]))
    return table


def _certificates(subjects: Sequence[Subject]) -> Table:
    columns, cells = certificate_table(subjects)
    table = columns_table(*columns, left=range(2), whole=(1,))
    for row in cells:
        table.add_row(*row)
    return table


def _accuracy(subjects: Sequence[Subject]) -> Table:
    columns = ("start, r/min", "load step, r/min", "steady rms, r/min", "angle, deg")
    table = columns_table("scenario", "filter", "drive", *columns, "", left=range(3))
    for row in accuracy_rows(subjects):
        table.add_row(*row[:-1], Text(row[-1], style="green" if row[-1] == LOCKED else "bold red"))
    return table
