"""Products taken apart and put together again so that what they share is computed once.

``a (b c)`` and ``b (a d)`` share ``a b`` although no node does. Every product is flattened into its factors;
then the pair of factors that most products hold becomes a factor of its own, again and again, until no pair
is held twice (greedy two-factor sharing). Constants are factors like the others, but those that meet in one
product are folded into one number first.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import combinations_with_replacement

from codegen.ir.constants import Folded, folded, product_name, taken_apart
from codegen.ir.graph import Graph


def share_products(
    graph: Graph, roots: list[int], whole: bool = True, squares: bool = False
) -> tuple[Graph, dict[int, int]]:
    """Regroup products; sums and functions stay as they are.

    Parameters
    ----------
    graph : Graph
    roots : list of int
        Nodes that must survive as values.
    whole : bool, optional
        Inner products are taken apart even where several products share them already; else those stay.
    squares : bool, optional
        Beside a square, that of a known constant counts as the constant twice: K^2 x^2 = (K x) (K x).

    Returns
    -------
    tuple of Graph and dict of int to int
        The new graph, and its nodes by the old ones'.

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
    named = {graph[k].name: k for k in order if graph[k].op == "const" and graph[k].name} if squares else {}
    factors = {top: _folded(graph, _factors(graph, top, kept), named) for top in order if top in tops}
    ranks = {index: rank for rank, index in enumerate(order)}
    pairs = _share(factors, ranks)
    return _rebuild(graph, order, factors, pairs, ranks)


@dataclass(frozen=True)
class Shared:
    """A pair of factors that several products hold, by number."""

    number: int


#: A node of the old graph, a folded constant, or a shared pair.
Factor = int | Folded | Shared
Pair = tuple[Factor, Factor]


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


def _folded(graph: Graph, found: Counter[int], roots: dict[str, int]) -> Counter[Factor]:
    """All constants of a product as one; beside a square, the squares of ``roots`` are taken apart."""
    constants = sorted(
        (index for index in found.elements() if graph[index].op == "const"),
        key=lambda k: (graph[k].name, graph[k].value),
    )
    rest: Counter[Factor] = Counter({index: count for index, count in found.items() if graph[index].op != "const"})
    if len(constants) == 1 and max(rest.values(), default=0) > 1:
        return rest + _rooted(graph, constants[0], roots)
    if len(constants) == 1:
        rest[constants[0]] += 1
    elif constants and folded(graph, constants).value != 1.0:
        rest[folded(graph, constants)] += 1
    return rest


def _rooted(graph: Graph, index: int, roots: dict[str, int]) -> Counter[Factor]:
    """A constant as the root whose square it holds, twice, and the number that is left; else as it is."""
    names, plain = taken_apart(graph[index])
    root = roots.get(product_name(Counter(dict.fromkeys(names, 1)), 1.0)) if set(names.values()) == {2} else None
    if root is None:
        return Counter({index: 1})
    return Counter({root: 2} | ({Folded(plain, "", ""): 1} if plain != 1.0 else {}))


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
    holders: dict[Pair, dict[int, int]] = {}  # how often a product holds a pair, side by side
    total, met = Counter[Pair](), dict[Pair, int]()
    queue: list[tuple[int, float, float, int, Pair]] = []  # the best first; what no longer holds is passed over

    def counted(pair: Pair, times: int) -> None:
        total[pair] += times
        if total[pair] > 1:
            a, b = pair
            heappush(queue, (-total[pair], rank[b], rank[a], met[pair], pair))

    def count(top: int, changed: set[Factor]) -> None:
        for pair in _pairs(factors[top], rank, changed):
            times = _times(factors[top], pair)
            holders.setdefault(pair, {})[top] = times
            met.setdefault(pair, len(met))
            counted(pair, times)

    for top in factors:
        count(top, set(factors[top]))
    while queue:
        times, *_, best = heappop(queue)
        if -times != total[best]:
            continue
        made = Shared(len(pairs))
        pairs.append(best)
        rank[made] = max(rank[best[0]], rank[best[1]]) + 1e-3 * len(pairs)
        changed = {*best, made}
        for top, times in sorted(holders[best].items()):
            held = factors[top]
            for pair in _pairs(held, rank, changed):
                counted(pair, -holders[pair].pop(top))
            for factor in best:
                held[factor] -= times
            held[made] += times
            for factor in [factor for factor, number in held.items() if not number]:
                del held[factor]
            count(top, changed)
    return pairs


def _times(held: Counter[Factor], pair: tuple[Factor, Factor]) -> int:
    """How often a product holds a pair of factors."""
    return held[pair[0]] // 2 if pair[0] == pair[1] else min(held[pair[0]], held[pair[1]])


def _pairs(held: Counter[Factor], rank: dict[Factor, float], among: set[Factor]) -> list[tuple[Factor, Factor]]:
    """Every pair of factors that a product holds and of which one is ``among`` some, the earlier first."""
    if sum(held.values()) < 2:
        return []
    distinct = sorted(held, key=lambda factor: (rank[factor], str(factor)))
    return [
        (a, b)
        for a, b in combinations_with_replacement(distinct, 2)
        if (a in among or b in among) and (a != b or held[a] >= 2)
    ]


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
            return new.adopt(graph[factor], []) if graph[factor].op == "const" else moved[factor]
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
