"""Measurements are kept by the code they were made from: same code, same report, with or without the compiler."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from codegen.evidence import measure
from codegen.evidence.ledger import Program
from codegen.evidence.measure import Measurer, compiler_version, kept_records, not_found
from codegen.evidence.programs import ProgramError
from codegen.generate import generate
from codegen.output.folder import write_folder
from codegen.targets.description import StandIn
from codegen.targets.find import default_target
from model.drives.load import load_drive
from runtime import cli
from runtime.estimator.folder import GENERATED

STAND_IN = default_target().stand_in
NOT_FOUND = not_found(STAND_IN)
NAME = "paper_spmsm_ckf"
STEP = f"{NAME}_step"


def committed() -> tuple[dict[str, str], dict[str, dict[str, object]]]:
    folder = GENERATED / "paper_spmsm"
    return {path.name: path.read_text() for path in folder.glob("*.[ch]")}, kept_records(folder)


def record(measurer: Measurer, files: dict[str, str]) -> dict[str, object]:
    return measurer(files, Program(files, f"{NAME}.c", f"{NAME}_foc.c"), STEP)


@pytest.fixture
def no_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)


@pytest.mark.usefixtures("no_compiler")
def test_same_code_is_reused_and_comments_are_no_code() -> None:
    files, kept = committed()
    assert record(Measurer(kept, compile=True), files) == kept[STEP]
    files[f"{NAME}.c"] = files[f"{NAME}.c"].replace("/* ", "/* another word, ", 3)
    files["paper_spmsm_ickf.c"] += "int elsewhere;\n"
    assert record(Measurer(kept, compile=True), files) == kept[STEP]


@pytest.mark.usefixtures("no_compiler")
@pytest.mark.parametrize("name", [f"{NAME}.c", f"{NAME}.h"])
def test_other_code_is_not_measured_without_the_compiler(name: str) -> None:
    files, kept = committed()
    files[name] += "typedef int another;\n"
    found = record(Measurer(kept, compile=True), files)
    assert found.get("not_measured") == NOT_FOUND == "arm-none-eabi-gcc not found (Debian: gcc-arm-none-eabi)"
    assert found["source_sha256"] != kept[STEP]["source_sha256"]


def test_a_missing_measurement_is_made_up_for_only_when_writing(monkeypatch: pytest.MonkeyPatch) -> None:
    """--check takes the folder as it is; generate measures as soon as there is a compiler."""
    files, kept = committed()
    missing = {STEP: {"source_sha256": kept[STEP]["source_sha256"], "not_measured": NOT_FOUND}}
    made = ({STEP: 72, "time_update": 100}, 1000)
    monkeypatch.setattr("codegen.evidence.measure.compile_object", lambda files, source, stand_in: made)
    monkeypatch.setattr("codegen.evidence.measure.compiler_version", lambda stand_in: "1.2.3")
    monkeypatch.setattr(shutil, "which", lambda name: f"bin/{name}")
    assert record(Measurer(missing, compile=True), files) == missing[STEP]
    found = record(Measurer(missing, compile=True, retry=True), files)
    assert (found["compiler"], found["stack_bytes"], found["text_bytes"]) == ("arm-none-eabi-gcc 1.2.3", 172, 1000)


@pytest.mark.usefixtures("no_compiler")
def test_report_says_what_was_not_measured(tmp_path: Path) -> None:
    drive = load_drive("paper_spmsm")
    package = generate(drive, samples=5, measurer=Measurer(compile=True))
    assert f"not measured: {NOT_FOUND}." in package.files["REPORT.md"]
    manifest = json.loads(package.files["manifest.json"])
    assert {entry["not_measured"] for entry in manifest["measured"].values()} == {NOT_FOUND}
    write_folder(tmp_path / "d", package.files)
    again = generate(drive, samples=5, measurer=Measurer(kept_records(tmp_path / "d"), compile=True))
    assert again.files == package.files


def test_no_folder_keeps_nothing(tmp_path: Path) -> None:
    assert kept_records(tmp_path / "none") == {}


def test_of_a_functions_clones_the_largest_frame_counts() -> None:
    usage = "a.c:1:5:step.constprop.0\t96\tstatic\na.c:1:5:step\t40\tstatic\na.c:9:1:reset\t8\tstatic\n"
    assert measure._frames(usage) == {"step": 96, "reset": 8}


def test_stack_is_the_deepest_chain_and_code_the_sum_of_all_files(monkeypatch: pytest.MonkeyPatch) -> None:
    """The controller's step lies in two files."""
    files, _ = committed()
    name = "paper_spmsm_ckf"
    objects = {
        f"{name}.c": ({STEP: 72, "time_update": 100, "ckf_measurement_update": 40}, 1000),
        f"{name}_foc.c": ({f"{name}_foc_step": 16, "control": 30}, 500),
    }
    monkeypatch.setattr(measure, "compile_object", lambda texts, source, stand_in: objects[source])
    monkeypatch.setattr(measure, "compiler_version", lambda stand_in: "1.2.3")
    monkeypatch.setattr(shutil, "which", lambda name: f"bin/{name}")
    program = Program(files, f"{name}.c", f"{name}_foc.c")
    found = Measurer(compile=True)(files, program, f"{name}_foc_step")
    assert (found["stack_bytes"], found["text_bytes"]) == (16 + 72 + 100, 1500)
    assert Measurer(compile=True)(files, program, STEP)["text_bytes"] == 1000


def test_other_flags_are_another_measurement() -> None:
    assert measure._digest(("-O0",), {"a.c": "int a;"}) != measure._digest(STAND_IN.flags, {"a.c": "int a;"})


def stand_in_of(tmp_path: Path, compiler: str, size: str = "exit 0") -> StandIn:
    """The stand-in with a compiler and its size tool that are shell scripts of ours."""
    for tool, text in (("a-gcc", compiler), ("a-size", size)):
        (tmp_path / tool).write_text(f"#!/bin/sh\n{text}\n")
        (tmp_path / tool).chmod(0o755)
    return replace(STAND_IN, compiler=str(tmp_path / "a-gcc"), flags=())


USAGE = "printf 'a.c:1:5:step\\t40\\tstatic\\n' > measured.su"
SIZES = "printf ' text\\tdata\\tbss\\tdec\\n  123\\t 4\\t 5\\t 132\\n'"


def test_text_is_the_first_column_of_the_size_tool(tmp_path: Path) -> None:
    stand_in = stand_in_of(tmp_path, USAGE, SIZES)
    assert measure.compile_object({"a.c": "int a;"}, "a.c", stand_in) == ({"step": 40}, 123)


@pytest.mark.parametrize(
    ("compiler", "size", "said"),
    [
        ("kill -SEGV $$", SIZES, "a-gcc crashed on a.c: Segmentation fault."),
        ("echo 'a.c:1: internal compiler error: in x' >&2; exit 1", SIZES, "a-gcc crashed on a.c: a.c:1: internal"),
        ("echo 'fatal error: Killed signal terminated program cc1' >&2; exit 1", SIZES, "Killed signal"),
        ("sleep 60", SIZES, "a-gcc did not end within 0.5 s on a.c."),
        ("exit 0", SIZES, "a-gcc ended well on a.c, but what it made cannot be read."),
        ("echo no table > measured.su", SIZES, "a-gcc ended well on a.c, but"),
        (r"printf '\377\376' > measured.su", SIZES, "a-gcc ended well on a.c, but"),
        (USAGE, "exit 0", "a-size ended well on a.c, but"),
        (USAGE, r"printf 'x\n\377 b\n'", "a-size ended well on a.c, but"),
        (USAGE, "kill -KILL $$", "a-size crashed on a.c: Killed."),
    ],
)
def test_a_compiler_that_crashes_or_hangs_is_one_line(
    compiler: str, size: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It has said nothing of the code: that is not kept as a finding. What it has started ends with it."""
    monkeypatch.setattr("codegen.evidence.programs.PATIENCE", 0.5 if "sleep" in compiler else 60.0)
    with pytest.raises(ProgramError, match=re.escape(said)) as caught:
        measure.compile_object({"a.c": "int a;"}, "a.c", stand_in_of(tmp_path, compiler, size))
    assert "\n" not in str(caught.value)


def test_a_compiler_that_cannot_be_started_or_has_no_version_is_one_line(tmp_path: Path) -> None:
    gone = replace(STAND_IN, compiler=str(tmp_path / "none"))
    with pytest.raises(ProgramError, match=r"none cannot be started: No such file or directory\.$"):
        measure.compile_object({"a.c": "int a;"}, "a.c", gone)
    with pytest.raises(ProgramError, match=r"a-gcc ended well, but what it made cannot be read\.$"):
        compiler_version(stand_in_of(tmp_path, "exit 0"))


def test_a_compiler_that_refuses_leaves_it_unmeasured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """For want of its C library, say; one that crashes ends the command, by the same way."""
    files, _ = committed()
    stand_in_of(tmp_path, "echo 'fatal error: math.h: No such file or directory' >&2; exit 1")
    for tool in ("gcc", "size"):
        (tmp_path / f"a-{tool}").rename(tmp_path / f"arm-none-eabi-{tool}")
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    assert record(Measurer(compile=True), files)["not_measured"] == "arm-none-eabi-gcc failed on it"
    (tmp_path / "arm-none-eabi-gcc").write_text("#!/bin/sh\nkill -SEGV $$\n")
    assert cli._explained(caught_of(lambda: record(Measurer(compile=True), files))) == 2


def caught_of(call: Callable[[], object]) -> Exception:
    with pytest.raises(ProgramError) as caught:
        call()
    return caught.value
