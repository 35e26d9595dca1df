"""The generated folder on disk: swapped whole, never half-written, hand edits never overwritten in silence."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from codegen.output import folder as folder_module
from codegen.output.folder import FolderError, check_unedited, difference, edited_files, with_manifest, write_folder

pytestmark = pytest.mark.unit

FILES = with_manifest({"a.c": "int a;\n", "host/b.c": "int b;\n"}, {"drive": "x", "filters": {}})
OTHER = with_manifest({"a.c": "int other;\n"}, {"drive": "x", "filters": {}})


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


@pytest.mark.parametrize("exchange", ["atomic", "two renames"])
def test_a_failing_write_leaves_the_old_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, exchange: str) -> None:
    target = tmp_path / "x"
    write_folder(target, FILES)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    if exchange == "atomic":
        monkeypatch.setattr(folder_module, "_exchange", full)
    else:
        monkeypatch.setattr(folder_module, "_exchange", lambda *_: False)
        monkeypatch.setattr(folder_module.os, "rename", full)
    with pytest.raises(FolderError, match="No space left on device"):
        write_folder(target, OTHER)
    monkeypatch.undo()
    assert difference(target, FILES) == ""
    assert [path.name for path in tmp_path.iterdir()] == ["x"]


def test_where_folders_cannot_be_exchanged_two_renames_do_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "x"
    write_folder(target, FILES)
    monkeypatch.setattr(folder_module, "_exchange", lambda *_: False)
    rename, renamed = os.rename, []

    def second_fails(source: Path, place: Path) -> None:
        renamed.append(place)
        if len(renamed) == 2:
            raise OSError(5, "Input/output error")
        rename(source, place)

    monkeypatch.setattr(folder_module.os, "rename", second_fails)
    with pytest.raises(FolderError, match="Input/output error"):
        write_folder(target, OTHER)
    assert difference(target, FILES) == "", "the old folder is put back"
    monkeypatch.setattr(folder_module.os, "rename", rename)
    write_folder(target, OTHER)
    assert difference(target, OTHER) == ""
    assert [path.name for path in tmp_path.iterdir()] == ["x"]


def test_what_a_killed_one_left_is_removed_and_nothing_else(tmp_path: Path) -> None:
    for name in (".x.writing-abc", ".xy.writing-abc", ".x.swp"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "half.c").write_text("int ")
    write_folder(tmp_path / "x", FILES)
    assert sorted(path.name for path in tmp_path.iterdir()) == [".x.swp", ".xy.writing-abc", "x"]


def test_a_link_to_a_folder_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "x").symlink_to(tmp_path / "elsewhere" / "x")
    for files in (FILES, OTHER):
        write_folder(tmp_path / "x", files)
        assert (tmp_path / "x").is_symlink()
        assert difference(tmp_path / "elsewhere" / "x", files) == ""


@pytest.mark.parametrize(
    "text", ["{", "", "[]", "null", "{}", '{"files": []}', '{"files": {"a.c": 1}}', "[" * 100_000, "\x00"]
)
def test_a_broken_manifest_is_named(tmp_path: Path, text: str) -> None:
    target = tmp_path / "x"
    write_folder(target, FILES)
    (target / "manifest.json").write_text(text)
    with pytest.raises(FolderError, match=r"manifest\.json"):
        write_folder(target, FILES)
    write_folder(target, FILES, force=True)
    assert difference(target, FILES) == ""
