"""Time and measurement update of a filter that draws points: eq. 13-26 for any rule."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from model.filters.cubature import (
    CUBATURE,
    Rule,
    Vector,
    cholesky,
    corrected,
    deviations,
    gain,
    mean,
    measured_points,
    pack,
    packed_names,
    points,
    record_points,
    sides,
    spread,
    unpack,
)
from model.filters.inverter import f_inputs
from model.filters.noise import add_noise
from model.filters.program import BlockBuilder
from model.machines.state_space import OUTPUTS, StateSpaceModel
from model.quantities import Block


@lru_cache(maxsize=4)
def time_update(model: StateSpaceModel, rule: Rule = CUBATURE) -> Block:
    """Eq. 13-17: x, P, Q, u -> x_pred, P_pred. CKF and ICKF share it, so it is built once a model.

    Parameters
    ----------
    model : StateSpaceModel
        The symbolic state space model.
    rule : Rule, optional
        How points are spread and weighted.
    """
    states = [state.name for state in model.states]
    n = len(states)
    eq = rule.equation
    # CKF and ICKF share this block, so under the cubature rule it bears no filter's name.
    name, title = (
        ("ukf_time_update", "Time update of the UKF") if rule.kappa else ("time_update", "Time update, eq. 13-17")
    )
    b = BlockBuilder(name, title)
    x = b.input("x", states)
    P = unpack(b.input("P", packed_names("P", n)), n)
    Q = b.input("Q", [f"Q_{i}" for i in range(n)])
    inputs = f_inputs(b, model)

    S = b.lower("S", eq("13"), "S = chol(P)", cholesky(P, model.order))
    X = points(b, rule, eq("14"), S, x, model, "")
    record_points(b, "X", eq("14"), f"X_i = x +- {rule.reach_text} S_i", X, states, "state")
    X_prop = _propagated(b, model, eq("15"), X, inputs)
    record_points(b, "X_prop", eq("15"), "X_i' = f(X_i, u)", X_prop, [f"{s}_next" for s in states], "state")
    x_pred = mean(b, rule, eq("16"), X_prop, states)
    meaning = "x_pred = mean X_i', about the first point"
    b.stage("x_pred", eq("16"), meaning, x_pred, [f"{s}_pred" for s in states], scale="state")
    dev = deviations(b, eq("17"), X_prop, x_pred, states)
    P_pred = spread(rule, dev, dev)
    added = add_noise(b, model, eq("17"), P_pred, Q, (x, *inputs))
    b.lower("P_pred", eq("17"), f"P_pred = mean (X_i' - x_pred)(X_i' - x_pred)^T + {added}", P_pred, scale="covariance")
    b.output("x_pred", x_pred)
    b.output("P_pred", pack(P_pred))
    return b.build()


def _propagated(
    b: BlockBuilder, model: StateSpaceModel, equation: str, X: list[Vector], inputs: list[Vector]
) -> list[Any]:
    """f at every point, its intermediates named."""
    X_prop = []
    for side, point in zip(sides(len(X)), X, strict=True):
        value, named = model.propagate(point, *inputs)
        b.working(equation, named, side)
        X_prop.append(value)
    return X_prop


def measurement_update(model: StateSpaceModel, rule: Rule = CUBATURE) -> Block:
    """Eq. 18-26: x_pred, P_pred, R, y -> x, P; the points are redrawn from P_pred.

    Parameters
    ----------
    model : StateSpaceModel
        The symbolic state space model.
    rule : Rule, optional
        How points are spread and weighted.
    """
    states = [state.name for state in model.states]
    outputs = [quantity.name for quantity in OUTPUTS]
    n = len(states)
    eq = rule.equation
    title = "Measurement update of the UKF" if rule.kappa else "Measurement update, eq. 18-26"
    b = BlockBuilder(f"{rule.kind}_measurement_update", title)
    x_pred = b.input("x_pred", [f"{s}_pred" for s in states])
    P_pred = unpack(b.input("P_pred", packed_names("P_pred", n)), n)
    R = b.input("R", ["R_0", "R_1"])
    y = b.input("y", [f"{name}_meas" for name in outputs])

    S = b.lower("S_pred", eq("18"), "S = chol(P_pred)", cholesky(P_pred, model.order))
    X = points(b, rule, eq("19"), S, x_pred, model, "_pred")
    names = [f"{s}_pred" for s in states]
    record_points(b, "X_pred", eq("19"), f"X_i = x_pred +- {rule.reach_text} S_i", X, names, "state")
    Y = measured_points(b, model, eq("20"), X, "pred_")
    measured = [f"y_{name}" for name in outputs]
    record_points(b, "Y", eq("20"), "Y_i = h(X_i)", Y, measured, "output")
    y_pred = mean(b, rule, eq("21"), Y, measured)
    meaning = "y_pred = mean Y_i, about the first point"
    b.stage("y_pred", eq("21"), meaning, y_pred, [f"{name}_pred" for name in measured], scale="output")
    dev_y = deviations(b, eq("22"), Y, y_pred, measured)
    Pyy = spread(rule, dev_y, dev_y)
    Pyy[0][0], Pyy[1][1] = Pyy[0][0] + R[0], Pyy[1][1] + R[1]
    b.lower("Pyy", eq("22"), "Pyy = mean (Y_i - y_pred)(Y_i - y_pred)^T + R", Pyy, scale="covariance")
    dev_x = deviations(b, eq("23"), X, x_pred, names)
    meaning = "Pxy = mean (X_i - x_pred)(Y_i - y_pred)^T"
    Pxy = b.matrix("Pxy", eq("23"), meaning, spread(rule, dev_x, dev_y), scale="cross")
    K = gain(b, eq("24"), Pxy, Pyy)
    innovation = [y[k] - y_pred[k] for k in range(2)]
    corrected(b, model, (eq("25"), eq("26")), (x_pred, P_pred), K, Pyy, innovation)
    return b.build()
