"""A function along the columns of L, and what its values there say of mean and covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from codegen.fast.affine import affine_states
from codegen.fast.dependent_rows import DependentRow, Gram
from codegen.fast.factored import Matrix
from codegen.fast.frame import Frame
from codegen.fast.rows import common_factor
from codegen.fast.split import Split, SplitAlgebra
from codegen.fast.tape import Tape, suggest_parts
from codegen.ir.expr import Expr, GraphBuilder, dot, sum_of
from model.filters.cubature import Rule
from model.machines.base import Rotor
from model.machines.state_space import INPUTS, StateSpaceModel

Vector = list[Expr]

#: The comment above the lines of eq. 15 and 20.
_PARTS = "along column c the image is base + even_c +- s_c odd_c, s_c^2 = n D_c"


@dataclass(frozen=True)
class Spread:
    """A function along the columns of L: base (m), and its even and odd parts (m rows, n columns).

    ``jacobian`` (m rows, n columns) where the odd parts are derivatives.
    """

    base: Vector
    even: Matrix
    odd: Matrix
    jacobian: Matrix | None = None


@dataclass(frozen=True)
class SigmaPoints:
    """How one filter of one model spreads its points: by a rule, or (None) not at all, taking derivatives."""

    model: StateSpaceModel
    kind: str
    gain: str
    rule: Rule | None
    turning: bool = False

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.model.states)

    @property
    def states(self) -> list[str]:
        """Names of the states, in order."""
        return [state.name for state in self.model.states]

    @property
    def is_paper(self) -> bool:
        """Whether the filter is one of the paper's."""
        return self.kind in {"ckf", "ickf"}

    def equation(self, number: str) -> str:
        """Return the number of the paper's equation; empty for other filters."""
        return number if self.is_paper else self.kind.upper()

    def along(
        self,
        b: GraphBuilder,
        tape: Tape,
        x: Vector,
        L: Matrix,
        D: Vector,
        others: list[Vector],
        equation: str,
        names: list[str],
        frame: Frame | None = None,
    ) -> Spread:
        """A function's base, even and odd parts along every column, the working quantities named."""
        if self.rule is None or (self.kind == "ickf" and self.gain == "jacobian" and not others):
            return self._derived(b, tape, x, L, others, equation, names, frame)
        parts = []
        for c in range(self.n):
            column = [L[i][c] for i in range(self.n)]
            algebra = SplitAlgebra(D[c], frame.angle if frame else None, self.n + self.rule.kappa)
            values, named = self.replay(b, tape, algebra, x, column, others, frame)
            suggest_parts(b, equation, named, algebra, c)
            parts.append(values)
        even, odd = (
            [[getattr(part[i], side) for part in parts] for i in range(len(names))] for side in ("even", "odd")
        )
        for label, rows, meaning in (("even", even, ""), ("odd", odd, _PARTS)):
            labels = [f"{label}_{name}_{c}" for name in names for c in range(self.n)]
            entries = [entry for row in rows for entry in row]
            b.stage(f"{label}_{names[0]}", equation, meaning, entries, labels, scale="none")
        return Spread([value.base for value in parts[0]], even, odd)

    def _derived(
        self,
        b: GraphBuilder,
        tape: Tape,
        x: Vector,
        L: Matrix,
        others: list[Vector],
        equation: str,
        names: list[str],
        frame: Frame | None,
    ) -> Spread:
        """The same to first order: the Jacobian by dual numbers, then its product with L."""
        zero = x[0] * 0.0
        columns = []
        for k in range(self.n):
            unit = [zero + float(i == k) for i in range(self.n)]
            algebra = SplitAlgebra(zero, frame.angle if frame else None)
            values, named = self.replay(b, tape, algebra, x, unit, others, frame, unit)
            b.suggest(equation, {name: part.base for name, part in named.items()})
            columns.append(values)
        jacobian = [[column[i].odd for column in columns] for i in range(len(names))]
        labels = [f"slope_{name}_{k}" for name in names for k in range(self.n)]
        entries = [entry for row in jacobian for entry in row]
        meaning = "Jacobian" + (", in the turned frame" if frame else "")
        b.stage(f"jacobian_{names[0]}", equation, meaning, entries, labels, scale="none")
        turned = [
            frame.into([L[i][c] for i in range(self.n)]) if frame else [L[i][c] for i in range(self.n)]
            for c in range(self.n)
        ]
        odd = [[dot(row, column) for column in turned] for row in jacobian]
        return Spread([value.base for value in columns[0]], [[zero] * self.n for _ in names], odd, jacobian)

    def replay(
        self,
        b: GraphBuilder,
        tape: Tape,
        algebra: SplitAlgebra,
        x: Vector,
        direction: Vector,
        others: list[Vector],
        frame: Frame | None,
        turned: Vector | None = None,
    ) -> tuple[list[Split], dict[str, Split]]:
        """A tape along a direction of the stator frame (or, ``turned``, of the turned one), by name."""
        if frame:
            x, others = frame.into(x), [frame.into(vector) for vector in others]
            direction = turned if turned is not None else frame.into(direction)
        point = [algebra.along(value, slope) for value, slope in zip(x, direction, strict=True)]
        constants = [algebra.constant(b.const(k.value, k.name, k.formula)) for k in self.model.constants]
        inputs = [point, *([algebra.constant(value) for value in vector] for vector in others)]
        values, named = tape.replay(algebra, inputs, constants)
        names = [f"{name}_turned" if frame and k < 2 else name for k, name in enumerate(tape.inputs)]
        states = dict(zip(names, point, strict=True))
        return values, {**named, **states}  # the first name offered is the one taken

    def expected(
        self,
        b: GraphBuilder,
        tape: Tape,
        x: Vector,
        back: tuple[Vector, Vector],
        frame: Frame | None,
        run: Spread,
    ) -> list[tuple[Expr, Expr]]:
        """h(x) + H (x_pred - x), H at x, as a sum of two: what an iterate expects to be measured.

        ``back``: x_pred, and x_pred - x. In what h is affine in, a, and what else it depends on, z, it is
        h(a_pred, z) + H_z (z_pred - z): h is asked where a is predicted, and H spares those columns.
        """
        x_pred, difference = back
        affine, zero = affine_states(self.model), x[0] * 0.0
        at = [x_pred[i] if i in affine else value for i, value in enumerate(x)]
        left = [zero if i in affine else value for i, value in enumerate(difference)]
        algebra = SplitAlgebra(zero, frame.angle if frame else None)
        held = [part.base for part in self.replay(b, tape, algebra, at, [zero] * self.n, [], frame)[0]]
        if run.jacobian is None:
            slopes = [part.odd for part in self.replay(b, tape, algebra, x, left, [], frame)[0]]
        else:
            turned = frame.into(left) if frame else left
            slopes = [dot(row, turned) for row in run.jacobian]
        return list(zip(held, slopes, strict=True))

    def wrong_data(self, b: GraphBuilder, inputs: list[Vector], frame: Frame | None) -> Matrix | None:
        """Rows of G, of which Q_p = G G^T; in the turned frame, if there is one. None where all data are exact."""
        G = self.model.G
        if not G:
            return None
        n, zero = self.n, inputs[0][0] * 0.0
        tape = Tape(self.model, self.model.arguments, [ca.vertcat(*G.values())], _on_axes(self.model))
        algebra, still = SplitAlgebra(zero, frame.angle if frame else None), [zero] * n
        found, named = self.replay(b, tape, algebra, inputs[0], still, inputs[1:], frame, still)
        values = [value.base for value in found]
        b.hint({name: named[name].base for name in tape.named})
        rows = [[values[n * k + i] for k in range(len(G))] for i in range(n)]
        if frame:
            b.hint({f"{q.name}_turned": v for q, v in zip(INPUTS, frame.into(inputs[1]), strict=True)})
        labels = [f"G_{state}_{letter}" for state in self.states for letter in G]
        meaning = "G: by how much a wrong datum moves f, so that Q_p = G G^T" + (", turned" if frame else "")
        b.stage("G", self.equation("17"), meaning, [entry for row in rows for entry in row], labels, scale="none")
        return rows

    def _weight(self) -> float:
        """Of a pair of points."""
        return 0.0 if self.rule is None else 2 * self.rule.weights(self.n)[1]

    def _name_weight(self, b: GraphBuilder, weight: float) -> None:
        """Keep the name of a number that no constant of the model makes."""
        if self.rule is not None:
            of = f"1 / {self.n + self.rule.kappa:g}: weight of the two points of a column of S"
            b.graph.told[weight] = "PAIR_WEIGHT" if self.is_paper else f"{self.kind.upper()}_PAIR_WEIGHT", of

    def _name_bends(
        self, b: GraphBuilder, equation: str, names: list[str], even: Sequence[Vector], totals: Vector, mean: Vector
    ) -> None:
        """Even parts without their common factor, their sum and mean."""
        named = {f"curv_{name}_{c}": e for name, row in zip(names, even, strict=True) for c, e in enumerate(row)}
        named |= {f"curv_{name}_sum": total for name, total in zip(names, totals, strict=True)}
        named |= {f"curv_{name}_mean": value for name, value in zip(names, mean, strict=True)}
        b.stage(f"curv_{names[0]}", equation, "", list(named.values()), list(named), scale="none")

    def moments(
        self,
        b: GraphBuilder,
        run: Spread,
        D: Vector,
        equations: tuple[str, str],
        names: list[str],
        linear: bool = True,
        dependent: dict[int, DependentRow] | None = None,
        wrong: Matrix | None = None,
    ) -> tuple[Vector, Matrix]:
        """How far the mean of the points' images lies off the image of their mean, and the images' covariance.

        The covariance is the weighted mean of the outer products of the deviations, odd and even parts apart;
        ``linear`` off leaves the odd parts out. ``dependent``: rows that follow from others.
        ``wrong``: rows of G, whose G G^T is added; a dependent row of it depends alike.

        A row's even parts are taken about their mean if all columns bend. If one is flat, the mean is taken out of
        the product afterwards: k of n equal bends leave 1 - k / n of their squares at least, so little cancels.
        About one row's mean is enough for two rows: the deviations' own mean is zero.
        """
        weight = self._weight()
        self._name_weight(b, weight)
        scale, even = zip(*(common_factor(row) for row in run.even), strict=True)
        totals = [sum_of(row) for row in even]
        mean = [total * weight for total in totals]
        self._name_bends(b, equations[0], names, even, totals, mean)
        offset = [k * m for k, m in zip(scale, mean, strict=True)]
        b.stage(f"offset_{names[0]}", equations[0], "", offset, [f"offset_{name}" for name in names], scale="none")
        flat = [any(e.is_zero() for e in row) for row in even]
        dev = [row if f else [e - m for e in row] for row, m, f in zip(even, mean, flat, strict=True)]
        labels = [f"dev_{name}_{c}" for name in names for c in range(self.n)]
        b.stage(f"dev_{names[0]}", equations[0], "", [e for row in dev for e in row], labels, scale="none")
        centre = 0.0 if self.rule is None else self.rule.weights(self.n)[0]
        gram = Gram(D, run.odd, dependent or {}) if linear else None
        weighted = gram.weighted if gram else []
        b.hint({f"D_odd_{name}_{c}": e for name, row in zip(names, weighted, strict=False) for c, e in enumerate(row)})
        b.hint({f"mean_{name}_by_n": m * weight for name, m in zip(names, mean, strict=True)})
        P = [[D[0] * 0.0] * len(names) for _ in names]
        for i in range(len(names)):
            for j in range(i + 1):
                if gram and gram.is_dependent(i, j):
                    P[i][j] = P[j][i] = gram.dependent_product(P, i, j)
                    continue
                about = dot(dev[i], dev[j]) * weight
                if flat[i] and flat[j]:
                    about = about - mean[i] * mean[j]
                elif not (flat[i] or flat[j]):
                    about = about + mean[i] * mean[j] * centre
                bend = scale[i] * scale[j] * about
                bend = bend + dot(wrong[i], wrong[j]) if wrong else bend
                P[i][j] = P[j][i] = gram.product(i, j) + bend if gram else bend
        return offset, P


def _on_axes(model: StateSpaceModel) -> dict[str, Any]:
    """What G is made of, by name: currents and a turning unit on the rotor's axes, the way in which a loss acts."""
    rotor = Rotor.at(model.x[3])
    i_d, i_q = rotor.to_rotor((model.h[0], model.h[1]))
    named = {"i_d": i_d, "i_q": i_q, "omega_x_sin": model.x[2] * rotor.sin, "omega_x_cos": model.x[2] * rotor.cos}
    if model.doubt:
        g_alpha, g_beta, _ = ca.vertsplit(model.arguments[2])
        named |= zip(("g_d", "g_q"), model.torque_rotor.to_rotor((g_alpha, g_beta)), strict=True)
    return named
