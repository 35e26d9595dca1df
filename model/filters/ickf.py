"""Iterated cubature Kalman filter, eq. 27-34, with both gains."""

from __future__ import annotations

from typing import Any

import casadi as ca

from model.filters.conditions import ACCEPTED
from model.filters.cubature import (
    CUBATURE,
    Matrix,
    Vector,
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
    unpack,
)
from model.filters.inverter import inverter_calls
from model.filters.program import BlockBuilder, Call, Copy, FilterStep, Guard, If, Node, Repeat, wrap_angle
from model.filters.sigma_point import time_update
from model.machines.state_space import OUTPUTS, StateSpaceModel
from model.quantities import Block


def build_ickf(model: StateSpaceModel, gain: str = "cubature") -> FilterStep:
    """The ICKF's step.

    Where the update provably does not depend on the iterate, iterating repeats the same numbers: one pass
    is emitted and the proof's statement kept.

    Parameters
    ----------
    model : StateSpaceModel
        The symbolic state space model.
    gain : str, optional
        "cubature" or "jacobian"; matters to the ICKF alone.
    """
    one = iterate(model, gain)
    proof = idle_iteration_proof(model, one)
    if proof is not None:
        update: tuple[Node, ...] = (Call(_single_pass(model, gain)),)
    else:
        head: tuple[Node, ...] = (Call(_factor(model)),) if gain == "cubature" else ()
        update = (*head, Copy("x_j", "x_pred"), Repeat((Call(one),)), Call(_finish(model)))
    before = (*inverter_calls(model), Call(time_update(model)))
    choice = If(ACCEPTED, update, (Call(coast(model)),))
    step: tuple[Node, ...] = (Guard(), *before, choice, wrap_angle(model))
    return FilterStep("ickf", gain, model, step, proof)


def idle_iteration_proof(model: StateSpaceModel, iterate: Block) -> str | None:
    """A statement, if the next iterate provably does not depend on the present one, else None.

    Symbolic, entry by entry: the derivative with respect to x^j of all that makes x^{j+1} (the corrected
    innovation, Pyy^j, Pxy^j) must be the constant zero.

    Parameters
    ----------
    model : StateSpaceModel
        Its H may depend on the state; then there is no proof.
    iterate : Block
        One iterate, eq. 28-31, with an input ``x_j`` and stages ``innovation``, ``Pyy`` and ``Pxy``.
    """
    x_j = ca.vertcat(*next(port for port in iterate.inputs if port.name == "x_j").entries)
    if ca.depends_on(model.H, model.x):
        return None
    makers = [stage for stage in iterate.stages if stage.name in {"innovation", "Pyy", "Pxy"}]
    derivative = ca.jacobian(ca.vertcat(*(entry for stage in makers for entry in stage.entries)), x_j)
    if any(not entry.is_zero() for entry in derivative.nonzeros()):
        return None
    return (
        "H does not depend on x, and the derivative of the innovation (31), of Pyy (29, 22) and of Pxy (30, 23) with "
        "respect to x^j is the constant zero in every entry: each iterate equals the first, so one pass is emitted."
    )


def _inputs(b: BlockBuilder, model: StateSpaceModel, names: list[str]) -> dict[str, Vector]:
    """Declare input ports by name, with the entries every block of this filter agrees on."""
    states = [state.name for state in model.states]
    n = len(states)
    entries = {
        "x_j": [f"{s}_j" for s in states],
        "x_pred": [f"{s}_pred" for s in states],
        "P_pred": packed_names("P_pred", n),
        "S_pred": packed_names("S_pred", n),
        "R": ["R_0", "R_1"],
        "y": [f"{quantity.name}_meas" for quantity in OUTPUTS],
        "K": [f"K_{i}{j}" for i in range(n) for j in range(2)],
        "Pyy": packed_names("Pyy", 2),
    }
    return {name: b.input(name, entries[name]) for name in names}


def _factor(model: StateSpaceModel) -> Block:
    """Eq. 18, once a step: the points of every iterate are drawn with the predicted covariance."""
    b = BlockBuilder("ickf_factor", "Square root of P_pred, eq. 18")
    P_pred = _inputs(b, model, ["P_pred"])["P_pred"]
    S = b.lower("S_pred", "18", "S = chol(P_pred)", cholesky(unpack(P_pred, len(model.states)), model.order))
    b.output("S_pred", pack(S))
    return b.build()


def iterate(model: StateSpaceModel, which: str) -> Block:
    """One iterate, eq. 28-31 and the norm of 33.

    Parameters
    ----------
    model : StateSpaceModel
    which : str
        The gain: "cubature" or "jacobian".
    """
    b = BlockBuilder("ickf_iterate", "One iterate, eq. 28-33")
    spread_from = "S_pred" if which == "cubature" else "P_pred"
    arrays = _inputs(b, model, ["x_j", "x_pred", spread_from, "R", "y"])
    x_next, K, Pyy = _update(b, model, which, arrays, spread_from)
    moved = [after - before for after, before in zip(x_next, arrays["x_j"], strict=True)]
    b.stage("moved", "33", "x^{j+1} - x^j", moved, [f"moved_{s.name}" for s in model.states], scale="none")
    change = sum((step * step for step in moved[1:]), moved[0] * moved[0])
    b.stage("change", "33", "|x^{j+1} - x^j|^2", [change], ["change"], scale="none")
    b.output("x_j", x_next)
    b.output("K", [entry for row in K for entry in row])
    b.output("Pyy", pack(Pyy))
    b.output("change", [change])
    return b.build()


def _update(
    b: BlockBuilder, model: StateSpaceModel, which: str, arrays: dict[str, Vector], spread_from: str
) -> tuple[Vector, Matrix, Matrix]:
    """Eq. 28-31 about x^j: the next iterate, its gain and its Pyy."""
    states = [state.name for state in model.states]
    outputs = [quantity.name for quantity in OUTPUTS]
    x_j, x_pred, R, y = arrays["x_j"], arrays["x_pred"], arrays["R"], arrays["y"]
    h_j, named = model.measure(x_j)
    b.working("28", named, "j")
    b.stage("h_j", "28", "h(x^j)", h_j, [f"h_{name}_j" for name in outputs], scale="output")
    H = _jacobian(b, model, x_j)
    spread_array = unpack(arrays[spread_from], len(states))
    gains = _cubature_moments if which == "cubature" else _jacobian_moments
    Pyy, Pxy = gains(b, model, x_j, H, spread_array, R)
    K = gain(b, "28", Pxy, Pyy)
    back = [x_pred[i] - x_j[i] for i in range(len(states))]
    b.stage("back", "31", "x_pred - x^j", back, [f"back_{s}" for s in states], scale="none")
    innovation = [y[k] - h_j[k] - sum(H[k][i] * back[i] for i in range(len(states))) for k in range(2)]
    labels = [f"innovation_{name}" for name in outputs]
    b.stage("innovation", "31", "y - h(x^j) - H^j (x_pred - x^j)", innovation, labels, scale="output")
    x_next = [x_pred[i] + (K[i][0] * innovation[0] + K[i][1] * innovation[1]) for i in range(len(states))]
    b.stage("x_next", "31", "x^{j+1}", x_next, [f"{s}_after" for s in states], scale="state")
    return x_next, K, Pyy


def _jacobian(b: BlockBuilder, model: StateSpaceModel, x_j: Vector) -> Matrix:
    """H^j = dh/dx at x^j."""
    H = model.measurement_jacobian(x_j)
    rows = [[H[k, i] for i in range(len(x_j))] for k in range(2)]
    return b.matrix("H", "28", "H^j = dh/dx at x^j", rows)


def _jacobian_moments(
    b: BlockBuilder, model: StateSpaceModel, x_j: Vector, H: Matrix, P_pred: Matrix, R: Vector
) -> tuple[Matrix, Matrix]:
    """Eq. 29 and 30."""
    n = len(x_j)
    Pxy = [[_dot(P_pred[i], H[k]) for k in range(2)] for i in range(n)]
    b.matrix("Pxy", "30", "Pxy^j = P_pred H^jT", Pxy, scale="cross")
    Pyy = [[_dot(H[k], [Pxy[i][m] for i in range(n)]) for m in range(2)] for k in range(2)]
    Pyy[0][0], Pyy[1][1] = Pyy[0][0] + R[0], Pyy[1][1] + R[1]
    b.lower("Pyy", "29", "Pyy^j = H^j P_pred H^jT + R", Pyy, scale="covariance")
    Pyy[0][1] = Pyy[1][0]
    return Pyy, Pxy


def _cubature_moments(
    b: BlockBuilder, model: StateSpaceModel, x_j: Vector, H: Matrix, S_pred: Matrix, R: Vector
) -> tuple[Matrix, Matrix]:
    """Section 2.3, step 3: eq. 19-23 about x^j, spread by the predicted covariance."""
    states = [state.name for state in model.states]
    outputs = [f"y_{quantity.name}" for quantity in OUTPUTS]
    X = points(b, CUBATURE, "19", S_pred, x_j, model, "_j")
    record_points(b, "X_j", "19", "X_i = x^j +- sqrt(n) S_i", X, [f"{s}_j" for s in states], "state")
    Y = measured_points(b, model, "20", X, "j_")
    record_points(b, "Y_j", "20", "Y_i = h(X_i)", Y, outputs, "output")
    y_mean = b.stage(
        "y_mean",
        "21",
        "mean Y_i, about the first point",
        mean(b, CUBATURE, "21", Y, outputs),
        [f"{name}_mean" for name in outputs],
        scale="output",
    )
    dev_y = deviations(b, "22", Y, y_mean, outputs)
    Pyy = spread(CUBATURE, dev_y, dev_y)
    Pyy[0][0], Pyy[1][1] = Pyy[0][0] + R[0], Pyy[1][1] + R[1]
    b.lower("Pyy", "22", "Pyy^j = mean (Y_i - mean Y)(Y_i - mean Y)^T + R", Pyy, scale="covariance")
    dev_x = deviations(b, "23", X, x_j, [f"{s}_j" for s in states])
    Pxy = b.matrix(
        "Pxy", "23", "Pxy^j = mean (X_i - x^j)(Y_i - mean Y)^T", spread(CUBATURE, dev_x, dev_y), scale="cross"
    )
    return Pyy, Pxy


def _dot(a: Vector, b: Vector) -> Any:
    """Inner product that leaves structural zeros out."""
    terms = [p * q for p, q in zip(a, b, strict=True) if not (p.is_zero() or q.is_zero())]
    return sum(terms[1:], terms[0])


def _finish(model: StateSpaceModel) -> Block:
    """Eq. 32 and 34, after the loop: only P^N is used, so only P^N is computed."""
    states = [state.name for state in model.states]
    b = BlockBuilder("ickf_finish", "Result of the last iterate, eq. 32 and 34")
    arrays = _inputs(b, model, ["x_j", "P_pred", "K", "Pyy"])
    K = [arrays["K"][2 * i : 2 * i + 2] for i in range(len(states))]
    _close(b, model, arrays["x_j"], unpack(arrays["P_pred"], len(states)), K, unpack(arrays["Pyy"], 2))
    return b.build()


def _close(b: BlockBuilder, model: StateSpaceModel, x_last: Vector, P_pred: Matrix, K: Matrix, Pyy: Matrix) -> None:
    x = model.kept(x_last)
    meaning = ", ".join(filter(None, ["x = x^N", model.kept_meaning]))
    b.stage("x", "34", meaning, x, [f"{s.name}_new" for s in model.states], scale="state")
    P = reduced(b, "32", P_pred, K, Pyy)
    b.output("x", x)
    b.output("P", pack(P))


def _single_pass(model: StateSpaceModel, which: str) -> Block:
    """The whole measurement update where iterating is idle: x^0 = x_pred put in for x^j."""
    n = len(model.states)
    b = BlockBuilder(
        "ickf_measurement_update", "Measurement update, eq. 18 and 28-34 (H is constant: one pass is exact)"
    )
    arrays = _inputs(b, model, ["x_pred", "P_pred", "R", "y"])
    arrays["x_j"] = arrays["x_pred"]
    spread_from = "P_pred"
    if which == "cubature":
        spread_from = "S_pred"
        S = b.lower("S_pred", "18", "S = chol(P_pred)", cholesky(unpack(arrays["P_pred"], n), model.order))
        arrays["S_pred"] = pack(S)
    x_last, K, Pyy = _update(b, model, which, arrays, spread_from)
    _close(b, model, x_last, unpack(arrays["P_pred"], n), K, Pyy)
    return b.build()
