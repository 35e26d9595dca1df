"""The compiler of the Python package ziglang, where the system has none: found, told what it must not do, same bits."""

from __future__ import annotations

import ctypes
import importlib.util
import shutil
from pathlib import Path

import numpy as np
import pytest

from runtime.estimator.compiler import ANY_PROCESSOR, PACKAGED, build_library, find_compiler
from runtime.estimator.folder import GENERATED, GeneratedFolder
from runtime.system.errors import UserError
from tests.conftest import DRIVES
from tests.runtime.test_compilers import SOURCES, fake
from tests.runtime.test_lanes import _runs

ZIG = importlib.util.find_spec("ziglang")


@pytest.fixture
def _no_compiler(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A system without a compiler, and nothing that one has made."""
    monkeypatch.setenv("PATH", str(tmp_path / "nothing"))
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PMSM_ICKF_CACHE", str(tmp_path / "cache"))


def package(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package ziglang whose program notes its words and has the system's compiler do the work."""
    real = shutil.which("cc") or pytest.fail("the tests need a C compiler")
    (folder / "ziglang").mkdir()
    (folder / "ziglang" / "__init__.py").touch()
    script = (
        f'echo "$*" >> {folder}/said; shift; PATH=/usr/bin:/bin; exec {real} $(echo "$@" | sed s/{ANY_PROCESSOR}//)'
    )
    fake(folder / "ziglang" / "zig", script)
    monkeypatch.syspath_prepend(str(folder))
    return folder / "said"


def test_it_is_taken_where_there_is_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PMSM_ICKF_CACHE", str(tmp_path / "cache"))
    said = package(tmp_path, monkeypatch)
    assert find_compiler()[1:] == [], "the system's own comes first"
    monkeypatch.setenv("PATH", str(tmp_path / "nothing"))
    monkeypatch.delenv("CC", raising=False)
    assert find_compiler() == [str(tmp_path / "ziglang" / "zig"), "cc", *PACKAGED]
    for more in ((), ("-march=native",)):
        assert ctypes.CDLL(str(build_library(SOURCES, {}, ("-O2", *more)))).answer() == 42
        words = said.read_text().splitlines()[-1].split()
        assert words[0] == "cc"
        assert {"-ffp-contract=off", "-fno-sanitize=undefined"} <= set(words)
        assert (ANY_PROCESSOR in words) == (not more)


@pytest.mark.usefixtures("_no_compiler")
def test_without_it_one_line_says_where_compilers_come_from(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(UserError, match=r"apt-get install gcc; anywhere: pip install 'pmsm-ickf\[compiler\]'"):
        find_compiler()


@pytest.mark.thorough
@pytest.mark.usefixtures("_no_compiler")
@pytest.mark.skipif(ZIG is None, reason="not run: the package ziglang is not installed (pip install ziglang)")
@pytest.mark.parametrize("drive", DRIVES)
def test_its_bits_are_the_systems_compilers(drive: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every filter, scalar and in lanes, with inputs that are rejected among the others."""
    folder = GeneratedFolder(GENERATED / drive)
    for kind in folder.kinds:
        packaged = _runs(folder, kind, 60, 37)
        monkeypatch.setenv("PATH", "/usr/local/bin:/usr/bin:/bin")
        monkeypatch.setenv("PMSM_ICKF_CACHE", str(tmp_path / "other"))
        systems = _runs(folder, kind, 60, 37)
        monkeypatch.undo()
        for mine, theirs in zip(packaged, systems, strict=True):
            for a, b in zip(mine, theirs, strict=True):
                assert np.asarray(a).tobytes() == np.asarray(b).tobytes()
