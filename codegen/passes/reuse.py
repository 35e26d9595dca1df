"""(k m) x y = (k x) (m y) where k x and m y are known: constants that met in one product part again."""

from __future__ import annotations

import math
from collections import Counter, defaultdict

from codegen.ir.graph import Graph

#: Constants that were multiplied in another order are the same constant.
SAME = 1e-14

#: The factors of a product that are no constants, to look products up by.
Key = frozenset[tuple[int, int]]


def reuse_products(graph: Graph, roots: list[int]) -> tuple[Graph, dict[int, int]]:
    """A product becomes that of two others which are needed anyway, where its own inner products then go.

    Parameters
    ----------
    graph : Graph
    roots : list of int
        Nodes that must survive as values.

    Returns
    -------
    tuple of Graph and dict of int to int
        The new graph, and its nodes by the old ones'.

    >>> g = Graph()
    >>> x, y, k, m = g.input("x"), g.input("y"), g.const(3.0), g.const(0.25)
    >>> known = [g.op("mul", k, x), g.op("mul", m, y)]
    >>> new, moved = reuse_products(g, [*known, g.op("mul", g.op("mul", g.const(0.75), x), y)])
    >>> sum(new[index].op == "mul" for index in new.reachable(moved[root] for root in (*known, max(moved))))
    3
    """
    order = graph.reachable(roots)
    uses = Counter(arg for index in order for arg in graph[index].args)
    uses.update(roots)
    parts = {index: _parts(graph, index) for index in order if graph[index].op == "mul"}
    known, least = defaultdict[Key, list[int]](list), defaultdict[int, list[tuple[int, int]]](list)
    for place, (index, (_, factors)) in enumerate(parts.items()):
        known[frozenset(factors.items())].append(index)
        if factors:
            least[min(factors)].append((place, index))
    instead, kept, gone = dict[int, tuple[int, int]](), set[int](), set[int]()
    for index in parts:
        inner = _inner(graph, index, uses)
        if inner and not inner & kept and index not in gone:
            pair = _pair(index, parts, known, least, (inner, gone))
            if pair:
                instead[index] = pair
                kept |= set(pair)
                gone |= inner
    return _rebuild(graph, order, instead)


def _parts(graph: Graph, top: int) -> tuple[float, Counter[int]]:
    """A product's constants as one number, and its other factors, inner products taken apart."""
    nodes, number, found, stack = graph.nodes, 1.0, list[int](), [top]
    while stack:
        index = stack.pop()
        node = nodes[index]
        if node.op == "mul":
            stack += node.args
        elif node.op == "const":
            number *= node.value
        else:
            found.append(index)
    return number, Counter(found)


def _inner(graph: Graph, top: int, uses: Counter[int]) -> set[int]:
    """Products that serve this one alone."""
    found, stack = set[int](), [top]
    while stack:
        for arg in graph[stack.pop()].args:
            if graph[arg].op == "mul" and uses[arg] == 1:
                found.add(arg)
                stack.append(arg)
    return found


def _pair(
    top: int,
    parts: dict[int, tuple[float, Counter[int]]],
    known: dict[Key, list[int]],
    least: dict[int, list[tuple[int, int]]],
    barred: tuple[set[int], set[int]],
) -> tuple[int, int] | None:
    """Two other products, none of them ``barred``, whose product is ``top``.

    ``known``: products by their factors; ``least``: products and their places in order, by their least factor.
    """
    number, factors = parts[top]
    inner, gone = barred
    for _, first in sorted(pair for factor in factors for pair in least.get(factor, ())):
        one, some = parts[first]
        if first == top or first in inner or first in gone or not _held(some, factors):
            continue
        for second in known.get(frozenset((factors - some).items()), ()):
            if (
                second not in inner
                and second not in gone
                and math.isclose(one * parts[second][0], number, rel_tol=SAME)
            ):
                return first, second
    return None


def _held(some: Counter[int], factors: Counter[int]) -> bool:
    """Whether a product's factors are among another's; ``<=`` of counters would look at both."""
    return all(factors.get(factor, 0) >= times for factor, times in some.items())


def _rebuild(graph: Graph, order: list[int], instead: dict[int, tuple[int, int]]) -> tuple[Graph, dict[int, int]]:
    new, moved = Graph(), dict[int, int]()

    def place(index: int) -> int:
        if index not in moved:
            args = [place(arg) for arg in instead.get(index, graph[index].args)]
            moved[index] = new.adopt(graph[index], args)
        return moved[index]

    for index in order:
        place(index)
    return new, moved
