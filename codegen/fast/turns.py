"""The small angles of a block, computed in a block of their own before it.

Every column of L turns an angle by some d; the block needs sin(d) / d and cos(d) - 1 (see
:mod:`codegen.ir.small_angle`). Apart, the usual polynomials stand in straight lines and the rare wide angle is
mended before anything depends on it, in one place.
"""

from __future__ import annotations

from codegen.ir.expr import Expr, GraphBlock
from codegen.ir.graph import Graph
from model.quantities import Port, Stage

OPERATIONS = ("sinc", "cosm1")

#: z = d^2 / n and n, as nodes.
Angle = tuple[int, ...]


def spread_of(block: GraphBlock) -> float:
    """The n of a block of small angles, z = d^2 / n."""
    turned = (entry.node for port in block.outputs for entry in port.entries)
    (n,) = {block.graph[node].args[1] for node in turned if block.graph[node].op in OPERATIONS}
    return block.graph[n].value


def split_turns(block: GraphBlock, tag: str) -> list[GraphBlock]:
    """The block, preceded by the one that computes its turns if it has any.

    ``tag`` tells their arrays ``z<tag>`` and ``turn<tag>`` apart within a step.
    """
    roots = [entry.node for port in block.outputs for entry in port.entries]
    order = block.graph.reachable(roots)
    angles = list(dict.fromkeys(block.graph[k].args for k in order if block.graph[k].op in OPERATIONS))
    angles.sort(key=lambda angle: block.graph[angle[0]].op == "input")  # the angle's own column, z = D, comes last
    if not angles:
        return [block]
    names = _names(block, angles)
    return [_before(block, angles, names, tag), _after(block, angles, names, tag)]


def _names(block: GraphBlock, angles: list[Angle]) -> list[tuple[str, str, str]]:
    """Names of z, sinc and cosm1, as the block's stages suggest."""
    known = {
        entry.node: name
        for stage in reversed(block.stages)
        for entry, name in zip(stage.entries, stage.names, strict=True)
    }
    found = []
    for k, angle in enumerate(angles):
        nodes = (angle[0], *(block.graph.op(op, *angle) for op in OPERATIONS))
        names = [known.get(node, f"{label}_{k}") for node, label in zip(nodes, ("z", *OPERATIONS), strict=True)]
        found.append((names[0], names[1], names[2]))
    return found


def _before(block: GraphBlock, angles: list[Angle], names: list[tuple[str, str, str]], tag: str) -> GraphBlock:
    graph = block.graph
    needed = {graph[k].name for k in graph.reachable(z for z, _ in angles) if graph[k].op == "input"}
    inputs = tuple(port for port in block.inputs if needed & set(port.names))
    turned = [Expr(graph, graph.op(op, *angle)) for angle in angles for op in OPERATIONS]
    labels = tuple(name for _, sinc, cosm1 in names for name in (sinc, cosm1))
    z = tuple(Expr(graph, node) for node, _ in angles)
    (n,) = {graph[spread].value for _, spread in angles}
    meaning = f"z = d^2 / {n:g}, d what column c turns an angle by"
    stages = (
        Stage("z", "14", meaning, z, tuple(name for name, _, _ in names), (0,) * len(z), "none"),
        Stage("turn", "14", "sin(d) / d, cos(d) - 1", tuple(turned), labels, (0,) * len(turned), "none"),
    )
    outputs = (Port(f"z{tag}", z, tuple(name for name, _, _ in names)), Port(f"turn{tag}", tuple(turned), labels))
    title = f"Small angles of {block.name}: sin(d) / d and cos(d) - 1"
    known = tuple(pair for stage in block.stages for pair in zip(stage.names, stage.entries, strict=True))
    return GraphBlock(f"{block.name}_turns", title, inputs, outputs, stages, graph, hints=(*known, *block.hints))


def _after(block: GraphBlock, angles: list[Angle], names: list[tuple[str, str, str]], tag: str) -> GraphBlock:
    """The block with the turns as inputs."""
    new, moved = Graph(), dict[int, int]()
    given = {
        block.graph.op(op, *angle): name
        for angle, (_, sinc, cosm1) in zip(angles, names, strict=True)
        for op, name in zip(OPERATIONS, (sinc, cosm1), strict=True)
    }
    for index, node in enumerate(block.graph.nodes):
        if index in given:
            moved[index] = new.input(given[index])
        else:
            moved[index] = new.adopt(node, [moved[arg] for arg in node.args])

    def move(entries: tuple[Expr, ...]) -> tuple[Expr, ...]:
        return tuple(Expr(new, moved[entry.node]) for entry in entries)

    turn = tuple(Expr(new, new.input(name)) for name in given.values())
    inputs = (
        *(Port(p.name, move(p.entries), p.names) for p in block.inputs),
        Port(f"turn{tag}", turn, tuple(given.values())),
    )
    outputs = tuple(Port(p.name, move(p.entries), p.names) for p in block.outputs)
    stages = tuple(
        Stage(s.name, s.equation, s.meaning, move(s.entries), s.names, s.rows, s.scale) for s in block.stages
    )
    new.folds, new.told = block.graph.folds, block.graph.told
    hints = tuple((name, Expr(new, moved[entry.node])) for name, entry in block.hints)
    return GraphBlock(block.name, block.title, inputs, outputs, stages, new, block.last, hints)
