"""The page of identified motor data: what was found, what was not, and how the search ended, beside its figures."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from runtime.identify.intervals import Estimate, Result
from runtime.identify.page import INNOVATIONS, LIKELIHOOD, write_identified
from runtime.identify.redesign import Compared
from runtime.identify.tables import INTERRUPTED, filters_table
from runtime.identify.unknowns import DATA
from tests.judges.made import cells_of, replayed
from tests.judges.test_pages import heads_of
from tests.judges.test_study_page import rows_of

UNTOLD = "J: these recordings do not show it <see>"


def found(interrupted: bool = False) -> Any:
    """R told within a half per cent, J not at all; a recording with a note and a step of the load."""
    estimates = (
        Estimate(DATA["R"], 5.0, 3.6, 3.582, 3.618, True),
        Estimate(DATA["J"], 0.01, 0.02, 0.0055, 0.067, False),
    )
    rows = SimpleNamespace(
        recorded=SimpleNamespace(path=Path("a<b>.csv")), notes=("7 rows bridged",), load_steps=(0.25,), steps=1999
    )
    problem = SimpleNamespace(recordings=(rows,), subject=SimpleNamespace(name="pump"))
    end = SimpleNamespace(interrupted=interrupted, ends=(1.0, 1.0, 2.0), agreeing=2)
    return SimpleNamespace(problem=problem, found=end, result=Result(estimates, np.eye(2), 1, (UNTOLD,)))


@pytest.fixture
def drawn(tmp_path: Path) -> Path:
    """A folder with the two figures, each known by its text; one colour is the page's, one a figure's own."""
    for name in ("innovations", "likelihood"):
        text = f'<svg xmlns="http://www.w3.org/2000/svg"><path d="M0 0" stroke="#c8553d" /><text>{name}</text></svg>'
        (tmp_path / f"{name}.svg").write_text(text, encoding="utf-8")
    return tmp_path


def chapters(page: Path) -> dict[str, str]:
    """Heading -> what stands below it."""
    pieces = re.split(r"<h2[^>]*>(.*?)</h2>", page.read_text(encoding="utf-8"))
    return dict(zip(pieces[1::2], pieces[2::2], strict=True))


def test_its_chapters_hold_the_terminals_tables_and_the_figures(drawn: Path) -> None:
    compared = Compared((replayed(),), (replayed(),))
    page = write_identified(found(), compared, drawn)
    assert page == drawn / "index.html"
    held = chapters(page)
    assert list(held) == ["Motor data", "The filter before and after", "Innovations", "Likelihood"]
    assert rows_of(held["Motor data"]) == [
        ["R", "5", "3.6", "3.582 .. 3.618", "ohm +- 0.5 %", ""],
        ["J", "0.01", "0.02", "0.0055 .. 0.067", "kg m^2 +- 1.5e+02 %", "not shown"],
    ]
    assert rows_of(held["The filter before and after"]) == cells_of(filters_table(compared))
    assert heads_of(page)[0] == ["datum", "guess", "found", "95 % interval", "unit, half-width", ""]
    for head, words in (("Innovations", INNOVATIONS), ("Likelihood", LIKELIHOOD)):
        assert held[head].count("<svg") == 1
        assert f"<text>{head.lower()}</text>" in held[head]
        assert f"<p>{words}</p>" in held[head]
    assert "stroke:var(--red)" in page.read_text(encoding="utf-8").replace('stroke="var(--red)"', "stroke:var(--red)")


def test_it_says_what_the_terminal_says(drawn: Path) -> None:
    """Notes of the recordings, steps of the load, what is not shown; and names of files are no markup."""
    said = chapters(write_identified(found(), Compared((), ()), drawn))["Motor data"]
    for words in (
        "note: a&lt;b&gt;.csv: 7 rows bridged", "a&lt;b&gt;.csv: the load steps at 0.25 s",
        UNTOLD.replace("<", "&lt;").replace(">", "&gt;"),
        "1,999 samples; 2 of 3 starts ended here; the recordings tell 1 of 2 combinations of the data",
    ):  # fmt: skip
        assert f"<p>{words}</p>" in said, words
    assert INTERRUPTED not in said


def test_an_interrupted_search_says_so_and_compares_no_filters(drawn: Path) -> None:
    held = chapters(write_identified(found(interrupted=True), None, drawn))
    assert list(held) == ["Motor data", "Innovations", "Likelihood"]
    assert held["Motor data"].index(INTERRUPTED) < held["Motor data"].index("<table>")


def test_it_sits_in_the_frame(drawn: Path) -> None:
    text = write_identified(found(), None, drawn).read_text(encoding="utf-8")
    assert "<title>Motor data of pump</title>" in text
    assert " identify." in text
    assert "prefers-color-scheme: dark" in text
    assert not re.search(r'(?:src|href)="(?:https?:)?//', text), "nothing from outside"
