"""A filter in constant time: every step of status 0 takes the same path, counted; a branch put back is noticed."""

from __future__ import annotations

import shutil
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from codegen.generate import generate_bare
from codegen.output.folder import write_folder
from model.drives.load import DRIVES as FILES
from model.drives.load import load_drive, parse_drive
from model.schema import DriveError
from runtime.cli import app
from runtime.estimator.compiler import build_program
from runtime.estimator.folder import GENERATED, GeneratedFolder
from runtime.estimator.numpy_backend import NumpyBackend
from runtime.firmware.build import cross_compile, harness_sources
from runtime.firmware.callgrind import instructions_of_each
from runtime.firmware.cortex_m import boards
from runtime.firmware.host import run_on_host
from runtime.firmware.link_ef import RECORDINGS, compare, same_path
from runtime.firmware.recording import Recording
from runtime.firmware.subject import Subject, subjects
from runtime.folders.generate import for_target
from runtime.proof.link_text import link_text
from runtime.system.errors import UserError
from tests.conftest import ALL_DRIVES, DRIVES, thoroughly
from tests.mutants.checks import overlaid
from tests.target.need import need

M4 = boards()["cortex_m4f"]
#: A main program around the harness of the host, for valgrind.
MAIN = """#include <stdint.h>
void harness_run(uint32_t *words);
static uint32_t words[WORDS];
int main(void) { harness_run(words); return 0; }
"""


@cache
def folder_of(drive: str, base: Path) -> GeneratedFolder:
    """The drive's folder in constant time."""
    path = base / drive
    if not path.exists():
        write_folder(path, generate_bare(for_target(load_drive(drive), None, constant_time=True)).files)
    return GeneratedFolder(path)


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("constant_time")


def filters(folder: GeneratedFolder) -> list[Subject]:
    return [subject for subject in subjects(folder) if subject.part == ""]


def planted(subject: Subject, old: str, new: str) -> Subject:
    """A filter with a fault: the same text in its C but for one place."""
    name = f"{subject.name}.c"
    assert old in subject.sources[name]
    return replace(subject, sources={**subject.sources, name: subject.sources[name].replace(old, new, 1)})


def judged(subject: Subject, recording: Recording) -> str:
    """What the gate says of a filter on an emulated Cortex-M4F."""
    expected = run_on_host(subject, recording)
    found = compare(M4, subject, recording, expected)
    assert found.divergence is None, str(found.divergence)
    return same_path(found, expected[:, 0]).state


# --- counted


@pytest.mark.parametrize("drive", [*DRIVES, *thoroughly(*(name for name in ALL_DRIVES if name not in DRIVES))])
def test_every_step_takes_as_many_instructions_on_a_cortex_m4(drive: str, base: Path) -> None:
    need(*M4.programs)
    folder = folder_of(drive, base)
    recording = RECORDINGS[""](folder, 400)
    for subject in filters(folder):
        assert judged(subject, recording) == "passed", subject.name


#: Each is what the form without the option has, or what somebody might put back.
BRANCHES = {
    "the wrapped angle stored if it has to be": (
        "    f->x[3] = wrap_angle(f->x[3]);",
        "    if (!(f->x[3] * f->x[3] <= INSIDE)) {\n        f->x[3] = wrap_angle(f->x[3]);\n    }",
    ),
    "a choice by a condition": (
        "return chosen((x * x <= INSIDE) ? 1 : 0, x, larger(smaller(r, BELOW_PI), -3.1415925f));",
        "return (x * x <= INSIDE) ? x : larger(smaller(r, BELOW_PI), -3.1415925f);",
    ),
    "small turns by fewer terms": (
        "    turn_out[0] = ",
        "    if (D_theta < 0.01f) {\n        turn_out[0] = SINC_1 * z_theta_0 + 1.0f;\n    } else turn_out[0] = ",
    ),
}


@pytest.mark.parametrize("branch", BRANCHES)
def test_a_branch_put_back_is_noticed(branch: str, base: Path) -> None:
    need(*M4.programs)
    folder = folder_of("paper_spmsm", base)
    subject = planted(filters(folder)[0], *BRANCHES[branch])
    assert judged(subject, RECORDINGS[""](folder, 400)) == "failed"


def test_an_iteration_that_ends_early_is_noticed(base: Path) -> None:
    need(*M4.programs)
    folder = folder_of("ipmsm_flux", base)
    (subject,) = (s for s in filters(folder) if s.name.endswith("_ickf"))
    early = planted(subject, "while (iter", "while ((moving != 0) && (iter")
    early = planted(early, "f->max_iterations);\n        status", "f->max_iterations));\n        status")
    assert judged(early, RECORDINGS[""](folder, 400)) == "failed"


def test_without_the_option_the_recording_shows_many_paths() -> None:
    need(*M4.programs)
    folder = GeneratedFolder(GENERATED / "paper_spmsm")
    recording = RECORDINGS[""](folder, 400)
    for subject in filters(folder):
        assert judged(subject, recording) == "failed"


@pytest.mark.thorough
@pytest.mark.parametrize("target", ["cortex_m33f", "cortex_m7"])
@pytest.mark.parametrize("drive", DRIVES)
def test_the_same_on_other_cores(drive: str, target: str, base: Path) -> None:
    processor = boards()[target]
    need(*processor.programs)
    folder = folder_of(drive, base)
    recording = RECORDINGS[""](folder, 400)
    for subject in filters(folder):
        expected = run_on_host(subject, recording)
        assert same_path(compare(processor, subject, recording, expected), expected[:, 0]).state == "passed"


def counted_on_x86(subject: Subject, recording: Recording, compiler: Sequence[str] = ()) -> set[int]:
    """Instructions of the steps of status 0, each by callgrind."""
    sources = {
        **harness_sources(subject, recording, "host"),
        "main.c": MAIN.replace("WORDS", str(recording.steps * len(subject.words))),
    }
    if compiler:
        path = shutil.which(compiler[0])
        assert path is not None
        program = cross_compile(path, [*compiler[1:], "-ffp-contract=off"], sources)
    else:
        program = build_program(sources, {})
    counts = np.array(instructions_of_each(program, f"{subject.name}_step"))
    status = run_on_host(subject, recording)[:, 0]
    assert len(counts) == len(status)
    return {int(count) for count in counts[status == 0]}


@pytest.mark.parametrize("drive", [DRIVES[0], *thoroughly(*DRIVES[1:])])
@pytest.mark.parametrize("compiler", [(), *thoroughly((("clang", "-O2"),), (("gcc", "-O3"),), (("gcc", "-Os"),))])
def test_every_step_takes_as_many_instructions_on_x86(drive: str, compiler: tuple[str, ...], base: Path) -> None:
    need("valgrind", *compiler[:1])
    folder = folder_of(drive, base)
    recording = RECORDINGS[""](folder, 200)
    for subject in filters(folder):
        assert len(counted_on_x86(subject, recording, compiler)) == 1, subject.name


def test_valgrind_sees_the_paths_without_the_option() -> None:
    need("valgrind")
    folder = GeneratedFolder(GENERATED / "paper_spmsm")
    assert len(counted_on_x86(filters(folder)[0], RECORDINGS[""](folder, 200))) > 1


# --- the same filter


@pytest.mark.parametrize("drive", [*DRIVES, *thoroughly(*(name for name in ALL_DRIVES if name not in DRIVES))])
def test_c_and_numpy_are_the_same_program(drive: str, base: Path) -> None:
    folder = folder_of(drive, base)
    for kind in folder.kinds:
        link = link_text(folder, kind, "as shipped", ("C", "lanes"))
        assert link.passed, [row.stage for row in link.rows if not row.passed]


@pytest.mark.parametrize(
    ("old", "new"),
    [("    of[0] = b;\n    of[1] = a;\n", "    of[0] = a;\n    of[1] = b;\n"), ("return of[first]", "return of[0]")],
)
def test_a_choice_that_takes_the_other_number_is_another_program(old: str, new: str, base: Path) -> None:
    folder = folder_of("paper_spmsm", base)
    name = f"paper_spmsm_{folder.kinds[0]}.c"
    assert old in folder.text(name)
    wrong = overlaid(folder, name, folder.text(name).replace(old, new))
    assert not link_text(wrong, folder.kinds[0], "as shipped", ("C",)).passed


@pytest.mark.parametrize("drive", ["paper_spmsm", *thoroughly("ipmsm_flux", "ipmsm_adaptive")])
def test_it_stays_with_the_form_without_the_option(drive: str, base: Path) -> None:
    """In float64, where both polynomials are exact to rounding, no step tells two forms apart that both iterate on."""
    one, two = GeneratedFolder(GENERATED / drive), folder_of(drive, base)
    recording = RECORDINGS[""](one, 200)
    u, y = (np.concatenate([s.inputs for s in recording.segments])[:100, k : k + 2] for k in (0, 2))
    for kind in one.kinds:
        states = []
        for folder in (one, two):
            backend = NumpyBackend(folder.module, kind, "float64")
            backend.reset(
                np.array(folder.module.DEFAULTS["x_0"]), folder.module.pack(np.diag(folder.module.DEFAULTS["P_0"]))
            )
            backend.filter.tolerance = 0.0
            for k in range(len(u)):
                backend.step(u[k], y[k])
            states.append(np.array(backend.state()[0]))
        np.testing.assert_allclose(states[0], states[1], rtol=1e-9, atol=1e-9)


# --- asked for


def test_the_command_and_the_drive_file_ask_for_the_same(tmp_path: Path) -> None:
    text = (FILES / "paper_spmsm.toml").read_text()
    (tmp_path / "paper_spmsm.toml").write_text(text + "\n[target]\nconstant_time = true\n")
    stated = parse_drive(
        tomllib.loads(text + "\n[target]\nconstant_time = true\n"), "d.toml", load_drive("paper_spmsm").sha256
    )
    assert stated.constant_time
    asked = for_target(load_drive("paper_spmsm"), None, constant_time=True)
    assert asked.stated == stated.stated
    assert generate_bare(asked).files == generate_bare(stated).files
    assert for_target(stated, "cortex_m7").stated["target"] == {"name": "cortex_m7", "constant_time": True}
    result = CliRunner().invoke(app, ["generate", "paper_spmsm", "--constant-time", "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    folder = GeneratedFolder(tmp_path / "out" / "paper_spmsm")
    assert folder.manifest["parameters"]["target"]["constant_time"] is True
    assert "Constant time: every step whose status is 0" in folder.text("paper_spmsm_ickf.c")
    assert "In constant time" in folder.text("REPORT.md")


def test_without_out_it_would_take_the_place_of_what_the_file_says(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["generate", "paper_spmsm", "--constant-time"])
    assert isinstance(result.exception, UserError)
    assert "--constant-time differs from what the drive file says" in str(result.exception)


@pytest.mark.parametrize("value", ["1", '"true"', '"yes"'])
def test_what_is_no_truth_is_refused(value: str) -> None:
    text = (FILES / "paper_spmsm.toml").read_text() + f"\n[target]\nconstant_time = {value}\n"
    with pytest.raises(DriveError, match=r"target\.constant_time"):
        parse_drive(tomllib.loads(text), "d.toml")


def test_what_is_not_asked_for_does_not_show() -> None:
    text = (FILES / "paper_spmsm.toml").read_text() + "\n[target]\nconstant_time = false\n"
    assert parse_drive(tomllib.loads(text), "d.toml").stated["target"] == {"name": "f28335"}
