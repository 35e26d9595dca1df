"""P = L D L^T: factoring it, and taking a measurement in it.

L has a unit diagonal, D is diagonal. P is then symmetric and positive definite by construction, whatever
float32 does, and a measurement touches only the columns it sees.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from codegen.ir.covariance import place
from codegen.ir.expr import Expr, sum_of

Matrix = list[list[Expr]]


def from_packed(packed: list[Expr], order: Sequence[int]) -> tuple[Matrix, list[Expr]]:
    """L (its upper part and diagonal structural) and D from the n (n + 1) / 2 words of a filter's state.

    ``order``: of the states in L's columns and in the words; its rows here are in the order of the state.
    """
    n, zero = len(order), packed[0] * 0.0
    at = {(i, j): packed[place(i, j)] for i in range(n) for j in range(i + 1)}
    L = [[at[i, j] if i > j else zero + float(i == j) for j in range(n)] for i in range(n)]
    return _by_state(L, order), [at[i, i] for i in range(n)]


def to_packed(L: Matrix, D: list[Expr], order: Sequence[int]) -> list[Expr]:
    """Row by row in this ``order`` of the states, D in the place of the unit diagonal."""
    return [D[k] if k == j else L[i][j] for k, i in enumerate(order) for j in range(k + 1)]


def _by_state(L: Matrix, order: Sequence[int]) -> Matrix:
    """Row k of L is that of state order[k]."""
    rows = dict(zip(order, L, strict=True))
    return [rows[i] for i in range(len(L))]


def factor(P: Matrix, floor: list[Expr], order: Sequence[int]) -> tuple[Matrix, list[Expr], Matrix]:
    """L, D and L D of L D L^T = P, of which the lower triangle is read, its states taken in this ``order``.

    Rows of L and of L D are in the order of the state.

    ``floor`` bounds D from below. For P = A + diag(floor) with A positive semidefinite no pivot of P is
    smaller, so in exact arithmetic the bound changes nothing; in float it keeps rounding from making a
    pivot zero or negative. A pivot at its bound is an event that the step's status tells.
    """
    n = len(P)
    P, floor = [[P[max(i, j)][min(i, j)] for j in order] for i in order], [floor[i] for i in order]
    L = [[P[0][0] * 0.0 + float(i == j) for j in range(n)] for i in range(n)]
    D: list[Expr] = []
    scaled = [[P[0][0] * 0.0] * n for _ in range(n)]  # L D
    for j in range(n):
        pivot = P[j][j]
        for k in range(j):
            pivot = pivot - scaled[j][k] * L[j][k]
        D.append(pivot.apply("max", floor[j]))
        for i in range(j + 1, n):
            entry = P[i][j]
            for k in range(j):
                entry = entry - scaled[i][k] * L[j][k]
            scaled[i][j] = entry
            L[i][j] = entry / D[j]
    return _by_state(L, order), D, _by_state(scaled, order)


@dataclass
class ScalarUpdates:
    """A covariance and an estimate while scalar measurements are taken from them, one after another.

    ``rows``: measurements still to come, as rows of H L; they turn with the columns of L. ``correction``: what
    the measurements add to the estimate, summed apart from it, because an angle's last digits are coarser.
    Of those taken ``weighted_innovations`` are the innovations by ``innovation_variances``, ``squares`` nu^2 by them.
    ``named``: names for what comes up on the way, rows and columns of L counted in the factors' ``order``.
    """

    L: Matrix
    D: list[Expr]
    correction: list[Expr]
    rows: Matrix
    innovations: list[Expr]
    variances: list[Expr]
    innovation_variances: list[Expr] = field(default_factory=list)
    weighted_innovations: list[Expr] = field(default_factory=list)
    squares: list[Expr] = field(default_factory=list)
    order: Sequence[int] = ()
    named: dict[str, Expr] = field(default_factory=dict)

    @property
    def nis(self) -> Expr:
        """Normalised innovation squared of the measurements taken: their nu^2 / span, summed."""
        return sum_of(self.squares)

    def take(self) -> None:
        """The next scalar measurement: Bierman's update of an L D L^T, last column first.

        For the row f = H L: a_n = r, a_j = a_{j+1} + f_j g_j with g = D f; D_j becomes D_j a_{j+1} / a_j and
        column j of L gains -f_j / a_{j+1} times what K has gathered from the columns behind it (G. J. Bierman,
        Factorization Methods for Discrete Sequential Estimation, 1977, V.3, mirrored). Columns with f_j = 0 drop out.
        No a is below r, and rounding does not change that: f g = f (D f) has D's sign.
        """
        n = len(self.D)
        row, nu, a = self.rows.pop(0), self.innovations.pop(0), self.variances.pop(0)
        stacked, rows = [*self.L, *self.rows], self._places()
        gathered = [a * 0.0] * len(stacked)
        for j in reversed(range(n)):
            f = row[j]
            if f.is_zero():
                continue
            g = self.D[j] * f
            grown = a + f * g
            for i, line in enumerate(stacked):
                before = line[j]
                line[j] = before - f * gathered[i] / a
                self.named[f"change_{self._which}_{rows.get(i, 'y')}{j}"] = f * gathered[i] / a
                gathered[i] = gathered[i] + before * g
            self.D[j] = self.D[j] * a / grown
            self._name_column(j, (f, g, a, grown), gathered)
            a = grown
        weighted = nu / a
        self.squares.append(nu * weighted)
        self.correction = [sum_ + k * weighted for sum_, k in zip(self.correction, gathered[:n], strict=True)]
        self.named |= {f"correction_{self._which}_{k}": self.correction[i] for i, k in rows.items()}
        self.innovations = [later - k * weighted for later, k in zip(self.innovations, gathered[n:], strict=True)]
        self.innovation_variances.append(a)
        self.weighted_innovations.append(weighted)

    @property
    def _which(self) -> str:
        k = len(self.innovation_variances)
        return ("first", "second")[k] if k < 2 else f"later_{k}"

    def _places(self) -> dict[int, int]:
        """Where the rows of the states stand in the factors."""
        return {i: k for k, i in enumerate(self.order or range(len(self.D)))}

    def _name_column(self, j: int, values: tuple[Expr, ...], gathered: list[Expr]) -> None:
        """Names for f, g and a of column j, f by the a before, what is gathered, the factors it leaves."""
        which, rows = self._which, self._places()
        f, g, before, a = values
        self.named |= {f"f_{which}_{j}": f, f"g_{which}_{j}": g, f"var_{which}_{j}": a}
        self.named |= {f"gain_{which}_{rows.get(i, 'y')}{j}": value for i, value in enumerate(gathered)}
        self.named |= {f"D_{which}_{j}": self.D[j], f"lambda_{which}_{j}": f / before}
        self.named |= {f"L_{which}_{k}{j}": self.L[i][j] for i, k in rows.items()}


def decorrelated(
    rows: Matrix, innovations: list[Expr], R: Matrix, floor: Expr
) -> tuple[Matrix, list[Expr], list[Expr]]:
    """Two measurements with a full 2x2 noise R as two with independent noise: the second less m times the first."""
    if R[1][0].is_zero():
        return rows, innovations, [R[0][0], R[1][1]]
    m = R[1][0] / R[0][0]
    rest = (R[1][1] - m * R[1][0]).apply("max", floor)
    second = [b - m * a for a, b in zip(rows[0], rows[1], strict=True)]
    return [rows[0], second], [innovations[0], innovations[1] - m * innovations[0]], [R[0][0], rest]
