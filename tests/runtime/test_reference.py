"""The reference against identities that hold whatever its code says, and against what it must not import."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from model.drives.load import load_drive
from model.machines.state_space import default_initial_state
from model.schema import Drive
from runtime.proof import inverter, motors, reference, wrong_data
from runtime.proof.link_ab import free_run, own_run, pieces_of, reference_run
from runtime.proof.motors import make_motor
from runtime.proof.own_trajectory import trajectory_of
from runtime.proof.reference import make_reference, wrap
from runtime.proof.verify import literal_package
from tests.conftest import ALL_DRIVES, variant

pytestmark = pytest.mark.unit


def test_a_unit_test_may_start_no_program() -> None:
    """The condition that conftest.py puts on every test of such a module."""
    with pytest.raises(RuntimeError, match="starts a program"):
        subprocess.run(["true"], check=True)


def test_reference_imports_nothing_it_is_to_check() -> None:
    plain = {"__future__", "math", "collections", "dataclasses", "typing", "numpy"}
    beside = {"runtime.proof.inverter"}
    ours = beside | {"runtime.proof.motors", "runtime.proof.wrong_data"}
    for module, more in (
        (reference, ours),
        (motors, beside),
        (inverter, set()),
        (wrong_data, beside | {"runtime.proof.motors"}),
    ):
        nodes = list(ast.walk(ast.parse(Path(module.__file__).read_text())))
        names = {alias.name.split(".")[0] for node in nodes if isinstance(node, ast.Import) for alias in node.names}
        names |= {str(node.module) for node in nodes if isinstance(node, ast.ImportFrom)} - {"numpy.typing"}
        names = {name if name.startswith("runtime") else name.split(".")[0] for name in names}
        assert names <= plain | more, module


@pytest.mark.parametrize("discretization", ["euler", "exact"])
def test_jacobian_against_finite_differences(drive: Drive, discretization: str) -> None:
    motor = make_motor(variant(drive, model={"discretization": discretization}).model_dump())
    n = len(drive.filter.process_noise)
    x = np.array([0.3, -0.4, 50.0, 0.8, 1.0, 0.4, 3.0])[:n]
    for k in range(n):
        shift = 1e-6 * np.eye(n)[k]
        difference = (motor.h(x + shift) - motor.h(x - shift)) / 2e-6
        np.testing.assert_allclose(motor.H(x)[:, k], difference, rtol=1e-7, atol=1e-7)


def _filter(drive: Drive, kind: str, gain: str, **changes: object) -> reference.Reference:
    built = make_reference(drive.model_dump(), kind, gain, np.array(default_initial_state(drive)))
    for name, value in changes.items():
        setattr(built, name, value)
    return built


def test_the_root_in_any_order_is_a_root(drive: Drive) -> None:
    """S S^T = P by state, and the points' mean and covariance are x and P."""
    rng = np.random.default_rng(4)
    f = _filter(drive, "ckf", "cubature")
    n = len(f.x)
    A = rng.normal(size=(n, n))
    f.order, f.P = list(rng.permutation(n)), A @ A.T + np.eye(n)
    P = f.P
    s = f.step(np.zeros(2), np.zeros(2))
    X = s["X"] - s["X"].mean(axis=1)[:, None]
    np.testing.assert_allclose(X @ X.T / (2 * n), P, atol=1e-12 * np.abs(P).max())
    np.testing.assert_allclose(s["S"] @ s["S"].T, P[np.ix_(f.order, f.order)], atol=1e-12 * np.abs(P).max())


def test_centred_sums_are_the_printed_ones(drive: Drive) -> None:
    """Eq. 17, 22, 23 as printed, sum XX^T/m - x x^T, agree in float64 where theta is small."""
    f = _filter(drive, "ckf", "cubature")
    data = trajectory_of(drive, steps=30)
    for u, y in zip(data.u, data.y, strict=True):
        s = f.step(u, y)
        X, x, Y, m = s["X_prop"], s["x_pred"], s["Y"], s["y_pred"]
        printed = X @ X.T / X.shape[1] - np.outer(x, x) + np.diag(f.Q)
        np.testing.assert_allclose(s["P_pred"], printed, atol=1e-9 * np.abs(printed).max())
        printed = Y @ Y.T / Y.shape[1] - np.outer(m, m) + np.diag(f.R)
        np.testing.assert_allclose(s["Pyy"], printed, atol=1e-9 * np.abs(Y).max() ** 2)


def test_points_have_the_moments_they_are_drawn_for(drive: Drive) -> None:
    f = _filter(drive, "ckf", "cubature")
    s = f.step(np.array([10.0, 5.0]), np.array([0.2, 0.1]))
    X = s["X_pred"]
    np.testing.assert_allclose(X.mean(axis=1), s["x_pred"], atol=1e-13)
    np.testing.assert_allclose(np.cov(X, bias=True), s["P_pred"], rtol=1e-10, atol=1e-13)


def test_jacobian_iterates_descend_the_cost(drive: Drive) -> None:
    """The fixed point of (31) with the Jacobian gain minimises the cost (27)."""
    f = _filter(drive, "ickf", "jacobian", N_max=50, eps=1e-12)
    y = np.array([0.4, -0.3])
    s = f.step(np.array([15.0, -5.0]), y)
    x_pred, P_pred = s["x_pred"], s["P_pred"]

    def cost(x: np.ndarray) -> float:
        r, d = y - f.motor.h(x), x - x_pred
        return float(d @ np.linalg.solve(P_pred, d) + r @ (r / f.R))

    best = s["iterates"][-1]["x_next"]
    assert cost(best) <= cost(x_pred)
    for k in range(len(best)):
        step = 1e-4 * np.sqrt(P_pred[k, k]) * np.eye(len(best))[k]
        slope = (cost(best + step) - cost(best - step)) / 2e-4
        assert abs(slope) < 1e-4 * max(1.0, cost(x_pred))


def test_one_jacobian_iterate_is_the_kalman_update() -> None:
    """With h linear the update is the textbook one: information adds up."""
    drive = load_drive("paper_spmsm")
    f = _filter(drive, "ickf", "jacobian")
    s = f.step(np.array([15.0, -5.0]), np.array([0.4, -0.3]))
    H = s["iterates"][0]["H"]
    information = np.linalg.inv(s["P_pred"]) + H.T @ np.diag(1 / f.R) @ H
    np.testing.assert_allclose(s["P"], np.linalg.inv(information), rtol=1e-9, atol=1e-12)


def test_iterating_is_idle_on_the_papers_model() -> None:
    """Both gains, five iterates: the first is the last. (So the paper's gap between CKF and ICKF is not (27)-(34).)"""
    drive = load_drive("paper_spmsm")
    data = trajectory_of(drive, steps=200)
    for gain in ("cubature", "jacobian"):
        f = _filter(drive, "ickf", gain, N_max=5, eps=-1.0)
        for u, y in zip(data.u, data.y, strict=True):
            iterates = f.step(u, y)["iterates"]
            assert len(iterates) == 5
            for later in iterates[1:]:
                np.testing.assert_allclose(later["x_next"], iterates[0]["x_next"], rtol=1e-12, atol=1e-12)


@pytest.mark.process
def test_estimates_follow_the_motor(drive: Drive) -> None:
    """Not only equal: right. Speed within 40 r/min after the start, angle within 3 degrees."""
    data = trajectory_of(drive, steps=round(0.2 / drive.model.sample_time) // 4 * 4)
    import runtime

    trace = runtime.load(drive.name, "ickf", "c").run(data.u, data.y)
    late = slice(3 * len(data.t) // 4, None)
    speed_error = (trace.x[late, 2] - data.omega[late]) * 30 / np.pi
    angle_error = np.degrees([wrap(a) for a in trace.x[late, 3] - data.theta[late]])
    assert np.max(np.abs(speed_error)) < 40
    assert np.max(np.abs(angle_error)) < 3


def test_trajectory_obeys_the_motor(drive: Drive) -> None:
    """Without noise the discrete model predicts the measured currents: voltages really are interval means."""
    data = trajectory_of(drive, noise=0.0, steps=round(0.1 / drive.model.sample_time))
    model = {"discretization": "exact", "mechanics": "load_torque", "adaptive": []}
    motor = make_motor(variant(drive, model=model).model_dump())
    surface = drive.model.machine == "surface"
    worst = 0.0
    for k in range(1, len(data.t), 7):
        electrical = data.y[k - 1] if surface else data.psi[k - 1]
        x = np.array([*electrical, data.omega[k - 1], data.theta[k - 1], 0.0])
        worst = max(worst, float(np.max(np.abs(motor.f(x, data.u[k])[:2] - (data.y[k] if surface else data.psi[k])))))
    assert worst < (5e-3 if surface else 1e-4)  # A, Wb: the back-EMF's second-order error at 100 us


def test_wrap() -> None:
    assert wrap(np.pi) == pytest.approx(-np.pi)
    assert wrap(-np.pi) == pytest.approx(-np.pi)
    assert wrap(7.0) == pytest.approx(7.0 - 2 * np.pi)


@pytest.mark.process
def test_reference_runs_without_casadi() -> None:
    code = (
        "import sys; sys.modules['casadi'] = sys.modules['model'] = sys.modules['codegen'] = None\n"
        "import tomllib, numpy as np; from runtime.proof.reference import make_reference\n"
        "p = tomllib.load(open('model/drives/paper_spmsm.toml', 'rb'))\n"
        "make_reference(p, 'ickf', 'jacobian', np.zeros(4)).step(np.zeros(2), np.zeros(2))"
    )
    root = Path(reference.__file__).parents[2]
    subprocess.run([sys.executable, "-c", code], check=True, cwd=root)


@pytest.mark.parametrize("name", ALL_DRIVES)
@pytest.mark.parametrize(
    ("kind", "gain"), [("ckf", "cubature"), ("ickf", "jacobian"), ("ukf", "cubature"), ("ekf", "")]
)
def test_filters_side_by_side_are_each_on_its_own(name: str, kind: str, gain: str) -> None:
    """All stages of three filters at once, some of which converge before others, are those of one after another."""
    drive, rng = load_drive(name), np.random.default_rng(6)
    n = len(drive.filter.process_noise)
    x, u = 0.1 * rng.normal(size=(3, n)), 10 * rng.normal(size=(4, 3, 2))
    y = 0.1 * rng.normal(size=(4, 3, 2)) * np.array([0.0, 1.0, 30.0])[:, None]
    together, *alone = (make_reference(drive.model_dump(), kind, gain, start) for start in (x, *x))
    together.P = np.array([together.P] * 3)
    for u_k, y_k in zip(u, y, strict=True):
        stages = together.step(u_k, y_k)
        for lane, one in enumerate(alone):
            for stage, value in one.step(u_k[lane], y_k[lane]).items():
                if stage != "iterates":
                    np.testing.assert_allclose(stages[stage][lane], value, rtol=1e-9, atol=1e-11)
            for j, iterate in enumerate(one.stages.get("iterates", [])):
                for stage, value in iterate.items():
                    np.testing.assert_allclose(stages["iterates"][j][stage][lane], value, rtol=1e-9, atol=1e-11)


def test_pieces_begin_where_the_run_is_a_filters() -> None:
    x, P = np.arange(12.0).reshape(6, 2), np.array([np.eye(2)] * 6)
    x[1], P[3] = np.nan, -np.eye(2)
    starts, covariances = pieces_of((x, P), (np.array([-1.0, -2.0]), 7 * np.eye(2)), 2)
    np.testing.assert_array_equal(starts, [[-1, -2], [-1, -2], [-1, -2]])
    x[1], P[3] = 5.0, 3 * np.eye(2)
    starts, covariances = pieces_of((x, P), (np.array([-1.0, -2.0]), 7 * np.eye(2)), 2)
    np.testing.assert_array_equal(starts, [[-1, -2], [5, 5], [6, 7]])
    np.testing.assert_array_equal(covariances, [7 * np.eye(2), np.eye(2), 3 * np.eye(2)])


def test_a_run_that_drifts_from_the_reference_is_noticed() -> None:
    """The generated filter's own run bent by a little more than is allowed, in one step of one piece."""
    drive = load_drive("ipmsm_flux")
    literal, data = literal_package(drive), trajectory_of(drive, steps=40)
    step, module = literal.steps["ckf"], literal.module
    first = np.array(module.DEFAULTS["x_0"]), np.diag(drive.filter.initial_covariance)
    x, P = own_run(module, "ckf", first, data.u, data.y)
    u, y = (np.swapaxes(signal.reshape(4, 10, 2), 0, 1) for signal in (data.u, data.y))
    run = reference_run("trajectory", drive.model_dump(), step, pieces_of((x, P), first, 10), u, y)
    assert free_run(step, drive.name, run, (x, P), module.ANGLE).passed
    for array in (x, P):
        array[25, 1] *= 1 + 1e-8
        assert not free_run(step, drive.name, run, (x, P), module.ANGLE).passed
        array[25, 1] /= 1 + 1e-8
    x[25, 1] = np.nan
    assert not free_run(step, drive.name, run, (x, P), module.ANGLE).passed
