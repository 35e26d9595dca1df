"""The filters against an outside oracle, and the proof that iterating is idle against what would break it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from stonesoup.base import Property
from stonesoup.models.measurement.base import MeasurementModel
from stonesoup.models.transition.base import TransitionModel
from stonesoup.predictor.kalman import CubatureKalmanPredictor
from stonesoup.types.array import StateVector, StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import CubatureKalmanUpdater

from codegen.generate import draft
from model.drives.load import load_drive
from model.filters import build_filter
from model.filters.ickf import idle_iteration_proof
from model.machines import MACHINES
from model.machines.state_space import build
from model.schema import Drive
from runtime.estimator.estimator import Estimator
from runtime.estimator.numpy_backend import NumpyBackend
from runtime.proof.own_trajectory import trajectory_of
from tests.conftest import DRIVES, thoroughly, variant

pytestmark = pytest.mark.unit


def _columns(function: Callable[[np.ndarray], np.ndarray], vectors: Any) -> StateVectors:
    points = np.asarray(vectors, dtype=float)
    return StateVectors(np.column_stack([function(points[:, k]) for k in range(points.shape[1])]))


class _Transition(TransitionModel):  # type: ignore[misc]
    """A motor's f for Stone Soup; the input is set before each step."""

    f: Any = Property(doc="x, u -> x'")
    Q: np.ndarray = Property(doc="variances")
    u: np.ndarray = np.zeros(2)

    @property
    def ndim_state(self) -> int:
        return len(self.Q)

    def function(self, state: Any, noise: bool = False, **kwargs: Any) -> Any:
        return _columns(lambda x: np.array(self.f(x, self.u)).ravel(), state.state_vector)

    def covar(self, **kwargs: Any) -> np.ndarray:
        return np.diag(self.Q)

    def rvs(self, **kwargs: Any) -> Any:
        raise NotImplementedError

    def pdf(self, *args: Any, **kwargs: Any) -> Any:
        raise NotImplementedError


class _Measurement(MeasurementModel):  # type: ignore[misc]
    """A motor's h for Stone Soup."""

    h: Any = Property(doc="x -> y")
    R: np.ndarray = Property(doc="variances")
    ndim_meas = 2

    def function(self, state: Any, noise: bool = False, **kwargs: Any) -> Any:
        return _columns(lambda x: np.array(self.h(x)).ravel(), state.state_vector)

    def covar(self, **kwargs: Any) -> np.ndarray:
        return np.diag(self.R)

    def rvs(self, **kwargs: Any) -> Any:
        raise NotImplementedError

    def pdf(self, *args: Any, **kwargs: Any) -> Any:
        raise NotImplementedError


@pytest.mark.slow
@pytest.mark.parametrize("name", [DRIVES[0], *thoroughly(*DRIVES[1:])])
def test_ckf_against_stone_soup(name: str) -> None:
    """400 steps of the start, free running: state and covariance of the generated CKF within 1e-8.

    Stone Soup factors P in the order of its state, so its state is ours in the root's order.
    """
    drive = load_drive(name)
    model = build(drive)
    order = list(model.order)
    x = model.x[order]
    f = ca.Function("f", [x, model.u], [model.numeric(model.f)[order]])
    h = ca.Function("h", [x], [model.numeric(model.h)])
    transition = _Transition(f, np.array(drive.filter.process_noise)[order])
    measurement = _Measurement(
        len(model.states), tuple(range(len(model.states))), h, np.array(drive.filter.measurement_noise)
    )
    predictor, updater = CubatureKalmanPredictor(transition), CubatureKalmanUpdater(measurement)

    data = trajectory_of(drive, steps=400)
    ours = _in_memory(drive, "ckf")
    square = np.ix_(order, order)
    state, theta = GaussianState(StateVector(ours.x[order]), ours.P[square]), order.index(model.angle)
    for u, y in zip(data.u, data.y, strict=True):
        transition.u = u
        prediction = predictor.predict(state)
        detection = Detection(StateVector(y), measurement_model=measurement)
        state = updater.update(SingleHypothesis(prediction, detection))
        estimate = ours.step(u, y)[order]
        theirs = np.asarray(state.state_vector, dtype=float).ravel()
        theirs[theta] = (theirs[theta] + np.pi) % (2 * np.pi) - np.pi
        state = GaussianState(StateVector(theirs), state.covar)
        P = ours.P[square]
        scale = np.sqrt(np.diag(P))
        assert np.max(np.abs(estimate - theirs) / np.maximum(scale, np.abs(theirs))) <= 1e-8
        assert np.max(np.abs(P - state.covar) / np.outer(scale, scale)) <= 1e-8


def _in_memory(drive: Drive, kind: str) -> Estimator:
    """A generated filter that was never on disk."""
    loaded = draft(drive).load(drive.name)

    class Folder:
        module = loaded
        drive = loaded.__name__

    folder = Folder()
    backend = NumpyBackend(folder.module, kind, "float64")  # type: ignore[arg-type]
    return Estimator(folder, kind, backend, "float64")  # type: ignore[arg-type]


@pytest.mark.parametrize("gain", ["cubature", "jacobian"])
def test_iteration_is_proved_idle_where_h_is_linear(gain: str) -> None:
    step = build_filter(build(load_drive("paper_spmsm")), "ickf", gain)
    assert step.iteration_proof is not None
    assert not any(block.name.endswith("iterate") for block in step.blocks)


@pytest.mark.parametrize("gain", ["cubature", "jacobian"])
def test_iteration_stays_where_h_is_nonlinear(gain: str) -> None:
    step = build_filter(build(load_drive("ipmsm_flux")), "ickf", gain)
    assert step.iteration_proof is None
    assert any(block.name.endswith("iterate") for block in step.blocks)


@pytest.mark.parametrize("gain", ["cubature", "jacobian"])
def test_idle_proof_fails_for_a_barely_nonlinear_measurement(gain: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A measurement that bends by 1e-12 is not constant, and no proof may say so."""
    monkeypatch.setattr(
        MACHINES["surface"], "currents", lambda self, z, theta: ((z[0] + 1e-12 * z[0] * z[1], z[1]), {})
    )
    model = build(load_drive("paper_spmsm"))
    step = build_filter(model, "ickf", gain)
    assert step.iteration_proof is None
    iterate = next(block for block in step.blocks if block.name.endswith("iterate"))
    assert idle_iteration_proof(model, iterate) is None


def test_one_cubature_iterate_is_the_ckf_where_h_is_linear() -> None:
    drive = variant(load_drive("paper_spmsm"), filter={"max_iterations": 1, "gain": "cubature"})
    ckf, ickf = _in_memory(drive, "ckf"), _in_memory(drive, "ickf")
    data = trajectory_of(drive, steps=300)
    a, b = ckf.run(data.u, data.y), ickf.run(data.u, data.y)
    np.testing.assert_allclose(a.x, b.x, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(a.P, b.P, rtol=1e-11, atol=1e-13)


def test_stage_names_carry_the_papers_equations(drive: Drive) -> None:
    model = build(drive)
    for kind, expected in (("ckf", set(range(13, 27))), ("ickf", {13, 14, 15, 16, 17, 28, 31, 32, 34})):
        for gain in ("cubature", "jacobian"):
            step = build_filter(model, kind, gain)
            found = {int(stage.equation) for block in step.blocks for stage in block.stages}
            assert expected <= found, (kind, gain)
