"""Rows of f that are another row and something linear: their covariances follow from that row's.

The angle after a sample is theta + h (omega + omega'): it bends as omega' does and no other way. For such a row
f_i = sum_k a_k f_k + g, g linear in x with the part g_c along column c::

    cov(f_i, f_j) = sum_k a_k cov(f_k, f_j) + sum_c g_c D_c odd_jc

and g, which holds few states, has few columns of the triangular L.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass

import casadi as ca
import numpy as np

from codegen.fast.factored import Matrix
from codegen.fast.frame import DRAWS, ROUNDING
from codegen.fast.rows import common_factor
from codegen.fast.tape import Tape
from codegen.ir.expr import Expr, GraphBuilder, dot, sum_of
from model.machines.state_space import StateSpaceModel

Vector = list[Expr]


@dataclass(frozen=True)
class DependentRow:
    """f_i = sum of a_k f_k over ``rows`` (k, a_k) + g, whose parts along the columns of L are ``own`` (n,)."""

    rows: tuple[tuple[int, Expr], ...]
    own: Vector


class Gram:
    """Sums over the columns of D times a product of odd parts: what the linear share of f makes of P.

    ``dependent``: by row. Products of rows are asked for in the order of a lower triangle.
    """

    def __init__(self, D: Vector, odd: Matrix, dependent: dict[int, DependentRow]) -> None:
        self.D, self.dependent = D, dependent
        factored = [common_factor(row) for row in odd]
        self.slope, self.odd = [slope for slope, _ in factored], [row for _, row in factored]
        self.weighted = [[d * o for d, o in zip(D, row, strict=True)] for row in self.odd]

    def product(self, i: int, j: int) -> Expr:
        """Of two rows, neither of which is dependent."""
        return self.slope[i] * self.slope[j] * dot(self.weighted[i], self.odd[j])

    def is_dependent(self, i: int, j: int) -> bool:
        """Whether one row depends linearly on another."""
        return i in self.dependent or j in self.dependent

    def dependent_product(self, P: Matrix, i: int, j: int) -> Expr:
        """Covariance of rows i >= j, of which at least one is dependent, from those of the rows above."""
        row, other = (i, j) if i in self.dependent else (j, i)
        return self._from_others(row, lambda k: P[k][other]) + self._across(self.dependent[row].own, other)

    def _across(self, own: Vector, j: int) -> Expr:
        """Of a row's own linear part with any row."""
        if j not in self.dependent:
            return self.slope[j] * dot(self.weighted[j], own)
        with_own = dot([d * g for d, g in zip(self.D, own, strict=True)], self.dependent[j].own)
        return self._from_others(j, lambda k: self._across(own, k)) + with_own

    def _from_others(self, i: int, value: Callable[[int], Expr]) -> Expr:
        """The part of a row that comes from the rows it depends on."""
        return sum_of([a * value(k) for k, a in self.dependent[i].rows])


def find_dependent_rows(b: GraphBuilder, tape: Tape, inputs: list[Vector], L: Matrix) -> dict[int, DependentRow]:
    """Every row of the tape's function that depends on rows before it, by its index.

    ``inputs``: plain symbols of the block, the state first. ``L``: its columns are the directions.
    """
    values = tape.at(b, inputs)
    states = {entry.node: j for j, entry in enumerate(inputs[0])}
    others = {entry.node for vector in inputs[1:] for entry in vector}
    found = {}
    for i, value in enumerate(values):
        rows = {other.node: k for k, other in enumerate(values[:i]) if other.node not in states}
        terms = _terms(value, rows.keys() | states.keys())
        if all(end.node in rows or end.node in states or end.node in others or end.value for end, _ in terms):
            on = _held(terms, rows)
            if on:
                found[i] = DependentRow(
                    on, [_along(value, states, rows.keys(), [row[c] for row in L]) for c in range(len(L))]
                )
    return found


def follows(row: DependentRow, i: int, model: StateSpaceModel) -> bool:
    """Whether row i of G (the derivatives with respect to wrong data) is that of the rows f_i depends on.

    It is unless a wrong datum is in the row's own linear part. Told at random points, to rounding.
    """
    if not model.G:
        return True
    G = ca.Function("G", model.arguments, [model.numeric(ca.densify(ca.horzcat(*model.G.values())))])
    rng = np.random.default_rng(1)
    for _ in range(DRAWS):
        values = np.array(G(*(rng.normal(size=column.numel()) for column in model.arguments)))
        shares = np.array([a.value * values[k] for k, a in row.rows if a.value is not None])
        if np.any(np.abs(values[i] - shares.sum(axis=0)) > ROUNDING * np.abs(shares).sum(axis=0)):
            return False
    return True


def _held(terms: list[tuple[Expr, Expr]], among: dict[int, int]) -> tuple[tuple[int, Expr], ...]:
    """Coefficients of the ends that are ``among`` these nodes, by the index given there."""
    sums: dict[int, Expr] = {}
    for end, factor in terms:
        if end.node in among:
            index = among[end.node]
            sums[index] = sums[index] + factor if index in sums else factor
    return tuple(sums.items())


def _along(value: Expr, states: dict[int, int], without: Collection[int], column: Vector) -> Expr:
    """The odd part of a linear value along a column, nodes ``without`` left out: as the tape's replay has it."""
    node, zero = value.graph[value.node], value * 0.0
    if value.node in without:
        return zero
    if value.node in states:
        return column[states[value.node]]
    args = [Expr(value.graph, arg) for arg in node.args]
    parts = [_along(arg, states, without, column) for arg in args]
    if node.op == "add":
        return parts[0] + parts[1]
    if node.op == "sub":
        return parts[0] - parts[1]
    if node.op == "neg":
        return -parts[0]
    if node.op == "mul":
        return args[0] * parts[1] if args[0].value is not None else parts[0] * args[1]
    return zero


def _terms(value: Expr, ends: set[int]) -> list[tuple[Expr, Expr]]:
    """A value as a sum of (end, constant factor), taken apart as far as ``ends`` and what is not linear."""
    one = value * 0.0 + 1.0
    found, stack = [], [(value, one)]
    while stack:
        part, factor = stack.pop()
        node = value.graph[part.node]
        args = [Expr(value.graph, arg) for arg in node.args]
        number = next((arg for arg in args if arg.value is not None), None)
        if part.node in ends or node.op not in {"add", "sub", "neg", "mul"} or (node.op == "mul" and number is None):
            found.append((part, factor))
        elif node.op == "mul" and number is not None:
            stack.append((args[0] if number == args[1] else args[1], factor * number))
        elif node.op == "neg":
            stack.append((args[0], -factor))
        else:
            stack += [(args[1], -factor if node.op == "sub" else factor), (args[0], factor)]
    return found
