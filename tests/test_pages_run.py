"""Every line of the pages is run, in the page's order, in a folder of its own that looks like a check-out.

A line is run as it stands, or as :mod:`tests.pages.tables` says, or stands there as one that is not run, with its
reason. `make test` runs the short ones, `make thorough` all.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.conftest import thoroughly
from tests.pages.read import ROOT, lines, make_desk, pages, run
from tests.pages.tables import ELSEWHERE, PAGES, Page
from tests.target.need import need

SHORT, WHOLE = "short lines", "all lines"


def wanted(page: str, lengths: str) -> list[str]:
    """Words of the lines that are run."""
    table = PAGES[page]
    skipped = {*table.left_out, *(table.long if lengths == SHORT else ())}
    return [line.words for line in lines(page) if line.words not in skipped]


@pytest.mark.unit
def test_every_page_with_a_line_is_run() -> None:
    assert pages() == sorted({**PAGES, **ELSEWHERE})
    assert not {*PAGES} & {*ELSEWHERE}
    for test in ELSEWHERE.values():
        assert (ROOT / test).is_file(), test


def stale(name: str, table: Page) -> set[str]:
    """Entries of a page's tables that the page does not have."""
    return table.named - {line.words for line in lines(name)}


@pytest.mark.unit
@pytest.mark.parametrize("name", PAGES)
def test_tables_name_lines_that_the_page_has(name: str) -> None:
    table = PAGES[name]
    assert stale(name, table) == set()
    assert len(table.long) == len({*table.long})
    assert not {*table.left_out} & {*table.instead, *table.before, *table.typed, *table.long}
    for why in (*table.left_out.values(), *(why for _, why in table.instead.values())):
        assert why


@pytest.mark.unit
def test_an_entry_whose_line_is_gone_is_seen() -> None:
    gone = "pmsm-ickf simulate my_motor.toml"
    for table in (Page(left_out={gone: "x"}), Page(instead={gone: ("true", "x")}), Page(long=(gone,))):
        assert stale("README.md", table) == {gone}


@pytest.mark.parametrize(
    ("name", "lengths"),
    [
        *((name, SHORT) for name in PAGES if wanted(name, SHORT)),
        *thoroughly(*((name, WHOLE) for name, table in PAGES.items() if table.long)),
    ],
)
def test_a_page_does_what_it_says(name: str, lengths: str, tmp_path: Path) -> None:
    need("cc", "make", "clang", "wasm-ld")
    table, still = PAGES[name], wanted(name, lengths)
    make_desk(tmp_path)
    for lay in table.laid:
        lay(tmp_path)
    for line in lines(name):
        if line.words not in still:
            continue
        if line.words in table.before:
            table.before[line.words](tmp_path)
        words = table.instead.get(line.words, (line.words, ""))[0]
        done = run(words, tmp_path, line.language, table.typed.get(line.words, ""))
        assert done.returncode == 0, f"{name}, line {line.number}: {words}\n{done.stdout[-3000:]}{done.stderr[-3000:]}"
