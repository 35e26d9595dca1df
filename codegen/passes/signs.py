"""Signs pulled out of products and into sums: (-a) b + c  =  c - a b. A negation then costs nothing."""

from __future__ import annotations

from codegen.ir.graph import Graph, Node


def pull_signs(graph: Graph, roots: list[int]) -> tuple[Graph, dict[int, int]]:
    """Negations and negative numbers wander outwards until a sum takes them up; the few that reach a root stay.

    Bits are those of the original but for the sign of zeros.

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
    >>> new, moved = pull_signs(g, [g.op("add", g.op("mul", g.op("neg", a), b), c)])
    >>> [node.op for node in new.nodes]
    ['input', 'input', 'mul', 'input', 'sub']
    """
    new = Graph()
    signed: dict[int, tuple[bool, int]] = {}  # negative?, node
    moved: dict[int, int] = {}
    wanted = set(roots)
    names = {node.value: node for node in graph.nodes if node.op == "const" and node.name}
    for index in graph.reachable(roots):
        node = graph.nodes[index]
        signed[index] = _signed(new, graph, index, signed, names)
        negative, value = signed[index]
        if negative and index in wanted:
            signed[index] = False, new.op("neg", value)
        if not signed[index][0]:
            moved[index] = signed[index][1]
        del node
    return new, moved


def _signed(
    new: Graph, graph: Graph, index: int, signed: dict[int, tuple[bool, int]], names: dict[float, Node]
) -> tuple[bool, int]:
    node = graph.nodes[index]
    args = [signed[arg] for arg in node.args]
    if node.op == "const" and node.value < 0 and not node.name:
        known = names.get(-node.value)  # a named constant lost its name when its sign was folded in
        return True, new.const(-node.value, known.name, known.formula) if known else new.const(-node.value)
    if node.op == "neg":
        return not args[0][0], args[0][1]
    if node.op in {"mul", "div"}:
        return args[0][0] != args[1][0], new.op(node.op, args[0][1], args[1][1])
    if node.op in {"add", "sub"}:
        return _sum(new, args[0], (args[1][0] != (node.op == "sub"), args[1][1]))
    values = [new.op("neg", value) if negative else value for negative, value in args]
    return False, new.adopt(node, values)


def _sum(new: Graph, a: tuple[bool, int], b: tuple[bool, int]) -> tuple[bool, int]:
    if a[0] == b[0]:
        return a[0], new.op("add", a[1], b[1])
    first, second = (b, a) if a[0] else (a, b)
    return False, new.op("sub", first[1], second[1])
