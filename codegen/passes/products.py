"""Products taken apart and put together again so that what they share is computed once.

``a (b c)`` and ``b (a d)`` share ``a b`` although no node does. Every product is flattened into its factors;
then the pair of factors that most products hold becomes a factor of its own, again and again, until no pair
is held twice (greedy two-factor sharing). Constants are factors like the others, but those that meet in one
product are folded into one number first.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from itertools import combinations_with_replacement

from codegen.graph import Graph


def share_products(graph: Graph, roots: list[int], whole: bool = True) -> tuple[Graph, dict[int, int]]:
    """Regroup products; sums and functions stay as they are.

    ``whole``: inner products are taken apart even where several products share them already; else those stay.

    >>> g = Graph()
    >>> a, b, c, d = (g.input(name) for name in "abcd")
    >>> one, two = g.op("mul", a, g.op("mul", b, c)), g.op("mul", b, g.op("mul", a, d))
    >>> new, moved = share_products(g, [g.op("add", one, two)])
    >>> sum(node.op == "mul" for node in new.nodes)
    3
    """
    order = graph.reachable(roots)
    tops = _tops(graph, order, set(roots))
    uses = Counter(arg for index in order for arg in graph[index].args)
    kept = set() if whole else {index for index in order if graph[index].op == "mul" and uses[index] > 1}
    tops |= kept
    factors = {top: _folded(graph, _factors(graph, top, kept)) for top in order if top in tops}
    ranks = {index: rank for rank, index in enumerate(order)}
    pairs = _share(factors, ranks)
    return _rebuild(graph, order, factors, pairs, ranks)


#: Characters that C89 promises to tell apart.
LONGEST_NAME = 31


@dataclass(frozen=True)
class Folded:
    """Constants of one product as one number."""

    value: float
    name: str
    formula: str


@dataclass(frozen=True)
class Shared:
    """A pair of factors that several products hold, by number."""

    number: int


#: A node of the old graph, a folded constant, or a shared pair.
Factor = int | Folded | Shared


def _tops(graph: Graph, order: list[int], roots: set[int]) -> set[int]:
    """Products that something other than a product uses, or that must survive."""
    tops = {index for index in order if graph[index].op == "mul" and index in roots}
    for index in order:
        if graph[index].op != "mul":
            tops |= {arg for arg in graph[index].args if graph[arg].op == "mul"}
    return tops


def _factors(graph: Graph, top: int, kept: set[int]) -> Counter[int]:
    """Factors of a product, inner products taken apart unless they are to be kept."""
    found: Counter[int] = Counter()
    stack = list(graph[top].args)
    while stack:
        index = stack.pop()
        if graph[index].op == "mul" and index not in kept:
            stack += graph[index].args
        else:
            found[index] += 1
    return found


def _folded(graph: Graph, found: Counter[int]) -> Counter[Factor]:
    """All constants of a product as one."""
    constants = sorted(
        (index for index in found.elements() if graph[index].op == "const"),
        key=lambda k: (graph[k].name, graph[k].value),
    )
    rest: Counter[Factor] = Counter({index: count for index, count in found.items() if graph[index].op != "const"})
    if len(constants) == 1:
        rest[constants[0]] += 1
    elif constants and folded(graph, constants).value != 1.0:
        rest[folded(graph, constants)] += 1
    return rest


def folded(graph: Graph, constants: list[int]) -> Folded:
    """Constants of a graph as one number, named after them."""
    constants = sorted(constants, key=lambda k: (graph[k].name, graph[k].value))
    value = math.prod(graph[index].value for index in constants)
    if len(constants) == 1:
        return Folded(value, graph[constants[0]].name, graph[constants[0]].formula)
    return Folded(value, _product_name(graph, constants), _formula(graph, constants))


def _product_name(graph: Graph, constants: list[int]) -> str:
    """``A_B`` for A times B, ``A_SQ`` for A times A, ``A_X4`` for 4 A; nothing for other numbers."""
    names = Counter(graph[k].name for k in constants if graph[k].name)
    plain = math.prod(graph[k].value for k in constants if not graph[k].name)
    if not names or plain != int(plain) or any(count > 2 for count in names.values()):
        return ""
    parts = [name + ("_SQ" if count == 2 else "") for name, count in names.items()]
    name = "_".join(parts + ([f"X{int(plain)}"] if plain != 1.0 else []))
    return name if len(name) <= LONGEST_NAME else ""


def _formula(graph: Graph, constants: list[int]) -> str:
    return " * ".join(graph[k].name or f"{graph[k].value:g}" for k in constants)


def _share(factors: dict[int, Counter[Factor]], ranks: dict[int, int]) -> list[tuple[Factor, Factor]]:
    """Replace the most frequent pair until none is frequent; returns the pairs in the order made.

    Among equally frequent pairs the one known first is taken, so that what does not change is computed first.
    """
    rank: dict[Factor, float] = {
        factor: float(ranks[factor]) if isinstance(factor, int) else -1.0
        for held in factors.values()
        for factor in held
    }
    pairs: list[tuple[Factor, Factor]] = []
    holders: dict[tuple[Factor, Factor], set[int]] = {}
    for top, held in factors.items():
        for pair in _pairs(held, rank):
            holders.setdefault(pair, set()).add(top)
    while True:
        most = max((len(tops) for tops in holders.values()), default=0)
        if most < 2:
            return pairs
        best = min(
            (pair for pair, tops in holders.items() if len(tops) == most),
            key=lambda pair: (rank[pair[1]], rank[pair[0]]),
        )
        made = Shared(len(pairs))
        pairs.append(best)
        rank[made] = max(rank[best[0]], rank[best[1]]) + 1e-3 * len(pairs)
        for top in sorted(holders[best]):
            held = factors[top]
            for pair in _pairs(held, rank):
                holders[pair].discard(top)
            while (held[best[0]] >= 2) if best[0] == best[1] else (held[best[0]] and held[best[1]]):
                held.subtract(best)
                held[made] += 1
            for factor in [factor for factor, number in held.items() if not number]:
                del held[factor]
            for pair in _pairs(held, rank):
                holders.setdefault(pair, set()).add(top)


def _pairs(held: Counter[Factor], rank: dict[Factor, float]) -> list[tuple[Factor, Factor]]:
    """Every pair of factors that a product holds, the earlier first."""
    if sum(held.values()) < 2:
        return []
    distinct = sorted(held, key=lambda factor: (rank[factor], str(factor)))
    return [(a, b) for a, b in combinations_with_replacement(distinct, 2) if a != b or held[a] >= 2]


def _rank(factor: Factor, ranks: dict[int, int], pairs: list[tuple[Factor, Factor]]) -> float:
    """When a factor is known: constants at once, nodes in order, pairs with their later half."""
    if isinstance(factor, int):
        return float(ranks[factor])
    if isinstance(factor, Shared):
        earlier = pairs[: factor.number]
        return max(_rank(half, ranks, earlier) for half in pairs[factor.number]) + 1e-3 * (factor.number + 1)
    return -1.0


def _rebuild(
    graph: Graph,
    order: list[int],
    factors: dict[int, Counter[Factor]],
    pairs: list[tuple[Factor, Factor]],
    ranks: dict[int, int],
) -> tuple[Graph, dict[int, int]]:
    new, moved = Graph(), dict[int, int]()
    inner = {index for index in order if graph[index].op == "mul"} - factors.keys()

    def place(factor: Factor) -> int:
        if isinstance(factor, int):
            return moved[factor]
        if isinstance(factor, Shared):
            a, b = (place(half) for half in pairs[factor.number])
            return new.op("mul", a, b)
        return new.const(factor.value, factor.name, factor.formula)

    for index in order:
        if index in inner:
            continue
        if index in factors:
            held = sorted(factors[index].elements(), key=lambda f: _rank(f, ranks, pairs))
            nodes = [place(factor) for factor in held]
            value = nodes[0]
            for node in nodes[1:]:
                value = new.op("mul", value, node)
            moved[index] = value
        else:
            moved[index] = new.adopt(graph[index], [moved[arg] for arg in graph[index].args])
    return new, moved
