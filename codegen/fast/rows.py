"""The common factor of all entries of a row, taken out of them once."""

from __future__ import annotations

import math
from collections import Counter

from codegen.ir.constants import Folded, folded
from codegen.ir.expr import Expr
from codegen.ir.graph import Graph

#: Constants that were multiplied in another order are the same constant.
SAME = 1e-14


def common_factor(row: list[Expr]) -> tuple[Expr, list[Expr]]:
    """The product that every entry of a row, but for those that are zero, holds; and the row without it.

    >>> from codegen.ir.graph import Graph
    >>> g = Graph()
    >>> k, w, a, b = Expr(g, g.const(3.0, "K")), *(Expr(g, g.input(name)) for name in "wab")
    >>> scale, rest = common_factor([w * (k * a), k * 0.0, b * w * k])
    >>> rest == [a, k * 0.0, b], g[scale.node].op
    (True, 'mul')
    """
    one = row[0] * 0.0 + 1.0
    present = [entry for entry in row if not entry.is_zero()]
    if len(present) < 2:
        return one, row
    parts = [_parts(entry) for entry in present]
    constants = [constant for constant, _ in parts]
    if not all(_equal(constants[0], other) for other in constants):
        parts = [_parts(entry, apart=True) for entry in present]
        constants = [constant for constant, _ in parts]
    shared = parts[0][1]
    for _, rest in parts[1:]:
        shared = shared & rest
    number = constants[0] if all(_equal(constants[0], other) for other in constants) else Folded(1.0, "", "")
    named = max((c for c in constants if _equal(c, number)), key=lambda c: len(c.formula), default=number)
    keep_numbers = number.value == 1.0
    if keep_numbers and not shared:
        return one, row
    graph = row[0].graph
    scale = one if keep_numbers else _number(graph, named)
    for factor in shared.elements():
        scale = scale * Expr(graph, factor)
    remaining = iter(_multiplied(one, rest - shared, constant if keep_numbers else None) for constant, rest in parts)
    return scale, [entry if entry.is_zero() else next(remaining) for entry in row]


def _equal(a: Folded, b: Folded) -> bool:
    return math.isclose(a.value, b.value, rel_tol=SAME)


def _parts(entry: Expr, apart: bool = False) -> tuple[Folded, Counter[int]]:
    """All constants of a product as one, and its other factors; ``apart``: constants are factors like the others."""
    graph = entry.graph
    constants, rest, sign = [], Counter[int](), 1.0
    stack = [entry.node]
    while stack:
        index = stack.pop()
        node = graph[index]
        if node.op in {"mul", "neg"}:
            stack += node.args
            sign = -sign if node.op == "neg" else sign
        elif node.op == "const" and not apart:
            constants.append(index)
        else:
            rest[index] += 1
    if not constants:
        return Folded(sign, "", ""), rest
    known = folded(graph, constants)
    if known.value < 0:  # a name is its constant's, sign and all: it cannot stand for the size
        return Folded(sign * known.value, "", ""), rest
    return Folded(sign * known.value, known.name, known.formula), rest


def _number(graph: Graph, constant: Folded) -> Expr:
    """A constant with its sign; the name is its size's."""
    negative = constant.value < 0 and bool(constant.name)
    number = Expr(
        graph, graph.const(abs(constant.value) if negative else constant.value, constant.name, constant.formula)
    )
    return -number if negative else number


def _multiplied(one: Expr, factors: Counter[int], constant: Folded | None) -> Expr:
    value = one
    for factor in factors.elements():
        value = value * Expr(one.graph, factor)
    if constant is not None and constant.value != 1.0:
        value = value * _number(one.graph, constant)
    return value
