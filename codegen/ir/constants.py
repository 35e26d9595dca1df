"""Named constants that meet in one product: folded into one number, named after them."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

from codegen.ir.graph import SIGNIFICANT, Graph

#: A sum that comes to a multiple of 1 / ROUND could be any number: it gets no name.
ROUND = 64.0


@dataclass(frozen=True)
class Folded:
    """Constants of one product as one number."""

    value: float
    name: str
    formula: str


def folded(graph: Graph, constants: list[int]) -> Folded:
    """Constants of a graph as one number, named after them."""
    constants = sorted(constants, key=lambda k: (graph[k].name, graph[k].value))
    value = math.prod(graph[index].value for index in constants)
    if len(constants) == 1:
        return Folded(value, graph[constants[0]].name, graph[constants[0]].formula)
    names, plain = Counter[str](), 1.0
    for index in constants:
        some, number = taken_apart(graph, index)
        names, plain = names + some, plain * number
    names = Counter(dict(sorted(names.items())))
    return Folded(value, product_name(names, plain), _formula(names, plain))


def product_name(names: Counter[str], plain: float) -> str:
    """``A_B`` for A times B, ``A_SQ`` for A times A, ``A_X4`` for 4 A, ``A_BY4`` for A / 4; else nothing."""
    by = 0.0 < plain < 1.0
    number = 1.0 / plain if by else plain
    if not names or number != int(number) or any(count > 2 for count in names.values()):
        return ""
    parts = [name + ("_SQ" if count == 2 else "") for name, count in names.items()]
    name = "_".join(parts + ([f"{'BY' if by else 'X'}{int(number)}"] if number != 1.0 else []))
    return name if len(name) <= SIGNIFICANT else ""


def taken_apart(graph: Graph, index: int) -> tuple[Counter[str], float]:
    """The names a constant was multiplied together from, and the number beside them."""
    node = graph[index]
    if not node.name:
        return Counter(), node.value
    tokens = node.formula.split(" * ")
    names = Counter(token for token in tokens if token.isidentifier())
    plain = math.prod(float(token) for token in tokens if _is_number(token))
    if all(token.isidentifier() or _is_number(token) for token in tokens) and product_name(names, plain) == node.name:
        return names, plain
    return Counter([node.name]), 1.0


def is_round(value: float) -> bool:
    """Whether a number is one that formulas hold by themselves, and that a sum comes to by chance."""
    return (ROUND * value).is_integer()


def with_sums(graph: Graph) -> Graph:
    """The graph, its numbers that are sums met on the way, multiples or squares of them, named so; no value changes."""
    sums = {value: named for value, named in graph.sums.items() if not is_round(value)}
    known = dict[float, tuple[str, str]]()
    for value, (name, formula) in sums.items():
        known |= {k * value: (f"{name}_X{k}", f"{k} * ({formula})") for k in (2, 4)}
        known[value * value] = f"{name}_SQ", f"({formula}) * ({formula})"
    known = {value: named for value, named in known.items() if len(named[0]) <= SIGNIFICANT} | sums
    return graph.named(known)


def _is_number(token: str) -> bool:
    return token.replace(".", "", 1).isdigit()


def _formula(names: Counter[str], plain: float) -> str:
    return " * ".join([*([repr(plain).removesuffix(".0")] if plain != 1.0 else []), *names.elements()])
