"""Time of a step in Python, by us and by the peers: the one table of seconds, so ratios are what to read."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from costs.counting import Figure, Inputs, Missing, figure
from costs.ours import Problem
from costs.table import Cell, Row, Table, Wanted, chosen, ratio
from model.drives.load import load_drive
from model.schema import Drive
from runtime.estimator.estimator import load

Array = NDArray[Any]
Progress = Callable[[str], None]

REPEATS = 5
LANES = 1000
UKF, SOUP, COMPILED = "filterpy UKF", "Stone Soup CKF", "ours, C, float32"
STEP, RUN, BATCH = "step(), us", "run(), us a step", f"batch of {LANES}, us a filter step"


def python_table(steps: int, progress: Progress) -> Table:
    """Microseconds a step."""
    problem = Problem.of(load_drive("paper_spmsm"))
    inputs = Inputs.of(problem.drive, steps, 0, problem.initial_state)
    rows: list[Row] = []
    for label, peer in ((UKF, filterpy_ukf), (SOUP, stone_soup_ckf)):
        progress(f"{label}: timing")
        rows.append(_peer_row(label, peer, problem.drive, inputs))
    for label, backend, dtype in (
        ("ours, NumPy, float64", "numpy", "float64"),
        ("ours, NumPy, float32", "numpy", "float32"),
        ("ours, C, float64", "c", "float64"),
        (COMPILED, "c", "float32"),
    ):
        progress(f"{label}: timing")
        rows.append(_own_row(label, backend, dtype, inputs))
    base = chosen(rows, UKF)[STEP]
    for row in rows:
        row["UKF / step()"] = ratio(base, row[STEP])
        row["UKF / batch"] = ratio(base, row[BATCH]) if row[BATCH] != "" else ""
    note = (
        f"paper_spmsm, CKF; best of {REPEATS} over {steps} steps on one core; inputs are arrays of the filter's type. "
        "The peers have no batch. The UKF with alpha 1, beta 0, kappa 0 is the CKF; their f is "
        "written with NumPy."
    )
    return Table("python", "Python: microseconds a step", rows, [note])


def wanted(table: Table) -> list[Wanted]:
    step = chosen(table.rows, COMPILED)
    return [
        Wanted("one step(), C back end, us", step[STEP], 1.0),
        Wanted("filterpy UKF / step(), C back end", step["UKF / step()"], 150, at_least=True),
    ]


def best(work: Callable[[], Any], count: int, begin: Callable[[], Any] = lambda: None) -> float:
    """Microseconds one of ``count`` pieces of work takes, the best of some repeats; ``begin`` is not timed."""
    shortest = math.inf
    for _ in range(REPEATS):
        begin()
        start = time.perf_counter()
        work()
        shortest = min(shortest, time.perf_counter() - start)
    return 1e6 * shortest / count


def _own_row(label: str, backend: str, dtype: str, inputs: Inputs) -> Row:
    made = []
    failed = figure(lambda: float(bool(made.append(load("paper_spmsm", "ckf", backend, dtype)))))
    if isinstance(failed, Missing):
        return {"filter": label, STEP: failed, RUN: failed, BATCH: failed, "deviation, sigma": failed}
    f = made[0]
    u, y = (inputs.rows[:, k : k + 2].astype(dtype) for k in (0, 2))
    pairs = list(zip(u, y, strict=True))

    def one_by_one() -> None:
        step = f.step
        for voltage, current in pairs:
            step(voltage, current)

    alone = best(one_by_one, len(pairs), f.reset)
    off = _off(f.x, inputs)
    together = best(lambda: f.run(u, y), len(u), f.reset)
    few = slice(0, max(2, len(u) // 20))
    lanes = [np.ascontiguousarray(np.broadcast_to(a[few, :, None], (*a[few].shape, LANES))) for a in (u, y)]
    batch = best(lambda: f.run(*lanes), lanes[0].shape[0] * LANES, f.reset)
    return {"filter": label, STEP: alone, RUN: together, BATCH: batch, "deviation, sigma": off}


def _peer_row(label: str, peer: Callable[[Drive], Any], drive: Drive, inputs: Inputs) -> Row:
    made = []
    failed: Figure = figure(lambda: float(bool(made.append(peer(drive)))))
    if isinstance(failed, Missing):
        return {"filter": label, STEP: failed, RUN: "", BATCH: "", "deviation, sigma": failed}
    begin, step = made[0]
    rows = inputs.rows.astype(float)
    x: list[Array] = []

    def one_by_one() -> None:
        for row in rows:
            last = step(row[:2], row[2:])
        x.append(last)

    alone = best(one_by_one, len(rows), begin)
    empty: Cell = ""
    return {"filter": label, STEP: alone, RUN: empty, BATCH: empty, "deviation, sigma": _off(x[-1], inputs)}


def _off(x: Array, inputs: Inputs) -> float:
    difference = np.asarray(x, dtype=float) - inputs.reference[-1]
    difference[3] = np.remainder(difference[3] + math.pi, 2 * math.pi) - math.pi
    return float(np.max(np.abs(difference) / inputs.sigma[-1]))


def euler(drive: Drive) -> Callable[[Array, Array], Array]:
    """f of the paper's model as one writes it with NumPy."""
    m, T = drive.motor, drive.model.sample_time
    R, L, psi, poles, J, D = m.stator_resistance, m.inductance_d, m.magnet_flux, m.pole_pairs, m.inertia, m.friction

    def f(x: Array, u: Array) -> Array:
        e = poles * x[2] * psi
        return np.array(
            [
                x[0] + T / L * (u[0] - R * x[0] + e * np.sin(x[3])),
                x[1] + T / L * (u[1] - R * x[1] - e * np.cos(x[3])),
                x[2] - T * D / J * x[2],
                x[3] + T * poles * x[2],
            ]
        )

    return f


def filterpy_ukf(drive: Drive) -> Any:
    """Reset and step of filterpy's UKF with the cubature points."""
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

    f, tuning = euler(drive), drive.filter
    n = len(tuning.process_noise)
    points = MerweScaledSigmaPoints(n, 1.0, 0.0, 0.0)
    ukf = UnscentedKalmanFilter(n, 2, drive.model.sample_time, lambda x: x[:2], lambda x, dt, u: f(x, u), points)

    def begin() -> None:
        ukf.x = np.zeros(n)
        ukf.P = np.diag(tuning.initial_covariance).astype(float)
        ukf.Q, ukf.R = np.diag(tuning.process_noise), np.diag(tuning.measurement_noise)

    def step(u: Array, y: Array) -> Array:
        ukf.predict(u=u)
        ukf.update(y)
        return np.asarray(ukf.x)

    return begin, step


def stone_soup_ckf(drive: Drive) -> Any:
    """Reset and step of Stone Soup's cubature predictor and updater."""
    import datetime

    from stonesoup.base import Property
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.base import TransitionModel
    from stonesoup.predictor.kalman import CubatureKalmanPredictor
    from stonesoup.types.array import StateVector, StateVectors
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import GaussianState
    from stonesoup.updater.kalman import CubatureKalmanUpdater

    f, tuning = euler(drive), drive.filter
    n = len(tuning.process_noise)
    noise = np.diag(tuning.process_noise)
    held: dict[str, Any] = {}

    class Motor(TransitionModel):
        """The motor, its voltage held in ``held``."""

        size: int = Property(default=n)

        @property
        def ndim_state(self) -> int:
            return self.size

        def function(self, state: Any, noise: Any = False, **kwargs: Any) -> Any:
            columns = np.asarray(state.state_vector, dtype=float).T
            images = np.array([f(column, held["u"]) for column in columns]).T
            return StateVectors(images)

        def covar(self, **kwargs: Any) -> Any:
            return noise

        def rvs(self, *args: Any, **kwargs: Any) -> Any:
            raise NotImplementedError

        def pdf(self, *args: Any, **kwargs: Any) -> Any:
            raise NotImplementedError

    predictor = CubatureKalmanPredictor(Motor())
    measured = LinearGaussian(n, (0, 1), np.diag(tuning.measurement_noise))
    updater = CubatureKalmanUpdater(measured)
    now = datetime.datetime(2000, 1, 1)

    def begin() -> None:
        held["x"] = GaussianState(StateVector(np.zeros(n)), np.diag(tuning.initial_covariance), timestamp=now)

    def step(u: Array, y: Array) -> Array:
        held["u"] = u
        prediction = predictor.predict(held["x"], timestamp=now)
        held["x"] = updater.update(SingleHypothesis(prediction, Detection(StateVector(y), timestamp=now)))
        return np.asarray(held["x"].state_vector, dtype=float).ravel()

    return begin, step
