"""The page of a study: its tables say what the groups hold, its figures are there, in the frame of all pages."""

from __future__ import annotations

import html
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from runtime.study.figures import write_figures
from runtime.study.page import WORDS, write_study
from runtime.study.run import Study
from runtime.study.statement import Range
from runtime.study.tables import groups_table, paired_table
from tests.judges.made import cells_of, group
from tests.judges.test_pages import heads_of

RUNS = 40
#: The second drive is called as a figure is.
DRIVES = ("a", "b_map")
FIGURES = [f"{drive}_{figure}" for drive in DRIVES for figure in ("errors", "success_over_theta", "map")]


def study(folder: Path, drives: tuple[str, ...] = DRIVES, kinds: tuple[str, ...] = ("ckf", "ickf")) -> Study:
    """Two drives with two filters; of each drive's second filter a tenth does not lock."""
    rng = np.random.default_rng(4)
    drawn = {"theta": np.linspace(-90.0, 90.0, RUNS), "R": rng.uniform(0.7, 1.4, RUNS)}
    groups = tuple(
        group(kind, np.arange(RUNS) >= 4 * (k > 0), drive=drive, drawn=drawn, start=np.arange(1.0, RUNS + 1) + k)
        for drive in drives
        for k, kind in enumerate(kinds)
    )
    statement: Any = SimpleNamespace(ranges=(Range("theta", -90.0, 90.0), Range("R", 0.7, 1.4)), supervised=False)
    return Study(statement, RUNS, groups, folder, interrupted=False)


def rows_of(text: str) -> list[list[str]]:
    """The rows of a page's tables."""
    rows = (re.findall(r"<td[^>]*>([^<]*)</td>", row) for row in re.findall(r"<tr>(.*?)</tr>", text, re.DOTALL))
    return [[html.unescape(cell) for cell in row] for row in rows if row]


@pytest.fixture
def made(tmp_path: Path) -> tuple[Study, Path]:
    of = study(tmp_path)
    return of, write_study(of, write_figures(of))


def test_its_tables_are_those_of_the_terminal(made: tuple[Study, Path]) -> None:
    of, page = made
    text = page.read_text(encoding="utf-8")
    paired = paired_table(of)
    assert paired is not None
    rows = rows_of(text)
    assert rows == [*cells_of(groups_table(of)), *cells_of(paired)]
    assert heads_of(page)[0][:4] == ["drive", "filter", "runs", "success, % (95 %)"]
    assert [row[:3] for row in rows[:4]] == [
        ["a", "ckf", "40"], ["a", "ickf", "40"], ["b_map", "ckf", "40"], ["b_map", "ickf", "40"]
    ]  # fmt: skip
    assert [row[3].partition(" ")[0] for row in rows[:4]] == ["100.0", "90.0", "100.0", "90.0"]
    start = heads_of(page)[0].index("start, r/min")
    assert rows[0][start] == f"20.5 / {1 + 0.95 * 39:.3g} / 40", "median, 95 %, worst of 1 .. 40"
    assert rows[1][start] == f"23.5 / {6 + 0.95 * 35:.3g} / 41", "of the runs that locked alone"


def test_every_figure_stands_once_under_its_heading(made: tuple[Study, Path]) -> None:
    of, page = made
    text = page.read_text(encoding="utf-8")
    assert sorted(path.name for path in of.folder.iterdir()) == sorted(
        ["index.html", *(f"{name}.svg" for name in FIGURES)]
    )
    pieces = re.split(r"<h2[^>]*>(.*?)</h2>", text)
    held = dict(zip(pieces[1::2], pieces[2::2], strict=True))
    tables = ["How often, and how well", "Filters on the same runs"]
    titles = ("errors", "success over the angle at the start", "success and error over two variables")
    assert list(held) == [*tables, *(f"{drive}: {title}" for drive in DRIVES for title in titles)]
    for head, body in held.items():
        words = WORDS[next(end for end, (title, _) in WORDS.items() if title in head)][1] if head not in tables else ""
        assert f"<p>{words}</p>" in body or not words, head
    assert {head: body.count("<svg") for head, body in held.items()} == {head: int(head not in tables) for head in held}


def test_it_sits_in_the_frame(made: tuple[Study, Path]) -> None:
    _, page = made
    text = page.read_text(encoding="utf-8")
    assert "<title>Runs drawn at random: a, b_map" in text
    assert "prefers-color-scheme: dark" in text
    assert "@media print" in text
    links = re.findall(r'<a href="#([^"]*)"', text)
    assert links == re.findall(r'<h2 id="([^"]*)"', text)
    assert not re.search(r'(?:src|href)="(?:https?:)?//', text), "nothing from outside"
    assert not re.search(r"#[0-9a-f]{6}", "".join(re.findall(r"<svg.*?</svg>", text, re.DOTALL)), re.IGNORECASE), (
        "a colour of a figure is the page's, which changes in the dark"
    )


def test_one_filter_has_nothing_beside_it(tmp_path: Path) -> None:
    of = study(tmp_path, ("a",), ("ckf",))
    text = write_study(of, write_figures(of)).read_text(encoding="utf-8")
    assert "Filters on the same runs" not in text
    assert len(rows_of(text)) == 1
