"""The noise that a time update adds to the spread of f: Q, and what motor data that may be wrong do."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from model.filters.cubature import Matrix, Vector
from model.filters.program import BlockBuilder
from model.machines.state_space import StateSpaceModel


def add_noise(
    b: BlockBuilder, model: StateSpaceModel, equation: str, P: Matrix, Q: Vector, at: Sequence[Vector]
) -> str:
    """Add Q to the spread P, and what motor data that may be wrong do to a sample; the sum is P_pred.

    Parameters
    ----------
    b : BlockBuilder
    model : StateSpaceModel
    equation : str
        Number of the paper's equation.
    P : list of lists, (n, n)
    Q : list of SX
        The diagonal.
    at : sequence of lists
        What f takes: the estimate x (n), the voltage (2), and what the inverter says beside it.

    Returns
    -------
    str
        What was added, in letters.
    """
    n = len(P)
    for i in range(n):
        P[i][i] = P[i][i] + Q[i]
    if not model.G:
        return "Q"
    G = ca.substitute(
        ca.horzcat(*model.G.values()),
        ca.vertcat(*model.arguments),
        ca.vertcat(*(value for values in at for value in values)),
    )
    rows = [[G[i, k] for k in range(len(model.G))] for i in range(n)]
    names = [f"G_{state.name}_{letter}" for state in model.states for letter in model.G]
    b.stage("G", equation, "", [entry for row in rows for entry in row], names, scale="none")
    Q_p = [[_dot(one, other) for other in rows] for one in rows]
    b.lower("Q_p", equation, "Q_p = G G^T, G each uncertain datum's sigma df/dp at x", Q_p, scale="addend")
    for i in range(n):
        for j in range(n):
            P[i][j] = P[i][j] + Q_p[i][j]
    return "Q + Q_p"


def _dot(a: Vector, b: Vector) -> Any:
    terms = [p * q for p, q in zip(a, b, strict=True)]
    return sum(terms[1:], terms[0])
