"""The cost of a filter step beside its peers, measured here and now, in one run.

Run: python benchmarks/cost.py [--table peers --table forms ...] [--json F] [--out build/bench]

Needs valgrind, arm-none-eabi-gcc and qemu-system-arm for instructions, and ``pip install 'pmsm-ickf[bench]'`` with
Eigen's headers (Debian: libeigen3-dev) for the peers; what is missing is named in its row.
"""

from __future__ import annotations

import json
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from costs import blocks, growth, python_time, step_tables
from costs.counting import Missing
from costs.step_tables import X86, Length
from costs.table import Table, Wanted
from runtime.system.errors import UserError


class Choice(StrEnum):
    """The tables there are."""

    peers = "peers"
    forms = "forms"
    python = "python"
    growth = "growth"
    passes = "passes"
    blocks = "blocks"


def main(
    table: Annotated[list[Choice], typer.Option(help="Which tables; all by default.")] = list(Choice),  # noqa: B006
    steps: Annotated[int, typer.Option(min=10, help="Steps counted.")] = 1000,
    settle: Annotated[int, typer.Option(min=0, help="Steps before them.")] = 200,
    json_path: Annotated[Path | None, typer.Option("--json", help="Write all figures to this file.")] = None,
    out: Annotated[Path, typer.Option(help="Where the plots go.")] = Path("build/bench"),
) -> None:
    """Print the tables of cost against peers."""
    console = Console() if sys.stdout.isatty() else Console(width=180)
    words = Console(stderr=True)
    try:
        tables, wanted = measure(list(table), Length(steps, settle), lambda text: words.print(text, style="dim"))
        for one in tables:
            one.show(console)
        if wanted:
            Table("figures", "Figures looked for", [item.row for item in wanted]).show(console)
        for path in draw(tables, out):
            console.print(f"wrote {path}")
        if json_path is not None:
            facts = {one.name: one.facts() for one in tables} | {"wanted": [item.row for item in wanted]}
            settings = {"steps": steps, "settle": settle}
            json_path.write_text(json.dumps({"settings": settings, **facts}, indent=2) + "\n", encoding="utf-8")
    except UserError as error:
        words.print(f"cost: {error}")
        raise typer.Exit(2) from None


def measure(choices: list[Choice], length: Length, progress: step_tables.Progress) -> tuple[list[Table], list[Wanted]]:
    """The tables chosen, and what is looked for in them."""
    makers = {
        Choice.peers: lambda: step_tables.peers_table(length, progress),
        Choice.forms: lambda: step_tables.forms_table(length, progress),
        Choice.python: lambda: python_time.python_table(length.steps, progress),
        Choice.growth: lambda: growth.growth_table(length, progress),
        Choice.passes: lambda: step_tables.passes_table(length, progress),
        Choice.blocks: lambda: blocks.blocks_table(length, progress),
    }
    found = {choice: makers[choice]() for choice in dict.fromkeys(choices)}
    wanted = step_tables.wanted(found.get(Choice.peers), found.get(Choice.forms))
    if Choice.python in found:
        wanted += python_time.wanted(found[Choice.python])
    return list(found.values()), wanted


def draw(tables: list[Table], out: Path) -> list[Path]:
    """The plots of the tables that have one."""
    written = []
    for table in tables:
        if table.name in {"growth", "passes"}:
            out.mkdir(parents=True, exist_ok=True)
            path = out / f"{table.name}.svg"
            (growth.write_figure if table.name == "growth" else write_passes)(table, path)
            written.append(path)
    return written


def write_passes(table: Table, path: Path) -> None:
    """The gain of each pass: operations, and instructions where they were counted."""
    from runtime.report.cost_figures import passes_figure

    panels: dict[str, dict[str, list[float]]] = {"operations, in additions": {}, "x86 instructions": {}}
    labels: list[str] = []
    for row in table.rows:
        drive, _, label = str(row["form"]).partition(": ")
        labels += [label] if label not in labels else []
        for panel, column in zip(panels.values(), ("weight", X86), strict=True):
            cell = row[column]
            if not isinstance(cell, Missing | str):
                panel.setdefault(drive, []).append(float(cell))
    path.write_text(passes_figure(labels, {k: v for k, v in panels.items() if v}), encoding="utf-8")


if __name__ == "__main__":
    typer.run(main)
