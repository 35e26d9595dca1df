"""Nothing that these tests make up may be kept for others; figures are looked at as figures."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.judges.made import Kept


@pytest.fixture(autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PMSM_ICKF_CACHE", str(tmp_path_factory.mktemp("cache")))


@pytest.fixture
def kept(monkeypatch: pytest.MonkeyPatch) -> Kept:
    """Every figure module hands its figure over in the place of SVG."""
    found = Kept()
    for room in ("proof", "drive", "replay", "study", "faults", "endurance", "compare"):
        monkeypatch.setattr(f"runtime.{room}.figures.svg_text", found)
    return found


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path
