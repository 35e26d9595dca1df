"""k (a + b x) = (k a) + (k b) x where k a and k b are known: a product with a sum that nothing else needs goes."""

from __future__ import annotations

from collections import Counter

from codegen.ir.graph import Graph


def distribute(graph: Graph, roots: list[int]) -> tuple[Graph, dict[int, int]]:
    """Products of a sum are multiplied out if every term finds its product with the other factor done already.

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
    >>> k, a, b, x = (g.input(name) for name in "kabx")
    >>> known = [g.op("mul", k, a), g.op("mul", k, b)]
    >>> new, moved = distribute(g, [*known, g.op("mul", k, g.op("add", a, g.op("mul", b, x)))])
    >>> sum(new[index].op == "mul" for index in new.reachable(moved.values()))
    3
    """
    order = graph.reachable(roots)
    uses = Counter(arg for index in order for arg in graph.nodes[index].args)
    uses.update(roots)
    known = {frozenset(graph.nodes[index].args): index for index in order if graph.nodes[index].op == "mul"}
    instead: dict[int, tuple[int, int]] = {}  # a product: its factor, the sum
    for index in order:
        if graph.nodes[index].op == "mul":
            for k, total in (graph.nodes[index].args, graph.nodes[index].args[::-1]):
                if _opens(graph, total, k, uses, known):
                    instead[index] = k, total
    return _rebuild(graph, roots, instead, uses, known)


def _opens(graph: Graph, total: int, k: int, uses: Counter[int], known: dict[frozenset[int], int]) -> bool:
    """Whether ``total`` is a sum of this one user, each of whose terms holds a factor that is known times ``k``."""
    node = graph.nodes[total]
    if node.op not in {"add", "sub"} or uses[total] != 1:
        return False
    return all(_term(graph, arg, k, uses, known) or _opens(graph, arg, k, uses, known) for arg in node.args)


def _term(
    graph: Graph, term: int, k: int, uses: Counter[int], known: dict[frozenset[int], int]
) -> tuple[int, int | None] | None:
    """The known product that stands for ``k`` and a term, and what it is still to be multiplied with."""
    if frozenset((k, term)) in known:
        return known[frozenset((k, term))], None
    if graph.nodes[term].op == "mul" and uses[term] == 1:
        for factor, rest in (graph.nodes[term].args, graph.nodes[term].args[::-1]):
            if frozenset((k, factor)) in known:
                return known[frozenset((k, factor))], rest
    return None


def _rebuild(
    graph: Graph,
    roots: list[int],
    instead: dict[int, tuple[int, int]],
    uses: Counter[int],
    known: dict[frozenset[int], int],
) -> tuple[Graph, dict[int, int]]:
    new, moved = Graph(), dict[int, int]()

    def opened(total: int, k: int) -> int:
        left, right = (times(arg, k) for arg in graph.nodes[total].args)
        return new.op(graph.nodes[total].op, left, right)

    def times(term: int, k: int) -> int:
        found = _term(graph, term, k, uses, known)
        if found is None:
            return opened(term, k)
        product, rest = found
        return place(product) if rest is None else new.op("mul", place(product), place(rest))

    def place(index: int) -> int:
        if index not in moved:
            if index in instead:
                k, total = instead[index]
                moved[index] = opened(total, k)
            else:
                moved[index] = new.adopt(graph.nodes[index], [place(arg) for arg in graph.nodes[index].args])
        return moved[index]

    for root in roots:
        place(root)
    return new, moved
