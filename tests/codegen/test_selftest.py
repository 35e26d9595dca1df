"""The self-test in C: it passes where it must, names the first wrong word of a wrong filter, and allows the chip's
division and square root no more than their due.

Oracles that share nothing with it: the C back end's runner finds the first difference of a mutant by itself, and the
chip's Newton steps are modelled here from their published seeds.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from codegen.evidence.recording import Recording, execute, record_control, record_filter, run_control, run_filter
from codegen.evidence.selftest import BEYOND, NOT_A_NUMBER, Segment, control_run, gains, segments
from model.drives.load import load_drive
from model.machines.state_space import build
from model.schema import Drive
from runtime.estimator.c_backend import CBackend
from runtime.estimator.folder import GENERATED, GeneratedFolder
from tests.codegen.strict import STRICT
from tests.conftest import thoroughly

MAIN = """
#include <stdio.h>
#include "{p}_selftest.h"
static {p}_t work;
int main(void)
{{
    printf("%d %d\\n", {p}_selftest(&work, PMSM_SELFTEST_TOLERANCE), {p}_selftest(&work, 1.0f));
    return 0;
}}
"""


def _run(folder: Path, p: str, build: Path, *flags: str) -> tuple[int, int]:
    """The self-test's answers: exact, and with the C28x's tolerance."""
    (build / "main.c").write_text(MAIN.format(p=p))
    names = {p, f"{p}_selftest", p.removesuffix("_foc")}
    sources = [str(folder / f"{name}.c") for name in sorted(names)]
    command = ["gcc", *STRICT, *flags, f"-I{folder}", str(build / "main.c"), *sources, "-o", str(build / "t"), "-lm"]
    subprocess.run(command, check=True, capture_output=True, text=True)
    exact, tolerant = subprocess.run([build / "t"], check=True, capture_output=True, text=True).stdout.split()
    return int(exact), int(tolerant)


@pytest.fixture
def runs(drive: Drive) -> list[Segment]:
    return segments(drive, build(drive))


def _module(drive: Drive) -> str:
    return (GENERATED / drive.name / f"{drive.name}.py").read_text()


@pytest.mark.parametrize(
    "optimisation", [("-O2",), *thoroughly((("-O0",),), (("-O3", "-march=native"),))], ids=" ".join
)
def test_passes_on_the_host(drive: Drive, optimisation: tuple[str, ...], tmp_path: Path) -> None:
    for kind in drive.filter.kinds:
        for p in (f"{drive.name}_{kind}", f"{drive.name}_{kind}_foc"):
            assert _run(GENERATED / drive.name, p, tmp_path, *optimisation) == (0, 0)


def test_every_input_is_a_float32_and_two_are_rejected(drive: Drive, runs: list[Segment]) -> None:
    """The generated text must not hang on the last bit of a platform's cosine: 12 binary digits."""
    for run in runs:
        for values in (run.x_0, run.u, run.y):
            mantissa = np.frexp(values[np.isfinite(values)])[0] * 2**12
            assert np.array_equal(mantissa, np.round(mantissa))
        assert np.array_equal(run.P_0, run.P_0.astype(np.float32))
    for kind in drive.filter.kinds:
        status = record_filter(_module(drive), kind, runs).status
        assert np.flatnonzero(status & 1).tolist() == [BEYOND, NOT_A_NUMBER]


# --- mutants


def _off_by(units: int) -> Callable[[re.Match[str]], str]:
    """A literal as many float32 numbers further on."""

    def change(match: re.Match[str]) -> str:
        value = np.float32(match.group(2).rstrip("f;"))
        text = str((value.view(np.int32) + np.int32(units)).view(np.float32))
        return f"{match.group(1)}{text if '.' in text or 'e' in text else text + '.0'}f"

    return change


def _constant(name: str, units: int) -> Callable[[str], str]:
    return lambda text: re.sub(rf"(#define {name} )(\S+f)", _off_by(units), text, count=1)


def _sign(nth: float) -> Callable[[str], str]:
    """A plus where there was a minus, in the nth (share) of the locals that have one."""

    def change(text: str) -> str:
        places = [match.start(1) for match in re.finditer(r"^    const float32 \w+ = [^;]*?( - )", text, re.MULTILINE)]
        at = places[int(nth * len(places))]
        return text[:at] + " + " + text[at + 3 :]

    return change


MUTANTS: dict[str, Callable[[str], str]] = {
    "dropped Q": lambda text: re.sub(r"\bQ\[(\d)\];", r"0.0f * Q[\1];", text),
    # One unit may vanish where Q is added to a larger P; of two, one is left.
    "Q of the angle off by a bit": lambda text: re.sub(r"(f->Q\[3\] = )([^;]+)", _off_by(2), text, count=1),
    "sine's first coefficient": lambda text: text.replace("-0.04166664f", "-0.04166665f", 1),
    "sign, early": _sign(0.12),
    "sign, middle": _sign(0.5),
    "sign, late": _sign(0.95),
    "bad input taken": lambda text: text.replace("size_of(value[0]) <= most", "size_of(0.0625f * value[0]) <= most", 1),
    "held voltage lost": lambda text: text.replace("f->u_held[1] = u[1];", "f->u_held[1] = 0.0f;", 1),
}


def _mutant(drive: Drive, kind: str, change: Callable[[str], str], folder: Path) -> Path:
    shutil.copytree(GENERATED / drive.name, folder, dirs_exist_ok=True)
    path = folder / f"{drive.name}_{kind}.c"
    text = path.read_text()
    path.write_text(change(text))
    assert path.read_text() != text, "the mutation found its place"
    return folder


def _first_difference(folder: Path, kind: str, runs: list[Segment], recording: Recording) -> int:
    """The same verdict by another way: the C back end's runner, and a search in NumPy."""
    backend = CBackend(GeneratedFolder(folder, checked=False), kind, "float32", ("-O0",))
    vector = 0
    for run in runs:
        n = len(run.x_0)
        backend.reset(run.x_0.astype(np.float32), np.diag(run.P_0.astype(np.float32))[np.tril_indices(n)])
        x, P, iterations, status = backend.run(run.u.astype(np.float32), run.y.astype(np.float32))
        words = np.concatenate([x, P], axis=1).view(np.uint32)
        for k in range(len(run.u)):
            if status[k] != recording.status[vector]:
                return 100 * (vector + 1) + 1
            if iterations[k] != recording.iterations[vector]:
                return 100 * (vector + 1) + 2
            different = np.flatnonzero(words[k] != recording.words[vector].view(np.uint32))
            if different.size:
                return 100 * (vector + 1) + int(different[0] + (10 if different[0] < n else 20 - n))
            vector += 1
    return 0


@pytest.mark.parametrize("mutation", MUTANTS)
@pytest.mark.parametrize("name", ["paper_spmsm", *thoroughly("ipmsm_flux")])
def test_a_wrong_filter_is_caught_at_its_first_wrong_word(name: str, mutation: str, tmp_path: Path) -> None:
    drive = load_drive(name)
    runs = segments(drive, build(drive))
    folder = _mutant(drive, "ickf", MUTANTS[mutation], tmp_path / "m")
    exact, tolerant = _run(folder, f"{name}_ickf", tmp_path, "-O0", "-Wno-error")
    assert exact == _first_difference(folder, "ickf", runs, record_filter(_module(drive), "ickf", runs))
    if mutation == "sine's first coefficient":
        assert exact >= 100, "the self-test's own copy of sin_cos is right; the filter's is not"
    assert exact != 0
    if "bit" not in mutation and "coefficient" not in mutation:
        assert tolerant != 0, "what is allowed the chip is far smaller than a wrong formula"


@pytest.mark.parametrize("name", ["paper_spmsm", *thoroughly("ipmsm_flux")])
def test_the_last_bit_of_a_constant_counts(name: str, tmp_path: Path) -> None:
    """Motor data folded into the filter. A few are added to something so much larger that their last bits vanish in
    its rounding; those are seen from 2^12 units on. One that only says how far a column of L turns the angle enters a
    square that is small beside 1, and need not be seen at all. One that scales what the bend of f adds to P, of second
    order, is seen from 2^16 units (0.4 to 0.8 %) on."""
    drive = load_drive(name)
    kind = drive.filter.kinds[-1]
    p = f"{drive.name}_{kind}"
    names = re.findall(
        r"#define ((?!SMALL_TURN|UNKNOWN_TURN|ROUND_EVEN|SANE_LIMIT|PER_SANE_LIMIT)\w+) \S+f /\* ",
        (GENERATED / drive.name / f"{p}.c").read_text(),
    )
    assert len(names) >= 6

    def unseen(among: list[str], units: int) -> list[str]:
        folders = {name: _mutant(drive, kind, _constant(name, units), tmp_path / f"{name}{units}") for name in among}
        return [name for name, folder in folders.items() if _run(folder, p, tmp_path, "-O0")[0] == 0]

    small = unseen(names, 1)
    assert len(small) <= len(names) // 2
    text = (GENERATED / drive.name / f"{p}.c").read_text()
    turns = re.search(r"_turns\(float32.*?\n}\n", text, re.DOTALL)
    elsewhere = text.replace(turns.group(), "") if turns else text
    seen_elsewhere = [name for name in small if len(re.findall(rf"\b{name}\b", elsewhere)) > 1]
    late = unseen(seen_elsewhere, 4096)
    bends = "".join(s for s in re.findall(r"const float32 \w*P_\w+ = [^;]*;", elsewhere) if re.search("dev_|curv_", s))
    assert [name for name in late if name not in bends] == []
    assert unseen(late, 2**16) == []


def test_fused_multiply_add_is_caught(drive: Drive, tmp_path: Path) -> None:
    if "fma" not in Path("/proc/cpuinfo").read_text():
        pytest.skip("not run: this processor has no fused multiply-add")
    p = f"{drive.name}_ickf"
    assert _run(GENERATED / drive.name, p, tmp_path, "-O2", "-march=native", "-ffp-contract=fast")[0] != 0


def test_an_approximate_square_root_is_told_from_a_wrong_filter(drive: Drive, tmp_path: Path) -> None:
    """Exact: vector 0, stage 2. With the tolerance it passes, and a coarse root does not."""
    p = f"{drive.name}_ickf"
    near, coarse = (f"-DPMSM_SQRT(x)=(__builtin_sqrtf(x)*{factor}f)" for factor in ("1.0000002", "1.0001"))
    assert _run(GENERATED / drive.name, p, tmp_path, "-O2", near) == (2, 0)
    assert _run(GENERATED / drive.name, p, tmp_path, "-O2", coarse) == (2, 2)


# --- the chip's division and square root, modelled from their published seeds


def _seed(value: np.ndarray) -> np.ndarray:
    """Eight bits of a positive number."""
    mantissa, exponent = np.frexp(value)
    return np.ldexp(1 + np.floor(128 * (2 * mantissa - 1) + 0.5) / 128, exponent - 1).astype(np.float32)


def _truncated(value: np.ndarray) -> np.ndarray:
    mantissa, exponent = np.frexp(np.asarray(value, dtype=float))
    return np.ldexp(np.floor(256 * mantissa) / 256, exponent)


def _chip_divide(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    a, b = np.float32(a), np.float32(b)
    y = np.sign(b) * _seed(1 / _truncated(np.abs(b)))
    for _ in range(2):
        y = y * (np.float32(2) - y * b)
    return np.asarray(a * y)


def _chip_root(x: np.ndarray) -> np.ndarray:
    x = np.float32(x)
    y = _seed(1 / np.sqrt(_truncated(x)))
    for _ in range(2):
        y = y * (np.float32(1.5) - y * y * (x * np.float32(0.5)))
    return np.asarray(x * y)


def test_model_of_the_chip_is_within_three_units() -> None:
    """The recording's assumption on a division and on a square root."""
    rng = np.random.default_rng(0)
    a, b = (np.exp(rng.uniform(-20, 20, 200_000)).astype(np.float32) for _ in range(2))
    quotient, root = a.astype(float) / b, np.sqrt(a.astype(float))
    for found, exact in ((_chip_divide(a, b), quotient), (_chip_root(a), root)):
        units = np.abs(found - exact) / np.spacing(exact.astype(np.float32)).astype(float)
        assert 0.5 < np.max(units) <= 3.0


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_the_chip_passes_with_the_tolerance_and_not_without(drive: Drive, runs: list[Segment]) -> None:
    """On the modelled chip every word stays within a quarter of what is allowed, and not every word has its bits.

    With seven states, some of them learnt, the controller's words need up to half of it.
    """
    most = 0.5 if drive.model.adaptive else 0.25
    module = _module(drive)
    chip = execute(module, "chip", divide=_chip_divide, root=_chip_root)
    control = control_run(drive)
    for kind in drive.filter.kinds:
        expected = record_filter(module, kind, runs)
        found = run_filter(chip, kind, runs, 1)[2][..., 0]
        share = np.abs(found.astype(float) - expected.words) / 2.0 ** (expected.allowed - 127.0)
        assert 0.0 < np.max(share) <= most
        values = gains(drive, control.delay).values
        expected = record_control(module, kind, control, values)
        found = run_control(chip, kind, control, values, 1)[1][..., 0]
        share = np.abs(found.astype(float) - expected.words) / 2.0 ** (expected.allowed - 127.0)
        assert 0.0 < np.max(share) <= most
