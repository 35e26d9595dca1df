"""PMSM_RECIPROCAL: the port header's macro, and a filter in which it is a seed and two Newton steps.

The seed is EINVF32's as :mod:`codegen.evidence.fpu32` models it, in C; measured on the host, not on the chip.
"""

from __future__ import annotations

import re
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from codegen.evidence.fpu32 import divide
from codegen.evidence.ledger import RECIPROCAL
from codegen.generate import count
from model.drives.load import load_drive
from runtime.estimator.compiler import build_library
from runtime.estimator.folder import GENERATED, GeneratedFolder
from runtime.firmware.cortex_m import boards
from runtime.firmware.host import run_on_host
from runtime.firmware.link_ef import compare
from runtime.firmware.recording import Recording, Segment
from runtime.firmware.subject import Subject, subjects
from runtime.proof.own_trajectory import trajectory_of
from tests.conftest import ALL_DRIVES, DRIVES, thoroughly
from tests.target.need import need

#: A seed of 8 bits from a table's formula, and two Newton steps in float32: what a C28x does with EINVF32 in line.
SEEDED = """
static float seed_of(float x)
{
    union { float value; unsigned long bits; } s;
    union { float value; unsigned int bits; } w;
    unsigned int mantissa;
    int exponent;
    double seed;
    s.bits = 0UL;
    w.value = x;
    mantissa = (w.bits >> 16) & 0x7FU;
    exponent = (int)((w.bits >> 23) & 0xFFU) - 127;
    seed = 2.0 / (1.0 + (double)mantissa / 128.0); /* in (1, 2] */
    mantissa = (unsigned int)(128.0 * (seed - 1.0) + 0.5);
    w.bits = (w.bits & 0x80000000U) | ((unsigned int)(127 - 1 - exponent) << 23);
    s.value = w.value;
    return s.value * (float)(1.0 + (double)mantissa / 128.0);
}

static float seeded(float x)
{
    float y = seed_of(x);
    y = y * (2.0f - y * x);
    y = y * (2.0f - y * x);
    return y;
}
#define PMSM_RECIPROCAL(x) seeded(x)
"""
#: Units in the last place by which the reciprocal may be off the rounded one, over every mantissa.
UNITS = 2
#: Sigmas of P by which a filter with it may part from the default's, running free over the trajectory. Measured: 8.4e-6
#: (`paper_spmsm`) to 6.6e-4, and 8.7e-3 of `ipmsm_adaptive`, which learns R and psi_m.
SIGMAS, OF = 2e-3, {"ipmsm_adaptive": 2e-2}

ALL_MANTISSAS = """
float reciprocal_of(float x);
float reciprocal_of(float x) { return PMSM_RECIPROCAL(x); }
void fill(const float *x, float *y, int n);
void fill(const float *x, float *y, int n)
{
    int k;
    for (k = 0; k < n; k++) {
        y[k] = PMSM_RECIPROCAL(x[k]);
    }
}
"""


def seeded(subject: Subject, header: str = SEEDED) -> Subject:
    """The filter whose port header comes behind a definition of the macro."""
    return replace(subject, sources={**subject.sources, "pmsm_port.h": header + subject.sources["pmsm_port.h"]})


def filters(drive: str) -> list[Subject]:
    return [subject for subject in subjects(GeneratedFolder(GENERATED / drive)) if subject.part == ""]


def along(drive: str, steps: int) -> Recording:
    """Steps of the proof's trajectory."""
    data = trajectory_of(load_drive(drive), steps)
    return Recording((Segment(np.column_stack([data.u, data.y])),))


# --- the macro


@pytest.mark.parametrize("drive", ALL_DRIVES)
def test_every_reciprocal_of_a_filter_goes_by_the_macro(drive: str) -> None:
    folder = GeneratedFolder(GENERATED / drive)
    for kind in folder.kinds:
        text = re.sub(r"/\*.*?\*/", "", folder.text(f"{drive}_{kind}.c"), flags=re.DOTALL)
        assert not re.search(r"\b1\.0f / ", text)
        assert "PMSM_RECIPROCAL(" in text
        assert "PMSM_RECIPROCAL" not in folder.text(f"host/{drive}_{kind}_lanes.c")
    assert "#define PMSM_RECIPROCAL(x) (1.0f / (x))" in folder.text("pmsm_port.h")


def test_the_ledger_counts_what_the_macro_stands_for() -> None:
    drive = load_drive("paper_spmsm")
    folder = GENERATED / drive.name
    files = {path.name: path.read_text(encoding="utf-8") for path in folder.glob("*.[ch]")}
    operations = count(drive, files)["ickf"].filter.operations
    assert operations[RECIPROCAL] == files["paper_spmsm_ickf.c"].count("PMSM_RECIPROCAL(") == 4
    prices = count(drive, files)["ickf"].prices
    assert prices is not None
    cycles = prices.total(operations, prices.factors[0])
    inline = cycles - 4 * (prices.cycles["div"] - prices.reciprocal)
    assert f"ickf {inline} cycles at k = 2.5, **computed, not measured**" in (folder / "REPORT.md").read_text()
    files["paper_spmsm_ickf.c"] = files["paper_spmsm_ickf.c"].replace("PMSM_RECIPROCAL(var_first)", "2.0f / var_first")
    assert count(drive, files)["ickf"].filter.operations[RECIPROCAL] == 3


# --- a seed and two Newton steps


def reciprocals(x: np.ndarray, header: str = SEEDED) -> np.ndarray:
    """The C's reciprocals of float32."""
    import ctypes

    library = ctypes.CDLL(str(build_library({"seeded.c": header + ALL_MANTISSAS}, {})))
    y = np.empty_like(x)
    library.fill(x.ctypes.data_as(ctypes.c_void_p), y.ctypes.data_as(ctypes.c_void_p), len(x))
    return y


def units_off(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Numbers of the format between y and 1 / x rounded once: a quotient of float32 in double rounds as one."""
    rounded = (1.0 / x.astype(float)).astype(np.float32)
    assert np.array_equal(np.signbit(y), np.signbit(rounded))
    return np.abs(y.view(np.int32).astype(int) - rounded.view(np.int32))


def test_it_is_within_two_units_at_every_mantissa() -> None:
    x = np.arange(0x3F800000, 0x40000000, dtype=np.uint32).view(np.float32)
    assert len(x) == 2**23
    off = units_off(x, reciprocals(x))
    assert off.max() == UNITS
    share = np.bincount(off) / len(off)
    assert np.allclose(share, [0.581, 0.410, 0.009], atol=5e-4)
    rng = np.random.default_rng(1)
    anywhere = (rng.uniform(1, 2, 10_000) * 2.0 ** rng.integers(-100, 100, 10_000)).astype(np.float32)
    signed = np.where(rng.random(10_000) < 0.5, -anywhere, anywhere)
    assert units_off(signed, reciprocals(signed)).max() <= UNITS


def test_it_is_the_chips_as_modelled() -> None:
    rng = np.random.default_rng(2)
    x = (rng.uniform(1, 2, 20_000) * 2.0 ** rng.integers(-60, 60, 20_000)).astype(np.float32)
    assert np.array_equal(reciprocals(x), divide(np.ones_like(x), x))


def test_one_newton_step_is_not_enough() -> None:
    x = np.linspace(1, 2, 4096, endpoint=False, dtype=np.float32)
    once = SEEDED.replace("    y = y * (2.0f - y * x);\n", "", 1)
    assert units_off(x, reciprocals(x, once)).max() > 50


# --- in a filter


def deviation(subject: Subject, other: Subject, recording: Recording, drive: str) -> float:
    """Largest difference of x over the steps, in sigmas of P by the first."""
    module = GeneratedFolder(GENERATED / drive).module
    names = list(subject.words)
    at = [names.index(f"x[{k}]") for k in range(len(module.STATES))]
    own = [names.index(f"{module.COVARIANCE}[{k}]") for k in range(module.WORDS)]
    one, two = (run_on_host(s, recording).view(np.float32) for s in (subject, other))
    P = module.unpack(one[:, own].T.astype(float))
    sigma = np.sqrt(np.stack([P[i, i] for i in range(len(at))], axis=1))
    difference = (one[:, at] - two[:, at]).astype(float)
    turned = difference[:, module.ANGLE]
    difference[:, module.ANGLE] = np.remainder(turned + np.pi, 2 * np.pi) - np.pi
    return float(np.max(np.abs(difference) / sigma))


@pytest.mark.parametrize("drive", [*DRIVES, *thoroughly(*(name for name in ALL_DRIVES if name not in DRIVES))])
def test_a_filter_with_it_stays_with_the_default(drive: str) -> None:
    recording = along(drive, 10_000)
    for subject in filters(drive):
        found = deviation(subject, seeded(subject), recording, drive)
        assert 0.0 < found <= OF.get(drive, SIGMAS), f"{subject.name}: {found:.1e}"


def test_a_wrong_reciprocal_is_told_apart() -> None:
    (subject, *_) = filters("paper_spmsm")
    wrong = SEEDED.replace("    y = y * (2.0f - y * x);\n", "", 2)
    assert deviation(subject, seeded(subject, wrong), along("paper_spmsm", 2000), "paper_spmsm") > SIGMAS


def test_the_default_spelled_out_has_the_defaults_bits() -> None:
    (subject, *_) = filters("paper_spmsm")
    spelled = seeded(subject, "#define PMSM_RECIPROCAL(x) (1.0f / (x))\n")
    recording = along("paper_spmsm", 500)
    assert np.array_equal(run_on_host(subject, recording), run_on_host(spelled, recording))


def test_it_compiles_and_runs_on_a_cortex_m4() -> None:
    processor = boards()["cortex_m4f"]
    need(*processor.programs)
    (subject, *_) = filters("paper_spmsm")
    recording = along("paper_spmsm", 100)
    other = seeded(subject)
    assert compare(processor, other, recording, run_on_host(other, recording)).divergence is None
    assert compare(processor, other, recording, run_on_host(subject, recording)).divergence is not None


def test_the_header_of_the_page_is_c89(tmp_path: Path) -> None:
    """The page's own header, its instruction stood for by the seed above."""
    page = (Path(__file__).parents[2] / "docs" / "firmware.md").read_text(encoding="utf-8")
    found = re.search(r"```cpp\n(/\* my_reciprocal\.h.*?)```", page, re.DOTALL)
    assert found is not None
    seed = SEEDED.split("static float seeded")[0].replace("seed_of", "__einvf32")
    x = np.linspace(1, 2, 4096, endpoint=False, dtype=np.float32)
    assert np.array_equal(reciprocals(x, seed + found[1]), reciprocals(x))
    (tmp_path / "x.c").write_text(seed + found[1] + ALL_MANTISSAS)
    subprocess.run(["gcc", "-std=c89", "-pedantic", "-Wall", "-Werror", "-c", "x.c"], cwd=tmp_path, check=True)
