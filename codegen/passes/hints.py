"""Names that outlive a rewriting: a value is known again by a fingerprint, whatever form it has come to have."""

from __future__ import annotations

import math
import random
from collections.abc import Callable

from codegen.ir.expr import Expr
from codegen.ir.graph import Graph

Hints = tuple[tuple[str, Expr], ...]

#: Digits in which two forms of one value agree.
DIGITS = 9

#: Any smooth functions will do for those that a pass leaves alone: a bound that does not bite must not look like none.
_SAMPLE: dict[str, Callable[..., float]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "neg": lambda a: -a,
    "sqrt": lambda a: math.sqrt(abs(a)),
    "sin": math.sin,
    "cos": math.cos,
    "min": lambda a, b: a + b - math.hypot(a, b),
    "max": lambda a, b: a + b + math.hypot(a, b),
    "wrap": lambda a: 1.1 * a,
    "sinc": lambda a, n: 1.0 - 0.17 * math.tanh(a * n),
    "cosm1": lambda a, n: -0.47 * math.tanh(a * n),
}


def carried(hints: Hints, new: Graph) -> Hints:
    """The hints of a graph for a graph it was rewritten to; the name of a value that is gone is dropped.

    Parameters
    ----------
    hints : tuple of (str, Expr)
        All of one graph.
    new : Graph
    """
    if not hints:
        return ()
    old = _fingerprints(hints[0][1].graph)
    found: dict[str, int] = {}
    for index, print_ in reversed(list(enumerate(_fingerprints(new)))):
        found[print_] = index
    at = [(name, found.get(old[entry.node])) for name, entry in hints]
    at += [(f"minus_{name}", found.get(_negative(old[entry.node]))) for name, entry in hints]
    return tuple((name, Expr(new, index)) for name, index in at if index is not None)


def _negative(print_: str) -> str:
    return print_.removeprefix("-") if print_.startswith("-") else f"-{print_}"


def _fingerprints(graph: Graph) -> list[str]:
    """Every node's value at one point drawn by the names of the inputs, to :data:`DIGITS` digits."""
    values: list[float] = []
    for node in graph.nodes:
        if node.op == "input":
            values.append(random.Random(node.name).uniform(0.5, 1.5))
        elif node.op == "const":
            values.append(node.value)
        else:
            try:
                values.append(_SAMPLE[node.op](*(values[arg] for arg in node.args)))
            except (ZeroDivisionError, OverflowError):
                values.append(math.nan)
    return [f"{value:.{DIGITS}g}" for value in values]
