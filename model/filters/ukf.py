"""Unscented Kalman filter after Julier and Uhlmann (1997): the cubature points and one in the centre."""

from __future__ import annotations

import math
from typing import Any

from model.filters.cubature import (
    Matrix,
    Vector,
    cholesky,
    coast,
    gain,
    pack,
    packed_names,
    points,
    reduced,
    unpack,
    wrapped,
)
from model.filters.program import BlockBuilder, Call, FilterStep, IfAccepted
from model.quantities import Block
from model.state_space import INPUTS, OUTPUTS, StateSpaceModel

#: Weight of the centre: KAPPA / (n + KAPPA). Positive, so that P stays positive definite in float32 too.
KAPPA = 1.0


def build_ukf(model: StateSpaceModel, gain: str = "cubature") -> FilterStep:
    """The UKF's step, kappa = 1; points are drawn anew for the measurement. ``gain`` changes nothing."""
    update = IfAccepted((Call(measurement_update(model)),), (Call(coast(model)),))
    return FilterStep("ukf", "cubature", model, (Call(time_update(model)), update))


def _sides(n: int) -> list[str]:
    return ["c", *(f"{c}p" for c in range(n)), *(f"{c}m" for c in range(n))]


def _moments(
    b: BlockBuilder, pts: list[Vector], names: list[str], tag: str
) -> tuple[Vector, list[Vector], list[float]]:
    """Weighted mean about the centre point, deviations from it, and the weights."""
    n = (len(pts) - 1) // 2
    weights = [KAPPA / (n + KAPPA)] + [0.5 / (n + KAPPA)] * (2 * n)
    centre = pts[0]
    offset = []
    for i in range(len(centre)):
        total = pts[1][i] - centre[i]
        for point in pts[2:]:
            total = total + (point[i] - centre[i])
        offset.append(weights[1] * total)
    b.stage(f"offset_{tag}", "UKF", "", offset, [f"offset_{name}" for name in names], scale="none")
    middle = [a + d for a, d in zip(centre, offset, strict=True)]
    return middle, _deviations(b, pts, middle, names), weights


def _deviations(b: BlockBuilder, pts: list[Vector], centre: Vector, names: list[str]) -> list[Vector]:
    dev = [[value - m for value, m in zip(point, centre, strict=True)] for point in pts]
    for side, point in zip(_sides(len(pts) // 2), dev, strict=True):
        labels = [f"dev_{name}_{side}" for name in names]
        b.stage(labels[0], "UKF", "", point, labels, scale="none")
    return dev


def _spread(a: list[Vector], c: list[Vector], weights: list[float]) -> Matrix:
    """Weighted sum of a_i c_i^T."""

    def entry(i: int, j: int) -> Any:
        around = a[1][i] * c[1][j]
        for p, q in zip(a[2:], c[2:], strict=True):
            around = around + p[i] * q[j]
        return weights[0] * (a[0][i] * c[0][j]) + weights[1] * around

    return [[entry(i, j) for j in range(len(c[0]))] for i in range(len(a[0]))]


def _draw(b: BlockBuilder, P: Matrix, x: Vector, states: list[str], tag: str) -> list[Vector]:
    """Centre and x +- sqrt(n + kappa) S_i."""
    n = len(x)
    S = b.lower(f"S{tag}", "UKF", "S = chol(P)", cholesky(P))
    return [x, *points(b, "UKF", S, x, states, tag, radius=math.sqrt(n + KAPPA))]


def _record(b: BlockBuilder, name: str, meaning: str, pts: list[Vector], names: list[str], kind: str) -> None:
    sides = _sides(len(pts) // 2)
    entries = [pts[k][i] for i in range(len(names)) for k in range(len(pts))]
    labels = [f"{names[i]}_{sides[k]}" for i in range(len(names)) for k in range(len(pts))]
    b.stage(name, "UKF", meaning, entries, labels, scale=kind, columns=len(pts))


def time_update(model: StateSpaceModel) -> Block:
    """Sigma points through f."""
    states = [state.name for state in model.states]
    n = len(states)
    b = BlockBuilder("ukf_time_update", "Time update of the UKF")
    x = b.input("x", states)
    P = unpack(b.input("P", packed_names("P", n)), n)
    Q = b.input("Q", [f"Q_{i}" for i in range(n)])
    u = b.input("u", [quantity.name for quantity in INPUTS])
    X = _draw(b, P, x, states, "")
    _record(b, "X", "sigma points", X, states, "state")
    X_prop = []
    for side, point in zip(_sides(n), X, strict=True):
        value, named = model.propagate(point, u)
        b.working("UKF", named, side)
        X_prop.append(value)
    _record(b, "X_prop", "X_i' = f(X_i, u)", X_prop, [f"{s}_next" for s in states], "state")
    x_pred, dev, weights = _moments(b, X_prop, states, "x")
    b.stage("x_pred", "UKF", "weighted mean", x_pred, [f"{s}_pred" for s in states], scale="state")
    P_pred = _spread(dev, dev, weights)
    for i in range(n):
        P_pred[i][i] = P_pred[i][i] + Q[i]
    b.lower("P_pred", "UKF", "weighted covariance + Q", P_pred)
    b.output("x_pred", x_pred)
    b.output("P_pred", pack(P_pred))
    return b.build()


def measurement_update(model: StateSpaceModel) -> Block:
    """Sigma points, drawn anew, through h."""
    states = [state.name for state in model.states]
    n = len(states)
    outputs = [quantity.name for quantity in OUTPUTS]
    b = BlockBuilder("ukf_measurement_update", "Measurement update of the UKF")
    x_pred = b.input("x_pred", [f"{s}_pred" for s in states])
    P_pred = unpack(b.input("P_pred", packed_names("P_pred", n)), n)
    R = b.input("R", ["R_0", "R_1"])
    y = b.input("y", [f"{name}_meas" for name in outputs])
    X = _draw(b, P_pred, x_pred, states, "_pred")
    _record(b, "X_pred", "sigma points", X, [f"{s}_pred" for s in states], "state")
    Y = []
    for side, point in zip(_sides(n), X, strict=True):
        value, named = model.measure(point)
        b.working("UKF", named, f"pred_{side}")
        Y.append(value)
    _record(b, "Y", "Y_i = h(X_i)", Y, [f"y_{name}" for name in outputs], "output")
    y_pred, dev_y, weights = _moments(b, Y, [f"y_{name}" for name in outputs], "y")
    b.stage("y_pred", "UKF", "weighted mean", y_pred, [f"y_{name}_pred" for name in outputs], scale="output")
    Pyy = _spread(dev_y, dev_y, weights)
    Pyy[0][0], Pyy[1][1] = Pyy[0][0] + R[0], Pyy[1][1] + R[1]
    b.lower("Pyy", "UKF", "weighted covariance + R", Pyy)
    dev_x = _deviations(b, X, x_pred, [f"{s}_pred" for s in states])
    Pxy = b.matrix("Pxy", "UKF", "weighted cross covariance", _spread(dev_x, dev_y, weights), scale="cross")
    K = gain(b, "UKF", Pxy, Pyy)
    innovation = [y[k] - y_pred[k] for k in range(2)]
    b.stage("innovation", "UKF", "y - y_pred", innovation, [f"innovation_{name}" for name in outputs], scale="output")
    x = wrapped([x_pred[i] + (K[i][0] * innovation[0] + K[i][1] * innovation[1]) for i in range(n)], model)
    b.stage("x", "UKF", "x = x_pred + K (y - y_pred), theta wrapped", x, [f"{s}_new" for s in states], scale="state")
    P = reduced(b, "UKF", P_pred, K, Pyy)
    b.output("x", x)
    b.output("P", pack(P))
    return b.build()
