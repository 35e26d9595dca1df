"""Compiled templates that are kept: never in the place of a text that is not theirs, and never missed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import jinja2
import pytest

from codegen.render import fill
from codegen.render.fill import render

NAME = "packing.py.j2"


@pytest.fixture(autouse=True)
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The folder of an environment that has compiled nothing yet."""
    monkeypatch.setattr("sys.dont_write_bytecode", False)
    monkeypatch.setattr(fill._ENVIRONMENT.bytecode_cache, "directory", str(tmp_path / "kept"))
    forget()
    yield tmp_path / "kept"
    forget()


def forget() -> None:
    """As in a new process."""
    assert fill._ENVIRONMENT.cache is not None
    fill._ENVIRONMENT.cache.clear()


def test_a_template_is_compiled_once(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = render(NAME, covariance="P")
    assert len(list(kept.iterdir())) == 1
    forget()
    monkeypatch.setattr(fill._ENVIRONMENT, "compile", None)  # would be called
    assert render(NAME, covariance="P") == text


def test_another_text_is_compiled_anew(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    render(NAME, covariance="P")
    forget()
    monkeypatch.setattr(fill._ENVIRONMENT, "loader", jinja2.DictLoader({NAME: "other: {{ covariance }}"}))
    assert render(NAME, covariance="P") == "other: P"


@pytest.mark.parametrize("left", [0, 2, 12, 20, 40, 60, 80, 200, 600])
def test_what_is_cut_off_is_compiled_anew(kept: Path, left: int) -> None:
    text = render(NAME, covariance="P")
    (file,) = kept.iterdir()
    whole = file.read_bytes()
    assert left < len(whole)
    file.write_bytes(whole[:left])
    forget()
    assert render(NAME, covariance="P") == text


def test_nothing_is_kept_where_nothing_can_be_written_or_is_to_be(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept.write_text("no folder")
    text = render(NAME, covariance="P")
    kept.unlink()
    forget()
    monkeypatch.setattr("sys.dont_write_bytecode", True)
    assert render(NAME, covariance="P") == text
    assert not kept.exists()
