"""Targets: found by their file, told in the folder, and with the default's bits on their own processor."""

from __future__ import annotations

import json
import subprocess
import tomllib
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

import codegen.targets.chips as chips
from codegen.evidence.budget import check_budget
from codegen.evidence.ledger import OPERATIONS
from codegen.generate import Package, generate
from codegen.output.folder import write_folder
from codegen.targets.find import find_target, target_names
from model.drives.load import DRIVES, load_drive, parse_drive
from model.schema import DriveError
from runtime.cli import app
from runtime.compare.facts import costs
from runtime.compare.tables import COST_COLUMNS, cost_cells
from runtime.estimator.folder import GENERATED, GeneratedFolder, find_folder
from runtime.firmware.cortex_m import CortexM, boards
from runtime.firmware.host import run_on_host
from runtime.firmware.link_ef import RECORDINGS, compare, link_ef
from runtime.firmware.subject import subjects
from runtime.folders.generate import for_target
from runtime.system.errors import UserError
from tests.conftest import thoroughly
from tests.target.need import need

IEEE = ("c99", "cortex_m33f", "cortex_m4f", "cortex_m7")
#: One drive whose filter is a straight line, one whose filter iterates.
FEW = ["paper_spmsm", *thoroughly("ipmsm_flux")]


@cache
def made_for(drive: str, target: str) -> Package:
    return generate(for_target(load_drive(drive), target), samples=50)


def preprocessed(files: dict[str, str], name: str, folder: Path) -> str:
    """A file as the host's compiler reads it."""
    for path, text in files.items():
        if "/" not in path and path.endswith((".c", ".h")):
            (folder / path).write_text(text)
    command = ["gcc", "-E", "-P", name]
    text = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True).stdout
    return "\n".join(line.lstrip() for line in text.splitlines() if "#pragma" not in line)


# --- found by the file's name


def test_every_file_is_a_target_of_its_name() -> None:
    assert {*IEEE, "f28335"} <= set(target_names())
    for name in target_names():
        assert find_target(name).name == name


def test_a_target_that_is_not_there_is_one_line() -> None:
    with pytest.raises(DriveError, match=r"^no target 'cortex_m4'\. Did you mean 'cortex_m4f'\?$"):
        find_target("cortex_m4")
    with pytest.raises(DriveError, match=r"^no target 'z80'\. There are: c99, "):
        find_target("z80")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--target", "cortex_m4f"), "say where it goes with --out DIR"),
        (("--target", "m4f", "--out", "x"), "no target 'm4f'"),
    ],
)
def test_options_that_do_not_do(
    options: tuple[str, ...], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["generate", "paper_spmsm", *options])
    assert isinstance(result.exception, UserError | DriveError)
    assert said in str(result.exception)
    assert not list(tmp_path.iterdir())


def test_a_drive_file_chooses_its_target() -> None:
    text = (DRIVES / "paper_spmsm.toml").read_text()
    drive = parse_drive(tomllib.loads(text + '\n[target]\nname = "cortex_m7"\n'), "d.toml")
    assert (drive.target_name, drive.stated["target"]) == ("cortex_m7", {"name": "cortex_m7"})
    assert "target" not in load_drive("paper_spmsm").stated
    with pytest.raises(DriveError, match=r"target\.name"):
        parse_drive(tomllib.loads(text + '\n[target]\nname = "../x"\n'), "d.toml")


# --- what the folder says


@pytest.mark.parametrize("target", [*IEEE[2:3], *thoroughly(IEEE[0], *IEEE[1:2], IEEE[3])])
def test_a_folder_names_its_target_and_prices_nothing_unpublished(target: str, tmp_path: Path) -> None:
    made, described = made_for("paper_spmsm", target), find_target(target)
    facts = json.loads(made.files["manifest.json"])
    assert facts["target"] == target
    assert f" * {target}, {described.title}. */" in made.files["pmsm_port.h"]
    assert f"For {described.purpose}." in made.files["paper_spmsm_ickf.c"]
    report = made.files["REPORT.md"]
    for word in ("C28x", "F28335", "F2833x", "fastRTS", "cycles, k", "TMS320"):
        assert word not in report
        assert not any(
            word in text for name, text in made.files.items() if name.endswith(".c") and "selftest" not in name
        )
    assert "No cycles are stated" in report
    assert facts["filters"]["ickf"]["chip_model"] is None
    assert "estimated_cycles" not in facts["filters"]["ickf"]
    assert facts["filters"]["ickf"]["state_words"] == 2 * len(subjects_of(made, tmp_path)[1].struct_words)
    check_budget(made.drive, made.accounts)  # the file allows 3000 cycles, which nobody can count here
    subject = SimpleNamespace(label="x", drive=made.drive, folder=GeneratedFolder(tmp_path / "d"), manifest=facts)
    cost = costs([subject])[0]  # type: ignore[list-item]
    cells = dict(zip(COST_COLUMNS, cost_cells(cost, cost), strict=True))
    assert {cells[name] for name in ("cycles", "ratio", "of T", "with controller")} == {"-"}
    assert "-" not in {cells[name] for name in OPERATIONS}


def subjects_of(made: Package, folder: Path) -> list:  # type: ignore[type-arg]
    write_folder(folder / "d", made.files)
    return list(subjects(GeneratedFolder(folder / "d")))


# --- the same bits


@pytest.mark.parametrize("target", IEEE)
def test_the_host_reads_the_defaults_text(target: str, tmp_path: Path) -> None:
    """So what is shown of the default's text is shown of this one."""
    made = made_for("paper_spmsm", target)
    default = {path.name: path.read_text() for path in (GENERATED / "paper_spmsm").glob("*.[ch]")}
    for which in ("own", "default"):
        (tmp_path / which).mkdir()
    compared = [name for name in default if name.endswith(".c")]
    assert len(compared) > 8
    for name in compared:
        own, wanted = (
            preprocessed(files, name, tmp_path / f) for files, f in ((made.files, "own"), (default, "default"))
        )
        assert own == wanted


@pytest.mark.parametrize("target", ["cortex_m33f", "cortex_m4f", "cortex_m7"])
@pytest.mark.parametrize("drive", FEW)
def test_a_targets_own_text_on_its_own_board_in_its_own_section(drive: str, target: str, tmp_path: Path) -> None:
    processor = boards()[target]
    need(*processor.programs)
    made = made_for(drive, target)
    filter_alone = subjects_of(made, tmp_path)[-5]
    recording = RECORDINGS[filter_alone.part](GeneratedFolder(tmp_path / "d"), 60)
    flags = ['-DPMSM_RAM_SECTION=".fast"']
    found = compare(processor, filter_alone, recording, run_on_host(filter_alone, recording), flags)
    assert found.divergence is None, str(found.divergence)
    assert np.all(found.outcome.cost > 0)
    compiler = processor.programs[0]
    source = f"{filter_alone.name}.c"
    command = [compiler, *processor.board.flags, "-O2", *flags, "-c", source, "-o", "x.o"]
    subprocess.run(command, cwd=tmp_path / "d", check=True)
    command = [compiler.replace("gcc", "size"), "-A", "x.o"]
    sizes = subprocess.run(command, cwd=tmp_path / "d", check=True, capture_output=True, text=True).stdout
    rows = {line.split()[0]: int(line.split()[1]) for line in sizes.splitlines() if line.startswith(".")}
    assert rows[".fast"] > 5 * rows[".text"]  # _init and _reset stay


@pytest.mark.thorough
@pytest.mark.parametrize("target", ["cortex_m33f", "cortex_m4f", "cortex_m7"])
def test_a_whole_folder_of_a_target_passes_link_e_f(target: str, tmp_path: Path) -> None:
    subjects_of(made_for("ipmsm_flux", target), tmp_path)
    rows = link_ef(GeneratedFolder(tmp_path / "d"), steps=200, processors=[boards()[target]])
    assert len(rows) == 7
    assert {row.state for row in rows} == {"passed"}


def test_without_an_fpu_the_port_header_refuses(tmp_path: Path) -> None:
    need("arm-none-eabi-gcc")
    compiler = "arm-none-eabi-gcc"
    (tmp_path / "pmsm_port.h").write_text(made_for("paper_spmsm", "cortex_m4f").files["pmsm_port.h"])
    (tmp_path / "x.c").write_text('#include "pmsm_port.h"\n')
    for flags, good in (
        (find_target("cortex_m4f").stand_in.flags, True),
        (("-mcpu=cortex-m4", "-mfloat-abi=soft"), False),
    ):
        done = subprocess.run(
            [compiler, *flags, "-c", "x.c"], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert (done.returncode == 0) == good
        assert good or "without the FPU a step takes many times as long" in done.stderr


# --- one more, in one file


NEW = '''"""Arm Cortex-M55."""

from dataclasses import replace

from codegen.targets.chips.cortex_m4f import TARGET as CORTEX_M4F
from codegen.targets.chips.cortex_m4f import stand_in
from codegen.targets.description import Board

CPU = ("-mcpu=cortex-m55", "-mfloat-abi=hard")
TARGET = replace(
    CORTEX_M4F,
    name="cortex_m55",
    title="Arm Cortex-M55",
    core="Cortex-M55",
    purpose="a Cortex-M55",
    language="C89 float32 for a Cortex-M55",
    stand_in=stand_in("Cortex-M55", "M55", CPU),
    board=Board("mps3-an547", "cortex-m55", (*CPU, "-mthumb"), code=0x10000000, data=0x70000000, clock=32e6),
)
'''


@pytest.fixture
def cortex_m55(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> CortexM:
    """A target that is not shipped: the one file that CONTRIBUTING.md asks for, and nothing else."""
    folder = tmp_path / "chips"
    folder.mkdir()
    (folder / "cortex_m55.py").write_text(NEW)
    monkeypatch.setattr(chips, "__path__", [*chips.__path__, str(folder)])
    return boards()["cortex_m55"]


def test_a_target_is_added_by_one_file(cortex_m55: CortexM, tmp_path: Path) -> None:
    """Found, generated for, its C sized by its own compiler's flags, its bits compared and its instructions counted."""
    need(*cortex_m55.programs)
    result = CliRunner().invoke(
        app, ["generate", "paper_spmsm", "--target", "cortex_m55", "--out", str(tmp_path / "out")]
    )
    assert result.exit_code == 0, result.output
    folder = GeneratedFolder(tmp_path / "out" / "paper_spmsm")
    assert folder.manifest["target"] == "cortex_m55"
    assert "bytes (M55)" in folder.text("REPORT.md")
    assert folder.manifest["measured"] != find_folder("paper_spmsm").manifest["measured"]
    subject = next(s for s in subjects(folder) if s.part == "")
    recording = RECORDINGS[""](folder, 60)
    found = compare(cortex_m55, subject, recording, run_on_host(subject, recording))
    assert found.divergence is None, str(found.divergence)
    assert found.counted_exactly
    wrong = replace(
        subject, sources={k: v.replace("#define ROUND 1", "#define ROUND 2") for k, v in subject.sources.items()}
    )
    assert compare(cortex_m55, wrong, recording, run_on_host(subject, recording)).divergence is not None
