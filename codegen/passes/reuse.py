"""(k m) x y = (k x) (m y) where k x and m y are known: constants that met in one product part again."""

from __future__ import annotations

import math
from collections import Counter, defaultdict

from codegen.ir.graph import Graph

#: Constants that were multiplied in another order are the same constant.
SAME = 1e-14

#: The factors of a product that are no constants, in order, each as often as it is held.
Factors = tuple[int, ...]


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
    uses = Counter(arg for index in order for arg in graph.nodes[index].args)
    uses.update(roots)
    parts = {index: _parts(graph, index) for index in order if graph.nodes[index].op == "mul"}
    known, least = defaultdict[Factors, list[int]](list), defaultdict[int, list[tuple[int, int]]](list)
    for place, (index, (_, factors)) in enumerate(parts.items()):
        known[factors].append(index)
        if factors:
            least[factors[0]].append((place, index))
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


def _parts(graph: Graph, top: int) -> tuple[float, Factors]:
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
    return number, tuple(sorted(found))


def _inner(graph: Graph, top: int, uses: Counter[int]) -> set[int]:
    """Products that serve this one alone."""
    nodes, found, stack = graph.nodes, set[int](), [top]
    while stack:
        for arg in nodes[stack.pop()].args:
            if nodes[arg].op == "mul" and uses[arg] == 1:
                found.add(arg)
                stack.append(arg)
    return found


def _pair(
    top: int,
    parts: dict[int, tuple[float, Factors]],
    known: dict[Factors, list[int]],
    least: dict[int, list[tuple[int, int]]],
    barred: tuple[set[int], set[int]],
) -> tuple[int, int] | None:
    """Two other products, none of them ``barred``, whose product is ``top``.

    ``known``: products by their factors; ``least``: products and their places in order, by their least factor.
    """
    number, factors = parts[top]
    inner, gone = barred
    for _, first in sorted(pair for factor in set(factors) for pair in least.get(factor, ())):
        one, some = parts[first]
        if first == top or first in inner or first in gone:
            continue
        rest = _without(factors, some)
        for second in known.get(rest, ()) if rest is not None else ():
            if (
                second not in inner
                and second not in gone
                and math.isclose(one * parts[second][0], number, rel_tol=SAME)
            ):
                return first, second
    return None


def _without(factors: Factors, some: Factors) -> Factors | None:
    """What a product holds beside some factors; None if it does not hold them."""
    rest = list(factors)
    for factor in some:
        if factor not in rest:
            return None
        rest.remove(factor)
    return tuple(rest)


def _rebuild(graph: Graph, order: list[int], instead: dict[int, tuple[int, int]]) -> tuple[Graph, dict[int, int]]:
    nodes, new, moved = graph.nodes, Graph(), dict[int, int]()

    def place(index: int) -> int:
        if index not in moved:
            args = [place(arg) for arg in instead.get(index, nodes[index].args)]
            moved[index] = new.adopt(nodes[index], args)
        return moved[index]

    for index in order:
        place(index)
    return new, moved
