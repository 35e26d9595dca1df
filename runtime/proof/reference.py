"""Link A: the paper's equations in plain NumPy float64, by hand, with loops.

The second opinion. It imports nothing of model, codegen or CasADi, and repeats the motor's f, h and H from
the paper (numbers in brackets are its equations). Readability before speed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Stages = dict[str, Any]


class Plant(Protocol):
    """A discrete motor: x' = f(x, u), y = h(x), H = dh/dx."""

    def f(self, x: Array, u: Array) -> Array: ...

    def h(self, x: Array) -> Array: ...

    def H(self, x: Array) -> Array: ...


@dataclass(frozen=True)
class MotorData:
    """SI units; ``p`` pole pairs, ``T`` sample time. ``loaded``: the load torque is a fifth state."""

    R: float
    L_d: float
    L_q: float
    psi: float
    p: int
    J: float
    D: float
    T: float
    exact: bool
    loaded: bool

    def mechanics(self, x: Array, T_e: Any) -> list[Any]:
        """omega, theta (and T_L) one sample later, under the electromagnetic torque T_e."""
        w, th = x[2], x[3]
        if not self.exact:  # (7) rows 3 and 4; (1) where the torque is known
            w_next = (1 - self.T * self.D / self.J) * w
            w_next += self.T / self.J * (T_e - x[4]) if self.loaded else 0.0
            return [w_next, th + self.T * self.p * w, *x[4:]]
        b = math.exp(-self.T * self.D / self.J)
        w_next = b * w
        w_next += self.T / self.J * (1 + b) / 2 * (T_e - x[4]) if self.loaded else 0.0
        return [w_next, th + self.T * self.p * (w + w_next) / 2, *x[4:]]


@dataclass(frozen=True)
class SurfaceMotor:
    """x = [i_alpha, i_beta, omega, theta(, T_L)], currents measured."""

    data: MotorData

    def f(self, x: Array, u: Array) -> Array:
        d = self.data
        i_alpha, i_beta, w, th = x[:4]
        w_e = d.p * w
        if not d.exact:  # (7)
            i = np.array(
                [
                    (1 - d.T * d.R / d.L_d) * i_alpha + d.T * d.psi / d.L_d * w_e * np.sin(th) + d.T / d.L_d * u[0],
                    (1 - d.T * d.R / d.L_d) * i_beta - d.T * d.psi / d.L_d * w_e * np.cos(th) + d.T / d.L_d * u[1],
                ]
            )
            return np.array([*i, *d.mechanics(x, self.torque(x[:2], th))])
        # (1) with the back-EMF held at the middle of the interval: a linear equation, solved exactly.
        a = math.exp(-d.T * d.R / d.L_d)
        middle = th + d.T * w_e / 2
        e = d.psi * w_e * np.array([-np.sin(middle), np.cos(middle)])
        i = a * x[:2] + (1 - a) / d.R * (u - e)
        return np.array([*i, *d.mechanics(x, self.torque((x[:2] + i) / 2, middle))])

    def torque(self, i: Array, th: Any) -> Any:
        """(1): 1.5 p psi i_q."""
        return 1.5 * self.data.p * self.data.psi * (i[1] * np.cos(th) - i[0] * np.sin(th))

    def h(self, x: Array) -> Array:
        return x[:2].copy()  # (5)

    def H(self, x: Array) -> Array:
        return np.eye(2, len(x))


@dataclass(frozen=True)
class SalientFluxMotor:
    """x = [psi_alpha, psi_beta, omega, theta(, T_L)]; measured: i = R(th) L^-1 (R(-th) psi - [psi_m, 0])."""

    data: MotorData

    def f(self, x: Array, u: Array) -> Array:
        d = self.data
        th = x[3]
        if not d.exact:
            psi = x[:2] + d.T * (u - d.R * self.currents(x[:2], th))
            return np.array([*psi, *d.mechanics(x, self.torque(x[:2], th))])
        # Rotor frame held at the middle of the interval; there d psi/dt = v - R L^-1 (psi - psi_m), diagonal.
        middle = th + d.T * d.p * x[2] / 2
        to_stator = rotation(middle)
        L = np.array([d.L_d, d.L_q])
        psi_m = np.array([d.psi, 0.0])
        a = np.exp(-d.T * d.R / L)
        steady = L / d.R * (to_stator.T @ u) + psi_m
        psi = to_stator @ (steady + a * (to_stator.T @ x[:2] - steady))
        return np.array([*psi, *d.mechanics(x, self.torque((x[:2] + psi) / 2, middle))])

    def torque(self, psi: Array, th: Any) -> Any:
        """1.5 p (psi x i)."""
        i = self.currents(psi, th)
        return 1.5 * self.data.p * (psi[0] * i[1] - psi[1] * i[0])

    def currents(self, psi: Array, th: Any) -> Array:
        d = self.data
        to_stator = rotation(th)
        psi_dq = to_stator.T @ psi
        return np.asarray(to_stator @ ((psi_dq - np.array([d.psi, 0.0])) / np.array([d.L_d, d.L_q])))

    def h(self, x: Array) -> Array:
        return self.currents(x[:2], x[3])

    def H(self, x: Array) -> Array:
        """By the product rule: di/dpsi = R L^-1 R^T; di/dth = R' i_dq + R L^-1 R'^T psi."""
        d = self.data
        to_stator = rotation(x[3])
        turned = to_stator @ np.array([[0.0, -1.0], [1.0, 0.0]])  # dR/dth
        inverse = np.diag([1 / d.L_d, 1 / d.L_q])
        i_dq = inverse @ (to_stator.T @ x[:2] - np.array([d.psi, 0.0]))
        H = np.zeros((2, len(x)))
        H[:, :2] = to_stator @ inverse @ to_stator.T
        H[:, 3] = turned @ i_dq + to_stator @ inverse @ turned.T @ x[:2]
        return H


def rotation(angle: Any) -> Array:
    """d-q to alpha-beta."""
    s, c = np.sin(angle), np.cos(angle)
    return np.array([[c, -s], [s, c]])


def make_motor(parameters: Mapping[str, Any]) -> Plant:
    """The motor of a drive file's parsed sections ``motor`` and ``model``."""
    m, model = parameters["motor"], parameters["model"]
    data = MotorData(
        R=m["stator_resistance"],
        L_d=m["inductance_d"],
        L_q=m["inductance_q"],
        psi=m["magnet_flux"],
        p=m["pole_pairs"],
        J=m["inertia"],
        D=m["friction"],
        T=model["sample_time"],
        exact=model["discretization"] == "exact",
        loaded={"constant_speed": False, "load_torque": True}[model.get("mechanics", "constant_speed")],
    )
    motors: dict[str, type[SurfaceMotor] | type[SalientFluxMotor]] = {
        "surface": SurfaceMotor,
        "salient_flux": SalientFluxMotor,
    }
    return motors[model["machine"]](data)


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

    def _time_update(self, u: Array) -> tuple[Array, Array]:
        n = len(self.x)
        S = np.linalg.cholesky(self.P)  # (13)
        X = self._points(S, self.x)  # (14)
        X_prop = np.array([self.motor.f(X[:, i], u) for i in range(2 * n)]).T  # (15)
        x_pred = X_prop.mean(axis=1)  # (16)
        P_pred = covariance(X_prop, x_pred, X_prop, x_pred) + np.diag(self.Q)  # (17)
        self.stages |= {"S": S, "X": X, "X_prop": X_prop, "x_pred": x_pred, "P_pred": P_pred}
        return x_pred, P_pred

    @staticmethod
    def _points(S: Array, centre: Array) -> Array:
        n = len(centre)
        xi = math.sqrt(n) * np.hstack([np.eye(n), -np.eye(n)])  # (11)
        return S @ xi + centre[:, None]

    def _ckf_update(self, x_pred: Array, P_pred: Array, y: Array) -> tuple[Array, Array]:
        S = np.linalg.cholesky(P_pred)  # (18)
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
        S = np.linalg.cholesky(P_pred)
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
        self.stages["iterates"] = iterates
        return x_j, P_pred - K @ Pyy @ K.T  # (34), (32)

    # --- not in the paper: the two filters people compare with

    def _ekf_prediction(self, u: Array) -> tuple[Array, Array]:
        F = jacobian(lambda x: self.motor.f(x, u), self.x)
        x_pred, P_pred = self.motor.f(self.x, u), F @ self.P @ F.T + np.diag(self.Q)
        self.stages |= {"x_pred": x_pred, "F": F, "P_pred": P_pred}
        return x_pred, P_pred

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
        reach = math.sqrt(n + 1.0) * S
        X = np.column_stack([centre, centre[:, None] + reach, centre[:, None] - reach])
        return X, np.array([1.0 / (n + 1.0)] + [0.5 / (n + 1.0)] * (2 * n))

    def _ukf_prediction(self, u: Array) -> tuple[Array, Array]:
        S = np.linalg.cholesky(self.P)
        X, w = self._sigma_points(S, self.x)
        X_prop = np.array([self.motor.f(X[:, i], u) for i in range(X.shape[1])]).T
        x_pred = X_prop @ w
        d = X_prop - x_pred[:, None]
        P_pred = d @ np.diag(w) @ d.T + np.diag(self.Q)
        self.stages |= {"S": S, "X": X, "X_prop": X_prop, "x_pred": x_pred, "P_pred": P_pred}
        return x_pred, P_pred

    def _ukf_update(self, x_pred: Array, P_pred: Array, y: Array) -> tuple[Array, Array]:
        S = np.linalg.cholesky(P_pred)
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


def make_reference(parameters: Mapping[str, Any], kind: str, gain: str, initial_state: Array) -> Reference:
    """The reference of a drive file's parsed sections, at its P_0."""
    tuning = parameters["filter"]
    return Reference(
        motor=make_motor(parameters),
        kind=kind,
        gain=gain,
        Q=np.array(tuning["process_noise"], dtype=float),
        R=np.array(tuning["measurement_noise"], dtype=float),
        x=np.array(initial_state, dtype=float),
        P=np.diag(np.array(tuning["initial_covariance"], dtype=float)),
        N_max=tuning["max_iterations"],
        eps=tuning["tolerance"],
    )
