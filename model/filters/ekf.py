"""Extended Kalman filter: the floor of cost, and the yardstick the paper's family is measured by."""

from __future__ import annotations

from typing import Any

import casadi as ca

from model.filters.conditions import ACCEPTED
from model.filters.cubature import Matrix, Vector, coast, corrected, gain, pack, packed_names, unpack
from model.filters.inverter import f_inputs, inverter_calls
from model.filters.noise import add_noise
from model.filters.program import BlockBuilder, Call, FilterStep, Guard, If, wrap_angle
from model.machines.state_space import OUTPUTS, StateSpaceModel
from model.quantities import Block


def build_ekf(model: StateSpaceModel, gain: str = "jacobian") -> FilterStep:
    """The EKF's step: linearised at the estimate, then at the prediction. ``gain`` changes nothing.

    Parameters
    ----------
    model : StateSpaceModel
        The symbolic state space model.
    gain : str, optional
        "cubature" or "jacobian"; matters to the ICKF alone.
    """
    update = If(ACCEPTED, (Call(measurement_update(model)),), (Call(coast(model)),))
    predict = (*inverter_calls(model), Call(time_update(model)))
    return FilterStep("ekf", "jacobian", model, (Guard(), *predict, update, wrap_angle(model)))


def time_update(model: StateSpaceModel) -> Block:
    """x_pred = f(x, u), P_pred = F P F^T + Q.

    Parameters
    ----------
    model : StateSpaceModel
        Gives f and F = df/dx, both at the estimate.

    Returns
    -------
    Block
        ``x`` (n), ``P`` (n(n+1)/2, packed), ``Q`` (n, the diagonal), f's inputs -> ``x_pred``, ``P_pred``.
    """
    states = [state.name for state in model.states]
    n = len(states)
    b = BlockBuilder("ekf_time_update", "Time update of the EKF")
    x = b.input("x", states)
    P = unpack(b.input("P", packed_names("P", n)), n)
    Q = b.input("Q", [f"Q_{i}" for i in range(n)])
    inputs = f_inputs(b, model)
    x_pred, named = model.propagate(x, *inputs)
    b.working("EKF", named, "here")
    b.stage("x_pred", "EKF", "x_pred = f(x, u)", x_pred, [f"{s}_pred" for s in states], scale="state")
    F = ca.substitute(model.F, ca.vertcat(*model.arguments), ca.vertcat(*x, *(v for vector in inputs for v in vector)))
    rows = b.matrix("F", "EKF", "F = df/dx", [[F[i, j] for j in range(n)] for i in range(n)])
    FP = b.matrix("FP", "EKF", "F P", _product(rows, P), scale="none")
    P_pred = _product(FP, [[rows[j][i] for j in range(n)] for i in range(n)])
    added = add_noise(b, model, "EKF", P_pred, Q, (x, *inputs))
    b.lower("P_pred", "EKF", f"P_pred = F P F^T + {added}", P_pred, scale="covariance")
    b.output("x_pred", x_pred)
    b.output("P_pred", pack(P_pred))
    return b.build()


def measurement_update(model: StateSpaceModel) -> Block:
    """The Kalman update with H at the prediction.

    Parameters
    ----------
    model : StateSpaceModel
        Gives h and H = dh/dx, both at the prediction.

    Returns
    -------
    Block
        ``x_pred`` (n), ``P_pred`` (n(n+1)/2, packed), ``R`` (2, the diagonal, A^2), ``y`` (2, A) -> ``x``, ``P``.
    """
    states = [state.name for state in model.states]
    n = len(states)
    b = BlockBuilder("ekf_measurement_update", "Measurement update of the EKF")
    x_pred = b.input("x_pred", [f"{s}_pred" for s in states])
    P_pred = unpack(b.input("P_pred", packed_names("P_pred", n)), n)
    R = b.input("R", ["R_0", "R_1"])
    y = b.input("y", [f"{quantity.name}_meas" for quantity in OUTPUTS])
    h, named = model.measure(x_pred)
    b.working("EKF", named, "pred")
    jacobian = model.measurement_jacobian(x_pred)
    H = b.matrix("H", "EKF", "H = dh/dx at x_pred", [[jacobian[k, i] for i in range(n)] for k in range(2)])
    transposed = [[H[k][i] for k in range(2)] for i in range(n)]
    Pxy = b.matrix("Pxy", "EKF", "P_pred H^T", _product(P_pred, transposed), scale="cross")
    Pyy = _product(H, Pxy)
    Pyy[0][0], Pyy[1][1] = Pyy[0][0] + R[0], Pyy[1][1] + R[1]
    Pyy[0][1] = Pyy[1][0]
    b.lower("Pyy", "EKF", "H P_pred H^T + R", Pyy, scale="covariance")
    K = gain(b, "EKF", Pxy, Pyy)
    innovation = [y[k] - h[k] for k in range(2)]
    corrected(b, model, ("EKF", "EKF"), (x_pred, P_pred), K, Pyy, innovation)
    return b.build()


def _product(a: Matrix, b: Matrix) -> Matrix:
    """Matrix product that leaves structural zeros out."""
    return [[_dot(row, [b[k][j] for k in range(len(b))]) for j in range(len(b[0]))] for row in a]


def _dot(a: Vector, b: Vector) -> Any:
    terms = [p * q for p, q in zip(a, b, strict=True) if not (ca.SX(p).is_zero() or ca.SX(q).is_zero())]
    return sum(terms[1:], terms[0]) if terms else ca.SX(0)
