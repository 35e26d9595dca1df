"""The cubature rule and the pieces the filters are made of, eq. 11-26."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import casadi as ca

from model.filters.program import BlockBuilder
from model.machines.state_space import OUTPUTS, StateSpaceModel
from model.quantities import Block

Vector = list[Any]
Matrix = list[list[Any]]


def packed_names(name: str, n: int) -> list[str]:
    """Names of a packed lower triangle, row by row: P_00, P_10, P_11, ...

    Parameters
    ----------
    name : str
        The matrix's, in front of the indices.
    n : int
        Rows of the matrix.
    """
    return [f"{name}_{i}{j}" for i in range(n) for j in range(i + 1)]


def unpack(packed: Vector, n: int) -> Matrix:
    """Symmetric matrix from its packed lower triangle.

    Parameters
    ----------
    packed : list of n(n+1)/2 SX
        Row by row, as :func:`pack` gives it.
    n : int
        Rows of the matrix.
    """
    return [[packed[max(i, j) * (max(i, j) + 1) // 2 + min(i, j)] for j in range(n)] for i in range(n)]


def pack(matrix: Matrix) -> Vector:
    """Lower triangle, row by row.

    Parameters
    ----------
    matrix : list of lists, (n, n)
        What is above the diagonal is not read.
    """
    return [matrix[i][j] for i in range(len(matrix)) for j in range(i + 1)]


@dataclass(frozen=True)
class Rule:
    """Which points a filter draws and how it weighs them.

    With ``kappa`` 0 the cubature rule (eq. 11, 12): 2n points, equal weights. With kappa > 0 the centre joins
    with weight kappa / (n + kappa) (Julier and Uhlmann 1997).
    """

    kind: str
    kappa: float = 0.0

    def equation(self, number: str) -> str:
        """The paper's number where the rule is the paper's, else the filter's name.

        Parameters
        ----------
        number : str
            The equation's number in the paper.
        """
        return self.kind.upper() if self.kappa else number

    @property
    def reach_text(self) -> str:
        """How far the points lie from the mean, in words."""
        return "sqrt(n + kappa)" if self.kappa else "sqrt(n)"

    def reach(self, n: int) -> float:
        """How far the points lie from the centre, in columns of S.

        Parameters
        ----------
        n : int
            Number of states.
        """
        return math.sqrt(n + self.kappa)

    def weights(self, n: int) -> tuple[float, float]:
        """Of the centre, and of each other point; all 2n points and the centre together weigh 1.

        Parameters
        ----------
        n : int
            Number of states.
        """
        return self.kappa / (n + self.kappa), 0.5 / (n + self.kappa)


CUBATURE = Rule("ckf")


def sides(count: int) -> list[str]:
    """Names of the points: column of S and side, eq. 11 with its I block first; the centre, if any, is ``c``.

    Parameters
    ----------
    count : int
        How many.
    """
    n = count // 2
    return ["c"] * (count % 2) + [f"{c}p" for c in range(n)] + [f"{c}m" for c in range(n)]


def cholesky(P: Matrix, order: tuple[int, ...]) -> Matrix:
    """Lower S with S S^T = P, rows and columns of P taken in this ``order``, eq. 13 and 18.

    Parameters
    ----------
    P : list of lists
        Covariance.
    order : tuple of int
    """
    n = len(P)
    P = [[P[i][j] for j in order] for i in order]
    S: Matrix = [[ca.SX(0)] * n for _ in range(n)]
    for j in range(n):
        S[j][j] = ca.sqrt(P[j][j] - sum(S[j][k] * S[j][k] for k in range(j)))
        for i in range(j + 1, n):
            S[i][j] = (P[i][j] - sum(S[i][k] * S[j][k] for k in range(j))) / S[j][j]
    return S


def points(
    b: BlockBuilder, rule: Rule, equation: str, S: Matrix, centre: Vector, model: StateSpaceModel, tag: str
) -> list[Vector]:
    """The points centre +- sqrt(n) S_c, eq. 14 and 19; row k of S is that of state ``model.order[k]``.

    ``tag`` tells the drawings apart in names.

    Parameters
    ----------
    b : BlockBuilder
    rule : Rule
    equation : str
    S : list of lists
        Square root of P.
    centre : list of Expr
        Mean of the points.
    model : StateSpaceModel
    tag : str
        Appended to names.
    """
    n = len(centre)
    states = [state.name for state in model.states]
    row = {i: k for k, i in enumerate(model.order)}
    rows = [(i, c) for i in range(n) for c in range(row[i] + 1)]
    step = {(i, c): rule.reach(n) * S[row[i]][c] for i, c in rows}
    names = [f"d{tag}_{states[i]}_{c}" for i, c in rows]
    b.stage(f"d{tag}", equation, f"{rule.reach_text} S", [step[k] for k in rows], names, scale="none")
    plus = [[centre[i] + step[i, c] if (i, c) in step else centre[i] for i in range(n)] for c in range(n)]
    minus = [[centre[i] - step[i, c] if (i, c) in step else centre[i] for i in range(n)] for c in range(n)]
    return [*([centre] if rule.kappa else []), *plus, *minus]


def record_points(
    b: BlockBuilder, name: str, equation: str, meaning: str, pts: list[Vector], names: list[str], kind: str
) -> None:
    """Record points as a stage, row-major (one row a state or output, one column a point).

    Parameters
    ----------
    b : BlockBuilder
    name : str
    equation : str
    meaning : str
    pts : list of Vector
    names : list of str
    kind : str
        Filter kind, such as "ickf".
    """
    entries = [point[i] for i in range(len(names)) for point in pts]
    labels = [f"{name}_{side}" for name in names for side in sides(len(pts))]
    b.stage(name, equation, meaning, entries, labels, scale=kind, columns=len(pts))


def mean(b: BlockBuilder, rule: Rule, equation: str, pts: list[Vector], names: list[str]) -> Vector:
    """Weighted mean, eq. 16 and 21, taken about the first point; ``names`` are the rows'.

    The plain sum of 2n angles is some 25 rad, whose float32 spacing alone is 2e-6 rad.

    Parameters
    ----------
    b : BlockBuilder
    rule : Rule
    equation : str
    pts : list of Vector
    names : list of str
    """
    _, weight = rule.weights(len(pts) // 2)
    first = pts[0]
    offset = [weight * _sum([point[i] - first[i] for point in pts[1:]]) for i in range(len(first))]
    b.stage(f"offset_{names[0]}", equation, "", offset, [f"offset_{name}" for name in names], scale="none")
    return [a + d for a, d in zip(first, offset, strict=True)]


def _sum(terms: Vector) -> Any:
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total


def spread(rule: Rule, a: list[Vector], b: list[Vector]) -> Matrix:
    """Weighted mean of a_i b_i^T over deviations: the centred form of eq. 17, 22, 23.

    As printed, sum XX^T/m - x x^T, these equations cancel in float32 once theta or a current is large.

    Parameters
    ----------
    rule : Rule
        Says how the points are weighed.
    a, b : list of Vector
        Deviations from the mean, one vector a point: (points, n) and (points, m). The centre, if the rule has one, is
        the first.

    Returns
    -------
    list of lists, (n, m)
        The covariance, before any noise is added to it.
    """
    centre, weight = rule.weights(len(a) // 2)

    def entry(i: int, j: int) -> Any:
        products = [p[i] * q[j] for p, q in zip(a, b, strict=True)]
        return centre * products[0] + weight * _sum(products[1:]) if rule.kappa else weight * _sum(products)

    return [[entry(i, j) for j in range(len(b[0]))] for i in range(len(a[0]))]


def deviations(b: BlockBuilder, equation: str, pts: list[Vector], centre: Vector, names: list[str]) -> list[Vector]:
    """Points minus their mean, named ``dev_<name>_<point>``.

    Parameters
    ----------
    b : BlockBuilder
    equation : str
    pts : list of Vector
    centre : list of Expr
        Mean of the points.
    names : list of str
    """
    dev = [[value - m for value, m in zip(point, centre, strict=True)] for point in pts]
    for side, point in zip(sides(len(pts)), dev, strict=True):
        labels = [f"dev_{name}_{side}" for name in names]
        b.stage(labels[0], equation, "", point, labels, scale="none")
    return dev


def coast(model: StateSpaceModel) -> Block:
    """A rejected measurement: the prediction becomes the estimate.

    Parameters
    ----------
    model : StateSpaceModel
        Its n states are those of ``x_pred`` (n) and ``P_pred`` (n(n+1)/2, packed).

    Returns
    -------
    Block
        ``x_pred``, ``P_pred`` -> ``x`` as it is kept (:meth:`StateSpaceModel.kept`), ``P``.
    """
    states = [state.name for state in model.states]
    n = len(states)
    b = BlockBuilder("coast", "No measurement: the prediction is the estimate")
    x_pred = b.input("x_pred", [f"{s}_pred" for s in states])
    P_pred = b.input("P_pred", packed_names("P_pred", n))
    b.output("x", model.kept(x_pred))
    b.output("P", P_pred)
    return b.build()


def measured_points(
    b: BlockBuilder, model: StateSpaceModel, equation: str, pts: list[Vector], tag: str
) -> list[Vector]:
    """h at every point, eq. 20, its intermediates named.

    Parameters
    ----------
    b : BlockBuilder
    model : StateSpaceModel
    equation : str
    pts : list of Vector
    tag : str
        Appended to names.
    """
    Y = []
    for side, point in zip(sides(len(pts)), pts, strict=True):
        value, named = model.measure(point)
        b.working(equation, named, f"{tag}{side}")
        Y.append(value)
    return Y


def gain(b: BlockBuilder, equation: str, Pxy: Matrix, Pyy: Matrix) -> Matrix:
    """K = Pxy Pyy^-1 with the 2x2 inverse in closed form, eq. 24.

    Parameters
    ----------
    b : BlockBuilder
    equation : str
    Pxy : list of lists
        Covariance of state and measurement.
    Pyy : list of lists
        Covariance of the measurement.
    """
    det = b.stage(
        "det_Pyy", equation, "det Pyy", [Pyy[0][0] * Pyy[1][1] - Pyy[1][0] * Pyy[1][0]], ["det_Pyy"], scale="none"
    )[0]
    W_00, W_10, W_11 = Pyy[1][1] / det, -Pyy[1][0] / det, Pyy[0][0] / det
    b.stage("Pyy_inv", equation, "Pyy^-1", [W_00, W_10, W_11], ["Pyy_inv_00", "Pyy_inv_10", "Pyy_inv_11"], scale="none")
    K = [[row[0] * W_00 + row[1] * W_10, row[0] * W_10 + row[1] * W_11] for row in Pxy]
    return b.matrix("K", equation, "K = Pxy Pyy^-1", K, scale="gain")


def corrected(
    b: BlockBuilder,
    model: StateSpaceModel,
    equations: tuple[str, str],
    prior: tuple[Vector, Matrix],
    K: Matrix,
    Pyy: Matrix,
    innovation: Vector,
) -> None:
    """x = x_pred + K innovation and P = P_pred - K Pyy K^T: the end of every filter that updates once.

    Parameters
    ----------
    b : BlockBuilder
    model : StateSpaceModel
    equations : tuple[str, str]
        Numbers of the paper's equations.
    prior : tuple[Vector, Matrix]
    K : list of lists
    Pyy : list of lists
        Covariance of the measurement.
    innovation : list of Expr
        y - y_pred, A.
    """
    x_pred, P_pred = prior
    states = [state.name for state in model.states]
    labels = [f"innovation_{quantity.name}" for quantity in OUTPUTS]
    b.stage("innovation", equations[0], "y - y_pred", innovation, labels, scale="output")
    x = [x_pred[i] + (K[i][0] * innovation[0] + K[i][1] * innovation[1]) for i in range(len(states))]
    x = model.kept(x)
    meaning = ", ".join(filter(None, ["x = x_pred + K (y - y_pred)", model.kept_meaning]))
    b.stage("x", equations[0], meaning, x, [f"{s}_new" for s in states], scale="state")
    P = reduced(b, equations[1], P_pred, K, Pyy)
    b.output("x", x)
    b.output("P", pack(P))


def reduced(b: BlockBuilder, equation: str, P_pred: Matrix, K: Matrix, Pyy: Matrix) -> Matrix:
    """P = P_pred - K Pyy K^T, eq. 26 and 32.

    Parameters
    ----------
    b : BlockBuilder
    equation : str
    P_pred : list of lists
        Predicted covariance.
    K : list of lists
    Pyy : list of lists
        Covariance of the measurement.
    """
    n = len(P_pred)
    KPyy = [[row[0] * Pyy[0][0] + row[1] * Pyy[1][0], row[0] * Pyy[1][0] + row[1] * Pyy[1][1]] for row in K]
    labels = [f"KPyy_{i}{j}" for i in range(n) for j in range(2)]
    b.stage("KPyy", equation, "K Pyy", [entry for row in KPyy for entry in row], labels, scale="none")
    P = [[P_pred[i][j] - (KPyy[i][0] * K[j][0] + KPyy[i][1] * K[j][1]) for j in range(n)] for i in range(n)]
    return b.lower("P", equation, "P = P_pred - K Pyy K^T", P, scale="difference")
