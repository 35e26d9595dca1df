"""The page of drives side by side: each cell under the head that says what it is."""

from __future__ import annotations

import re
from pathlib import Path

from model.drives.load import load_drive
from runtime.compare.facts import costs
from runtime.compare.page import write_comparison
from runtime.compare.subject import Subject
from runtime.compare.tables import accuracy_rows, certificate_table, cost_cells, firsts
from tests.judges.made import Kept
from tests.judges.test_pages import heads_of
from tests.judges.test_side_by_side import NAMES, subjects

__all__ = ["subjects"]


def test_the_page_of_a_comparison(subjects: list[Subject], tmp_path: Path, kept: Kept) -> None:
    """Its tables under their heads, each cell where its head says."""
    page = write_comparison(subjects, tmp_path)
    heads = heads_of(page)
    assert heads[0] == ["drive", "machine", "mechanics", "discretisation", "T, us", "states", "filters"]
    accuracy = ["start, r/min", "load step, r/min", "steady rms, r/min", "angle after start, deg", ""]
    assert heads[1] == ["scenario", "filter", "drive", *accuracy]
    assert heads[2] == [
        "filter", "drive", "add", "mul", "div", "sqrt", "compare", "select", "branch", "call",
        "cycles", "ratio", "of T", "with controller", "RAM, words", "stack, B (M4F)", "code, B (M4F)",
    ]  # fmt: skip
    assert heads[-1] == certificate_table(subjects)[0]
    text = page.read_text(encoding="utf-8")
    rows = [re.findall(r"<td[^>]*>([^<]*)</td>", row) for row in re.findall(r"<tr>(.*?)</tr>", text, re.DOTALL)]
    for name in NAMES:
        model = load_drive(name).model
        (first,) = [row for row in rows if row[:2] == [name, model.machine]]
        assert first[2:5] == [model.mechanics, model.discretization, f"{model.sample_time * 1e6:g}"]
    for told in accuracy_rows(subjects):
        assert list(told) in rows
    first_of = firsts(costs(subjects))
    for cost in costs(subjects):
        assert list(cost_cells(cost, first_of[cost.kind])) in rows
    for told in certificate_table(subjects)[1]:
        assert list(told) in rows
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "accuracy_ckf.svg", "accuracy_ickf.svg", "cost.svg", "index.html", "sparsity.svg"
    ]  # fmt: skip
