"""Link A: the paper's equations in plain NumPy float64, by hand, with loops.

The second opinion. It imports nothing of model, codegen or CasADi, nor do the motors of :mod:`runtime.proof.motors`
it filters and their inverter, :mod:`runtime.proof.inverter` (numbers in brackets are the paper's equations).
Readability before speed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.proof.inverter import LossyInverter, make_inverter
from runtime.proof.motors import Plant, make_motor
from runtime.proof.wrong_data import STEP, bounds, doubt, moved_motors

Array = NDArray[Any]
Stages = dict[str, Any]


@dataclass
class Reference:
    """A filter in the paper's words. ``step`` returns every stage by name; ``x`` and ``P`` move on.

    x (..., n), P (..., n, n), u and y (..., 2): leading axes are filters side by side, each on its own.
    """

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
    inverter: LossyInverter | None = None
    shortfall: Array = field(default_factory=lambda: np.zeros(2))  # of the voltage that arrives, per V of a state V_d
    way: Array = field(default_factory=lambda: np.zeros(2))  # the same of any V_d
    unsure: Array = field(default_factory=lambda: np.zeros(1))  # of the way: 0 where all legs fall short in full
    doubt: tuple[float, float] | None = None  # V: deviation of a V_d that is no state, and where no sign is sure
    moved: list[tuple[Any, float]] = field(default_factory=list)  # the motor with a datum moved, and its deviation
    bounds: list[tuple[int, float, float]] = field(default_factory=list)  # of slow states, by place
    early: bool = True  # iterating ends once (33) holds
    stages: Stages = field(default_factory=dict)

    def step(self, u: Array, y: Array) -> Stages:
        """One time update with u (V), one measurement update with y (A).

        Parameters
        ----------
        u : ndarray
            Voltages, V, (N, 2).
        y : ndarray
            Currents, A, (N, 2).
        """
        self.stages = {}
        update = {"ekf": self._ekf_update, "ukf": self._ukf_update, "ickf": self._ickf_update}.get(
            self.kind, self._ckf_update
        )
        x_pred, P_pred = self._predict(u)
        self.x, self.P = update(x_pred, P_pred, y)
        self._keep()
        self.stages |= {"x": self.x, "P": self.P}
        return self.stages

    def coast(self, u: Array) -> None:
        """A sample whose measurement is missing: the prediction is the estimate.

        Parameters
        ----------
        u : ndarray
            Voltages, V, (N, 2).
        """
        self.x, self.P = self._predict(u)
        self._keep()

    def _keep(self) -> None:
        """The angle within a turn, slow states within their bounds."""
        self.x[..., 3] = wrap(self.x[..., 3])
        for place, least, most in self.bounds:
            self.x[..., place] = np.clip(self.x[..., place], least, most)

    def _predict(self, u: Array) -> tuple[Array, Array]:
        if self.inverter:  # the estimate's word for all points alike: which way, and at its own V_d what does not show
            i = self._h(self.x)
            way, shown = self.inverter.shortfall(i), self.inverter.shown(i)
            estimated = self.inverter.place is not None
            u = u - self.inverter.voltage(self.x) * (1 - shown if estimated else 1) * way
            self.way, self.shortfall = way, shown * way if estimated else np.zeros(2)
            self.unsure = self.inverter.unsure(i)
            g = np.concatenate([shown * way, self.unsure][: 2 if self.doubt else 1], axis=-1)
            self.stages |= {"g": g[..., None, :], "v": u[..., None, :]}
        predict = {"ekf": self._ekf_prediction, "ukf": self._ukf_prediction}.get(self.kind, self._time_update)
        return predict(u)

    def _time_update(self, u: Array) -> tuple[Array, Array]:
        n = self.x.shape[-1]
        S = self._root(self.P)  # (13)
        X = self._points(S, self.x)  # (14)
        X_prop = np.stack([self._f(X[..., i], u) for i in range(2 * n)], axis=-1)  # (15)
        x_pred = X_prop.mean(axis=-1)  # (16)
        P_pred = covariance(X_prop, x_pred, X_prop, x_pred) + self._noise(u)  # (17)
        self.stages |= {"S": S, "X": X, "X_prop": X_prop, "x_pred": x_pred, "P_pred": P_pred}
        return x_pred, P_pred

    def _noise(self, u: Array) -> Array:
        """Q and, where motor data may be wrong, sigma^2 (df/dp)(df/dp)^T for each, at the estimate."""
        Q = np.diag(self.Q)
        shifts = [deviation * self._f(self.x, u, motor).imag / STEP for motor, deviation in self.moved]
        if self.doubt:
            shifts += [self._f(self.x, u - 1j * STEP * volts).imag / STEP for volts in self._doubtful_volts()]
        if not shifts:
            return Q
        Q_p = np.zeros((*self.x.shape, self.x.shape[-1]))
        for shift in shifts:
            Q_p += shift[..., :, None] * shift[..., None, :]
        self.stages["Q_p"] = Q_p
        return np.asarray(Q + Q_p)

    def _doubtful_volts(self) -> list[Array]:
        """One sigma of each voltage the inverter may take beside its V_d g, (..., 2).

        A wrong V_d the same way. And all that the legs do not say, as much on each axis; the axes are the rotor's.
        """
        assert self.doubt is not None
        theta = self.x[..., 3]
        ahead = np.stack([np.cos(theta), np.sin(theta)], axis=-1)
        aside = np.stack([-np.sin(theta), np.cos(theta)], axis=-1)
        noise = self.doubt[1] * self.unsure
        return [self.doubt[0] * self.way, noise * ahead, noise * aside]

    def _f(self, x: Array, u: Array, motor: Plant | None = None) -> Array:
        """The motor's f, whose states are the first axis, of the voltage that arrives."""
        f, v = (motor or self.motor).f, self._applied(x, u)
        return np.moveaxis(np.asarray(f(np.moveaxis(x, -1, 0), np.moveaxis(v, -1, 0))), 0, -1)

    def _applied(self, x: Array, u: Array) -> Array:
        """What a state's own V_d leaves of a voltage."""
        return u - self.inverter.voltage(x) * self.shortfall if self.inverter else u

    def _h(self, x: Array) -> Array:
        return np.moveaxis(np.asarray(self.motor.h(np.moveaxis(x, -1, 0))), 0, -1)

    def _H(self, x: Array) -> Array:
        """(..., 2, n), also where it is the same everywhere."""
        H = np.moveaxis(np.asarray(self.motor.H(np.moveaxis(x, -1, 0))), (0, 1), (-2, -1))
        return np.broadcast_to(H, (*x.shape[:-1], *H.shape[-2:]))

    def _root(self, P: Array) -> Array:
        """S with S S^T = P by Cholesky's method, its rows as its columns in the states' order there."""
        return np.asarray(np.linalg.cholesky(P[..., self.order, :][..., self.order]))

    def _points(self, S: Array, centre: Array) -> Array:
        n = centre.shape[-1]
        xi = math.sqrt(n) * np.hstack([np.eye(n), -np.eye(n)])  # (11)
        return np.asarray(self._by_state(S) @ xi + centre[..., None])

    def _by_state(self, S: Array) -> Array:
        """Row k of S is that of state order[k]."""
        return S[..., np.argsort(self.order), :]

    def _ckf_update(self, x_pred: Array, P_pred: Array, y: Array) -> tuple[Array, Array]:
        S = self._root(P_pred)  # (18)
        X = self._points(S, x_pred)  # (19)
        Y = np.stack([self._h(X[..., i]) for i in range(X.shape[-1])], axis=-1)  # (20)
        y_pred = Y.mean(axis=-1)  # (21)
        Pyy = covariance(Y, y_pred, Y, y_pred) + np.diag(self.R)  # (22)
        Pxy = covariance(X, x_pred, Y, y_pred)  # (23)
        K = Pxy @ np.linalg.inv(Pyy)  # (24)
        innovation = y - y_pred
        x = x_pred + times(K, innovation)  # (25)
        P = P_pred - K @ Pyy @ transposed(K)  # (26)
        self.stages |= {"S_pred": S, "X_pred": X, "Y": Y, "y_pred": y_pred, "Pyy": Pyy, "Pxy": Pxy, "K": K}
        self.stages |= {"innovation": innovation}
        return x, P

    def _ickf_update(self, x_pred: Array, P_pred: Array, y: Array) -> tuple[Array, Array]:
        S = self._root(P_pred)
        x_j = x_pred
        iterates: list[Stages] = []
        done = np.zeros(x_pred.shape[:-1], dtype=bool)
        count = np.zeros(x_pred.shape[:-1], dtype=int)
        while True:
            here = self._iterate(S, x_pred, P_pred, x_j, y)
            for name, value in here.items() if iterates else ():  # a filter that has converged stays where it was
                stays = done.reshape(done.shape + (1,) * (value.ndim - done.ndim))
                here[name] = np.where(stays, iterates[-1][name], value)
            iterates.append(here)
            count += ~done
            converged = done | (np.linalg.norm(here["x_next"] - x_j, axis=-1) <= self.eps)  # (33)
            x_j, done = here["x_next"], converged & self.early
            if done.all() or len(iterates) >= self.N_max:
                break
        self.stages |= {"iterates": iterates, "iterations": count, "converged": converged}
        return x_j.copy(), P_pred - here["K"] @ here["Pyy"] @ transposed(here["K"])  # (34), (32)

    def _iterate(self, S: Array, x_pred: Array, P_pred: Array, x_j: Array, y: Array) -> Stages:
        H, h_j = self._H(x_j), self._h(x_j)
        here: Stages = {"H": H, "h_j": h_j, "S_pred": S}
        if self.gain == "jacobian":
            Pyy = H @ P_pred @ transposed(H) + np.diag(self.R)  # (29)
            Pxy = P_pred @ transposed(H)  # (30)
        else:
            X = self._points(S, x_j)
            Y = np.stack([self._h(X[..., i]) for i in range(X.shape[-1])], axis=-1)
            y_mean = Y.mean(axis=-1)
            Pyy = covariance(Y, y_mean, Y, y_mean) + np.diag(self.R)  # (22)
            Pxy = covariance(X, x_j, Y, y_mean)  # (23)
            here |= {"X_j": X, "Y_j": Y, "y_mean": y_mean}
        K = Pxy @ np.linalg.inv(Pyy)
        innovation = y - h_j - times(H, x_pred - x_j)
        x_next = x_pred + times(K, innovation)  # (31)
        return {**here, "Pyy": Pyy, "Pxy": Pxy, "K": K, "innovation": innovation, "x_next": x_next}

    # --- not in the paper: the two filters people compare with

    def _ekf_prediction(self, u: Array) -> tuple[Array, Array]:
        F = self._slope(u)
        x_pred, P_pred = self._f(self.x, u), F @ self.P @ transposed(F) + self._noise(u)
        self.stages |= {"x_pred": x_pred, "F": F, "P_pred": P_pred}
        return x_pred, P_pred

    def _slope(self, u: Array) -> Array:
        """df/dx: the motor's own F where it has one (what is no formula in NumPy takes no complex step)."""
        own = getattr(self.motor, "F", None)
        if own:
            at = np.moveaxis(self.x, -1, 0), np.moveaxis(self._applied(self.x, u), -1, 0)
            F = np.moveaxis(np.asarray(own(*at)), (0, 1), (-2, -1)).copy()
            if self.inverter and self.inverter.place is not None:  # V_d acts through the voltage
                B = np.moveaxis(np.asarray(self.motor.B(*at)), (0, 1), (-2, -1))  # type: ignore[attr-defined]
                F[..., self.inverter.place] -= times(B, self.shortfall)
            return F
        return jacobian(lambda x: self._f(x, u), self.x)

    def _ekf_update(self, x_pred: Array, P_pred: Array, y: Array) -> tuple[Array, Array]:
        H = self._H(x_pred)
        Pxy = P_pred @ transposed(H)
        Pyy = H @ Pxy + np.diag(self.R)
        K = Pxy @ np.linalg.inv(Pyy)
        innovation = y - self._h(x_pred)
        self.stages |= {"H": H, "Pxy": Pxy, "Pyy": Pyy, "K": K, "innovation": innovation}
        return x_pred + times(K, innovation), P_pred - K @ Pyy @ transposed(K)

    def _sigma_points(self, S: Array, centre: Array) -> tuple[Array, Array]:
        """Julier and Uhlmann, kappa = 1: the centre with weight 1 / (n + 1), the others share the rest."""
        n = centre.shape[-1]
        reach = math.sqrt(n + 1.0) * self._by_state(S)
        middle = centre[..., None]
        X = np.concatenate([middle, middle + reach, middle - reach], axis=-1)
        return X, np.array([1.0 / (n + 1.0)] + [0.5 / (n + 1.0)] * (2 * n))

    def _ukf_prediction(self, u: Array) -> tuple[Array, Array]:
        S = self._root(self.P)
        X, w = self._sigma_points(S, self.x)
        X_prop = np.stack([self._f(X[..., i], u) for i in range(X.shape[-1])], axis=-1)
        x_pred = X_prop @ w
        d = X_prop - x_pred[..., None]
        P_pred = d @ np.diag(w) @ transposed(d) + self._noise(u)
        self.stages |= {"S": S, "X": X, "X_prop": X_prop, "x_pred": x_pred, "P_pred": P_pred}
        return x_pred, P_pred

    def _ukf_update(self, x_pred: Array, P_pred: Array, y: Array) -> tuple[Array, Array]:
        S = self._root(P_pred)
        X, w = self._sigma_points(S, x_pred)
        Y = np.stack([self._h(X[..., i]) for i in range(X.shape[-1])], axis=-1)
        y_pred = Y @ w
        d_x, d_y = X - x_pred[..., None], Y - y_pred[..., None]
        Pyy = d_y @ np.diag(w) @ transposed(d_y) + np.diag(self.R)
        Pxy = d_x @ np.diag(w) @ transposed(d_y)
        K = Pxy @ np.linalg.inv(Pyy)
        innovation = y - y_pred
        self.stages |= {"S_pred": S, "X_pred": X, "Y": Y, "y_pred": y_pred, "Pyy": Pyy, "Pxy": Pxy, "K": K}
        self.stages |= {"innovation": innovation}
        return x_pred + times(K, innovation), P_pred - K @ Pyy @ transposed(K)


def transposed(matrix: Array) -> Array:
    """Of each filter's matrix.

    Parameters
    ----------
    matrix : ndarray, (..., m, n)
    """
    return np.swapaxes(matrix, -1, -2)


def times(matrix: Array, vector: Array) -> Array:
    """Each filter's matrix (..., m, n) times its vector (..., n).

    Parameters
    ----------
    matrix : ndarray, (..., m, n)
    vector : ndarray, (..., n)

    Returns
    -------
    ndarray, (..., m)
    """
    return np.asarray(matrix @ vector[..., None])[..., 0]


def jacobian(function: Callable[[Array], Array], x: Array) -> Array:
    """df/dx by complex steps: exact to rounding, whatever f's formula.

    Parameters
    ----------
    function : callable
    x : ndarray
        State, in the model's order.
    """
    h = 1e-30
    columns = [function(x + 1j * h * row).imag / h for row in np.eye(x.shape[-1])]
    return np.stack(columns, axis=-1)


def covariance(a: Array, a_mean: Array, b: Array, b_mean: Array) -> Array:
    """(17), (22), (23), centred: mean of (a_i - a_mean)(b_i - b_mean)^T over the columns.

    Parameters
    ----------
    a, b : ndarray, (..., m, points) and (..., k, points)
        The points are the columns.
    a_mean, b_mean : ndarray, (..., m) and (..., k)

    Returns
    -------
    ndarray, (..., m, k)
    """
    total = np.zeros((*a.shape[:-1], b.shape[-2]))
    for i in range(a.shape[-1]):
        total += (a[..., i] - a_mean)[..., :, None] * (b[..., i] - b_mean)[..., None, :]
    return np.asarray(total / a.shape[-1])


def wrap(angle: Any) -> Any:
    """The angle in [-pi, pi).

    Parameters
    ----------
    angle : object
        Electrical angle, rad.
    """
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
    """The reference of a drive file's parsed sections, at its P_0; ``motor`` by default the one they name.

    Parameters
    ----------
    parameters : mapping of str to Any
        Sections of the drive file, parsed.
    kind : str
        Filter kind, such as "ickf".
    gain : str
        "cubature" or "jacobian"; matters to the ICKF alone.
    initial_state : ndarray
    motor : Plant, optional
        The motor's data.
    """
    tuning = parameters["filter"]
    own = getattr(motor, "moved", None)  # a machine file's motors are made elsewhere
    moved = own if own is not None else moved_motors(parameters)
    return Reference(
        motor=motor or make_motor(parameters),
        kind=kind,
        gain=gain,
        Q=np.array(tuning["process_noise"], dtype=float),
        R=np.array(tuning["measurement_noise"], dtype=float),
        x=np.array(initial_state, dtype=float),
        P=np.diag(np.array(tuning["initial_covariance"], dtype=float)),
        N_max=tuning["max_iterations"],
        eps=tuning["tolerance"],
        order=_order(parameters),
        inverter=make_inverter(parameters),
        moved=moved,
        bounds=bounds(parameters),
        doubt=doubt(parameters),
        early=not (parameters.get("target") or {}).get("constant_time", False),
    )
