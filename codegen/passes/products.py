"""Products taken apart and put together again so that what they share is computed once.

``a (b c)`` and ``b (a d)`` share ``a b`` although no node does. Every product is flattened into its factors;
then the pair of factors that most products hold becomes a factor of its own, again and again, until no pair
is held twice (greedy two-factor sharing). Constants are factors like the others, but those that meet in one
product are folded into one number first.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from heapq import heappop, heappush
from itertools import combinations_with_replacement
from typing import NamedTuple

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


class Shared(NamedTuple):
    """A pair of factors that several products hold, by number."""

    number: int


#: A node of the old graph, a folded constant, or a shared pair.
Factor = int | Folded | Shared
Pair = tuple[Factor, Factor]


def _tops(graph: Graph, order: list[int], roots: set[int]) -> set[int]:
    """Products that something other than a product uses, or that must survive."""
    nodes = graph.nodes
    users = (nodes[index] for index in order)
    used = {arg for node in users if node.op != "mul" for arg in node.args} | roots
    return {index for index in order if nodes[index].op == "mul" and index in used}


def _factors(graph: Graph, top: int, kept: set[int]) -> Counter[int]:
    """Factors of a product, inner products taken apart unless they are to be kept."""
    nodes, found = graph.nodes, list[int]()
    stack = list(nodes[top].args)
    while stack:
        index = stack.pop()
        if nodes[index].op == "mul" and index not in kept:
            stack += nodes[index].args
        else:
            found.append(index)
    return Counter(found)


def _folded(graph: Graph, found: Counter[int], roots: dict[str, int]) -> Counter[Factor]:
    """All constants of a product as one; beside a square, the squares of ``roots`` are taken apart."""
    constants = [index for index in found.elements() if graph[index].op == "const"]
    constants.sort(key=lambda k: (graph[k].name, graph[k].value))
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


def _share(factors: dict[int, Counter[Factor]], ranks: dict[int, int]) -> list[Pair]:
    """Replace the most frequent pair until none is frequent; returns the pairs in the order made.

    Among equally frequent pairs the one known first is taken, so that what does not change is computed first.
    """
    rank: dict[Factor, float] = {
        factor: float(ranks[factor]) if isinstance(factor, int) else -1.0
        for held in factors.values()
        for factor in held
    }
    pairs: list[Pair] = []
    holders: dict[Pair, dict[int, int]] = {}  # how often a product holds a pair, side by side
    total, met = dict[Pair, int](), dict[Pair, int]()
    queue: list[tuple[int, float, float, int, Pair]] = []  # the best first; what no longer holds is passed over

    def wanted(pair: Pair) -> None:
        if total[pair] > 1:
            a, b = pair
            heappush(queue, (-total[pair], rank[b], rank[a], met[pair], pair))

    def counted(top: int, among: Collection[Factor]) -> list[Pair]:
        held = factors[top]
        found = _pairs(held, rank, among)
        for pair in found:
            times = _times(held, pair)
            holders.setdefault(pair, {})[top] = times
            met.setdefault(pair, len(met))
            total[pair] = total.get(pair, 0) + times
        return found

    for top, held in factors.items():
        counted(top, held)
    for pair in total:
        wanted(pair)
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
                total[pair] -= holders[pair].pop(top)
                wanted(pair)
            for factor in best:
                held[factor] -= times
            held[made] += times
            for factor in best:
                if not held.get(factor, 1):
                    del held[factor]
            for pair in counted(top, changed):
                wanted(pair)
    return pairs


def _times(held: Counter[Factor], pair: Pair) -> int:
    """How often a product holds a pair of factors."""
    return held[pair[0]] // 2 if pair[0] == pair[1] else min(held[pair[0]], held[pair[1]])


def _pairs(held: Counter[Factor], rank: dict[Factor, float], among: Collection[Factor]) -> list[Pair]:
    """Every pair of factors that a product holds and of which one is ``among`` some, the earlier first."""
    if len(held) < 2 and held.total() < 2:
        return []
    distinct = sorted(held, key=str) if len({rank[factor] for factor in held}) < len(held) else list(held)
    distinct.sort(key=rank.__getitem__)
    pairs = combinations_with_replacement(distinct, 2)
    return [(a, b) for a, b in pairs if (a in among or b in among) and (a is not b or held[a] >= 2)]


def _ranks(pairs: list[Pair], ranks: dict[int, int]) -> dict[Factor, float]:
    """When nodes and pairs are known: nodes in order, pairs with their later half. Constants are not told: at once."""
    known: dict[Factor, float] = {index: float(rank) for index, rank in ranks.items()}
    for number, halves in enumerate(pairs):
        known[Shared(number)] = max(known.get(half, -1.0) for half in halves) + 1e-3 * (number + 1)
    return known


def _rebuild(
    graph: Graph,
    order: list[int],
    factors: dict[int, Counter[Factor]],
    pairs: list[Pair],
    ranks: dict[int, int],
) -> tuple[Graph, dict[int, int]]:
    new, moved = Graph(), dict[int, int]()
    inner = {index for index in order if graph[index].op == "mul"} - factors.keys()
    known = _ranks(pairs, ranks)

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
            held = sorted(factors[index].elements(), key=lambda factor: known.get(factor, -1.0))
            nodes = [place(factor) for factor in held]
            value = nodes[0]
            for node in nodes[1:]:
                value = new.op("mul", value, node)
            moved[index] = value
        else:
            moved[index] = new.adopt(graph[index], [moved[arg] for arg in graph[index].args])
    return new, moved
