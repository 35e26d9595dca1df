"""The generated folder on disk: swapped whole, never half-written, hand edits never overwritten in silence."""

from __future__ import annotations

from pathlib import Path

import pytest

from codegen import folder as folder_module
from codegen.folder import FolderError, check_unedited, difference, edited_files, with_manifest, write_folder

FILES = with_manifest({"a.c": "int a;\n", "host/b.c": "int b;\n"}, {"drive": "x", "filters": {}})


def test_written_and_read_back(tmp_path: Path) -> None:
    target = tmp_path / "x"
    write_folder(target, FILES)
    assert difference(target, FILES) == ""
    assert edited_files(target) == []
    assert [path.name for path in tmp_path.iterdir()] == ["x"], "no temporary folder is left behind"


def test_difference_is_a_diff(tmp_path: Path) -> None:
    target = tmp_path / "x"
    write_folder(target, FILES)
    (target / "a.c").write_text("int c;\n")
    text = difference(target, FILES)
    assert "-int c;" in text
    assert "+int a;" in text


@pytest.mark.parametrize("edit", ["change", "remove", "add"])
def test_hand_edits_are_not_overwritten(tmp_path: Path, edit: str) -> None:
    target = tmp_path / "x"
    write_folder(target, FILES)
    if edit == "change":
        (target / "a.c").write_text("int mine;\n")
    elif edit == "remove":
        (target / "a.c").unlink()
    else:
        (target / "mine.c").write_text("int mine;\n")
    before = {path: path.read_text() for path in target.rglob("*.c")}
    with pytest.raises(FolderError, match="edited by hand"):
        check_unedited(target)
    with pytest.raises(FolderError, match="edited by hand"):
        write_folder(target, FILES)
    assert {path: path.read_text() for path in target.rglob("*.c")} == before
    write_folder(target, FILES, force=True)
    assert difference(target, FILES) == ""


def test_somebody_elses_folder_is_not_overwritten(tmp_path: Path) -> None:
    target = tmp_path / "x"
    target.mkdir()
    (target / "thesis.txt").write_text("years of work")
    with pytest.raises(FolderError, match="was not generated"):
        write_folder(target, FILES)
    assert (target / "thesis.txt").read_text() == "years of work"


def test_a_failing_write_leaves_the_old_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "x"
    write_folder(target, FILES)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(folder_module.os, "rename", full)
    other = with_manifest({"a.c": "int other;\n"}, {"drive": "x", "filters": {}})
    with pytest.raises(FolderError, match="No space left on device"):
        write_folder(target, other)
    monkeypatch.undo()
    assert difference(target, FILES) == ""
    assert [path.name for path in tmp_path.iterdir()] == ["x"]


def test_a_broken_manifest_is_named(tmp_path: Path) -> None:
    target = tmp_path / "x"
    write_folder(target, FILES)
    (target / "manifest.json").write_text("{")
    with pytest.raises(FolderError, match=r"manifest\.json"):
        write_folder(target, FILES)
