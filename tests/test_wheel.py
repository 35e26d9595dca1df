"""What is packed: every file of the packages and nothing else, and it works from an empty folder."""

from __future__ import annotations

import fnmatch
import os
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

from tests.runtime.processes import PAPER

ROOT = Path(__file__).parents[1]
PACKAGES = ("model", "codegen", "runtime", "generated")


def files() -> set[str]:
    """Files of the packages, by their paths in the checkout."""
    return {
        str(path.relative_to(ROOT))
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }


def packed(name: str, patterns: dict[str, list[str]]) -> bool:
    """Whether a file is Python, or one of the patterns of its own package, the top one, or all holds for it."""
    top, _, below = name.partition("/")
    matches = any(fnmatch.fnmatchcase(Path(name).name, pattern) for pattern in patterns["*"])
    return name.endswith(".py") or matches or any(fnmatch.fnmatchcase(below, p) for p in patterns.get(top, []))


def test_every_file_of_the_packages_is_stated() -> None:
    stated = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["setuptools"]
    assert {pattern.rstrip("*") for pattern in stated["packages"]["find"]["include"]} == set(PACKAGES)
    assert [name for name in files() if not packed(name, stated["package-data"])] == []
    assert not packed("runtime/report/page.css", {"*": ["*.c"]}), "a new kind of file is noticed"


@pytest.mark.thorough
def test_the_wheel_holds_them_and_works_from_an_empty_folder(tmp_path: Path) -> None:
    source, place = tmp_path / "source", tmp_path / "place"
    for name in (*files(), "pyproject.toml", "README.md", "LICENSE"):
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, source / name)
    wheel = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(tmp_path), str(source)]
    subprocess.run(wheel, check=True)
    with zipfile.ZipFile(next(tmp_path.glob("*.whl"))) as archive:
        assert {name for name in archive.namelist() if ".dist-info/" not in name} == files()
        archive.extractall(tmp_path / "installed")
    place.mkdir()
    (place / "mine.toml").write_text(PAPER.replace("paper_spmsm", "mine"))
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "installed"), "PMSM_ICKF_CACHE": str(tmp_path / "cache")}
    load = "import runtime as r; print(r.__file__, len(r.load('generated/mine', filter='ckf').step([1, 0], [0, 0])))"
    for words in (
        ("-m", "runtime", "generate", "mine.toml"),
        ("-m", "runtime", "simulate", "mine.toml", "--scenario", "no_load", "--filters", "ckf", "--out", "runs"),
        ("-m", "runtime", "replay", "mine.toml", "runs/no_load_ckf.npz", "--backend", "numpy"),
        ("-c", load),
    ):
        done = subprocess.run([sys.executable, *words], cwd=place, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [str(tmp_path / "installed" / "runtime" / "__init__.py"), "4"]
