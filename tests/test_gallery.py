"""The gallery: scripts that are short, run as they are, and make the figure that stands beside them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.test_docs import ROOT, site_module

GALLERY = site_module("gallery_pages")
PICTURES = site_module("pictures")
#: Those that take little time.
QUICK = ("recording_replayed", "where_it_holds")
SCRIPTS = [
    *QUICK,
    *(pytest.param(name, marks=pytest.mark.thorough) for name in GALLERY.SCRIPTS if name not in QUICK),
]
#: Of a committed figure, bytes.
LARGEST = 210_000


def drawn(svg: str) -> tuple[list[str], list[float]]:
    """Elements of a figure in order, and all its coordinates: what two figures of the same things share."""
    body = svg[svg.index("<defs>") :] if "<defs>" in svg else svg
    paths = " ".join(re.findall(r'\sd="([^"]*)"', body))
    return re.findall(r"<(\w+)", body), [float(word) for word in re.findall(r"-?\d+(?:\.\d+)?", paths)]


def differ(found: str, committed: str) -> str:
    """Whether two figures show other things; a curve may move by a pixel, as processors round differently."""
    maker = [re.search(r"Matplotlib v[\d.]+", text) for text in (found, committed)]
    if maker[0] and maker[1] and maker[0][0] != maker[1][0]:
        return ""  # another matplotlib lays out otherwise
    (tags, numbers), (those, others) = drawn(found), drawn(committed)
    if tags != those or len(numbers) != len(others):
        return f"{len(tags)} elements and {len(numbers)} coordinates, committed {len(those)} and {len(others)}"
    worst = max((abs(a - b) for a, b in zip(numbers, others, strict=True)), default=0.0)
    return f"a coordinate moved by {worst:g}" if worst > 1.0 else ""


def test_a_dozen_scripts_none_of_them_long() -> None:
    files = {path.stem: path.read_text(encoding="utf-8") for path in (ROOT / "docs" / "gallery").glob("*.py")}
    assert set(files) == set(GALLERY.SCRIPTS)
    assert len(files) >= 12
    assert {name: n for name, text in files.items() if (n := len(text.splitlines())) > 40} == {}
    figures = {path.stem: path.stat().st_size for path in (ROOT / "docs" / "gallery").glob("*.svg")}
    assert set(figures) == set(files)
    assert {name: size for name, size in figures.items() if size > LARGEST} == {}
    for name in files:
        title, text, _ = GALLERY.told(name)
        assert len(title) < 100, name
        assert text, name


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_makes_its_figure(name: str, tmp_path: Path) -> None:
    done = GALLERY.run(name, tmp_path)
    assert done.returncode == 0, done.stderr
    committed = (ROOT / "docs" / "gallery" / f"{name}.svg").read_text(encoding="utf-8")
    assert differ((tmp_path / f"{name}.svg").read_text(encoding="utf-8"), committed) == ""


@pytest.mark.thorough
@pytest.mark.parametrize("name", sorted(PICTURES.PICTURES))
def test_a_picture_is_what_its_function_draws(name: str) -> None:
    committed = (ROOT / "docs" / "pictures" / f"{name}.svg").read_text(encoding="utf-8")
    assert differ(PICTURES.svg_text(PICTURES.PICTURES[name]()), committed) == ""


def test_a_figure_that_shows_something_else_is_seen() -> None:
    one = '<svg><defs></defs><path d="M 0 0 L 10 5"/></svg>'
    assert differ(one, one) == ""
    assert differ(one.replace("10 5", "10.4 5"), one) == ""
    assert differ(one.replace("10 5", "12 5"), one) == "a coordinate moved by 2"
    assert differ(one.replace("</svg>", '<path d="M 0 0"/></svg>'), one) != ""
