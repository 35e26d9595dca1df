"""EVA's verdict on small C, on the box it starts from, and on the filters."""

from __future__ import annotations

import shutil
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from codegen.ir.trig import sin_cos_bound
from codegen.output.folder import read_manifest
from model.schema import Drive
from runtime.estimator.folder import GENERATED
from runtime.firmware.gates import Gated
from runtime.firmware.static.bans import NotCError
from runtime.firmware.static.box import MARGIN, Interval, filter_box
from runtime.firmware.static.check import Check
from runtime.firmware.static.eva import (
    SHOWN,
    analyse,
    analyse_step,
    driver,
    eva_check,
    eva_checks,
    with_bounds,
    with_contract,
)
from tests.codegen.strict import need

PORT = GENERATED / "paper_spmsm"

SNIPPET = """#include "pmsm_port.h"
#include "__fc_builtin.h"
static float32 larger(float32 a, float32 b)
{{
    return (a > b) ? a : b;
}}
int proof(void);
int proof(void)
{{
    const float32 a = Frama_C_float_interval(-10.0f, 10.0f);
    const float32 b = Frama_C_float_interval(-1e30f, 1e30f);
    {body}
    return (r > 0.0f) ? 1 : 0;
}}
"""

CLEAN = {
    "square": "const float32 r = 1.0f / (a * a + 0.01f);",
    "floor": "const float32 r = a / larger(a, 0.01f);",
    "ternary": "const float32 c = (a > 0.01f) ? a : 0.01f; const float32 r = 1.0f / c;",
    "root of a floor": "const float32 r = PMSM_SQRT(larger(a, 0.0f));",
}
FAULTY = {
    "division": ("const float32 r = 1.0f / a;", "div_float"),
    "overflow": ("const float32 r = b * b;", "mul_float"),
    "root": ("const float32 r = PMSM_SQRT(a);", "arg_positive"),
    "difference's square": ("const float32 r = 1.0f / ((a - b) * (a - b) + 0.01f);", "float"),
    "unwritten": ("float32 r; if (a > 0.0f) { r = a; }", "initialized"),
    "outside": ("float32 w[2]; float32 r; w[0] = a; w[1] = a; r = w[(a > 9.0f) ? 2 : 0];", "index"),
}


@pytest.mark.parametrize("body", CLEAN.values(), ids=CLEAN)
def test_what_is_sound_is_proved(body: str) -> None:
    need("frama-c")
    verdict = analyse({"snippet.c": SNIPPET.format(body=body)}, PORT)
    assert verdict.proved, verdict


@pytest.mark.parametrize(("body", "alarm"), FAULTY.values(), ids=FAULTY)
def test_what_is_unsound_alarms(body: str, alarm: str) -> None:
    need("frama-c")
    verdict = analyse({"snippet.c": SNIPPET.format(body=body)}, PORT)
    assert not verdict.proved
    assert any(alarm in line for line in verdict.alarms), verdict


def test_what_cannot_be_read_is_no_proof() -> None:
    need("frama-c")
    verdict = analyse({"snippet.c": SNIPPET.format(body="this is not C;")}, PORT)
    assert not verdict.proved
    assert verdict.failure


def test_a_step_that_never_ends_is_no_proof() -> None:
    """Nothing alarms behind an endless loop, because nothing is reached."""
    need("frama-c")
    verdict = analyse({"snippet.c": SNIPPET.format(body="const float32 r = a; for (;;) { }")}, PORT)
    assert not verdict.proved


def test_a_proved_bound_is_handed_over() -> None:
    """R + (D f) f: EVA alone does not see a square there."""
    need("frama-c")
    body = "const float32 g = 3.0f * a;\n    const float32 s = 0.5f + g * a;\n    const float32 r = 1.0f / s;"
    source = SNIPPET.format(body=body)
    assert not analyse({"snippet.c": source}, PORT).proved
    given = with_bounds(source, {("proof", "s"): 0.49})
    assert "s = 0.5f + g * a; /*@ assert range: s >=" in given
    assert analyse({"snippet.c": given}, PORT).proved


def test_the_contract_says_what_the_generator_proved(drive: Drive) -> None:
    for path in (GENERATED / drive.name).glob("*ckf.c"):
        text = with_contract(path.read_text())
        assert text.count("ensures") == 3
        assert f"requires \\is_finite(x) && -{sin_cos_bound().limit!r} <= x" in text


# --- the box


def test_box_names_every_word_once(drive: Drive) -> None:
    manifest = read_manifest(GENERATED / drive.name)
    n = len(manifest["states"])
    for form in ("P", "LD"):
        box = filter_box(manifest, form)
        assert len(box.places) == n + n * (n + 1) // 2 + 6 + (form == "LD")  # nis
        assert all(i.low < i.high for i in box.places.values())
    text = driver("p", box)
    assert all(text.count(f"    {place} = ") == 1 for place in box.places)


def test_factors_stay_in_their_box_whatever_the_measurement() -> None:
    """Random P_pred >= Q with variances in the box, one measurement of the currents: D and L, by NumPy."""
    manifest = read_manifest(GENERATED / "paper_spmsm")
    tuning = manifest["parameters"]["filter"]
    Q, P_0, R = (np.array(tuning[k]) for k in ("process_noise", "initial_covariance", "measurement_noise"))
    places = filter_box(manifest, "LD").places
    rng = np.random.default_rng(3)
    H = np.eye(2, 4)
    nearest = np.inf
    for _ in range(2000):
        factor = rng.normal(size=(4, rng.integers(1, 5)))
        A = factor @ factor.T
        scale = np.sqrt(rng.uniform(0, 1, 4) ** 4 * (MARGIN * np.maximum(P_0, Q) - Q) / np.maximum(np.diag(A), 1e-12))
        P_pred = A * np.outer(scale, scale) + np.diag(Q)
        K = P_pred @ H.T @ np.linalg.inv(H @ P_pred @ H.T + np.diag(R))
        P = (np.eye(4) - K @ H) @ P_pred @ (np.eye(4) - K @ H).T + K @ np.diag(R) @ K.T
        root = np.linalg.cholesky(P)
        D, L = np.diag(root) ** 2, root / np.diag(root)
        for i in range(4):
            for j in range(i + 1):
                interval = places[f"f.LD[{i * (i + 1) // 2 + j}]"]
                value = D[i] if i == j else L[i, j]
                assert interval.low * (1 - 1e-9) <= value <= interval.high * (1 + 1e-9)
        nearest = min(nearest, *(D[i] / places[f"f.LD[{i * (i + 1) // 2 + i}]"].low for i in range(4)))
    assert nearest < 2.0, "the lower bound is not idle"


# --- the filters


@cache
def papers_check(kind: str) -> Check:
    return eva_check(GENERATED / "paper_spmsm", kind)


@pytest.mark.parametrize("kind", ["ickf", "ckf"])
def test_no_run_time_error_in_a_step_of_the_papers_filter(kind: str) -> None:
    need("frama-c")
    check = papers_check(kind)
    assert check.state == "passed", check.detail[:5]


def test_every_statement_is_reached() -> None:
    """Both the accepted and the rejected measurement; an analysis that stops early proves nothing."""
    need("frama-c")
    reached, total = papers_check("ckf").figure.split(", ")[1].removesuffix(" statements").split(" of ")
    assert reached == total


@pytest.mark.thorough
def test_what_eva_cannot_decide_is_neither_pass_nor_failure(drive: Drive) -> None:
    need("frama-c")
    checks = eva_checks(GENERATED / drive.name)
    for check in checks:
        assert check.state == ("passed" if drive.name == "paper_spmsm" else "not proved"), check.detail
        if check.state == "not proved":
            assert int(check.figure.split()[0]) > 0
            assert len(check.detail) <= 1 + SHOWN
    result = Gated(drive.name, tuple(checks))
    assert result.good(allow_missing=False)


@pytest.mark.thorough
def test_a_wider_box_raises_alarms() -> None:
    need("frama-c")
    manifest = read_manifest(GENERATED / "paper_spmsm")
    box = filter_box(manifest, "LD").replaced(**{"f.x[2]": Interval.within(1e20)})
    check = eva_check(GENERATED / "paper_spmsm", "ckf", box)
    assert check.state == "not proved"
    assert any("finite" in line for line in check.detail)


def test_an_analysis_that_fails_fails_the_gate(tmp_path: Path) -> None:
    """A filter that never returns, and one that is no C: neither passes, and neither is merely not proved."""
    need("frama-c")
    name = "paper_spmsm_ckf"
    for what in ("for (;;) { }", "this is not C;"):
        folder = tmp_path / str(len(what))
        shutil.copytree(GENERATED / "paper_spmsm", folder)
        path = folder / f"{name}.c"
        head = f"int {name}_step({name}_t *f, const float32 u[2], const float32 y[2])\n{{\n"
        text = path.read_text()
        assert text.count(head) == 1
        path.write_text(text.replace(head, f"{head}    {what}\n"))
        verdict = analyse_step(folder, name, filter_box(read_manifest(folder), "LD")) if "for" in what else None
        if verdict is not None:
            assert verdict.failure == "no execution reaches the end of the step"
            assert eva_check(folder, "ckf").state == "failed"
        else:
            with pytest.raises(NotCError):
                eva_check(folder, "ckf")
