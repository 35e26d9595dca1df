"""Rewriting passes: small, each with its identity, each on any graph.

A pass takes a graph and the nodes that must survive as values (roots: outputs and compared stages), and
returns a new graph with the map from old nodes to new ones. It changes no value beyond rounding;
``tests/codegen/test_passes.py`` shows that on random graphs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial

from codegen.ir.constants import with_names
from codegen.ir.expr import Expr, GraphBlock
from codegen.ir.graph import Graph, Node
from codegen.passes.collect import collect
from codegen.passes.distribute import distribute
from codegen.passes.hints import carried
from codegen.passes.products import share_products
from codegen.passes.reciprocals import share_reciprocals, spend_reciprocals
from codegen.passes.reuse import reuse_products
from codegen.passes.signs import pull_signs
from model.quantities import Block, Stage

#: A pass's graph, and its nodes by the old ones'.
Rewritten = tuple[Graph, dict[int, int]]
Folds = dict[float, tuple[str, tuple[Node, ...]]]
Pass = Callable[[Graph, list[int]], Rewritten]
Pipelines = tuple[tuple[Pass, ...], ...]

_HEAD: tuple[Pass, ...] = (pull_signs, share_reciprocals)
_COLLECTED: tuple[Pass, ...] = (collect, pull_signs)
_TAIL: tuple[Pass, ...] = (reuse_products, distribute, spend_reciprocals)
_KEPT = partial(share_products, whole=False)
_SQUARES = partial(share_products, squares=True)

#: In the order they run. Sharing is greedy, so several ways are gone and the cheapest result is kept.
PIPELINES: Pipelines = (
    (*_HEAD, share_products, *_COLLECTED, *_COLLECTED, share_products, *_TAIL),  # what was collected is opened again
    (*_HEAD, share_products, *_COLLECTED, *_COLLECTED, share_products, _SQUARES, *_TAIL),
    (*_HEAD, *_COLLECTED, share_products, *_TAIL),
    (*_HEAD, *_COLLECTED, _KEPT, *_TAIL),
    (),  # a sign pulled out of a sum's one term may have to be put into its others: then the graph as it stands
)


def without(*passes: Pass) -> Pipelines:
    """The ways with some passes left out, whatever options these take: to see what a pass earns.

    Parameters
    ----------
    *passes : Pass
        Such as :func:`collect`.
    """
    left = (tuple(step for step in ways if getattr(step, "func", step) not in passes) for ways in PIPELINES)
    return tuple(dict.fromkeys(left))


#: Weight of an operation where two forms are compared, in additions (division and square root as on the chip).
WEIGHTS = {"input": 0, "const": 0, "div": 10, "sqrt": 12, "sin": 18, "cos": 0, "sinc": 6, "cosm1": 5}


def weight(graph: Graph, roots: Iterable[int]) -> int:
    """Cost of computing the roots, in additions.

    Parameters
    ----------
    graph : Graph
    roots : iterable of int
        Nodes; what only others need costs nothing.
    """
    return sum(WEIGHTS.get(graph[index].op, 1) for index in graph.reachable(roots))


def run_passes(graph: Graph, roots: Iterable[int], pipelines: Pipelines = PIPELINES) -> tuple[Graph, dict[int, int]]:
    """The cheapest pipeline's graph, and the map from this graph's nodes to its nodes.

    Parameters
    ----------
    graph : Graph
        Keeps the result, for it is asked more than once.
    roots : iterable of int
        Nodes that must survive as values.
    pipelines : tuple of tuples of Pass, optional
        The ways to try; of equally cheap ones the first is taken.
    """
    key = (tuple(dict.fromkeys(roots)), pipelines)
    if key not in graph.rewritten:
        graph.rewritten[key], folds = _cheapest(_Given(repr((graph.nodes, graph.folds, graph.told)), graph), *key)
        graph.folds |= folds
    return graph.rewritten[key]


@dataclass(frozen=True)
class _Given:
    """A graph, known by all that passes see of it: drives that differ in tuning alone have the same blocks."""

    text: str
    graph: Graph = field(compare=False)


@lru_cache(maxsize=64)
def _cheapest(given: _Given, roots: tuple[int, ...], pipelines: Pipelines) -> tuple[Rewritten, Folds]:
    """The cheapest pipeline's result, and the folds that the graph holds after it."""
    ways = _Ways(given.graph, roots)
    best = min(pipelines, key=lambda pipeline: weight(*ways.run(pipeline)))
    return (ways.run(best)[0], ways.moved(best)), dict(given.graph.folds)


class _Ways:
    """Pipelines over one graph. What several begin with is done once, and so is what they do to equal graphs."""

    def __init__(self, graph: Graph, roots: tuple[int, ...]) -> None:
        #: By passes: the graph that they made, and the roots in it.
        self.made: dict[tuple[Pass, ...], tuple[Graph, tuple[int, ...]]] = {(): (graph, roots)}
        self.by_nodes: dict[tuple[Node, ...], Graph] = {tuple(graph.nodes): graph}
        #: By graph, the roots in it and pass.
        self.done: dict[tuple[int, tuple[int, ...], Pass], Rewritten] = {}

    def run(self, passes: tuple[Pass, ...]) -> tuple[Graph, tuple[int, ...]]:
        if passes not in self.made:
            graph, roots = self.run(passes[:-1])
            new, moved = self._pass(graph, roots, passes[-1])
            self.made[passes] = new, tuple(moved[root] for root in roots)
        return self.made[passes]

    def moved(self, passes: tuple[Pass, ...]) -> dict[int, int]:
        """Where the nodes of the first graph went."""
        graph, roots = self.run(passes[:-1])
        if not passes:
            return {node: node for node in graph.reachable(roots)}
        _, moved = self._pass(graph, roots, passes[-1])
        return {old: moved[now] for old, now in self.moved(passes[:-1]).items() if now in moved}

    def _pass(self, graph: Graph, roots: tuple[int, ...], step: Pass) -> Rewritten:
        key = (id(graph), roots, step)
        if key not in self.done:
            new, moved = step(graph, list(roots))
            new.folds, new.told = graph.folds | new.folds, graph.told
            self.done[key] = self.by_nodes.setdefault(tuple(new.nodes), new), moved
        return self.done[key]


def optimise(block: Block, pipelines: Pipelines = PIPELINES) -> Block:
    """The same block over the cheapest pipeline's graph; a block that is still a tape stays as it is.

    What a stage merely suggests a name for may be gone afterwards: the stage loses that entry.

    Parameters
    ----------
    block : Block
    pipelines : tuple of tuples of Pass, optional
        The ways to try.
    """
    if not isinstance(block, GraphBlock):
        return block
    graph, moved = run_passes(block.graph, block.roots, pipelines)
    graph = with_names(graph)

    def rewritten(stage: Stage) -> Stage:
        kept = [k for k, entry in enumerate(stage.entries) if entry.node in moved]
        entries = tuple(Expr(graph, moved[stage.entries[k].node]) for k in kept)
        names, rows = tuple(stage.names[k] for k in kept), tuple(stage.rows[k] for k in kept)
        return replace(stage, entries=entries, names=names, rows=rows)

    outputs = tuple(
        replace(port, entries=tuple(Expr(graph, moved[entry.node]) for entry in port.entries)) for port in block.outputs
    )
    staged = tuple(pair for stage in block.stages for pair in zip(stage.names, stage.entries, strict=True))
    hints = carried((*block.hints, *staged), graph)
    return replace(block, graph=graph, outputs=outputs, stages=tuple(map(rewritten, block.stages)), hints=hints)


__all__ = [
    "PIPELINES",
    "WEIGHTS",
    "Pipelines",
    "collect",
    "distribute",
    "optimise",
    "pull_signs",
    "reuse_products",
    "run_passes",
    "share_products",
    "share_reciprocals",
    "spend_reciprocals",
    "weight",
    "without",
]
