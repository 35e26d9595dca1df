"""TI's other targets: the TMU's instructions on a stub of its compiler, and the C subset of the CLA."""

from __future__ import annotations

import subprocess
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from codegen.evidence.ledger import Program
from codegen.evidence.tmu import PER_TURN, TMU32, cut, sin_cos
from codegen.generate import Package, generate
from codegen.output.folder import write_folder
from codegen.targets.find import find_target
from model.drives.load import load_drive
from runtime import load
from runtime.estimator.folder import GENERATED, GeneratedFolder
from runtime.firmware.static.subset import complaints, subset_checks
from runtime.folders.generate import for_target
from runtime.proof.link_text import link_text
from tests.conftest import thoroughly
from tests.target.need import need

TMU = ["f28379d", *thoroughly("f280049c")]
CLA = find_target("f2837x_cla")


@cache
def made_for(drive: str, target: str) -> Package:
    return generate(for_target(load_drive(drive), target), samples=50)


# --- the model of the TMU


def test_a_cut_number_is_the_next_one_towards_zero() -> None:
    exact = np.random.default_rng(1).normal(size=10_000) * 10.0 ** np.random.default_rng(2).uniform(-30, 30, 10_000)
    found = cut(exact)
    assert np.all(np.abs(found.astype(float)) <= np.abs(exact))
    assert np.all(np.abs(np.nextafter(found, np.copysign(np.float32(np.inf), found)).astype(float)) > np.abs(exact))
    assert cut(1e-39) == 0.0


def test_the_models_operations_are_off_by_less_than_a_unit() -> None:
    rng = np.random.default_rng(3)
    a, b = (rng.uniform(0.1, 10, 5000).astype(np.float32) for _ in range(2))
    quotient, root = (TMU32(a) / TMU32(b)).value, np.sqrt(TMU32(a)).value
    for found, exact in ((quotient, a.astype(float) / b), (root, np.sqrt(a.astype(float)))):
        off = (exact - found) / np.spacing(found)
        assert np.all((off >= 0) & (off < 1))
        assert np.max(off) > 0.9
    x = rng.uniform(-np.pi, np.pi, 5000).astype(np.float32)
    for found, exact in zip(sin_cos(TMU32(x)), (np.sin(x.astype(float)), np.cos(x.astype(float))), strict=True):
        assert 1e-7 < np.max(np.abs(found.value - exact)) < 5e-7  # the angle in turns is rounded, the result cut
    assert np.float32(1 / (2 * np.pi)) == PER_TURN


# --- the text that the chip's compiler reads


STUB = """
#include <math.h>
static float cut(double exact) {
    float f = (float)exact;
    return fabs((double)f) > fabs(exact) ? nextafterf(f, 0.0f) : f;
}
static float __divf32(float a, float b) { return cut((double)a / (double)b); }
#define __sqrt tmu_sqrt
static float tmu_sqrt(float x) { return cut(sqrt((double)x)); }
static float __sinpuf32(float x) { return cut(sin(6.283185307179586 * ((double)x - floor((double)x)))); }
static float __cospuf32(float x) { return cut(cos(6.283185307179586 * ((double)x - floor((double)x)))); }
"""
#: A unit more, away from zero, for sines; as TI says nothing of the side.
OTHER = STUB.replace("return cut(sin(", "return 1.0000002f * cut(sin(").replace(
    "return cut((double)a", "return 0.9999999f * cut((double)a"
)
MAIN = """
#include <stdio.h>
#include "{p}_selftest.h"
#include "{p}_foc_selftest.h"
int main(void) {{
    static {p}_t f; static {p}_foc_t c;
    printf("%d %d %d", {p}_selftest(&f, 1.0f), {p}_foc_selftest(&c, 1.0f), {p}_selftest(&f, 0.0f));
    return 0;
}}
"""


@pytest.mark.parametrize("stub", [STUB, OTHER], ids=["cut", "to the other side"])
@pytest.mark.parametrize(("drive", "target"), [("paper_spmsm", "f28379d"), *thoroughly(("ipmsm_flux", "f280049c"))])
def test_the_self_test_allows_what_the_tmu_is_expected_to_do(
    drive: str, target: str, stub: str, tmp_path: Path
) -> None:
    """The macros taken, with instructions of a stub: not the host's bits, and within what is recorded."""
    need("gcc")
    made, p = made_for(drive, target), f"{drive}_ickf"
    for name, text in made.files.items():
        if "/" not in name and name.endswith((".c", ".h")):
            (tmp_path / name).write_text(text)
    (tmp_path / "stub.h").write_text(stub)
    (tmp_path / "main.c").write_text(MAIN.format(p=p))
    sources = [f"{p}.c", f"{p}_foc.c", f"{p}_selftest.c", f"{p}_foc_selftest.c", "main.c"]
    command = ["gcc", "-O1", "-D__TMS320C28XX_TMU__", "-include", "stub.h", *sources, "-lm", "-o", "run"]
    subprocess.run(command, cwd=tmp_path, check=True)
    said = subprocess.run([str(tmp_path / "run")], capture_output=True, text=True, check=True).stdout.split()
    assert said[:2] == ["0", "0"]
    assert said[2] != "0"


@pytest.mark.parametrize("target", TMU)
def test_the_instructions_are_counted_where_they_are(target: str) -> None:
    """By the text: each macro of a filter's straight-line blocks is an instruction of the ledger."""
    made = made_for("paper_spmsm", target)
    counts = made.accounts["ickf"].filter.operations
    default = {path.name: path.read_text() for path in (GENERATED / "paper_spmsm").glob("*.[ch]")}
    program, n_max = Program(default, "paper_spmsm_ickf.c"), made.drive.filter.max_iterations
    usual = program.count("paper_spmsm_ickf_step", n_max, aside=frozenset({"sin_cos"}))
    assert counts["sine"] == 2 * usual["sincos"]
    assert (counts["div"], counts["sqrt"]) == (usual["div"], usual["sqrt"])
    assert counts["mul"] == usual["mul"] + usual["sincos"]
    assert all(counts[name] == usual[name] for name in ("add", "compare", "select", "branch", "call"))
    prices = find_target(target).prices
    assert prices is not None
    numbers = sum(counts[name] for name in ("add", "mul", "compare", "select"))
    jumps = 7 * counts["branch"] + 12 * counts["call"]
    cycles = 2.5 * numbers + 5 * counts["div"] + 4 * counts["sine"] + jumps + 60
    assert prices.total(counts, 2.5) == round(cycles)
    assert f"estimated {round(cycles)} cycles on C28x + FPU32 + TMU" in made.files["paper_spmsm_ickf.c"]


def test_without_the_tmu_the_port_header_refuses(tmp_path: Path) -> None:
    need("gcc")
    (tmp_path / "pmsm_port.h").write_text(made_for("paper_spmsm", "f28379d").files["pmsm_port.h"])
    (tmp_path / "x.c").write_text('#include "pmsm_port.h"\n')
    command = ["gcc", "-D__TMS320C28XX__", "-D__TMS320C28XX_FPU32__", "-c", "x.c"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "compile with --tmu_support=tmu0" in done.stderr


# --- the CLA's subset


def test_the_clas_text_keeps_the_rules(tmp_path: Path) -> None:
    made = made_for("ipmsm_flux", "f2837x_cla")
    write_folder(tmp_path / "d", made.files)
    (check,) = subset_checks(tmp_path / "d")
    assert (check.state, check.figure) == ("passed", "0 found in 8 files")
    assert "not run" in check.how
    assert subset_checks(GENERATED / "ipmsm_flux") == []  # a target without a subset


@pytest.mark.parametrize(
    ("planted", "said"),
    [
        ("static int f(int k) { return f(k - 1); }", "'f' calls itself"),
        (
            "static int g(int k); static int f(int k) { return g(k); } static int g(int k) { return f(k); }",
            "calls itself",
        ),
        ("typedef int (*function)(int);", "a pointer to a function"),
        ("static int f(int (*g)(int)) { return (*g)(1); }", "a call through a pointer"),
        ("static float f(float x) { return sinf(x); }", "a call of 'sinf', which is of a library"),
        ("static float x = 1.0f;", "'x' is initialised and not const"),
        ("static int f(void) { static int k; return k; }", "'k' is a static variable of a function"),
        ("static double x;", "the type double"),
        ("typedef unsigned long long wide;", "the type long long"),
        ("static int f(int a, int b) { return a / b; }", "the operator /"),
        ("static int f(int a, int b) { return a % b; }", "the operator %"),
        ("static int f(unsigned a, int b) { return a < b; }", "an unsigned comparison"),
        ("static int f(int b) { return b > 3U; }", "an unsigned comparison"),
        ("static int f(void) { goto ; }", "cannot be read as C"),
    ],
)
def test_what_the_cla_has_not_is_found(planted: str, said: str) -> None:
    found = complaints({"x.c": planted}, "x.c", CLA)
    assert any(said in line for line in found), found


def test_what_the_cla_has_is_not_complained_of() -> None:
    text = """
    #define PMSM_DIV(a, b) CLAdiv((a), (b))
    float CLAdiv(float a, float b);
    typedef struct { long k; float x[3]; } s;
    static const float table[2] = {1.0f, 2.0f};
    static s state;
    static float f(s *p, int n)
    {
        int k;
        for (k = 0; k < n; k++) { p->x[k] = PMSM_DIV(p->x[k], table[0]); }
        return p->x[0];
    }
    float g(void); float g(void) { return f(&state, 3); }
    """
    assert complaints({"x.c": text}, "x.c", CLA) == []


@pytest.mark.parametrize("target", ["f28379d", "f2837x_cla"])
def test_a_folder_of_a_target_with_macros_is_read_and_run_on_the_host(target: str, tmp_path: Path) -> None:
    """Link "text" takes the macros for the operators they stand for; the C runs."""
    need("gcc")
    write_folder(tmp_path / "d", made_for("paper_spmsm", target).files)
    assert link_text(GeneratedFolder(tmp_path / "d"), "ickf", "cubature").passed
    found = load(str(tmp_path / "d"), filter="ickf", backend="c").step([10.0, 0.0], [0.1, 0.0])
    assert np.all(np.isfinite(found))


def test_the_clas_guard_accepts_what_the_others_accept(tmp_path: Path) -> None:
    """Bits without the sign as signed numbers: each side of the limit, of both signs, and what is no number."""
    need("gcc")
    write_folder(tmp_path / "d", made_for("paper_spmsm", "f2837x_cla").files)
    ours = load(str(tmp_path / "d"), filter="ickf", backend="c")
    limit = np.float32(GeneratedFolder(tmp_path / "d").module.DEFAULTS["u_max"])
    beside = [np.nextafter(limit, np.float32(way)) for way in (0, np.inf)]
    for value in (limit, *beside, np.inf, np.nan, 0.0):
        for signed in (value, -value):
            ours.reset()
            status = ours.run(np.array([[signed, 0.0]]), np.zeros((1, 2))).status[0]
            assert bool(status & 1) is not bool(np.abs(value) <= limit), signed  # INPUT_REJECTED


def test_other_bits_of_an_input_are_not_its_size(tmp_path: Path) -> None:
    """A mask that drops a bit of the number's: link "text" does not understand it."""
    files = dict(made_for("paper_spmsm", "f2837x_cla").files)
    name = "paper_spmsm_ickf.c"
    assert files[name].count("0x7FFFFFFFUL") == 1
    files[name] = files[name].replace("0x7FFFFFFFUL", "0x7FFFFFFEUL")
    write_folder(tmp_path / "d", files)
    assert not link_text(GeneratedFolder(tmp_path / "d", checked=False), "ickf", "cubature").passed
