"""A comparison on one page: an HTML file that needs nothing else, and its figures beside it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from runtime.compare.differences import Line, constant_rows, equation_lines, file_rows, tuning_rows
from runtime.compare.facts import costs, kinds
from runtime.compare.figures import accuracy_figure, cost_figure, sparsity_figure
from runtime.compare.subject import Subject
from runtime.compare.tables import (
    COST_COLUMNS,
    accuracy_rows,
    alike,
    certificate_table,
    cost_cells,
    firsts,
    shown,
)
from runtime.style.pages import equation_line, page_template
from runtime.style.svg import themed
from runtime.system.files import make_folder, write_text


def write_comparison(subjects: Sequence[Subject], folder: Path) -> Path:
    """index.html, sparsity.svg, cost.svg and accuracy_<filter>.svg in a folder; the page's path."""
    figures = {"sparsity": sparsity_figure(subjects), "cost": cost_figure(subjects)}
    figures |= {f"accuracy_{kind}": accuracy_figure(subjects, kind) for kind in kinds(subjects)}
    page = folder / "index.html"
    make_folder(folder)
    for name, text in figures.items():
        write_text(folder / f"{name}.svg", text)
    write_text(page, _text(subjects, figures))
    return page


def _text(subjects: Sequence[Subject], figures: dict[str, str]) -> str:
    found = costs(subjects)
    first = firsts(found)
    tables = {
        "Drive files": file_rows(subjects),
        "Tuning": tuning_rows(subjects),
        "Constants of the equations": constant_rows(subjects),
    }
    columns, certificate = certificate_table(subjects)
    text: str = page_template(Path(__file__).with_name("compare.html.j2")).render(
        labels=[subject.label for subject in subjects],
        subjects=subjects,
        tables=[(title, alike(rows), [row for row in rows if row.differs]) for title, rows in tables.items()],
        shown=shown,
        lines=[_line(subjects, line) for line in equation_lines(subjects)],
        cost_columns=COST_COLUMNS,
        costs=[cost_cells(cost, first[cost.kind]) for cost in found],
        certificate_columns=columns,
        certificate=certificate,
        accuracy=accuracy_rows(subjects),
        figures={name: themed(figure) for name, figure in figures.items()},
    )
    return text


def _line(subjects: Sequence[Subject], line: Line) -> dict[str, Any]:
    variants = [
        {
            "math": equation_line(subjects[owners[0]].equations, line.left, right),
            "drives": ", ".join(subjects[k].label for k in owners),
        }
        for right, owners in line.variants
    ]
    return {"function": line.function, "differs": line.differs, "variants": variants}
