"""a / c, b / c  =  a r, b r  with r = 1 / c: a division costs ten multiplications on the chip."""

from __future__ import annotations

from collections import Counter

from codegen.ir.graph import Graph


def share_reciprocals(graph: Graph, roots: list[int]) -> tuple[Graph, dict[int, int]]:
    """One division a divisor, wherever a divisor is used more than once.

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
    >>> a, b, c = g.input("a"), g.input("b"), g.input("c")
    >>> new, moved = share_reciprocals(g, [g.op("div", a, c), g.op("div", b, c)])
    >>> [node.op for node in new.nodes]
    ['input', 'input', 'const', 'div', 'mul', 'input', 'mul']
    """
    order = graph.reachable(roots)
    uses = Counter(graph.nodes[index].args[1] for index in order if graph.nodes[index].op == "div")
    new, moved = Graph(), dict[int, int]()
    for index in order:
        node = graph.nodes[index]
        args = [moved[arg] for arg in node.args]
        if node.op == "div" and uses[node.args[1]] > 1:
            moved[index] = new.op("mul", args[0], new.op("div", new.const(1.0), args[1]))
        else:
            moved[index] = new.adopt(node, args)
    return new, moved


def spend_reciprocals(graph: Graph, roots: list[int]) -> tuple[Graph, dict[int, int]]:
    """a (1 / c) = a / c where 1 / c serves nothing else: one multiplication less.

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
    >>> a, c = g.input("a"), g.input("c")
    >>> new, moved = spend_reciprocals(g, [g.op("mul", a, g.op("div", g.const(1.0), c))])
    >>> new[moved[max(moved)]].op
    'div'
    """
    order = graph.reachable(roots)
    uses = Counter(arg for index in order for arg in graph.nodes[index].args)
    uses.update(roots)
    new, moved = Graph(), dict[int, int]()
    for index in order:
        node = graph.nodes[index]
        for a, r in (node.args, node.args[::-1]) if node.op == "mul" else ():
            inverse = graph.nodes[r]
            if (
                inverse.op == "div"
                and uses[r] == 1
                and graph.nodes[inverse.args[0]].op == "const"
                and graph.nodes[inverse.args[0]].value == 1.0
            ):
                moved[index] = new.op("div", moved[a], moved[inverse.args[1]])
                break
        else:
            moved[index] = new.adopt(node, [moved[arg] for arg in node.args])
    return new, moved
