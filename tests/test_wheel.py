"""What is packed: every file of the packages and nothing else, and it works from an empty folder."""

from __future__ import annotations

import fnmatch
import os
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

from tests.runtime.processes import PAPER

ROOT = Path(__file__).parents[1]
PACKAGES = ("model", "codegen", "runtime", "generated")
#: Folders and files beside them that are packed with the sources.
BESIDE = (".ci", "benchmarks", "docs", "tests")
TOPS = (
    "README.md", "ARCHITECTURE.md", "CHANGELOG.md", "CONTRIBUTING.md", "LICENSE", "Makefile", ".gitignore",
    ".pre-commit-config.yaml",
)  # fmt: skip


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


def test_the_source_distribution_states_all_that_is_no_package() -> None:
    """Every folder of the checkout, the pages at its top, and what the tests read of it."""
    lines = (ROOT / "MANIFEST.in").read_text("utf-8").splitlines()
    assert {line.partition(" ")[2] for line in lines if line.startswith("graft ")} == set(BESIDE)
    tops = next(line for line in lines if line.startswith("include ")).split()[1:]
    assert [name for name in TOPS if not any(fnmatch.fnmatchcase(name, pattern) for pattern in tops)] == []


def sources(root: Path) -> set[str]:
    """Files that a source distribution holds, by their paths."""
    found = {path for folder in (*PACKAGES, *BESIDE) for path in (root / folder).rglob("*") if path.is_file()}
    names = {str(path.relative_to(root)) for path in found if "__pycache__" not in path.parts}
    return {*names, *TOPS, "pyproject.toml", "MANIFEST.in"}


@pytest.fixture
def source_distribution(tmp_path: Path) -> Path:
    """The checkout as setuptools packs it, made in a copy."""
    copy, tools = tmp_path / "checkout", tmp_path / "tools"
    for name in sources(ROOT):
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, copy / name)
    (copy / "docs" / "__pycache__").mkdir()
    (copy / "docs" / "__pycache__" / "left.pyc").touch()
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--target", str(tools), "setuptools>=69"]
    subprocess.run(pip, check=True)
    build = f"from setuptools import build_meta; build_meta.build_sdist({str(tmp_path)!r})"
    environment = {**os.environ, "PYTHONPATH": str(tools)}
    subprocess.run([sys.executable, "-c", build], cwd=copy, env=environment, check=True, capture_output=True)
    return next(tmp_path.glob("*.tar.gz"))


@pytest.mark.thorough
def test_the_wheel_of_the_source_distribution_works_from_an_empty_folder(
    source_distribution: Path, tmp_path: Path
) -> None:
    with tarfile.open(source_distribution) as archive:
        held = {member.name.partition("/")[2] for member in archive if member.isfile()}
    made = {name for name in held if name in ("PKG-INFO", "setup.cfg") or ".egg-info/" in name}
    assert held - made == sources(ROOT)
    place = tmp_path / "place"
    wheel = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(tmp_path)]
    subprocess.run([*wheel, str(source_distribution)], check=True)
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
