"""Each documented status bit is provoked, in C and in NumPy, and nothing else sets it; names and values agree.

The bits' numbers are stated here once more, as docs/firmware.md has them.
"""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from codegen.evidence.recording import record_control, record_filter
from codegen.evidence.selftest import (
    BEYOND,
    CONTROL_BAD_COMMAND,
    CONTROL_BAD_CURRENT,
    NOT_A_NUMBER,
    control_run,
    gains,
    segments,
)
from model.drives.load import load_drive
from model.machines.state_space import build
from model.schema import Drive
from runtime import load
from runtime.estimator.c_backend import CBackend
from runtime.estimator.folder import GENERATED, GeneratedFolder
from runtime.proof.own_trajectory import trajectory_of
from tests.mutants.mutant import ROOT

BITS = {
    "INPUT_REJECTED": 0x1,
    "NOT_CONVERGED": 0x2,
    "COMMAND_REJECTED": 0x4,
    "COVARIANCE_REPAIRED": 0x8,
    "DIVERGED": 0x10,
    "RESTARTED": 0x20,
    "UNOBSERVABLE": 0x40,
}


def test_values_agree_in_port_module_and_docs(drive: Drive) -> None:
    port = (GENERATED / drive.name / "pmsm_port.h").read_text()
    found = re.findall(r"^#define PMSM_(\w+) (0x\w+) +/\*", port, re.MULTILINE)
    assert {name: int(value, 16) for name, value in found} == BITS
    module = GeneratedFolder(GENERATED / drive.name).module
    assert {name: getattr(module, name) for name in BITS} == BITS
    docs = (ROOT / "docs" / "firmware.md").read_text()
    rows = re.findall(r"^\| (0x\w+) \| `PMSM_(\w+)` \|", docs, re.MULTILINE)
    assert {name: int(value, 16) for value, name in rows} == BITS


def healthy(drive: Drive, steps: int = 40) -> tuple[np.ndarray, np.ndarray]:
    data = trajectory_of(drive, steps=steps)
    return np.float32(data.u), np.float32(data.y)


class Both:
    """One filter in C and in NumPy, float32: what is set and run in one is in the other."""

    def __init__(self, drive: Drive, kind: str) -> None:
        folder = GeneratedFolder(GENERATED / drive.name)
        self.module, self.drive = folder.module, drive
        self.c = CBackend(folder, kind, "float32", lanes=False)
        self.twin = load(drive.name, filter=kind, backend="numpy", dtype="float32")._backend  # type: ignore[attr-defined]
        self.x_0 = np.float32(self.module.DEFAULTS["x_0"])
        self.words = self.module.pack(np.diag(self.module.DEFAULTS["P_0"])).astype(np.float32)
        self.reset()

    def reset(self) -> None:
        for one in (self.c, self.twin):
            one.reset(self.x_0, self.words)

    @property
    def filters(self) -> tuple[Any, SimpleNamespace]:
        return self.c.filters[0], self.twin.filter

    def set(self, field: str, k: int | None, value: float) -> None:
        """A number of the tuning, or of the state (``k``)."""
        native, python = self.filters
        if k is None:
            setattr(native, field, value)
            setattr(python, field, value if isinstance(value, int) else np.float32(value))
        else:
            getattr(native, field)[k] = value
            entries = list(getattr(python, field))
            entries[k] = np.float32(value)
            setattr(python, field, tuple(entries))

    def run(self, u: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Status (N,), the same in both."""
        one, other = (
            np.asarray(backend.run(np.float32(u), np.float32(y))[3]).ravel() for backend in (self.c, self.twin)
        )
        assert np.array_equal(one, other)
        return one


@pytest.fixture
def both(drive: Drive) -> Both:
    return Both(drive, "ickf")


def test_healthy_is_zero(both: Both) -> None:
    u, y = healthy(both.drive, 300)
    assert not np.any(both.run(u, y) & ~BITS["NOT_CONVERGED"])


@pytest.mark.parametrize("place", range(4))
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, "beyond", "-beyond"])
def test_input_rejected_alone(both: Both, place: int, value: Any) -> None:
    """And the next good sample is taken; at the limit itself it is, too."""
    u, y = healthy(both.drive)
    limit = np.float32(both.module.DEFAULTS["u_max" if place < 2 else "y_max"])
    if isinstance(value, str):
        value = np.nextafter(limit, np.float32(np.inf)) * (-1 if value[0] == "-" else 1)
    inputs = np.hstack([u, y])
    inputs[20, place] = value
    status = both.run(inputs[:, :2], inputs[:, 2:])
    assert status[20] == BITS["INPUT_REJECTED"]
    assert not np.any(np.delete(status, 20) & ~BITS["NOT_CONVERGED"])
    native, python = both.filters
    assert native.iterations > 0
    assert np.all(python.iterations > 0)
    inputs[20, place] = limit
    both.reset()
    assert not both.run(inputs[:, :2], inputs[:, 2:])[20] & BITS["INPUT_REJECTED"]


def test_not_converged_alone() -> None:
    both = Both(load_drive("ipmsm_flux"), "ickf")
    u, y = healthy(both.drive)
    both.set("tolerance", None, 0.0)
    status = both.run(u, y)
    assert np.all(status[1:] & ~BITS["NOT_CONVERGED"] == 0)
    assert np.mean(status == BITS["NOT_CONVERGED"]) > 0.6  # elsewhere the last pass moved no bit
    both.reset()
    both.set("tolerance", None, 1e6)
    assert not np.any(both.run(u, y)), "the first pass is near enough"


def test_not_converged_where_nothing_is_iterated() -> None:
    for drive, kind in (("paper_spmsm", "ickf"), ("ipmsm_flux", "ckf")):
        both = Both(load_drive(drive), kind)
        both.set("tolerance", None, 0.0)
        assert not np.any(both.run(*healthy(both.drive)))


def test_covariance_repaired_alone(both: Both) -> None:
    """The variance that is factored first below zero, as a bit that fell over makes it."""
    u, y = healthy(both.drive)
    both.run(u[:10], y[:10])
    first = both.module.ORDER[0]
    word = both.module.VARIANCES[first]
    both.set(both.module.COVARIANCE, word, -2 * both.drive.filter.process_noise[first])
    status = both.run(u[10:], y[10:])
    assert status[0] & ~BITS["NOT_CONVERGED"] == BITS["COVARIANCE_REPAIRED"]
    assert not np.any(status[5:] & BITS["COVARIANCE_REPAIRED"])
    native, python = both.filters
    assert native.repairs == np.asarray(python.repairs) >= 1


@pytest.mark.parametrize("field", ["x", "covariance"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e12])
def test_restarted_leaves_the_start(both: Both, field: str, bad: float) -> None:
    u, y = healthy(both.drive)
    both.run(u[:10], y[:10])
    place = 2 if field == "x" else 5
    if field == "covariance" and np.isfinite(bad):
        bad *= 1e9
    both.set("x" if field == "x" else both.module.COVARIANCE, place, bad)
    status = both.run(u[10:12], y[10:12])
    found = int(np.bitwise_or.reduce(status))
    assert found & BITS["RESTARTED"]
    assert not found & (BITS["INPUT_REJECTED"] | BITS["COMMAND_REJECTED"])
    x, words = both.c.state()
    if status[-1] & BITS["RESTARTED"]:
        assert np.array_equal(np.ravel(x), both.x_0)
        assert np.array_equal(np.ravel(words), both.words)
    assert not np.any(both.run(u[12:], y[12:])[5:] & BITS["RESTARTED"])


def test_diverged_alone_from_nis_max_on(both: Both) -> None:
    """The mean's first value is its weight times the first innovation: on either side of it lies nis_max."""
    u, y = healthy(both.drive)
    both.run(u[:1], y[:1])
    mean = float(both.filters[0].nis)
    assert mean > 0
    for factor, expected in ((1.001, 0), (1.0, BITS["DIVERGED"]), (0.999, BITS["DIVERGED"])):
        both.reset()
        both.set("nis_max", None, factor * mean)
        assert both.run(u[:1], y[:1])[0] & ~BITS["NOT_CONVERGED"] == expected


def test_the_mean_is_the_exponential_one(both: Both) -> None:
    """With weight 1 it is each innovation's own; with weight w their sum by w (1 - w)^age, which is no recursion."""
    u, y = healthy(both.drive)
    both.set("nis_weight", None, 1.0)
    single = []
    for k in range(len(u)):
        both.run(u[k : k + 1], y[k : k + 1])
        single.append(float(both.filters[0].nis))
    both.reset()
    both.set("nis_weight", None, 0.125)
    both.run(u, y)
    age = np.arange(len(u))[::-1]
    assert float(both.filters[0].nis) == pytest.approx(np.sum(0.125 * 0.875**age * single), rel=1e-5)


@pytest.mark.parametrize("mean", [0.0, 1e6])
@pytest.mark.parametrize("place", range(3))
def test_a_state_beyond_all_sense_restarts_and_is_a_repair(both: Both, place: int, mean: float) -> None:
    """What is large is a state alone, or the monitor's mean with it: no input, and no word of the covariance.

    An angle would be wrapped.
    """
    u, y = healthy(both.drive)
    both.run(u[:10], y[:10])
    before = int(both.filters[0].repairs)
    both.set("x", place, 3e9)
    both.set("nis", None, mean)
    for name in ("u_max", "y_max"):  # a measurement would pull it back, and is not taken
        both.set(name, None, 0.0)
    assert both.run(u[10:11], y[10:11])[0] & BITS["RESTARTED"]
    assert [int(np.max(one.repairs)) for one in both.filters] == [before + 1] * 2


def test_nothing_hides_what_is_no_number(both: Both) -> None:
    u, y = healthy(both.drive)
    both.run(u[:10], y[:10])
    both.set("x", 2, np.nan)
    both.set("nis", None, np.nan)
    assert both.run(u[10:11], y[10:11])[0] & BITS["RESTARTED"]


def test_a_stuck_sensor_diverges_and_nothing_else(both: Both) -> None:
    u, y = healthy(both.drive, 400)
    y = y.copy()
    y[100:] = y[100] + 0.5 * both.module.DEFAULTS["y_max"] * np.where(np.arange(300)[:, None] % 2, 1, -1)
    y = np.clip(y, -both.module.DEFAULTS["y_max"], both.module.DEFAULTS["y_max"])
    status = both.run(u, y)
    assert not np.any(status[:100] & BITS["DIVERGED"])
    assert np.mean(status[200:] & BITS["DIVERGED"] > 0) > 0.9
    assert not np.any(status & (BITS["INPUT_REJECTED"] | BITS["COMMAND_REJECTED"]))


def test_of_the_recorded_starts_only_the_bad_samples_say_so(drive: Drive) -> None:
    """The filter's self-test has two bad inputs, the controller's one bad current and one bad command."""
    module = (GENERATED / drive.name / f"{drive.name}.py").read_text()
    for kind in drive.filter.kinds:
        status = record_filter(module, kind, segments(drive, build(drive))).status
        assert np.flatnonzero(status & BITS["INPUT_REJECTED"]).tolist() == [BEYOND, NOT_A_NUMBER]
        assert not np.any(status & BITS["COMMAND_REJECTED"])
        run = control_run(drive)
        status = record_control(module, kind, run, gains(drive, run.delay).values).status
        assert np.flatnonzero(status & BITS["INPUT_REJECTED"]).tolist() == [CONTROL_BAD_CURRENT]
        assert np.flatnonzero(status & BITS["COMMAND_REJECTED"]).tolist() == [CONTROL_BAD_COMMAND]
