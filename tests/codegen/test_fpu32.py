"""The model of the chip's arithmetic: its own claims, the hardware's flush to zero, and the generated code on it."""

from __future__ import annotations

import ctypes
import platform
from typing import Any

import numpy as np
import pytest

from codegen.evidence.fpu32 import FPU32, TINY, Flushed, divide, flush, inverse_root_seed, reciprocal_seed, square_root
from model.machines.state_space import build
from model.schema import Drive
from runtime.estimator.compiler import build_library
from runtime.estimator.folder import GENERATED, GeneratedFolder

pytestmark = pytest.mark.unit

F = np.float32


def ulps(found: np.ndarray, exact: np.ndarray) -> np.ndarray:
    """Units in the last place between a result and the correctly rounded one."""
    nearest = exact.astype(F)
    return np.asarray((found.astype(float) - nearest.astype(float)) / np.spacing(np.abs(nearest)).astype(float))


def mantissas() -> np.ndarray:
    """Every float32 in [1, 2)."""
    return np.asarray((2**23 + np.arange(2**23)) / 2**23, dtype=F)


def arguments(count: int = 500_000, exponent: int = 40) -> np.ndarray:
    rng = np.random.default_rng(7)
    return np.asarray(rng.uniform(1, 2, count) * 2.0 ** rng.integers(-exponent, exponent, count), dtype=F)


def test_division_is_within_three_units_and_half_exact() -> None:
    """1 million random quotients over 160 binades: 3 ulp is what two Newton steps and a product can lose."""
    a, b = arguments(), -arguments()[::-1]
    off = ulps(divide(a, b), a.astype(float) / b)
    assert np.max(np.abs(off)) <= 3
    assert 0.45 < np.mean(off == 0) < 0.6
    assert abs(np.mean(off)) < 0.1, "no bias to speak of"


def test_every_reciprocal_is_within_two_units() -> None:
    x = mantissas()
    assert np.max(np.abs(ulps(divide(np.ones_like(x), x), 1 / x.astype(float)))) <= 2


@pytest.mark.parametrize("octave", [1, 2])
def test_every_root_is_within_three_units(octave: int) -> None:
    """Exhaustive: both parities of the exponent, every mantissa."""
    x = mantissas() * F(octave)
    off = ulps(square_root(x), np.sqrt(x.astype(float)))
    assert np.max(np.abs(off)) <= 3
    assert 0.45 < np.mean(off == 0) < 0.65


def test_seeds_have_eight_bits_and_a_table() -> None:
    """About 7 bits right, 7 bits long, and powers of two exact."""
    x = mantissas()
    for seed, exact in ((reciprocal_seed(x), 1 / x.astype(float)), (inverse_root_seed(x), x.astype(float) ** -0.5)):
        assert np.max(np.abs(seed / exact - 1)) < 2.0**-6.5
        assert np.unique(seed).size <= 128
        assert np.all(seed * 2.0**8 == np.round(seed * 2.0**8))
    powers = F(2.0) ** np.arange(-120, 120).astype(F)
    assert np.array_equal(reciprocal_seed(powers), 1 / powers)
    squares = powers[60:-60] ** 2
    assert np.array_equal(inverse_root_seed(squares), 1 / powers[60:-60])


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        (1.0, 0.0, np.inf),
        (-1.0, 0.0, -np.inf),
        (1.0, np.inf, 0.0),
        (0.0, 3.0, 0.0),
        (1.0, 1e-40, np.inf),  # a denormal divisor is a zero
        (1e-40, 1e-20, 0.0),  # and so is a denormal numerator
        (1.0, 2.0**126, 2.0**-126),
        (1.0, 2.0**127, 0.0),  # its reciprocal is denormal
        (1e30, 1e-30, np.inf),
        (1e-30, 1e30, 0.0),
        (np.nan, 1.0, np.nan),
        (1.0, np.nan, np.nan),
    ],
)
def test_edges_of_division(a: float, b: float, expected: float) -> None:
    with np.errstate(all="ignore"):
        for found in (FPU32(a) / FPU32(b), (FPU32(np.array([a, a])) / b)[0]):
            assert np.array_equal(float(found), expected, equal_nan=True)


@pytest.mark.parametrize(
    ("x", "expected"), [(0.0, 0.0), (1e-40, 0.0), (-1.0, np.nan), (np.inf, np.inf), (4.0, 2.0), (np.nan, np.nan)]
)
def test_edges_of_the_root(x: float, expected: float) -> None:
    with np.errstate(all="ignore"):
        for found in (np.sqrt(FPU32(x)), np.sqrt(FPU32(np.array([x])))[0]):
            assert np.array_equal(float(found), expected, equal_nan=True)


def test_root_below_twice_the_smallest_normal_is_known_to_fail() -> None:
    """x / 2 is flushed there: the docstring says so, and nothing nearer to 1 is affected."""
    with np.errstate(all="ignore"):
        assert float(np.sqrt(FPU32(TINY))) > 2 * np.sqrt(float(TINY))
    assert abs(ulps(square_root(np.array([2 * TINY])), np.sqrt([2.0**-125]))[0]) <= 3


def test_nan_compares_as_infinity() -> None:
    nan, two = FPU32(np.nan), FPU32(2.0)
    assert (nan > two, nan < two, two < nan, nan >= nan, -nan < two) == (True, False, True, True, True)
    lanes = FPU32(np.array([np.nan, 1.0]))
    assert np.array_equal(lanes <= 2.0, [False, True])
    assert np.array_equal(F(2) > lanes, [False, True])


@pytest.mark.parametrize("cls", [Flushed, FPU32])
def test_scalars_and_lanes_give_the_same_bits(cls: type[Flushed]) -> None:
    rng = np.random.default_rng(3)
    a, b = (np.asarray(rng.normal(0, 10.0 ** rng.integers(-20, 20, 200)), dtype=F) for _ in range(2))
    for operation in (
        lambda x, y: x + y,
        lambda x, y: x - y,
        lambda x, y: 2.5 * x * y,
        lambda x, y: 1.0 - x / y,
        lambda x, y: np.sqrt(x * x) + F(3) - y,
        lambda x, y: np.where(x < y, x, -y)[()],
    ):
        with np.errstate(all="ignore"):
            lanes = operation(cls(a), cls(b)).value
            scalars = np.array([operation(cls(x), cls(y)).value for x, y in zip(a, b, strict=True)])
        assert lanes.dtype == scalars.dtype == F
        assert np.array_equal(lanes.view(np.uint32), scalars.view(np.uint32))


def test_what_the_model_does_not_know_is_refused() -> None:
    with pytest.raises(TypeError):
        np.exp(FPU32(1.0))
    with pytest.raises(TypeError):
        np.add.reduce(FPU32(np.ones(3)))


FTZ = """
#include <xmmintrin.h>
void run(const float *a, const float *b, int n, float *r)
{
    unsigned int before = _mm_getcsr();
    int k;
    _mm_setcsr(before | 0x8040u); /* flush results to zero, read denormals as zero */
    for (k = 0; k < n; k++) {
        r[k] = a[k] + b[k];
        r[n + k] = a[k] * b[k];
        r[2 * n + k] = a[k] / b[k];
    }
    _mm_setcsr(before);
}
"""


@pytest.mark.process
def test_flush_to_zero_is_that_of_real_hardware() -> None:
    """The host's own flush-to-zero mode, operation by operation, on numbers around the smallest normal one."""
    if platform.machine() not in {"x86_64", "AMD64"}:
        pytest.skip("flush to zero is set through x86's MXCSR")
    rng = np.random.default_rng(5)
    n = 20_000
    a, b = (np.asarray(rng.normal(0, 1, n) * 2.0 ** rng.integers(-149, 20, n), dtype=F) for _ in range(2))
    b[::7] = a[::7] * F(-1.0000001)
    library = ctypes.CDLL(str(build_library({"ftz.c": FTZ}, {}, ("-O1",))))
    result = np.empty(3 * n, dtype=F)
    pointer = ctypes.POINTER(ctypes.c_float)
    library.run(*(v.ctypes.data_as(pointer) for v in (a, b)), ctypes.c_int(n), result.ctypes.data_as(pointer))
    with np.errstate(all="ignore"):
        x, y = Flushed(a), Flushed(b)
        model = np.concatenate([(x + y).value, (x * y).value, (x / y).value])
    assert np.sum(np.abs(a) < TINY) > 1000
    assert np.sum(model == 0) > 1000
    same = (model.view(np.uint32) == result.view(np.uint32)) | (np.isnan(model) & np.isnan(result))
    # Hardware may round up to the smallest normal before it decides what is denormal.
    assert np.all(same | (np.maximum(np.abs(model), np.abs(result)) <= TINY))


def test_generated_code_runs_on_it_unchanged(drive: Drive) -> None:
    """The same module, the same lanes: flushing alone changes no bit in the box, Newton steps change few."""
    from codegen.evidence.box import sample_box
    from codegen.evidence.certificate import one_step

    module: dict[str, Any] = vars(GeneratedFolder(GENERATED / drive.name).module)
    model = build(drive)
    box = sample_box(drive, model, 50)
    for kind in module["KINDS"]:
        host, host_P = one_step(module, kind, box, "float32")
        flushed, _ = one_step(module, kind, box, "float32", Flushed)
        with np.errstate(all="ignore"):
            chip, chip_P = one_step(module, kind, box, "float32", FPU32)
        assert np.array_equal(flushed, host)
        assert not np.array_equal(chip_P, host_P)
        assert np.allclose(chip, host, rtol=1e-4, atol=1e-3)


def test_a_rejected_lane_runs_on_it_too(drive: Drive) -> None:
    """NaN, infinite and far inputs: selections between lanes, and the guard's comparisons, as on the host."""
    module: dict[str, Any] = vars(GeneratedFolder(GENERATED / drive.name).module)
    kind = module["KINDS"][0]
    y = np.array([[0.1, np.nan, np.inf, 1e9], [0.2, 0.2, 0.2, 0.2]], dtype=F)
    statuses = []
    for number in (lambda value: value, FPU32):
        lanes = np.ones(4, dtype=F)
        state = module["new_filter"](lambda value, number=number, lanes=lanes: number(F(value) * lanes))
        with np.errstate(all="ignore"):
            status = module["STEPS"][kind](
                state, (number(lanes), number(lanes)), tuple(number(row) for row in y), module["MATH"]["float32"]
            )
        statuses.append(status & 1)
        assert np.all(np.isfinite(np.array(state.x, dtype=float)))
    assert np.array_equal(statuses[0], [0, 1, 1, 1])
    assert np.array_equal(statuses[0], statuses[1])


def test_flush_keeps_what_is_normal() -> None:
    values = np.array([0.0, -0.0, 1e-45, -1e-39, TINY, -TINY, 1.0, np.inf, np.nan], dtype=F)
    found = flush(values)
    assert np.array_equal(found, [0, 0, 0, 0, TINY, -TINY, 1, np.inf, np.nan], equal_nan=True)
    assert [flush(value) for value in values[:6]] == list(found[:6])
    assert np.signbit(found[3])


def test_the_self_tests_allowance_covers_the_model(drive: Drive) -> None:
    """The firmware's self-test passes on the chip: the recorded steps again, with the model's / and root."""
    from codegen.evidence.recording import execute, record_filter, run_filter
    from codegen.evidence.selftest import segments
    from model.machines.state_space import build

    text = (GENERATED / drive.name / f"{drive.name}.py").read_text()
    runs = segments(drive, build(drive))
    chip = execute(text, "chip", divide=lambda a, b: divide(F(a), b), root=square_root)
    with np.errstate(all="ignore"):
        for kind in chip["KINDS"]:
            recording = record_filter(text, kind, runs)
            status, _, words = (array[..., 0] for array in run_filter(chip, kind, runs, 1))
            off = np.abs(words.astype(float) - recording.words.astype(float))
            assert np.all(off <= 2.0 ** (recording.allowed.astype(float) - 127))
            assert np.any(off > 0)
            assert np.array_equal(status & 1, recording.status & 1)  # convergence may be judged otherwise
