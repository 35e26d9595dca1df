"""Batches in C: the lane form has the scalar form's bits in every lane, however many there are and on any threads."""

from __future__ import annotations

import shutil
import subprocess
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import runtime
from codegen.generate import generate_bare
from codegen.ir.small_angle import LIMIT
from codegen.output.folder import write_folder
from codegen.render.lanes import LANES
from model.drives.load import load_drive
from model.schema import Drive
from runtime import UserError
from runtime.estimator import c_backend, threads
from runtime.estimator.c_backend import CBackend
from runtime.estimator.folder import GENERATED, GeneratedFolder
from runtime.estimator.lanes import OPTIMISATION, open_lanes
from tests.conftest import DRIVES, bare_package, thoroughly, variant

KINDS = ("ckf", "ickf")


def _start(module: Any, lanes: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """States and covariance words that differ from lane to lane; sigma of the angle from small to a radian."""
    n = len(module.STATES)
    x = np.repeat(np.array(module.DEFAULTS["x_0"])[:, None], lanes, axis=1)
    x[module.ANGLE] = rng.uniform(-3, 3, lanes)
    sigma = np.sqrt(np.array(module.DEFAULTS["P_0"]))[:, None] * rng.uniform(0.1, 4.0, (n, lanes))
    sigma[module.ANGLE] = np.linspace(0.02, 1.0, lanes)
    correlation = np.eye(n) * 0.7 + 0.3
    P = correlation[:, :, None] * sigma[:, None] * sigma[None]
    return x.astype(np.float32), module.pack(P).astype(np.float32)


def _inputs(steps: int, lanes: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Voltages and currents, a few of them not numbers, infinite or out of range."""
    u, y = (rng.normal(0, scale, (steps, 2, lanes)).astype(np.float32) for scale in (20, 1))
    for bad in (np.nan, np.inf, -np.inf, 1e9):
        for array in (u, y):
            array[rng.integers(steps), rng.integers(2), rng.integers(lanes)] = bad
    return u, y


def _runs(folder: GeneratedFolder, kind: str, steps: int, lanes: int) -> list[tuple[np.ndarray, ...]]:
    """The same batch in the scalar and in the lane form, final states and last inputs of the structs behind."""
    runs = []
    for lane_form in (False, True):
        rng = np.random.default_rng(7)
        backend = CBackend(folder, kind, "float32", lanes=lane_form)
        backend.reset(*_start(folder.module, lanes, rng))
        for b in range(lanes):  # tuning is each lane's own
            backend.filters[b].Q[2] = 0.01 * (b + 1)
            backend.filters[b].max_iterations = 1 + b % 5
        trace = backend.run(*_inputs(steps, lanes, rng))
        held = np.array([list(backend.filters[b].u_held) for b in range(lanes)], dtype=np.float32)
        runs.append((*trace, *backend.state(), held, backend.iterations, backend.status))
    return runs


def _same(runs: list[tuple[np.ndarray, ...]]) -> bool:
    return all(np.array_equal(a.view(np.int32), b.view(np.int32)) for a, b in zip(*runs, strict=True))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("lanes", [1, 2 * LANES + 5, *thoroughly(LANES, 33 * LANES - 1)])
def test_every_lane_has_the_scalar_bits(drive: Drive, kind: str, lanes: int) -> None:
    """Whole groups, a group begun, more groups than are kept together; wide angles and rejected inputs among them."""
    folder = GeneratedFolder(GENERATED / drive.name)
    runs = _runs(folder, kind, 30, lanes)
    assert _same(runs)
    status = runs[0][3]
    assert np.any(status & 1 != 0)
    if drive.name == "ipmsm_flux" and kind == "ickf" and lanes > 1:
        assert len(np.unique(runs[0][2])) > 2, "lanes that converge after different numbers of passes"
        assert np.any(status == 2)


def test_some_lanes_begin_with_wide_turns(drive: Drive) -> None:
    """The premise of the test above: the exact path for angles that are not small is taken, by some lanes only."""
    module = GeneratedFolder(GENERATED / drive.name).module
    _, words = _start(module, 40, np.random.default_rng(7))
    n, variance = len(module.STATES), module.unpack(words)[module.ANGLE, module.ANGLE]
    assert np.any(variance > LIMIT), "the columns' turns squared sum to n P: the largest is beyond the limit"
    assert np.any(n * variance < LIMIT), "none is"


@pytest.mark.parametrize("kind", ["ekf", "ukf"])
@pytest.mark.parametrize("form", ["fast", *thoroughly("literal")])
def test_other_kinds_and_the_literal_form(kind: str, form: str, tmp_path: Path) -> None:
    drive = variant(load_drive("ipmsm_flux"), filter={"kinds": [kind]})
    write_folder(tmp_path / drive.name, generate_bare(drive, form).files)
    assert _same(_runs(GeneratedFolder(tmp_path / drive.name), kind, 20, LANES + 3))


@pytest.fixture
def unoptimised(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lane forms compiled in half the time: for those that are wrong, which no optimisation makes right."""
    monkeypatch.setattr(c_backend, "open_lanes", partial(open_lanes, optimisation=("-O0",)))


@pytest.mark.usefixtures("unoptimised")
def test_without_optimisation_too_every_lane_has_the_scalar_bits() -> None:
    """So what is wrong below is the change alone."""
    for name, kind in (("paper_spmsm", "ckf"), ("ipmsm_flux", "ickf")):
        assert _same(_runs(GeneratedFolder(GENERATED / name), kind, 30, LANES))


@pytest.mark.usefixtures("unoptimised")
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("#define GAIN_V 0.023952097f", "#define GAIN_V 0.0239521f"),  # its last bit
        ("turn[2 * k].of[lane] = own_turn[2 * k]", "turn[2 * k].of[lane] = 1.0f"),  # in wide lanes alone
        ("f->iterations[lane] = good", "f->iterations[lane] = 1"),  # in rejected lanes alone
        ("(u_good != 0) ? u[0].of[lane] : held_0", "u[0].of[lane]"),
    ],
)
def test_a_wrong_lane_form_is_caught(old: str, new: str, tmp_path: Path) -> None:
    drive = load_drive("paper_spmsm")
    files = bare_package(drive.name).files
    name = "host/paper_spmsm_ckf_lanes.c"
    assert old in files[name]
    write_folder(tmp_path / drive.name, {**files, name: files[name].replace(old, new)})
    assert not _same(_runs(GeneratedFolder(tmp_path / drive.name, checked=False), "ckf", 30, LANES))


@pytest.mark.usefixtures("unoptimised")
def test_a_lane_that_goes_on_iterating_is_caught(tmp_path: Path) -> None:
    shutil.copytree(GENERATED / "ipmsm_flux", tmp_path / "ipmsm_flux")
    path, old = tmp_path / "ipmsm_flux" / "host" / "ipmsm_flux_ickf_lanes.c", "take(x_j, new_x_j, active, 4);"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, "copy(x_j, new_x_j, 4);"))
    assert not _same(_runs(GeneratedFolder(path.parents[1], checked=False), "ickf", 30, LANES))


@pytest.mark.parametrize("kind", KINDS)
def test_every_lane_loop_becomes_vector_instructions(drive: Drive, kind: str, tmp_path: Path) -> None:
    """GCC says which loops it vectorised; each block's is among them."""
    folder = GENERATED / drive.name
    source = folder / "host" / f"{drive.name}_{kind}_lanes.c"
    flags = [*OPTIMISATION, "-ffp-contract=off", "-fopt-info-vec", f"-I{folder}", "-c", "-o", str(tmp_path / "x.o")]
    done = subprocess.run(["gcc", *flags, str(source)], capture_output=True, text=True, check=True)
    if "clang" in subprocess.run(["gcc", "--version"], capture_output=True, text=True).stdout:
        pytest.skip("not run: this gcc is clang, which reports otherwise")
    vectorised = {int(line.split(":")[-4]) for line in done.stderr.splitlines() if "loop vectorized" in line}
    lines = source.read_text().splitlines()
    rare = {"static void widen_lanes(", "static void set_status_bits("}  # lane by lane on purpose
    rare |= {"static void coast("} if not drive.model.adaptive else set()  # copies alone, which become a memcpy
    loops, function = [], ""
    for k, line in enumerate(lines, 1):
        function = line if line.startswith("static") else function
        if line == "    for (lane = 0; lane < LANES; lane++) {" and not any(map(function.startswith, rare)):
            loops.append(k)
    assert len(loops) >= 4
    assert set(loops) <= vectorised


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_threads_change_no_bit(dtype: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "WORTH_IT", 1)
    u, y = _inputs(20, 3 * LANES + 5, np.random.default_rng(1))
    traces = []
    for count in ("1", "2", "9"):
        monkeypatch.setenv("PMSM_ICKF_THREADS", count)
        traces.append(runtime.load("paper_spmsm", "ickf", "c", dtype).run(u, y))
    for other in traces[1:]:
        for name in ("x", "P", "iterations", "status"):
            np.testing.assert_array_equal(getattr(traces[0], name), getattr(other, name))


@pytest.mark.parametrize(
    ("lanes", "count", "steps"), [(1, 1, 10**6), (100, 3, 10**6), (17, 8, 10**6), (1000, 2, 1), (48, 3, 10**6)]
)
def test_every_lane_is_served_once_and_groups_stay_whole(
    lanes: int, count: int, steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PMSM_ICKF_THREADS", str(count))
    pieces: list[tuple[int, int]] = []
    threads.share_lanes(lambda first, number: pieces.append((first, number)), lanes, 16, steps)
    assert sorted(b for first, number in pieces for b in range(first, first + number)) == list(range(lanes))
    assert all(first % 16 == 0 for first, _ in pieces)
    assert len(pieces) <= count
    if steps == 1:
        assert len(pieces) == 1, "too little work to share"


@pytest.mark.parametrize("wrong", ["0", "-1", "two", ""])
def test_a_wrong_number_of_threads_is_named(wrong: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PMSM_ICKF_THREADS", wrong)
    with pytest.raises(UserError, match="needs a positive whole number"):
        threads.thread_count()


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("lanes", [(), (3,)])
def test_the_last_step_alone(backend: str, lanes: tuple[int, ...]) -> None:
    rng = np.random.default_rng(3)
    u, y = rng.normal(0, 1, (2, 12, 2, *lanes))
    whole, last = (
        runtime.load("ipmsm_flux", "ickf", backend, "float32").run(u, y, keep=keep) for keep in ("all", "last")
    )
    for name in ("x", "P", "iterations", "status"):
        np.testing.assert_array_equal(getattr(whole, name)[-1:], getattr(last, name))
    with pytest.raises(UserError, match="keep 'first' is not all or last"):
        runtime.load("paper_spmsm").run(u, y, keep="first")


@pytest.mark.parametrize("name", DRIVES)
def test_covariances_are_worked_out_when_asked_for(name: str) -> None:
    """P is L D L^T of the words, symmetric and in the run's precision; asked for twice it is the same array."""
    u, y = np.random.default_rng(4).normal(0, 1, (2, 8, 2, 3))
    f = runtime.load(name, "ckf", "c", "float32")
    trace = f.run(u, y)
    assert "P" not in vars(trace)
    module = GeneratedFolder(GENERATED / name).module
    for k in range(8):
        np.testing.assert_array_equal(trace.P[k], module.unpack(trace.words[k]).astype(np.float32))
    np.testing.assert_array_equal(trace.P, trace.P.swapaxes(1, 2))
    np.testing.assert_array_equal(trace.P[-1], f.P)
    assert trace.P is trace.P
    assert trace.P.dtype == np.float32


def test_a_batch_goes_on_where_it_was() -> None:
    """One run, or two runs and single steps: the state lives in the structs, not in the lanes."""
    u, y = np.random.default_rng(5).normal(0, 1, (2, 12, 2, 5))
    a, b = (runtime.load("paper_spmsm", "ickf", "c", "float32") for _ in range(2))
    whole = a.run(u, y)
    b.run(u[:7], y[:7])
    for k in range(7, 12):
        np.testing.assert_array_equal(b.step(u[k], y[k]), whole.x[k])
    np.testing.assert_array_equal(a.P, b.P)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize(
    "pair",
    [
        [20, -3],
        (20.0, -3.0),
        np.array([20.0, -3.0]),
        np.array([20, -3]),
        np.array([20.0, -3.0], dtype=np.float32),
        [np.float32(20), np.float64(-3)],
        [np.array(20.0), np.array(-3.0)],
        np.array([20.0, 0.0, -3.0])[::2],
    ],
)
def test_a_step_takes_any_pair_of_numbers(pair: Any, dtype: str) -> None:
    expected = runtime.load("paper_spmsm", "ckf", "c", dtype).step(np.array([20.0, -3.0]), [0.5, 0.25])
    found = runtime.load("paper_spmsm", "ckf", "c", dtype).step(pair, [0.5, 0.25])
    np.testing.assert_array_equal(found, expected)
    assert found.dtype == np.dtype(dtype)


@pytest.mark.parametrize(
    ("u", "error"),
    [
        ([1.0], UserError),
        ([1.0, 2.0, 3.0], UserError),
        (1.0, UserError),
        ([[1.0], [2.0], [3.0]], UserError),
        (["a", "b"], ValueError),
        ("ab", ValueError),
        ({1.0: 2, 3.0: 4}, TypeError),
        ([None, {}], TypeError),
    ],
)
def test_a_step_refuses_what_is_no_pair_of_numbers(u: Any, error: type[Exception]) -> None:
    f = runtime.load("paper_spmsm", "ckf", "c", "float32")
    before = f.x
    with pytest.raises(error):
        f.step(u, [0.5, 0.25])
    np.testing.assert_array_equal(f.x, before)


def test_a_list_of_lanes_is_a_batch() -> None:
    f = runtime.load("paper_spmsm", "ckf", "c", "float32")
    assert f.step([[1.0], [2.0]], [np.array([0.0]), np.array([0.1])]).shape == (4, 1)
