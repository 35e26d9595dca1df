"""Link A: the paper's equations in plain NumPy float64, by hand, with loops.

The second opinion. It imports nothing of model, codegen or CasADi, nor do the motors of :mod:`runtime.proof.motors`
it filters (numbers in brackets are the paper's equations). Readability before speed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.proof.motors import Plant, make_motor

Array = NDArray[Any]
Stages = dict[str, Any]


@dataclass
class Reference:
    """A filter in the paper's words. ``step`` returns every stage by name; ``x`` and ``P`` move on."""

    motor: Plant
    kind: str
    gain: str
    Q: Array
    R: Array
    x: Array
    P: Array
    N_max: int
    eps: float
    order: list[int]  # of the states in the factors of P
    stages: Stages = field(default_factory=dict)

    def step(self, u: Array, y: Array) -> Stages:
        """One time update with u (V), one measurement update with y (A)."""
        self.stages = {}
        predict = {"ekf": self._ekf_prediction, "ukf": self._ukf_prediction}.get(self.kind, self._time_update)
        update = {"ekf": self._ekf_update, "ukf": self._ukf_update, "ickf": self._ickf_update}.get(
            self.kind, self._ckf_update
        )
        x_pred, P_pred = predict(u)
        self.x, self.P = update(x_pred, P_pred, y)
        self.x[3] = wrap(self.x[3])
        self.stages |= {"x": self.x, "P": self.P}
        return self.stages

    def coast(self, u: Array) -> None:
        """A sample whose measurement is missing: the prediction is the estimate."""
        predict = {"ekf": self._ekf_prediction, "ukf": self._ukf_prediction}.get(self.kind, self._time_update)
        self.x, self.P = predict(u)
        self.x[3] = wrap(self.x[3])

    def _time_update(self, u: Array) -> tuple[Array, Array]:
        n = len(self.x)
        S = self._root(self.P)  # (13)
        X = self._points(S, self.x)  # (14)
        X_prop = np.array([self.motor.f(X[:, i], u) for i in range(2 * n)]).T  # (15)
        x_pred = X_prop.mean(axis=1)  # (16)
        P_pred = covariance(X_prop, x_pred, X_prop, x_pred) + np.diag(self.Q)  # (17)
        self.stages |= {"S": S, "X": X, "X_prop": X_prop, "x_pred": x_pred, "P_pred": P_pred}
        return x_pred, P_pred

    def _root(self, P: Array) -> Array:
        """S with S S^T = P by Cholesky's method, its rows as its columns in the states' order there."""
        return np.asarray(np.linalg.cholesky(P[np.ix_(self.order, self.order)]))

    def _points(self, S: Array, centre: Array) -> Array:
        n = len(centre)
        xi = math.sqrt(n) * np.hstack([np.eye(n), -np.eye(n)])  # (11)
        return self._by_state(S) @ xi + centre[:, None]

    def _by_state(self, S: Array) -> Array:
        """Row k of S is that of state order[k]."""
        return S[np.argsort(self.order)]

    def _ckf_update(self, x_pred: Array, P_pred: Array, y: Array) -> tuple[Array, Array]:
        S = self._root(P_pred)  # (18)
        X = self._points(S, x_pred)  # (19)
        Y = np.array([self.motor.h(X[:, i]) for i in range(X.shape[1])]).T  # (20)
        y_pred = Y.mean(axis=1)  # (21)
        Pyy = covariance(Y, y_pred, Y, y_pred) + np.diag(self.R)  # (22)
        Pxy = covariance(X, x_pred, Y, y_pred)  # (23)
        K = Pxy @ np.linalg.inv(Pyy)  # (24)
        innovation = y - y_pred
        x = x_pred + K @ innovation  # (25)
        P = P_pred - K @ Pyy @ K.T  # (26)
        self.stages |= {"S_pred": S, "X_pred": X, "Y": Y, "y_pred": y_pred, "Pyy": Pyy, "Pxy": Pxy, "K": K}
        self.stages |= {"innovation": innovation}
        return x, P

    def _ickf_update(self, x_pred: Array, P_pred: Array, y: Array) -> tuple[Array, Array]:
        S = self._root(P_pred)
        x_j = x_pred
        iterates = []
        while True:
            H, h_j = self.motor.H(x_j), self.motor.h(x_j)
            here: Stages = {"H": H, "h_j": h_j, "S_pred": S}
            if self.gain == "jacobian":
                Pyy = H @ P_pred @ H.T + np.diag(self.R)  # (29)
                Pxy = P_pred @ H.T  # (30)
            else:
                X = self._points(S, x_j)
                Y = np.array([self.motor.h(X[:, i]) for i in range(X.shape[1])]).T
                y_mean = Y.mean(axis=1)
                Pyy = covariance(Y, y_mean, Y, y_mean) + np.diag(self.R)  # (22)
                Pxy = covariance(X, x_j, Y, y_mean)  # (23)
                here |= {"X_j": X, "Y_j": Y, "y_mean": y_mean}
            K = Pxy @ np.linalg.inv(Pyy)
            innovation = y - h_j - H @ (x_pred - x_j)
            x_next = x_pred + K @ innovation  # (31)
            iterates.append({**here, "Pyy": Pyy, "Pxy": Pxy, "K": K, "innovation": innovation, "x_next": x_next})
            done = np.linalg.norm(x_next - x_j) <= self.eps  # (33)
            x_j = x_next
            if done or len(iterates) >= self.N_max:
                break
        self.stages |= {"iterates": iterates, "converged": done}
        return x_j, P_pred - K @ Pyy @ K.T  # (34), (32)

    # --- not in the paper: the two filters people compare with

    def _ekf_prediction(self, u: Array) -> tuple[Array, Array]:
        F = self._slope(u)
        x_pred, P_pred = self.motor.f(self.x, u), F @ self.P @ F.T + np.diag(self.Q)
        self.stages |= {"x_pred": x_pred, "F": F, "P_pred": P_pred}
        return x_pred, P_pred

    def _slope(self, u: Array) -> Array:
        """df/dx: the motor's own F where it has one (what is no formula in NumPy takes no complex step)."""
        own = getattr(self.motor, "F", None)
        return np.asarray(own(self.x, u)) if own else jacobian(lambda x: self.motor.f(x, u), self.x)

    def _ekf_update(self, x_pred: Array, P_pred: Array, y: Array) -> tuple[Array, Array]:
        H = self.motor.H(x_pred)
        Pxy = P_pred @ H.T
        Pyy = H @ Pxy + np.diag(self.R)
        K = Pxy @ np.linalg.inv(Pyy)
        innovation = y - self.motor.h(x_pred)
        self.stages |= {"H": H, "Pxy": Pxy, "Pyy": Pyy, "K": K, "innovation": innovation}
        return x_pred + K @ innovation, P_pred - K @ Pyy @ K.T

    def _sigma_points(self, S: Array, centre: Array) -> tuple[Array, Array]:
        """Julier and Uhlmann, kappa = 1: the centre with weight 1 / (n + 1), the others share the rest."""
        n = len(centre)
        reach = math.sqrt(n + 1.0) * self._by_state(S)
        X = np.column_stack([centre, centre[:, None] + reach, centre[:, None] - reach])
        return X, np.array([1.0 / (n + 1.0)] + [0.5 / (n + 1.0)] * (2 * n))

    def _ukf_prediction(self, u: Array) -> tuple[Array, Array]:
        S = self._root(self.P)
        X, w = self._sigma_points(S, self.x)
        X_prop = np.array([self.motor.f(X[:, i], u) for i in range(X.shape[1])]).T
        x_pred = X_prop @ w
        d = X_prop - x_pred[:, None]
        P_pred = d @ np.diag(w) @ d.T + np.diag(self.Q)
        self.stages |= {"S": S, "X": X, "X_prop": X_prop, "x_pred": x_pred, "P_pred": P_pred}
        return x_pred, P_pred

    def _ukf_update(self, x_pred: Array, P_pred: Array, y: Array) -> tuple[Array, Array]:
        S = self._root(P_pred)
        X, w = self._sigma_points(S, x_pred)
        Y = np.array([self.motor.h(X[:, i]) for i in range(X.shape[1])]).T
        y_pred = Y @ w
        d_x, d_y = X - x_pred[:, None], Y - y_pred[:, None]
        Pyy = d_y @ np.diag(w) @ d_y.T + np.diag(self.R)
        Pxy = d_x @ np.diag(w) @ d_y.T
        K = Pxy @ np.linalg.inv(Pyy)
        innovation = y - y_pred
        self.stages |= {"S_pred": S, "X_pred": X, "Y": Y, "y_pred": y_pred, "Pyy": Pyy, "Pxy": Pxy, "K": K}
        self.stages |= {"innovation": innovation}
        return x_pred + K @ innovation, P_pred - K @ Pyy @ K.T


def jacobian(function: Callable[[Array], Array], x: Array) -> Array:
    """df/dx by complex steps: exact to rounding, whatever f's formula."""
    h = 1e-30
    columns = [function(x + 1j * h * row).imag / h for row in np.eye(len(x))]
    return np.array(columns).T


def covariance(a: Array, a_mean: Array, b: Array, b_mean: Array) -> Array:
    """(17), (22), (23), centred: mean of (a_i - a_mean)(b_i - b_mean)^T over the columns."""
    total = np.zeros((a.shape[0], b.shape[0]))
    for i in range(a.shape[1]):
        total += np.outer(a[:, i] - a_mean, b[:, i] - b_mean)
    return np.asarray(total / a.shape[1])


def wrap(angle: float) -> float:
    """The angle in [-pi, pi)."""
    return (angle + math.pi) % (2 * math.pi) - math.pi


def _order(parameters: Mapping[str, Any]) -> list[int]:
    """Of the states in the factors of P: the state's own unless the drive file names another."""
    names = parameters["filter"].get("root_order")
    if names is None:
        return list(range(len(parameters["filter"]["process_noise"])))
    moving = [name for name in ("omega", "theta", "load_torque") if name in names]
    slow = list(parameters["model"]["adaptive"])
    vector = sorted(set(names) - {*moving, *slow})  # alpha, beta
    return [[*vector, *moving, *slow].index(name) for name in names]


def make_reference(
    parameters: Mapping[str, Any], kind: str, gain: str, initial_state: Array, motor: Plant | None = None
) -> Reference:
    """The reference of a drive file's parsed sections, at its P_0; ``motor`` by default the one they name."""
    tuning = parameters["filter"]
    motor = motor or make_motor(parameters)
    return Reference(
        motor=motor,
        kind=kind,
        gain=gain,
        Q=np.array(tuning["process_noise"], dtype=float),
        R=np.array(tuning["measurement_noise"], dtype=float),
        x=np.array(initial_state, dtype=float),
        P=np.diag(np.array(tuning["initial_covariance"], dtype=float)),
        N_max=tuning["max_iterations"],
        eps=tuning["tolerance"],
        order=_order(parameters),
    )
