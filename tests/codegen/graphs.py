"""The common parts of tests of graphs: evaluation in any arithmetic, and random graphs."""

from __future__ import annotations

import math
import operator
import zlib
from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Any

import numpy as np
import sympy as sp

from codegen.ir.graph import Graph

Operations = Mapping[str, Callable[..., Any]]

ARITHMETIC: Operations = {
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "div": operator.truediv,
    "neg": operator.neg,
}


def _wrap(x: float) -> float:
    return (x + math.pi) % (2 * math.pi) - math.pi


#: float64, by the mathematics' own definition of each function.
FLOAT: Operations = {
    **ARITHMETIC,
    "sqrt": math.sqrt,
    "sin": math.sin,
    "cos": math.cos,
    "sinc": lambda z, n=1.0: math.sin(math.sqrt(n * z)) / math.sqrt(n * z) if z > 0 else 1.0,
    "cosm1": lambda z, n=1.0: -2.0 * math.sin(math.sqrt(n * z) / 2.0) ** 2,
    "min": min,
    "max": max,
    "wrap": _wrap,
}

SYMBOLIC: Operations = {
    **ARITHMETIC,
    "sqrt": sp.sqrt,
    "sin": sp.sin,
    "cos": sp.cos,
    "sinc": lambda z, n=1: sp.sin(sp.sqrt(n * z)) / sp.sqrt(n * z),
    "cosm1": lambda z, n=1: sp.cos(sp.sqrt(n * z)) - 1,
}


def _unknown(name: str) -> Callable[[Fraction], Fraction]:
    """Some function of exact numbers that has no identity a pass could lean on."""
    return lambda x: Fraction(zlib.crc32(f"{name} {x}".encode()) % 997 - 500, 97)


#: Exact: min and max as they are, every function an unknown one.
RATIONAL: Operations = {
    **ARITHMETIC,
    "min": min,
    "max": max,
    **{name: _unknown(name) for name in ("sqrt", "sin", "cos", "sinc", "cosm1", "wrap")},
}


def evaluate(
    graph: Graph, roots: list[int], inputs: Mapping[str, Any], ops: Operations, number: Callable[[float], Any] = float
) -> dict[int, Any]:
    """Values of all nodes the roots depend on; ``number`` turns a constant into the arithmetic's own."""
    values: dict[int, Any] = {}
    for index in graph.reachable(roots):
        node = graph[index]
        if node.op == "input":
            values[index] = inputs[node.name]
        elif node.op == "const":
            values[index] = number(node.value)
        else:
            values[index] = ops[node.op](*(values[arg] for arg in node.args))
    return values


#: Numbers whose products and sums fold without rounding.
CONSTANTS = (1.0, -1.0, 2.0, -2.0, 0.5, -0.5, 3.0, -3.0, 4.0, 5.0)
NAMED = {"GAIN": 3.0, "DECAY": 0.75, "OFFSET": -1.5}


def random_graph(rng: np.random.Generator, size: int, functions: bool = False) -> tuple[Graph, list[int]]:
    """A graph of ``size`` operations on five inputs, numbers and named numbers, and some of its nodes as roots."""
    g = Graph()
    nodes = [g.input(name) for name in "abcde"]
    nodes += [g.const(float(rng.choice(CONSTANTS))) for _ in range(3)]
    nodes += [g.const(value, name, name) for name, value in NAMED.items()]
    ops = [
        "add",
        "sub",
        "mul",
        "mul",
        "mul",
        "div",
        "neg",
        "min",
        "max",
        *(["sin", "sqrt", "sinc"] if functions else []),
    ]
    for _ in range(size):
        op = str(rng.choice(ops))
        recent = nodes[-8:] if rng.random() < 0.5 else nodes
        left, right = (int(k) for k in rng.choice(recent, 2))
        if op == "div" and g[right].op == "const" and math.frexp(g[right].value)[0] != 0.5:
            op = "mul"  # 1 / 3 is no number of any format: folded, it would round
        if op in {"sin", "sqrt", "sinc"} and g[left].op == "const":
            op = "neg"  # folded, it would round too
        nodes.append(g.op(op, left, right) if op in {"add", "sub", "mul", "div", "min", "max"} else g.op(op, left))
    last = list(dict.fromkeys(nodes[-max(3, size // 3) :]))
    return g, [int(k) for k in rng.choice(last, min(6, len(last)), replace=False)]


def random_point(rng: np.random.Generator) -> dict[str, Fraction]:
    return {name: Fraction(int(rng.integers(-60, 60)) or 1, int(rng.integers(1, 13))) for name in "abcde"}
