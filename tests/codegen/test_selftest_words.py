"""The self-tests' own judgement: each word, status and pass that they compare is changed on the way, one at a time,
and must be named; what is within the allowance must not be.

The step is the real one, tampered with in C (`tamper.c`); tables are read from the library's memory, inputs compared
with what the recording says, sizes with the ledger's layout of the emitted structs.
"""

from __future__ import annotations

import atexit
import ctypes
import json
import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from codegen.evidence.ledger import Program
from codegen.evidence.recording import approximate, execute, record_control, record_filter, run_control, run_filter
from codegen.evidence.selftest import control_run, gains, segments
from codegen.render.drive import default_kind
from model.drives.load import load_drive
from model.machines.state_space import build
from model.schema import Drive
from runtime.estimator.folder import GENERATED

HERE = Path(__file__).parent
SUBJECTS = (("paper_spmsm", False), ("paper_spmsm", True), ("ipmsm_flux", False), ("ipmsm_flux", True))
STATUS = (1, 2, 4, 8, 16, 32)
NO_NUMBER = float("nan")


@dataclass(frozen=True)
class Subject:
    """A self-test in a library, and the numbers it holds: expected words and allowed exponents, (vectors, words)."""

    drive: Drive
    kind: str
    controller: bool
    library: Any
    tamper: Any
    table: Any
    expected: np.ndarray
    allowed: np.ndarray
    integers: np.ndarray
    inputs: np.ndarray

    @property
    def p(self) -> str:
        return f"{self.drive.name}_{self.kind}{'_foc' if self.controller else ''}"

    @property
    def header(self) -> str:
        return (GENERATED / self.drive.name / f"{self.p}_selftest.h").read_text()

    @property
    def module(self) -> str:
        return (GENERATED / self.drive.name / f"{self.drive.name}.py").read_text()

    def run(self, tolerance: float, sample: int = -1, word: int = -1, **change: Any) -> int:
        """The self-test's answer with one thing changed."""
        for name, value in {"bits": 0, "passes": 0, "value": 0.0, "sample": sample, "word": word, **change}.items():
            setattr(self.tamper, name, value)
        return int(self.library.run_selftest(ctypes.c_float(tolerance)))

    def stage(self, word: int) -> int:
        leading = 3 if self.controller else len(self.tamper.x[0])
        return 10 + word if word < leading else 20 + word - leading


def _vector_type(ints: int, words: int) -> Any:
    fields = [("input", ctypes.c_uint32 * 4), ("ints", ctypes.c_int * ints), ("expected", ctypes.c_uint32 * words)]
    return type("vector", (ctypes.Structure,), {"_fields_": [*fields, ("allowed", ctypes.c_uint16 * words)]})


@lru_cache
def subject(name: str, controller: bool) -> Subject:
    drive = load_drive(name)
    kind = default_kind(drive.filter.kinds)
    facts = json.loads((GENERATED / name / "manifest.json").read_text())
    n = len(facts["states"])
    scratch = Path(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, scratch, ignore_errors=True)
    p = f"{name}_{kind}" + ("_foc" if controller else "")
    _compile(GENERATED / name, p, n, controller, scratch)
    library = ctypes.CDLL(str(scratch / "t.so"))
    words = 7 if controller else n + n * (n + 1) // 2
    row = _vector_type(1 if controller else 2, words)
    vectors = len(re.findall(r"^    /\* \d+: ", (GENERATED / name / f"{p}_selftest.c").read_text(), re.MULTILINE))
    table = (row * vectors).in_dll(library, "VECTORS")
    fields = [(item, ctypes.c_int) for item in ("calls", "sample", "word", "bits", "passes")]
    fields += [("value", ctypes.c_float), ("input", ctypes.c_float * 4 * 64), ("x", ctypes.c_float * n * 64)]
    fields += [("covariance", ctypes.c_float * (n * (n + 1) // 2) * 64)]
    tamper = type("tamper_t", (ctypes.Structure,), {"_fields_": fields}).in_dll(library, "tamper")
    return Subject(
        drive,
        kind,
        controller,
        library,
        tamper,
        table,
        np.array([list(item.expected) for item in table], dtype=np.uint32).view(np.float32),
        np.array([list(item.allowed) for item in table]),
        np.array([list(item.ints) for item in table]),
        np.array([list(item.input) for item in table], dtype=np.uint32).view(np.float32),
    )


def _compile(folder: Path, p: str, n: int, controller: bool, scratch: Path) -> None:
    """Self-test with mutable, visible tables; the filter as it is."""
    names = {
        "N": n,
        "N_COVARIANCE": n * (n + 1) // 2,
        "CONTROLLER": int(controller),
        "SUBJECT_T": f"{p}_t",
        "REAL_STEP": f"{p}_step",
        "SELFTEST": f"{p}_selftest",
        "INIT(w)": f"{p}_init(w, 1)" if controller else f"{p}_init(w)",
        "COVARIANCE": "LD" if re.search(r"\bLD\[", (folder / f"{p.removesuffix('_foc')}.h").read_text()) else "P",
    }
    text = "\n".join([f"#define {name} {value}" for name, value in names.items()])
    (scratch / "t.c").write_text(f'#include "{p}_selftest.h"\n{text}\n#include "{HERE / "tamper.c"}"\n')
    common = ["gcc", "-O0", "-fPIC", "-ffp-contract=off", "-w", f"-I{folder}"]
    sources = sorted({p, p.removesuffix("_foc")})
    open_tables = ["-Dstatic=", "-Dconst=", f"-D{p}_step=tampered_step", "-fvisibility=default"]
    commands = [
        [*common, *open_tables, "-c", str(folder / f"{p}_selftest.c"), "-o", "selftest.o"],
        [*common, "-shared", "t.c", "selftest.o", *(str(folder / f"{name}.c") for name in sources), "-o", "t.so"],
    ]
    for command in commands:
        subprocess.run(command, cwd=scratch, check=True)


@pytest.fixture(params=SUBJECTS, ids=lambda item: item[0] + ("-foc" if item[1] else ""))
def test_of(request: pytest.FixtureRequest) -> Subject:
    return subject(*request.param)


def _next(value: float, units: int) -> float:
    return float((np.float32(value).view(np.int32) + np.int32(units)).view(np.float32))


def test_untouched_it_passes_and_leaves_what_init_leaves(test_of: Subject) -> None:
    for tolerance in (0.0, 1.0, 2.0):
        assert test_of.run(tolerance) == 0
        assert test_of.library.is_as_init_leaves_it() == 1
    assert test_of.run(0.0, 0, 0, value=1e3) != 0
    assert test_of.library.is_as_init_leaves_it() == 1, "also where it fails"


def test_every_word_of_every_vector_is_compared(test_of: Subject) -> None:
    """One unit in the last place without a tolerance; just beyond the allowance, and no number, with one."""
    vectors, words = test_of.expected.shape
    for k in range(vectors):
        for word in range(words):
            value = test_of.expected[k, word]
            code = 100 * (k + 1) + test_of.stage(word)
            limit = 2.0 ** (int(test_of.allowed[k, word]) - 127)
            assert test_of.run(0.0, k, word, value=_next(value, 1)) == code
            assert test_of.run(1.0, k, word, value=NO_NUMBER) == code
            for sign in (1, -1):
                beyond = float(value) + sign * (1.01 * limit + 2 * float(np.spacing(np.abs(value))))
                assert test_of.run(1.0, k, word, value=beyond) == code
                assert test_of.run(4.0, k, word, value=float(value) + sign * 4.5 * limit) == code


def test_what_is_allowed_passes_that_word(test_of: Subject) -> None:
    """A word within the allowance is not what is named; what the rest of the run makes of it is another matter."""
    vectors, words = test_of.expected.shape
    for k in range(vectors):
        for word in range(words):
            value, limit = float(test_of.expected[k, word]), 2.0 ** (int(test_of.allowed[k, word]) - 127)
            for sign in (1, -1):
                found = test_of.run(1.0, k, word, value=value + sign * 0.74 * limit)
                assert found == 0 or found > 100 * (k + 1) + test_of.stage(word)
                found = test_of.run(2.0, k, word, value=value + sign * 1.7 * limit)
                assert found == 0 or found > 100 * (k + 1) + test_of.stage(word)


def test_status_and_iterations(test_of: Subject) -> None:
    """With a tolerance only what rounding cannot change: of the filter a rejected input, of the controller all but
    PMSM_NOT_CONVERGED."""
    for k in range(len(test_of.expected)):
        for bit in STATUS:
            assert test_of.run(0.0, k, bits=bit) == 100 * (k + 1) + 1
            compared = bit != 2 if test_of.controller else bit == 1
            assert test_of.run(1.0, k, bits=bit) == (100 * (k + 1) + 1 if compared else 0)
        if not test_of.controller:
            assert test_of.run(0.0, k, passes=1) == 100 * (k + 1) + 2
            assert test_of.run(1.0, k, passes=1) == 0


def test_a_recorded_status_that_is_wrong_is_named(test_of: Subject) -> None:
    """The same the other way round: the table's status is changed, not the step's."""
    for k, row in enumerate(test_of.table):
        for bit in STATUS:
            row.ints[0] ^= bit
            compared = bit != 2 if test_of.controller else bit == 1
            answers = test_of.run(0.0), test_of.run(1.0)
            row.ints[0] ^= bit
            assert answers == (100 * (k + 1) + 1, 100 * (k + 1) + 1 if compared else 0)


@pytest.mark.parametrize("end", ["", "_foc"], ids=["filter", "foc"])
@pytest.mark.parametrize("drive", sorted({drive for drive, _ in SUBJECTS}))
def test_no_table_is_read_beyond_its_end(drive: str, end: str, tmp_path: Path) -> None:
    """With the compiler's bounds trapped."""
    folder, p = GENERATED / drive, f"{drive}_ickf{end}"
    text = f'#include "{p}_selftest.h"\nstatic {p}_t work;\n'
    text += f"int main(void) {{ return {p}_selftest(&work, 0.0f) + {p}_selftest(&work, 1.0f); }}\n"
    (tmp_path / "main.c").write_text(text)
    sources = [str(folder / f"{name}.c") for name in sorted({p, p.removesuffix("_foc"), f"{p}_selftest"})]
    command = ["gcc", "-O0", "-w", "-fsanitize=undefined", "-fsanitize-undefined-trap-on-error", f"-I{folder}"]
    subprocess.run([*command, "main.c", *sources, "-o", "t", "-lm"], cwd=tmp_path, check=True)
    assert subprocess.run([tmp_path / "t"]).returncode == 0


def _recorded(test_of: Subject) -> tuple[np.ndarray, Any]:
    """Inputs (N, 4) and the recording, from the drive."""
    drive = test_of.drive
    if test_of.controller:
        run = control_run(drive)
        recording = record_control(test_of.module, test_of.kind, run, gains(drive, run.delay).values)
        return np.hstack([run.phase, run.command]), recording
    runs = segments(drive, build(drive))
    inputs = np.vstack([np.hstack([run.u, run.y]) for run in runs])
    return inputs, record_filter(test_of.module, test_of.kind, runs)


def test_each_vector_is_replayed_as_recorded(test_of: Subject) -> None:
    inputs, recording = _recorded(test_of)
    assert test_of.run(0.0) == 0
    assert test_of.tamper.calls == len(inputs) == len(test_of.expected)
    given = np.array([list(row) for row in test_of.tamper.input])[: len(inputs)]
    assert np.array_equal(given.astype(np.float32), inputs.astype(np.float32), equal_nan=True)
    assert np.array_equal(test_of.inputs, inputs.astype(np.float32), equal_nan=True)
    assert np.array_equal(test_of.expected.view(np.uint32), recording.words.view(np.uint32))
    assert np.array_equal(test_of.allowed, recording.allowed)
    assert np.array_equal(test_of.integers[:, 0], recording.status)


def test_each_segment_begins_where_it_says(test_of: Subject) -> None:
    if test_of.controller:
        return
    runs, first = segments(test_of.drive, build(test_of.drive)), 0
    unpack = execute(test_of.module, "m")["unpack"]
    assert test_of.run(0.0) == 0
    for run in runs:
        assert np.array_equal(list(test_of.tamper.x[first]), run.x_0.astype(np.float32))
        P = unpack(np.array(list(test_of.tamper.covariance[first])))
        assert np.array_equal(P, np.diag(run.P_0.astype(np.float32)))
        first += len(run.u)


def test_a_wrong_result_of_the_arithmetic_is_named_by_its_stage(test_of: Subject) -> None:
    """Quotient and root within their allowance with a tolerance; sine, cosine and wrapped angle never."""
    if test_of.controller:
        return
    row = type("sample", (ctypes.Structure,), {"_fields_": [("w", ctypes.c_uint32 * 8), ("a", ctypes.c_uint16 * 2)]})
    samples = (row * 5).in_dll(test_of.library, "SAMPLES")
    for sample in samples:
        a, b, angle, *results = (float(np.uint32(word).view(np.float32)) for word in sample.w)
        exact = [a / b, a**0.5, np.sin(angle), np.cos(angle), np.remainder(angle + np.pi, 2 * np.pi) - np.pi]
        assert results == pytest.approx(exact, rel=2e-7, abs=2e-4)
        for k in range(5):
            kept = sample.w[3 + k]
            for units, tolerant in ((1, k >= 2), (-1, k >= 2), (9, True), (-9, True)):
                sample.w[3 + k] = kept + units
                assert test_of.run(0.0) == 1 + k
                assert test_of.tamper.calls == 0
                assert test_of.run(1.0) == (1 + k if tolerant else 0)
            sample.w[3 + k] = kept
    assert test_of.run(0.0) == 0


def test_what_is_allowed_is_what_the_chips_errors_make_of_a_word(test_of: Subject) -> None:
    """The power of two at or above 8 times the worst of runs with random errors; other draws than the recording's."""
    drive, blurred = test_of.drive, approximate(test_of.module, "blurred", seed=99)
    if test_of.controller:
        run = control_run(drive)
        found = run_control(blurred, test_of.kind, run, gains(drive, run.delay).values, 64)[1]
    else:
        found = run_filter(blurred, test_of.kind, segments(drive, build(drive)), 64)[2]
    exact = test_of.expected.astype(float)
    worst = np.max(np.abs(found.astype(float) - exact[..., None]), axis=-1)
    least = np.maximum(8 * worst, np.maximum(4 * np.spacing(np.abs(test_of.expected)).astype(float), 2.0**-100))
    share = 2.0 ** (test_of.allowed - 127.0) / least
    assert np.all((share > 0.25) & (share < 64)), "draws differ; a power of two rounds up"
    assert np.mean((share > 0.5) & (share < 4)) > 0.9
    assert 1.0 <= np.exp(np.mean(np.log(share))) <= 2.5


def test_random_errors_are_three_units_either_way() -> None:
    module = (
        "def divide_it(a, b):\n    return a / b\n\n\ndef root_it(a):\n    return np.sqrt(a)\n\n\nimport numpy as np\n"
    )
    names = approximate(module, "m")
    one = np.ones(4000, dtype=np.float32)
    for values in (names["divide_it"](one, one), names["root_it"](one)):
        units, counts = np.unique(np.round((values - 1) * 2**23), return_counts=True)
        assert units.tolist() == [-3, -2, -1, 0, 1, 2, 3]
        assert min(counts) > 400


# --- what the headers and the manifest say


def test_sizes_are_those_of_the_tables(test_of: Subject) -> None:
    """The ledger's layout of the emitted structs, times their number."""
    folder = GENERATED / test_of.drive.name
    files = {path.name: path.read_text() for path in folder.glob("*.[ch]")}
    unit = Program(files, f"{test_of.p}_selftest.c").units[0]
    structs = [name for name in unit.typedefs if re.fullmatch(rf"{test_of.p}_(vector|start|sample)", name)]
    tables = {"vector": len(test_of.expected), "start": 5, "sample": 5}
    words = sum(unit.words(name) * tables[name.rpartition("_")[2]] for name in structs)
    assert len(structs) == (1 if test_of.controller else 3)
    facts = json.loads((folder / "manifest.json").read_text())["filters"][test_of.kind]["selftest"]
    if not test_of.controller:
        assert facts == {"vectors": len(test_of.expected), "words": words}
    header = " ".join(test_of.header.split())
    assert f"Replays {len(test_of.expected)} recorded steps" in header
    assert f"about {words} 16-bit words of constants" in header
    report = (folder / "REPORT.md").read_text()
    assert (
        f"| `{test_of.p}_selftest.h`, `.c` | replays {len(test_of.expected)} recorded steps at start-up, 0 is good; "
        f"about {words} 16-bit words of constants |"
    ) in report


def test_the_headers_plan_is_what_is_replayed(test_of: Subject) -> None:
    header = test_of.header
    plan = [
        (int(a), int(b or a), said)
        for a, b, said in re.findall(r"^ \*   vector +(\d+)(?: \.\. (\d+))?: (.*)$", header, re.MULTILINE)
    ]
    if test_of.controller:
        assert [row[:2] for row in plan] == [(1, len(test_of.expected))]
        ahead = test_of.inputs[:, 2] > 0.9 * test_of.drive.operating_box.speed
        assert np.flatnonzero(ahead & np.isfinite(test_of.inputs[:, 2])).tolist() == [8, 9]
        assert "the last two ask for more speed than there is" in plan[0][2]
        assert "with delay 1 leaves it" in " ".join(header.split()).replace("* ", "")
    else:
        first, expected = 1, []
        for run in segments(test_of.drive, build(test_of.drive)):
            expected.append((first, first + len(run.u) - 1, run.title))
            first += len(run.u)
        assert plan[1:] == expected
        assert plan[0][:2] == (0, 0)
        assert "stage 1 division, 2 square root, 3 sine, 4 cosine, 5 wrapped angle" in plan[0][2]
        assert np.flatnonzero(test_of.integers[:, 0] & 1).tolist() == [11, 12], "the start has two bad inputs in it"
    stages = dict(re.findall(r"^ \*   stage (.*?): (.*)$", header, re.MULTILINE))
    expected_stages = (
        {"1": "the status", "10 + k": "duty[k]", "20 + k": "integrator[k]"}
        if test_of.controller
        else {"1": "the status", "2": "the number of iterations", "10 + k": "x[k]", "20 + k": "LD[k]"}
    )
    assert stages == expected_stages
    text = " ".join(header.replace(" * ", " ").split())
    assert "good to 3 units in the last place" in text
    assert "is 8 times what such errors, drawn at random 64 times" in text


def test_the_values_in_comments_are_those_of_the_words(test_of: Subject) -> None:
    """Beside each row of words stands what they are, to six digits."""
    text = (GENERATED / test_of.drive.name / f"{test_of.p}_selftest.c").read_text()
    comments = re.findall(r"/\* (\d+): (.*?) -> (.*?) \*/", re.sub(r"\n\s+", " ", text))
    assert [int(number) for number, _, _ in comments] == list(range(1, len(test_of.expected) + 1))
    first, second = (("phase", "A"), ("command", "rad/s, V")) if test_of.controller else (("u", "V"), ("y", "A"))
    for (_, given, found), values, expected in zip(comments, test_of.inputs, test_of.expected, strict=True):
        parts = re.fullmatch(rf"{first[0]} = (.*) {first[1]}; {second[0]} = (.*) {second[1]}", given)
        assert parts is not None
        said = [float(item) for part in parts.groups() for item in part.split(", ")]
        assert said == pytest.approx(values.tolist(), rel=1e-5, nan_ok=True)
        said = [float(item) for item in re.split(", | [|] ", found)]
        assert said == pytest.approx(expected.tolist(), rel=1e-5)
