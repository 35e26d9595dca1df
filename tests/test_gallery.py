"""The gallery: scripts that are short, run as they are, and make the figure that stands beside them."""

from __future__ import annotations

import re
from importlib.metadata import version
from pathlib import Path

import numpy as np
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


#: A letter of a path's data, or a number, which may begin with its point.
WORD = re.compile(r"[A-Za-z]|-?(?:\d+\.?\d*|\.\d+)")


def line(d: str) -> np.ndarray:
    """Corners (n, 2) of a path, absolute, in points."""
    words = WORD.findall(d)
    assert set(re.findall("[A-Za-z]", d)) <= set("MLCQlhvz"), d
    corners, at, command, k = [], np.zeros(2), "", 0
    while k < len(words):
        if words[k].isalpha():
            command, k = words[k], k + 1
            continue
        if command in "hv":
            step, k = np.array([float(words[k]), 0.0]), k + 1
            at = at + (step if command == "h" else step[::-1])
        else:
            to, k = np.array([float(words[k]), float(words[k + 1])]), k + 2
            at = at + to if command == "l" else to
        corners.append(at)
    return np.array(corners)


def off(corners: np.ndarray, other: np.ndarray) -> float:
    """How far the corners of a line (n, 2) are from another line (m, 2), at most: points."""
    start, along = other[:-1], np.diff(other, axis=0)
    if not len(along):
        start, along = other, np.zeros_like(other)
    length = np.maximum((along**2).sum(1), 1e-12)
    share = np.clip(((corners[:, None] - start) * along).sum(2) / length, 0.0, 1.0)
    return float(np.linalg.norm(corners[:, None] - start - share[..., None] * along, axis=2).min(1).max())


def drawn(svg: str) -> tuple[list[str], list[np.ndarray]]:
    """Elements of a figure in order, and its lines: what two figures of the same things share."""
    return re.findall(r"<(\w+)", svg), [line(d) for d in re.findall(r'\sd="([^"]*)"', svg)]


def differ(found: str, committed: str) -> str:
    """Whether two figures show other things; a curve may move by a point, as processors round differently."""
    maker = re.search(r"Matplotlib v([\d.]+)", committed)
    if maker and maker[1] != version("matplotlib"):
        return ""  # another matplotlib lays out otherwise
    (tags, lines), (those, others) = drawn(found), drawn(committed)
    if tags != those or len(lines) != len(others):
        return f"{len(tags)} elements and {len(lines)} lines, committed {len(those)} and {len(others)}"
    moved = (max(off(a, b), off(b, a)) for a, b in zip(lines, others, strict=True))
    worst = max(moved, default=0.0)
    return f"a line moved by {worst:g}" if worst > 1.0 else ""


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


def test_the_board_without_its_extra_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "serial.py").write_text("raise ImportError('no such module')\n")
    monkeypatch.setattr(GALLERY, "ROOT", f"{tmp_path}:{GALLERY.ROOT}")
    done = GALLERY.run("board_on_a_terminal", tmp_path)
    assert done.returncode == 1
    assert done.stderr == "a serial port needs pyserial: pip install 'pmsm-ickf[board]'.\n"


@pytest.mark.thorough
@pytest.mark.parametrize("name", sorted(PICTURES.PICTURES))
def test_a_picture_is_what_its_function_draws(name: str) -> None:
    committed = (ROOT / "docs" / "pictures" / f"{name}.svg").read_text(encoding="utf-8")
    assert differ(PICTURES.svg_text(PICTURES.PICTURES[name]()), committed) == ""


def test_a_figure_that_shows_something_else_is_seen() -> None:
    one = '<svg><path d="M0 0l10 5 10-.5"/></svg>'
    assert differ(one, one) == ""
    assert differ(one.replace("l10 5 10-.5", "l10 5.4 10-.9"), one) == ""
    assert differ(one.replace("l10 5 ", "l4 2 6 3 "), one) == ""  # the same line with a corner more
    assert differ(one.replace("10-.5", "10-2.5"), one) == "a line moved by 2"
    assert differ(one.replace("10-.5", ""), one) != ""
    assert differ(one.replace("</svg>", '<path d="M0 0"/></svg>'), one) != ""


def test_a_box_and_a_curve_have_their_corners() -> None:
    assert line("M72 4h33v-1.5h-33z").tolist() == [[72, 4], [105, 4], [105, 2.5], [72, 2.5]]
    assert line("M 0 .5 C 1 2 3 4 -5 6 z").tolist() == [[0, 0.5], [1, 2], [3, 4], [-5, 6]]


def test_a_committed_figure_says_what_drew_it() -> None:
    """Without it a figure would be compared with another layout."""
    folders = ((ROOT / "docs" / "gallery", GALLERY.SCRIPTS), (ROOT / "docs" / "pictures", PICTURES.PICTURES))
    for folder, names in folders:
        for name in names:
            text = (folder / f"{name}.svg").read_text(encoding="utf-8")
            assert re.search(r"</svg>\n<!-- Matplotlib v[\d.]+ -->\n$", text), name
