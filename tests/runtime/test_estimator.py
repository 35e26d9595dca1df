"""load, step, run: both back ends, both precisions, batches, rejected inputs, and errors that teach."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import runtime
from model.drives.load import load_drive
from model.schema import Drive
from runtime import UserError
from runtime.estimator.folder import GENERATED
from runtime.proof.own_trajectory import trajectory_of
from tests.conftest import DRIVES

KINDS = ("ckf", "ickf")


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("kind", KINDS)
def test_back_ends_agree(drive: Drive, kind: str, dtype: str) -> None:
    """float32: the same bits. float64: C calls libm's sin and cos, NumPy its own; they may differ by an ulp."""
    data = trajectory_of(drive, steps=300)
    a, b = (runtime.load(drive.name, kind, backend, dtype).run(data.u, data.y) for backend in ("numpy", "c"))
    if dtype == "float32":
        np.testing.assert_array_equal(a.x, b.x)
        np.testing.assert_array_equal(a.P, b.P)
    else:
        np.testing.assert_allclose(a.x, b.x, rtol=1e-9, atol=1e-11)
    np.testing.assert_array_equal(a.status, b.status)
    np.testing.assert_array_equal(a.iterations, b.iterations)
    assert a.x.dtype == b.x.dtype == np.dtype(dtype)
    n = len(runtime.load(drive.name).state_names)
    assert a.P.shape == (300, n, n)


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("kind", KINDS)
def test_every_lane_keeps_the_bits_of_a_single_filter(drive: Drive, kind: str, backend: str) -> None:
    """Lanes differ in data and in the number of iterations they need; some inputs are rejected."""
    rng = np.random.default_rng(5)
    u, y = rng.normal(0, 30, (40, 2, 7)), rng.normal(0, 1, (40, 2, 7))
    y[10, 0, 2], u[20, 1, 3], y[5, 1, 6] = np.nan, np.inf, 1e9
    batch = runtime.load(drive.name, kind, backend, "float32").run(u, y)
    n = len(runtime.load(drive.name).state_names)
    assert batch.x.shape == (40, n, 7)
    assert batch.P.shape == (40, n, n, 7)
    for lane in range(7):
        single = runtime.load(drive.name, kind, backend, "float32").run(u[..., lane], y[..., lane])
        np.testing.assert_array_equal(batch.x[..., lane], single.x)
        np.testing.assert_array_equal(batch.P[..., lane], single.P)
        np.testing.assert_array_equal(batch.status[..., lane], single.status)
        np.testing.assert_array_equal(batch.iterations[..., lane], single.iterations)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_step_and_run_are_the_same(drive: Drive, backend: str) -> None:
    data = trajectory_of(drive, steps=50)
    a, b = (runtime.load(drive.name, "ickf", backend, "float32") for _ in range(2))
    trace = a.run(data.u, data.y)
    for k in range(50):
        x = b.step(data.u[k], data.y[k])
        np.testing.assert_array_equal(x, trace.x[k])
        np.testing.assert_array_equal(b.P, trace.P[k])
        assert int(b.iterations) == trace.iterations[k]


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_step_returns_a_copy(backend: str) -> None:
    f = runtime.load("paper_spmsm", "ckf", backend)
    x = f.step([1.0, 0.0], [0.1, 0.0])
    kept = x.copy()
    f.step([50.0, 0.0], [3.0, 0.0])
    np.testing.assert_array_equal(x, kept)


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e6])
@pytest.mark.parametrize("where", ["u", "y"])
def test_a_rejected_input_is_a_pure_prediction(drive: Drive, backend: str, bad: float, where: str) -> None:
    """The state moves by f alone, P grows by Q, the status says so; a bad voltage is replaced by the last good one."""
    f, g = (runtime.load(drive.name, "ckf", backend) for _ in range(2))
    for h in (f, g):
        h.step([20.0, 5.0], [0.4, 0.1])
    before = f.P
    inputs = {"u": np.array([21.0, 6.0]), "y": np.array([0.5, 0.1])}
    inputs[where] = np.array([bad, 0.1])
    x = f.step(inputs["u"], inputs["y"])
    assert int(f.status) == 1
    assert int(f.iterations) == 0
    assert np.all(np.isfinite(x))
    assert np.all(np.isfinite(f.P))
    assert np.linalg.det(f.P) > np.linalg.det(before)
    good_u = [20.0, 5.0] if where == "u" else [21.0, 6.0]
    np.testing.assert_array_equal(x, g.step(good_u, [np.nan, 0.0]))
    assert int(f.step([20.0, 5.0], [0.5, 0.1]) is not None and f.status) == 0


def test_tuning_is_live_in_c() -> None:
    """The struct's Q is data: changing it changes the next step, without a rebuild."""
    f, g = (runtime.load("paper_spmsm", "ckf", "c", "float32") for _ in range(2))
    f._backend.filters[0].Q[2] = 100.0  # type: ignore[attr-defined]
    assert f.step([0, 0], [0, 0]) is not None
    g.step([0, 0], [0, 0])
    assert f.P[2, 2] > g.P[2, 2] + 50


def test_reset_takes_states_and_covariances() -> None:
    f = runtime.load("paper_spmsm", "ckf")
    f.reset(x0=[1, 2, 3, 0.5], P0=[1, 2, 3, 4])
    np.testing.assert_array_equal(f.x, [1, 2, 3, 0.5])
    np.testing.assert_array_equal(f.P, np.diag([1, 2, 3, 4]))
    P = np.eye(4) + 0.1
    f.reset(P0=P)
    np.testing.assert_array_equal(f.P, P)
    f.reset(x0=np.zeros((4, 3)))
    assert f.step(np.zeros((2, 3)), np.zeros((2, 3))).shape == (4, 3)


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        (lambda: runtime.load("paper_spmsn"), "Did you mean 'paper_spmsm'?"),
        (lambda: runtime.load("paper_spmsm", filter="ukf"), "has no filter 'ukf'; generated: ckf, ickf"),
        (lambda: runtime.load("paper_spmsm", backend="rust"), "backend 'rust' is not numpy or c"),
        (lambda: runtime.load("paper_spmsm", dtype="float16"), "dtype 'float16'"),
        (lambda: runtime.load("paper_spmsm").step([1, 2, 3], [1, 2]), "step needs (2,) or (2, B)"),
        (lambda: runtime.load("paper_spmsm").run(np.zeros((5, 2)), np.zeros((4, 2))), "run needs (N, 2)"),
        (lambda: runtime.load("paper_spmsm").reset(x0=[1, 2]), "x0 has shape (2,)"),
        (lambda: runtime.load("paper_spmsm").reset(P0=[1, 1, -1, 1]), "P0 is not positive definite"),
        (lambda: runtime.load("paper_spmsm").reset(P0=np.ones((4, 4))), "P0 is not positive definite"),
    ],
)
def test_errors_teach(call, expected: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(UserError) as caught:
        call()
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def _copy_of(name: str, target: Path) -> Path:
    folder = target / name
    for path in (GENERATED / name).rglob("*"):
        if path.is_file():
            copy = folder / path.relative_to(GENERATED / name)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(path.read_bytes())
    return folder


@pytest.mark.parametrize(
    ("backend", "file"), [("numpy", "paper_spmsm.py"), ("c", "paper_spmsm_ckf.c"), ("c", "pmsm_port.h")]
)
def test_an_edited_folder_is_refused(tmp_path: Path, backend: str, file: str) -> None:
    folder = _copy_of("paper_spmsm", tmp_path)
    runtime.load(folder, "ckf", backend, "float32")
    (folder / file).write_text((folder / file).read_text() + "\n")
    with pytest.raises(UserError, match="was edited by hand"):
        runtime.load(folder, "ckf", backend, "float32")


def test_a_folder_without_manifest_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"no manifest\.json"):
        runtime.load(tmp_path)


@pytest.mark.parametrize("setting", ["", "no-such-compiler"])
def test_without_a_compiler_numpy_still_works(setting: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    if setting:
        monkeypatch.setenv("CC", setting)
    else:
        monkeypatch.delenv("CC", raising=False)
        monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(UserError, match="no C compiler"):
        runtime.load("paper_spmsm", "ckf", "c")
    assert runtime.load("paper_spmsm", "ckf", "numpy").step([0, 0], [0, 0]).shape == (4,)


def test_a_failing_compiler_says_so(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("CC", "false")
    monkeypatch.setenv("PMSM_ICKF_CACHE", str(tmp_path))
    with pytest.raises(UserError, match="the C compiler 'false' failed"):
        runtime.load("paper_spmsm", "ckf", "c")


def test_compiled_code_is_cached_by_content(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PMSM_ICKF_CACHE", str(tmp_path / "not there yet ü"))
    runtime.load("paper_spmsm", "ckf", "c", "float32")
    runtime.load("paper_spmsm", "ckf", "c", "float32")
    assert len(list((tmp_path / "not there yet ü").glob("*.so"))) == 1
    runtime.load("paper_spmsm", "ckf", "c", "float64")
    assert len(list((tmp_path / "not there yet ü").glob("*.so"))) == 2


IMPORT_PROBE = """
import sys
{what}
heavy = {{"casadi", "sympy", "pydantic", "rich", "typer", "jinja2", "model", "codegen", "scipy", "matplotlib"}}
print(sorted(heavy & set(sys.modules)))
"""


@pytest.mark.parametrize(
    "what",
    [
        "import runtime",
        "import runtime; runtime.load('paper_spmsm', 'ickf').step([0, 0], [0, 0])",
        "import runtime; runtime.load('paper_spmsm', 'ickf', 'c').step([0, 0], [0, 0])",
    ],
)
def test_the_estimator_needs_numpy_alone(what: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", IMPORT_PROBE.format(what=what)], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("name", DRIVES)
def test_manifest_tells_programs_what_they_need(name: str) -> None:
    manifest = json.loads((GENERATED / name / "manifest.json").read_text())
    assert manifest["drive"] == name
    for facts in manifest["filters"].values():
        assert facts["operations"]["mul"] > 100
        assert facts["certificate"]["not_finite"] == 0
    assert set(manifest["files"]) == {
        path.relative_to(GENERATED / name).as_posix()
        for path in (GENERATED / name).rglob("*")
        if path.is_file() and path.name != "manifest.json"
    }


def test_a_trace_travels_between_processes() -> None:
    """Drives are verified in parallel; a trace's P is worked out before it leaves its process."""
    import pickle

    trace = runtime.load("paper_spmsm", backend="c", dtype="float32").run(np.zeros((5, 2)), np.zeros((5, 2)))
    arrived = pickle.loads(pickle.dumps(trace))
    np.testing.assert_array_equal(arrived.P, trace.P)
    np.testing.assert_array_equal(arrived.x, trace.x)


@pytest.mark.parametrize("kind", KINDS)
def test_float32_covariance_of_an_unknown_start(kind: str) -> None:
    """P of float32 against float64 from P_0 = diag(1e4, 1e4, 1e6, 10): eight decades between entries, angle unknown.

    Entries relative to their sigmas. Most is lost in the first steps, where one measurement takes a variance of 1e4
    down to 1e-2 and with it six of float32's seven digits: 8.8e-4 in the second step, the bound is about twice that.
    """
    data = trajectory_of(load_drive("paper_spmsm"), steps=2000)
    found = {}
    for dtype in ("float32", "float64"):
        filter_ = runtime.load("paper_spmsm", kind, "numpy", dtype)
        filter_.reset(P0=np.diag([1e4, 1e4, 1e6, 10.0]))
        found[dtype] = filter_.run(data.u, data.y).P.astype(float)
    exact = found["float64"]
    sigma = np.sqrt(np.diagonal(exact, axis1=1, axis2=2))
    error = np.abs(found["float32"] - exact) / (sigma[:, :, None] * sigma[:, None, :])
    assert np.max(error) <= 2e-3
    assert np.min(np.linalg.eigvalsh(found["float32"])) > 0.0
