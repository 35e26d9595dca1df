"""Cubature Kalman filter, eq. 11-26."""

from __future__ import annotations

from model.filters.cubature import (
    cholesky,
    coast,
    deviations,
    gain,
    mean,
    measured_points,
    pack,
    packed_names,
    points,
    record_points,
    reduced,
    spread,
    time_update,
    unpack,
    wrapped,
)
from model.filters.program import BlockBuilder, Call, FilterStep, IfAccepted
from model.quantities import Block
from model.state_space import OUTPUTS, StateSpaceModel


def build_ckf(model: StateSpaceModel, gain: str = "cubature") -> FilterStep:
    """The CKF's step; ``gain`` is accepted for the registry's sake and changes nothing (eq. 22-24 are the gain)."""
    measurement = IfAccepted((Call(measurement_update(model)),), (Call(coast(model)),))
    return FilterStep("ckf", "cubature", model, (Call(time_update(model)), measurement))


def measurement_update(model: StateSpaceModel) -> Block:
    """Eq. 18-26: x_pred, P_pred, R, y -> x, P; the points are redrawn from P_pred."""
    states = [state.name for state in model.states]
    n = len(states)
    b = BlockBuilder("ckf_measurement_update", "Measurement update, eq. 18-26")
    x_pred = b.input("x_pred", [f"{s}_pred" for s in states])
    P_pred = unpack(b.input("P_pred", packed_names("P_pred", n)), n)
    R = b.input("R", ["R_0", "R_1"])
    y = b.input("y", [f"{quantity.name}_meas" for quantity in OUTPUTS])
    outputs = [quantity.name for quantity in OUTPUTS]

    S = b.lower("S_pred", "18", "S = chol(P_pred)", cholesky(P_pred))
    X = points(b, "19", S, x_pred, states, "_pred")
    record_points(b, "X_pred", "19", "X_i = x_pred +- sqrt(n) S_i", X, [f"{s}_pred" for s in states], "state")
    Y = measured_points(b, model, "20", X, "pred_")
    record_points(b, "Y", "20", "Y_i = h(X_i)", Y, [f"y_{name}" for name in outputs], "output")
    y_pred = b.stage(
        "y_pred",
        "21",
        "y_pred = mean Y_i, about the first point",
        mean(b, "21", Y, [f"y_{name}" for name in outputs]),
        [f"y_{name}_pred" for name in outputs],
        scale="output",
    )
    dev_y = deviations(b, "22", Y, y_pred, [f"y_{name}" for name in outputs])
    Pyy = spread(dev_y, dev_y)
    Pyy[0][0], Pyy[1][1] = Pyy[0][0] + R[0], Pyy[1][1] + R[1]
    b.lower("Pyy", "22", "Pyy = mean (Y_i - y_pred)(Y_i - y_pred)^T + R", Pyy)
    dev_x = deviations(b, "23", X, x_pred, [f"{s}_pred" for s in states])
    Pxy = b.matrix("Pxy", "23", "Pxy = mean (X_i - x_pred)(Y_i - y_pred)^T", spread(dev_x, dev_y), scale="cross")
    K = gain(b, "24", Pxy, Pyy)
    innovation = [y[k] - y_pred[k] for k in range(2)]
    b.stage("innovation", "25", "y - y_pred", innovation, [f"innovation_{name}" for name in outputs], scale="output")
    x = [x_pred[i] + (K[i][0] * innovation[0] + K[i][1] * innovation[1]) for i in range(n)]
    x = wrapped(x, model)
    b.stage("x", "25", "x = x_pred + K (y - y_pred), theta wrapped", x, [f"{s}_new" for s in states], scale="state")
    P = reduced(b, "26", P_pred, K, Pyy)
    b.output("x", x)
    b.output("P", pack(P))
    return b.build()
