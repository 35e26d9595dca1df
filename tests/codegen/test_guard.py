"""The guards: inputs by squares, exactly the floats that comparing accepts; states that are none; no bit else."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from model.schema import Drive
from runtime.estimator.c_backend import CBackend
from runtime.estimator.folder import GENERATED, GeneratedFolder, find_folder
from runtime.proof.own_trajectory import trajectory_of
from tests.target.need import need

SPECIAL = np.array([np.nan, np.inf, -np.inf, np.finfo(np.float32).max, 1e-45, 0.0, -0.0], np.float32)

#: Limits that the header allows as u_max and y_max; some have squares just below and above powers of two.
LIMITS = np.concatenate(
    [
        np.float32([1e-18, 1e18, 400.0, 100.0, 1.0, 2.0, np.sqrt(2.0), 16777215.0, 0.1]),
        np.float32(2.0) ** np.arange(-59, 60, 2, dtype=np.float32) * np.float32(np.sqrt(2.0)),
        np.nextafter(np.float32(2.0) ** np.arange(-59, 60, 3, dtype=np.float32), np.float32(0)),
        (10.0 ** np.random.default_rng(1).uniform(-18, 18, 2000)).astype(np.float32),
    ]
)


def neighbours(limit: np.ndarray) -> np.ndarray:
    """The limits, and up to four float32 above and below each."""
    found = [limit]
    for way in (np.float32(0), np.float32(np.inf)):
        here = limit
        for _ in range(4):
            here = np.nextafter(here, way)
            found.append(here)
    return np.stack(found)


def test_squares_stand_in_the_order_of_the_values() -> None:
    """fl(v v) <= fl(U U) where |v| <= U and nowhere else, over all neighbours of the limits.

    Rounding keeps order, so inside nothing is lost; outside v >= U + ulp, and v v - U U > 2 U ulp is more than a
    spacing of floats there, so that the two cannot round alike.
    """
    values = neighbours(LIMITS)
    assert np.array_equal(values * values <= LIMITS * LIMITS, values <= LIMITS)
    with np.errstate(over="ignore", invalid="ignore"):
        assert not np.any((SPECIAL * SPECIAL)[:4, None] <= LIMITS * LIMITS)


@pytest.mark.parametrize("place", range(4))
def test_c_and_numpy_accept_the_same(place: int) -> None:
    """The generated C step at the limits' neighbours and at what is no number, against the comparison."""
    need("gcc")
    folder = find_folder("paper_spmsm")
    limit = np.float32(folder.module.DEFAULTS["u_max" if place < 2 else "y_max"])
    values = np.concatenate([neighbours(np.array([limit])).ravel(), -neighbours(np.array([limit])).ravel(), SPECIAL])
    from runtime import load

    ours = load("paper_spmsm", filter="ckf", backend="c", dtype="float32")
    twin = load("paper_spmsm", filter="ckf", backend="numpy", dtype="float32")
    for value in values:
        inputs = np.zeros(4)
        inputs[place] = value
        for one in (ours, twin):
            one.reset()
        a, b = (one.run(inputs[None, :2], inputs[None, 2:]).status[0] for one in (ours, twin))
        rejected = [bool(status & 1) for status in (a, b)]  # INPUT_REJECTED; a current at the limit is no usual one
        assert rejected == [not np.abs(value) <= limit] * 2, value


@pytest.mark.parametrize(
    ("dtype", "header"), [("float32", "paper_spmsm_ckf.h"), ("float64", "host/paper_spmsm_ckf_f64.h")]
)
@pytest.mark.parametrize("limit", ["u_max", "y_max"])
def test_a_limit_that_is_nan_does_what_the_header_says(limit: str, dtype: str, header: str) -> None:
    """It rejects none, by bits, or all, by squares; either way x is numbers, or the status says that it was not."""
    from runtime import load

    says = re.search(rf" {limit}; /\* .* NaN rejects (none|all) \*/", find_folder("paper_spmsm").text(header))
    assert says
    one = load("paper_spmsm", filter="ckf", backend="c", dtype=dtype)
    assert isinstance(one.backend, CBackend)
    for value in (1.0, 1e6, np.inf, np.nan):
        one.reset()
        setattr(one.backend.filters[0], limit, np.nan)
        u = np.full((3, 2), value if limit == "u_max" else 1.0)
        trace = one.run(u, np.full((3, 2), value if limit == "y_max" else 1.0))
        assert np.all((trace.status & 1) == (says[1] == "all"))
        assert np.all(np.isfinite(trace.x))
        told = np.isfinite(value) or says[1] == "all" or np.all(trace.status & 32)
        assert told, "PMSM_RESTARTED"


def without_guards(source: str) -> str:
    """A filter's C with nothing left that watches: pivots, sum and mean go unseen, and nothing is done about them."""
    for watching in (
        r"    if \(!\(\(LD_pred\[0\].*?\n    \}\n",
        r"        f->nis = f->nis \+ [^;]*;\n",
        r"    check\[0\] = check\[0\] \+ .*?\n    \}\n",
        r"#pragma CODE_SECTION\(set_status_bits[^\n]*\n",
        r"/\* Sets the remaining status bits after.*?\n\}\n",
    ):
        source, count = re.subn(watching, "", source, flags=re.DOTALL)
        assert count, watching
    return source


@pytest.mark.parametrize("kind", ["ckf", "ickf"])
def test_guards_change_no_bit_of_a_healthy_run(drive: Drive, kind: str, tmp_path: Path) -> None:
    """The proof's start through the shipped C and through the same without its guards."""
    need("gcc")
    shutil.copytree(GENERATED / drive.name, tmp_path / drive.name)
    path = tmp_path / drive.name / f"{drive.name}_{kind}.c"
    path.write_text(without_guards(path.read_text()))
    data = trajectory_of(drive, steps=2000)
    u, y = (np.asarray(part, dtype=np.float32) for part in (data.u, data.y))
    runs = []
    for folder in (GeneratedFolder(GENERATED / drive.name), GeneratedFolder(tmp_path / drive.name, checked=False)):
        backend = CBackend(folder, kind, "float32", lanes=False)
        module = folder.module
        backend.reset(
            np.float32(module.DEFAULTS["x_0"]), module.pack(np.diag(module.DEFAULTS["P_0"])).astype(np.float32)
        )
        runs.append(backend.run(u, y))
    np.testing.assert_array_equal(runs[0][0].view(np.uint32), runs[1][0].view(np.uint32))
    np.testing.assert_array_equal(runs[0][1].view(np.uint32), runs[1][1].view(np.uint32))
    assert not np.any(runs[0][3] & ~2), "healthy: nothing but, at times, NOT_CONVERGED"


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e30])
def test_a_state_out_of_its_senses_starts_over(drive: Drive, bad: float) -> None:
    """Each word of x and LD, and R, in turn: the step says so and leaves numbers, and the run goes on."""
    folder = GeneratedFolder(GENERATED / drive.name)
    module, data = folder.module, trajectory_of(drive, steps=30)
    u, y = (np.asarray(part, dtype=np.float32) for part in (data.u, data.y))
    backend = CBackend(folder, "ckf", "float32", lanes=False)
    x_0 = np.float32(module.DEFAULTS["x_0"])
    words = module.pack(np.diag(module.DEFAULTS["P_0"])).astype(np.float32)
    places = [("x", k) for k in range(len(x_0)) if k != module.ANGLE or not np.isfinite(bad)]
    places += [(module.COVARIANCE, k) for k in range(len(words))]
    for field, k in places:
        backend.reset(x_0, words)
        backend.run(u[:10], y[:10])
        getattr(backend.filters[0], field)[k] = bad
        x, left, _, status = backend.run(u[10:], y[10:])
        told = np.flatnonzero(status & 0x38)
        assert told.size, (field, k)
        assert np.all(np.isfinite(x[told[0] + 2 :])), (field, k)
        assert np.all(np.isfinite(left[told[0] + 2 :])), (field, k)
        assert not np.any(status[-5:] & 0x28), (field, k)
