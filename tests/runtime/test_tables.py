"""Tables of a proof: no link is compared in silence, and what failed is told."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from runtime.proof.result import Link, Proof, Row
from runtime.proof.tables import proof_tables, whole_links
from tests.conftest import LINKS

pytestmark = pytest.mark.unit


def _said(*links: Link) -> str:
    console = Console(width=160, record=True, file=io.StringIO())
    console.print(proof_tables(Proof("d", list(links))))
    return console.export_text()


def _link(name: str, *rows: Row) -> Link:
    return Link(name, "a claim", "d", "ckf", "cubature", "some data", rows)


@pytest.mark.parametrize("name", sorted(LINKS))
def test_every_link_is_in_a_table(name: str) -> None:
    passed, failed = (_link(name, Row("13", "stage", "m", worst, 0.5, 10)) for worst in (0.25, 1.0))
    assert _said(passed) != _said()
    assert _said(failed) != _said(passed)


def test_one_that_may_not_differ_is_counted() -> None:
    exact, bounded = Row("-", "a", "m", 3.0, 0.0, 10), Row("-", "b", "m", 0.25, 0.5, 10)
    figures = [used for _, used in whole_links(Proof("d", [_link("data", exact), _link("guard", bounded)]))]
    assert figures == ["50 % of allowed", "3 differ"]
    ((_, used),) = whole_links(Proof("d", [_link("data", exact, bounded)]))
    assert used == "3 differ"
