"""DRIVE means the same to every command: a shipped name, a TOML file, or a generated folder."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from model.drives.load import DRIVES, load_drive
from model.schema import DriveError
from runtime.cli import app
from runtime.estimator.folder import GENERATED
from runtime.folders.current import current_package
from runtime.folders.generate import generate_drives
from runtime.folders.resolve import drive_folder, find_drive, target_folder
from runtime.system.errors import UserError

PAPER = (DRIVES / "paper_spmsm.toml").read_text(encoding="utf-8")


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with ``mine.toml``: the paper's motor under another name, with one filter."""
    monkeypatch.chdir(tmp_path)
    text = PAPER.replace('"paper_spmsm"', '"mine"').replace('kinds = ["ckf", "ickf"]', 'kinds = ["ckf"]')
    (tmp_path / "mine.toml").write_text(text)
    return tmp_path


def test_a_shipped_name_its_file_and_its_folder_are_one_drive(desk: Path) -> None:
    for word in ("ipmsm", str(DRIVES / "ipmsm.toml"), str(GENERATED / "ipmsm")):
        named = find_drive(word)
        assert named.drive == load_drive("ipmsm")
        assert named.path.resolve() == (GENERATED / "ipmsm").resolve()
        assert target_folder(named, None) == named.path
        assert drive_folder(word).path == named.path


@pytest.mark.thorough
def test_a_generated_folder_is_enough_to_generate_it_again(desk: Path) -> None:
    shutil.copytree(GENERATED / "spmsm_load_torque", desk / "kept")
    assert current_package(find_drive("kept")).drive.name == "spmsm_load_torque"
    (written,) = generate_drives(["kept"], None, check=True)
    assert (written.state, written.folder) == ("unchanged", Path("kept"))


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("nosuch", "neither a shipped one (hub_36v, .*) nor a TOML file, nor a generated folder"),
        ("ipmsn", "Did you mean 'ipmsm'"),
        ("empty", "'empty' is not a generated folder"),
        ("nosuch.toml", "no drive 'nosuch.toml'"),
    ],
)
def test_what_names_no_drive_is_said(desk: Path, word: str, said: str) -> None:
    (desk / "empty").mkdir()
    with pytest.raises((UserError, DriveError), match=said.replace("(", r"\(").replace(")", r"\)")):
        find_drive(word)


@pytest.mark.parametrize("command", ["verify", "firmware", "replay", "compare", "faults", "fuzz", "soak", "pil"])
def test_every_command_advises_a_command_that_is_not_refused(desk: Path, command: str) -> None:
    """As after ``generate --out``: the folder is not where a drive file's is looked for."""
    more = {"replay": ["run.npz"], "compare": ["ipmsm"], "pil": ["--port", "simulated"]}
    done = CliRunner().invoke(app, [command, "mine.toml", *more.get(command, [])])
    assert isinstance(done.exception, UserError)
    assert "Run: pmsm-ickf generate mine.toml; or give the folder that it was generated into" in str(done.exception)
    assert target_folder(find_drive("mine.toml"), None) == Path("generated/mine")


def test_the_advice_for_a_file_with_a_shipped_name_is_not_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "copy.toml").write_text(PAPER.replace("2.875", "1.2"))
    monkeypatch.chdir(GENERATED.parent)
    named = find_drive(tmp_path / "copy.toml")
    with pytest.raises(DriveError, match="belongs to a shipped drive"):
        target_folder(named, None)
    with pytest.raises(UserError, match=r"is stale.*--out DIR, and give DIR/paper_spmsm as the drive"):
        drive_folder(tmp_path / "copy.toml")
    assert target_folder(named, tmp_path) == tmp_path / "paper_spmsm"


def test_faults_take_the_filters_that_a_drive_has(desk: Path) -> None:
    """Else the command ends, after its work, with 'has no filter'."""
    generate_drives(["mine.toml"], Path("out"))
    done = CliRunner().invoke(app, ["faults", "out/mine", "--seeds", "1", "--only", "lost_sample", "--speed", "500"])
    assert "mine, ckf" in done.output, done.exception
    refused = CliRunner().invoke(app, ["faults", "ipmsm", "out/mine", "--filters", "ckf,ickf", "--seeds", "1"])
    assert str(refused.exception) == "drive 'mine' has no filter 'ickf'; generated: ckf."
    assert "ipmsm, ckf" not in refused.output
    mistyped = CliRunner().invoke(app, ["faults", "ipmsm", "--filters", "ikf", "--seeds", "1"])
    assert str(mistyped.exception) == "drive 'ipmsm' has no filter 'ikf'; generated: ckf, ickf. Did you mean 'ickf'?"
