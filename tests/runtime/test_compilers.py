"""Compilers that are missing, fail, hang or lie, and the cache of what they made."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from runtime.estimator import compiler
from runtime.system.errors import UserError
from tests.runtime.processes import PAPER, call, refused

SOURCES = {"a.c": "int answer(void) { return 42; }\n"}
FAKES: dict[str, tuple[str, str]] = {
    "fails": ("echo 'a.c:1: error: no\nmore' >&2; exit 1", "failed on a.c: a.c:1: error: no"),
    "fails silently": ("exit 3", "failed on a.c: it does not say why"),
    "speaks no UTF-8": (r"printf 'error \377\n' >&2; exit 1", "failed on a.c: error \ufffd"),
    "crashes": ("kill -SEGV $$", "crashed on a.c: Segmentation fault"),
    "fails to link": (
        "echo '/usr/bin/ld: final link failed: No space left\ncollect2: error: ld returned 1 exit status' >&2; exit 1",
        "failed on a.c: /usr/bin/ld: final link failed: No space left",
    ),
    "makes nothing": ("exit 0", "made no program"),
    "hangs": ("sleep 1000 & sleep 1000", "did not end within 1 s on a.c"),
    "reads the keyboard": ("read x; exit 4", "failed on a.c: it does not say why"),
}


def fake(path: Path, script: str) -> str:
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)
    return str(path)


@pytest.mark.parametrize("what", FAKES)
def test_a_compiler_that(what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    script, expected = FAKES[what]
    monkeypatch.setattr(compiler, "PATIENCE", 1)
    monkeypatch.setenv("CC", fake(tmp_path / "cc", script))
    monkeypatch.setenv("PMSM_ICKF_CACHE", str(tmp_path / "cache"))
    with pytest.raises(UserError) as error:
        compiler.build_library(SOURCES, {})
    assert expected in str(error.value)
    assert len(str(error.value).splitlines()) == 1
    assert list((tmp_path / "cache").iterdir()) == []
    if what == "hangs":
        listed = subprocess.run(["ps", "-eo", "pgid,args"], capture_output=True, text=True, check=True).stdout
        assert not [line for line in listed.splitlines() if str(tmp_path) in line], "it was ended, children too"


def test_what_an_ended_compiler_leaves_goes_with_its_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A compiler that is killed does not clear away its temporary files."""
    for name in ("cache", "temporary"):
        (tmp_path / name).mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    monkeypatch.setenv("CC", fake(tmp_path / "cc", 'touch "$TMPDIR/half.o" || exit 5; kill -KILL $$'))
    monkeypatch.setenv("PMSM_ICKF_CACHE", str(tmp_path / "cache"))
    with pytest.raises(UserError, match=r"crashed on a\.c: Killed"):
        compiler.build_library(SOURCES, {})
    assert [path for name in ("cache", "temporary") for path in (tmp_path / name).iterdir()] == []


def test_a_program_of_another_machine_as_the_compiler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "cc").write_bytes(b"\x7fELF" + bytes(100))
    (tmp_path / "cc").chmod(0o755)
    monkeypatch.setenv("CC", str(tmp_path / "cc"))
    monkeypatch.setenv("PMSM_ICKF_CACHE", str(tmp_path / "cache"))
    with pytest.raises(UserError, match="cannot be started: Exec format error"):
        compiler.build_library(SOURCES, {})


@pytest.mark.parametrize("damage", ["empty", "cut off", "overwritten", "no seal", "bad seal"])
def test_a_damaged_library_is_built_again(damage: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PMSM_ICKF_CACHE", str(tmp_path))
    library = compiler.build_library(SOURCES, {})
    good = library.read_bytes()
    seal = library.with_name(f"{library.name}.sha256")
    if "seal" in damage:
        seal.unlink()
        if damage == "bad seal":
            seal.write_bytes(b"\xff")
    else:
        bad = {"empty": b"", "cut off": good[:1000], "overwritten": good[:500] + bytes(len(good) - 500)}[damage]
        library.unlink()
        library.write_bytes(bad)
    again = compiler.build_library(SOURCES, {})
    import cffi

    ffi = cffi.FFI()
    ffi.cdef("int answer(void);")
    assert compiler.open_library(ffi, again).answer() == 42
    assert again.read_bytes() == good
    assert sorted(path.name for path in tmp_path.iterdir()) == [library.name, seal.name]


def test_a_library_the_system_will_not_load_is_one_line(tmp_path: Path) -> None:
    import cffi

    (tmp_path / "no.so").write_bytes(b"no library")
    with pytest.raises(UserError, match=r"no\.so' cannot be loaded: .*PMSM_ICKF_CACHE"):
        compiler.open_library(cffi.FFI(), tmp_path / "no.so")


@pytest.mark.parametrize("where", ["a file", "below a file", "/proc/none"])
def test_a_cache_that_cannot_be_written(where: str, tmp_path: Path) -> None:
    (tmp_path / "a file").write_text("mine")
    cache = {"a file": tmp_path / "a file", "below a file": tmp_path / "a file" / "x"}.get(where, Path(where))
    words = ("simulate", "--scenario", "no_load", "--filters", "ckf")
    line = refused(call(*words, cwd=tmp_path, environment={"PMSM_ICKF_CACHE": str(cache)}))
    assert "cannot write the compiled filter" in line
    assert "Set PMSM_ICKF_CACHE" in line


def test_a_broken_cross_compiler_is_told_in_the_report(tmp_path: Path) -> None:
    fake(tmp_path / "arm-none-eabi-gcc", "exit 1")
    (tmp_path / "mine.toml").write_text(PAPER.replace("paper_spmsm", "mine"))
    path = {"PATH": f"{tmp_path}:{os.environ['PATH']}"}
    code, _, err = call("generate", "mine.toml", cwd=tmp_path, environment=path)
    assert code == 0, err
    report = (tmp_path / "generated" / "mine" / "REPORT.md").read_text(encoding="utf-8")
    assert "not measured: arm-none-eabi-gcc failed on it" in report
