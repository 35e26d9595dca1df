"""Link E-F: identical bits on the emulated processors, and mutants that show the link can break and says where."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import runtime.firmware.gates
import runtime.firmware.link_ef
from codegen.render.drive import default_kind
from runtime.cli import app
from runtime.estimator.folder import GENERATED, find_folder
from runtime.estimator.numpy_backend import NumpyBackend
from runtime.firmware.avr import Avr
from runtime.firmware.cortex_m import boards
from runtime.firmware.drive_recording import CASES, PIECE
from runtime.firmware.emulator import Processor, outcome
from runtime.firmware.gates import check_firmware
from runtime.firmware.host import run_on_host
from runtime.firmware.link_ef import NAN, PROCESSORS, RECORDINGS, STEPS, Comparison, compare, link_ef
from runtime.firmware.recording import BAD, Recording, Segment, spoil
from runtime.firmware.static.check import Check
from runtime.firmware.subject import Subject, subjects
from runtime.firmware.tools import PACKAGES, find_tool
from runtime.system.errors import UserError
from tests.conftest import DRIVES, EVERY_DRIVE, thoroughly
from tests.target.need import need

FOLDERS = {path.parent.name: find_folder(path.parent.name) for path in sorted(GENERATED.glob("*/manifest.json"))}
SUBJECTS = {subject.name: (drive, subject) for drive, folder in FOLDERS.items() for subject in subjects(folder)}
#: A controller of every drive, which holds its filter's struct, and some filters alone; `pmsm-ickf firmware` runs all.
MANY = [
    name
    for name, (drive, subject) in SUBJECTS.items()
    if "_ickf" in name and (subject.part == "foc" or (drive == "ipmsm_flux" and not subject.part))
]
#: Those of ``make test``.
FEW = [f"{name}_ickf_foc" for name in DRIVES]
#: Whole drives: one without a rival, one with.
WHOLE = ("paper_spmsm_ickf_drive", "ipmsm_flux_ickf_drive")
M4 = boards()["cortex_m4f"]
OTHERS = [processor for processor in PROCESSORS if processor.name not in {Avr.name, M4.name}]
BOTH = pytest.mark.parametrize("processor", [Avr(), M4, *thoroughly(*OTHERS)], ids=lambda processor: processor.name)
QUICK = 60
#: A surface and a salient machine run all of the recording, others its first part.
FULL, SHORT = ("paper_spmsm", "ipmsm_flux"), 200


def whole(drive: str) -> str:
    """The subject that is the whole drive, around the filter that is meant where none is named."""
    return f"{drive}_{default_kind(FOLDERS[drive].kinds)}_drive"


def recorded(name: str, steps: int) -> tuple[Subject, Recording]:
    drive, subject = SUBJECTS[name]
    return subject, RECORDINGS[subject.part](FOLDERS[drive], steps)


def run(name: str, processor: Processor, steps: int, target: Subject | None = None, *flags: str) -> Comparison:
    """Compare a subject's host run with ``target`` (default: the same subject) on a processor."""
    need(*processor.programs)
    subject, recording = recorded(name, steps)
    return compare(processor, target or subject, recording, run_on_host(subject, recording), flags)


# --- the link holds


@BOTH
@pytest.mark.parametrize("name", ["paper_spmsm_ickf", *thoroughly("paper_spmsm_ickf_foc")])  # which runs longer below
def test_same_bits(name: str, processor: Processor) -> None:
    found = run(name, processor, QUICK)
    assert found.divergence is None, str(found.divergence)
    assert found.counted_exactly


@pytest.mark.parametrize("processor", OTHERS, ids=lambda processor: processor.name)
@pytest.mark.parametrize("name", ["ipmsm_flux_ickf", WHOLE[0]])
def test_same_bits_on_the_other_cores(name: str, processor: Processor) -> None:
    found = run(name, processor, QUICK if name == "ipmsm_flux_ickf" else PIECE * len(CASES))
    assert found.divergence is None, str(found.divergence)
    assert found.counted_exactly


@pytest.mark.slow
@BOTH
@pytest.mark.parametrize("name", [*FEW, *thoroughly(*(name for name in MANY if name not in FEW))])
def test_same_bits_over_many_steps(name: str, processor: Processor) -> None:
    found = run(name, processor, STEPS if SUBJECTS[name][0] in FULL else SHORT)
    assert found.divergence is None, str(found.divergence)
    assert found.counted_exactly
    assert np.all(found.outcome.cost > 0)


@pytest.mark.slow
@BOTH
@pytest.mark.parametrize(
    "name",
    [*WHOLE, *thoroughly(*(name for name in map(whole, FOLDERS) if name not in WHOLE))],
)
def test_same_bits_through_every_transition(name: str, processor: Processor) -> None:
    found = run(name, processor, PIECE * len(CASES))
    assert found.divergence is None, str(found.divergence)
    assert found.counted_exactly


@pytest.mark.parametrize("name", EVERY_DRIVE)
def test_every_transition_of_the_modes_is_replayed(name: str) -> None:
    """The drive's C, but that it keeps the transition's number where it keeps the step's status."""
    subject, recording = recorded(whole(name), PIECE * len(CASES))
    drive, call = f"{subject.name}.c", f"(void){subject.filter_name}_supervise("
    assert subject.sources[drive].count(call) == 1
    text = subject.sources[drive].replace(call, call.replace("(void)", "d->status = "))
    words = run_on_host(replace(subject, sources={**subject.sources, drive: text}), recording)
    taken = words[:, subject.words.index("status")]
    numbers = set(map(int, re.findall(r"taken = ([1-9]\d*);", subject.sources[f"{subject.filter_name}_supervisor.c"])))
    assert set(taken.tolist()) - {0} == numbers
    assert numbers == set(range(1, len(numbers) + 1))


@pytest.mark.parametrize("name", WHOLE)
def test_a_count_that_ends_nowhere_stands_at_its_largest_number(name: str) -> None:
    """What an int of 16 bits must hold is met, and held."""
    subject, recording = recorded(name, PIECE * len(CASES))
    most = FOLDERS[SUBJECTS[name][0]].module.MOST_SAMPLES
    words = run_on_host(subject, recording)
    found = words[:, subject.words.index("supervisor.since")].view(np.int32)
    assert int(np.max(found)) == most == 32_000
    assert np.count_nonzero(found == most) >= PIECE


def test_no_iteration_means_a_constant_number_of_instructions() -> None:
    """Straight-line code: accepted steps of the CKF all cost the same, but for those that turn an angle widely."""
    found = run("paper_spmsm_ckf", M4, QUICK)
    accepted = run_on_host(*recorded("paper_spmsm_ckf", QUICK))[:, 0] == 0
    costs, counts = np.unique(found.outcome.cost[accepted], return_counts=True)
    assert len(costs) <= 3
    assert costs[0] == costs[np.argmax(counts)]


# --- what is compared


@pytest.mark.parametrize("name", ["paper_spmsm_ickf", "ipmsm_flux_ckf_foc", *WHOLE])
def test_every_word_of_the_struct_is_compared(name: str) -> None:
    """Against the size of the struct, all of whose fields are four bytes wide on the host."""
    import cffi

    subject = SUBJECTS[name][1]
    fields = "".join(f"{'int' if f.is_int else 'float'} f{k}[{f.count}];" for k, f in enumerate(subject.fields))
    ffi = cffi.FFI()
    ffi.cdef(f"typedef struct {{ {fields} }} all;")
    assert 4 * len(subject.struct_words) == ffi.sizeof("all")
    header = re.sub(r"/\*.*?\*/", "", subject.sources[f"{name}.h"])
    declared = re.findall(r"^    (?:float32|int) (\w+)", header, re.MULTILINE)
    assert set(declared) <= {re.sub(r"\[.*", "", word) for word in subject.struct_words}
    inside = {
        "": {"status", "x[0]", "iterations"},
        "foc": {"status", "filter.x[0]", "duty[2]"},
        "drive": {"inverter", "status", "control.filter.x[0]", "control.v_queued[1]", "supervisor.since", "duty[2]"},
    }
    assert inside[subject.part] <= set(subject.words)
    assert ("supervisor.rival.x[0]" in subject.words) == (name == "ipmsm_flux_ickf_drive")
    assert len(set(subject.words)) == len(subject.words)


def test_the_subjects_of_a_folder() -> None:
    names = [subject.name.removeprefix("paper_spmsm_") for subject in subjects(FOLDERS["paper_spmsm"])]
    assert names == ["ckf", "ickf", "ckf_foc", "ickf_foc", "ckf_drive", "ickf_drive"]


def test_host_run_is_the_e_of_link_d_e() -> None:
    """The estimate the harness sees on the host has the bits of the NumPy twin."""
    subject, recording = recorded("spmsm_load_torque_ickf", QUICK)
    folder = FOLDERS["spmsm_load_torque"]
    rows = recording.segments[0].inputs.astype(np.float32)
    twin = NumpyBackend(folder.module, "ickf", "float32")
    x_0, P_0 = (np.array(folder.module.DEFAULTS[name], dtype=np.float32) for name in ("x_0", "P_0"))
    twin.reset(x_0, folder.module.pack(np.diag(P_0)).astype(np.float32))
    expected = twin.run(rows[:, :2], rows[:, 2:])[0]
    columns = [subject.words.index(f"x[{k}]") for k in range(len(x_0))]
    found = run_on_host(subject, Recording(recording.segments[:1]))[:, columns]
    np.testing.assert_array_equal(found, expected.view(np.uint32))


@pytest.mark.parametrize("steps", [1, 7, 60, STEPS])
def test_recordings_have_the_steps_asked_for(steps: int) -> None:
    assert list(RECORDINGS) == ["", "foc", "drive"]
    for record in RECORDINGS.values():
        assert record(FOLDERS["ipmsm_flux"], steps).steps == steps


def test_every_kind_of_bad_input_is_rejected_and_leaves_numbers() -> None:
    spoilt = spoil(np.zeros((100, 4)))
    for column in range(4):
        met = spoilt[:, column]
        assert all(np.any(np.isnan(met)) if np.isnan(bad) else bad in met for bad in BAD)
    subject, recording = recorded("ipmsm_flux_ickf", STEPS)
    words = run_on_host(subject, recording)
    bad = np.concatenate([~np.all(np.abs(segment.inputs) < 1e5, axis=1) for segment in recording.segments])
    np.testing.assert_array_equal(words[:, 0] & 1, bad)
    assert not np.any(words == NAN)


# --- the link can break


def mutants(subject: Subject) -> Iterator[Subject]:
    """Each folded constant of the filter's, the controller's or the supervisor's own file, one bit up."""
    file = f"{subject.filter_name}_supervisor.c" if subject.part == "drive" else f"{subject.name}.c"
    text = subject.sources[file]
    for match in re.finditer(r"(?<=#define )(\w+ )([-+.e0-9]+)f", text):
        up = f"{match.group(1)}{np.nextafter(np.float32(match.group(2)), np.float32(np.inf)):.9g}f"
        yield replace(subject, sources={**subject.sources, file: text[: match.start()] + up + text[match.end() :]})


@BOTH
@pytest.mark.parametrize("name", ["paper_spmsm_ickf", "paper_spmsm_ickf_foc", "paper_spmsm_ickf_drive"])
def test_a_constants_last_bit_is_caught_and_located(name: str, processor: Processor) -> None:
    """Step, word and both values are those of the mutant on the host, word by word."""
    steps = PIECE * len(CASES) if SUBJECTS[name][1].part == "drive" else QUICK
    subject, recording = recorded(name, steps)
    good = run_on_host(subject, recording)
    mutant = next(m for m in mutants(subject) if np.any(run_on_host(m, recording) != good))
    bad = run_on_host(mutant, recording)
    step = int(np.argmax(np.any(good != bad, axis=1)))
    k = int(np.argmax(good[step] != bad[step]))
    found = run(name, processor, steps, mutant)
    assert found.divergence is not None
    assert (found.divergence.step, found.divergence.word) == (step, subject.words[k])
    assert f"0x{good[step, k]:08x}" in found.divergence.expected
    assert f"0x{bad[step, k]:08x}" in found.divergence.found
    check = found.check(0)
    assert check.state == "failed"
    assert f"first divergence at step {step}, {subject.words[k]}" in check.detail[0]


def test_fused_multiply_add_is_caught() -> None:
    """The reason for -ffp-contract=off: the Cortex-M4F has a fused multiply-add."""
    found = run("paper_spmsm_ickf", M4, QUICK, None, "-ffp-contract=fast")
    assert found.divergence is not None


def test_an_int_of_16_bits_is_seen() -> None:
    """The AVR is a stand-in for the C28x because of its int: 40000 does not fit."""
    subject, recording = recorded("paper_spmsm_ickf", 3)
    segment = Segment(recording.segments[0].inputs, {"max_iterations": 40000})
    recording = Recording((segment,))
    expected = run_on_host(subject, recording)
    for processor, differs in ((Avr(), True), (M4, False)):
        need(*processor.programs)
        divergence = compare(processor, subject, recording, expected).divergence
        assert (divergence is not None) == differs
        assert divergence is None or (divergence.word, divergence.found) == ("max_iterations", "-25536")


def test_a_count_that_an_int_of_16_bits_does_not_hold_is_seen() -> None:
    """A supervisor that counts to 40000: the host does, the AVR comes round and parts from it."""
    subject, recording = recorded("paper_spmsm_ickf_drive", 3)
    file = f"{subject.filter_name}_supervisor.c"
    text = re.sub(r"(?<=#define MOST_SAMPLES )32000\b", "40000", subject.sources[file])
    assert text != subject.sources[file]
    wrong = replace(subject, sources={**subject.sources, file: text})
    fault = find_folder("paper_spmsm").module.FAULT  # the mode that no count ends
    fields = {"supervisor.mode": fault, "supervisor.since": 32766}
    long = Recording((Segment(recording.segments[0].inputs, fields),))
    expected = run_on_host(wrong, long)
    assert expected[:, wrong.words.index("supervisor.since")].tolist() == [32767, 32768, 32769]
    for processor, differs in ((Avr(), True), (M4, False)):
        need(*processor.programs)
        divergence = compare(processor, wrong, long, expected).divergence
        assert (divergence is not None) == differs
        assert divergence is None or (divergence.step, divergence.word) == (1, "supervisor.since")


# --- what cannot be run is said


def test_missing_tools_are_rows_and_exit_code_1(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name, which=shutil.which: None if name in PACKAGES else which(name))
    rows = link_ef(FOLDERS["paper_spmsm"])
    assert [row.state for row in rows] == ["not run"] * len(PROCESSORS)
    cortex = "gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm"
    needed = ["gcc-avr avr-libc simavr", *[cortex] * (len(PROCESSORS) - 1)]
    assert [row.figure for row in rows] == [f"needs {packages}" for packages in needed]
    monkeypatch.setattr(runtime.firmware.gates, "GATES", (link_ef,))
    for options, code in (((), 1), (("--allow-missing",), 0)):
        result = CliRunner().invoke(app, ["firmware", "paper_spmsm", *options])
        assert result.exit_code == code, result.output
        assert "E-F, Cortex-M4F was not run" in result.output
        assert f"apt-get install {needed[0]}" in result.output


def test_a_compiler_without_its_library_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    need("avr-gcc")
    monkeypatch.setitem(runtime.firmware.tools.LIBRARIES, "avr-gcc", ("avr-libc", "no_such_library.a"))
    with pytest.raises(UserError, match="apt-get install avr-libc"):
        find_tool("avr-gcc")


def test_a_run_that_stops_early_is_no_pass() -> None:
    with pytest.raises(UserError, match=r"stopped after 1 of 2 steps: .*FAULT"):
        outcome("E 00000001\nL 00000001\nS 00000000 00000000\nFAULT\n", 2, "qemu on x", 1.0)


def test_a_program_that_does_not_fit_is_one_clear_error() -> None:
    need("avr-gcc", "simavr")
    subject, recording = recorded("paper_spmsm_ickf", 1)
    with pytest.raises(UserError, match="avr-gcc failed"):
        Avr().run(subject, replace(recording, segments=recording.segments * 9000))


def test_json(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    row = Check("a gate", "paper_spmsm", "not run", "", "not run", ("why",))
    monkeypatch.setattr(runtime.firmware.gates, "GATES", (lambda folder, progress: [row],))
    path = tmp_path / "checks.json"
    (result,) = check_firmware(["paper_spmsm"], path)
    assert result.good(allow_missing=True)
    assert not result.good(allow_missing=False)
    data = json.loads(path.read_text())
    assert data["passed"] is False
    assert data["drives"][0]["checks"][0]["state"] == "not run"
