"""Rewriting passes on random graphs, in exact rational arithmetic: no value changes, and no work is added."""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache, partial
from typing import Any

import numpy as np
import pytest

from codegen.ir.graph import Graph
from codegen.passes import (
    PIPELINES,
    _Ways,
    collect,
    distribute,
    pull_signs,
    reuse_products,
    run_passes,
    share_products,
    share_reciprocals,
    spend_reciprocals,
    weight,
)
from codegen.passes import __all__ as exported
from tests.codegen.graphs import RATIONAL, evaluate, random_graph, random_point

pytestmark = pytest.mark.unit

PASSES = {
    "share_reciprocals": share_reciprocals,
    "spend_reciprocals": spend_reciprocals,
    "pull_signs": pull_signs,
    "distribute": distribute,
    "reuse_products": reuse_products,
    "share_products": share_products,
    "share_products, inner ones kept": partial(share_products, whole=False),
    "share_products, squares apart": partial(share_products, squares=True),
}
PASSES |= {name: getattr(__import__("codegen.passes", fromlist=[name]), name) for name in {"collect"} & set(exported)}


def exact(graph: Graph, roots: list[int], point: dict[str, Fraction]) -> dict[int, Fraction] | None:
    """Values of all nodes, or None if one divides by zero there."""
    try:
        return evaluate(graph, roots, point, RATIONAL, Fraction)
    except ZeroDivisionError:
        return None


def drawn(seed: int, functions: bool) -> tuple[np.random.Generator, Graph, list[int]]:
    """A random graph and its roots, and the generator behind them."""
    rng = np.random.default_rng(seed)
    return rng, *random_graph(rng, int(rng.integers(4, 60)), functions)


@lru_cache(maxsize=300)
def values(seed: int, functions: bool) -> list[tuple[dict[str, Fraction], dict[int, Fraction] | None]]:
    """Five points and the values of a random graph there: every pass is asked about the same."""
    rng, graph, roots = drawn(seed, functions)
    return [(point, exact(graph, roots, point)) for point in (random_point(rng) for _ in range(5))]


def check(seed: int, rewrite: object, functions: bool) -> tuple[int, int] | None:
    """Equal values at roots and at whatever else the pass says it kept; weights before and after."""
    _, graph, roots = drawn(seed, functions)
    new, moved = rewrite(graph, roots)  # type: ignore[operator]
    assert set(roots) <= moved.keys(), "roots survive"
    compared = 0
    for point, before in values(seed, functions):
        after = before and exact(new, [moved[root] for root in roots], point)
        if before is None:
            continue
        assert after is not None, "a division by zero that the original does not make"
        for old, place in moved.items():
            if place in after and old in before:
                assert after[place] == before[old], f"seed {seed}: node {old}, {graph[old]}"
                compared += 1
    if not compared:
        return None
    return weight(graph, roots), weight(new, [moved[root] for root in roots])


@pytest.mark.parametrize("functions", [False, True], ids=["rational", "with functions"])
@pytest.mark.parametrize("name", PASSES)
def test_a_pass_changes_no_value(name: str, functions: bool) -> None:
    checked = [check(seed, PASSES[name], functions) for seed in range(150)]
    assert sum(item is not None for item in checked) > 75, "most graphs can be evaluated"


def test_the_pipelines_change_no_value_and_add_no_work() -> None:
    for seed in range(1000, 1120):
        found = check(seed, run_passes, seed % 2 == 0)
        assert found is None or found[1] <= found[0], seed


def products(graph: Graph, roots: list[int], rewrite: Any) -> int:
    """Multiplications that the rewritten graph has, its values compared at a point."""
    new, moved = rewrite(graph, roots)
    point = {node.name: Fraction(k + 2, 3) for k, node in enumerate(graph.nodes) if node.op == "input"}
    before, after = exact(graph, roots, point), exact(new, [moved[root] for root in roots], point)
    assert before is not None
    assert after is not None
    assert [before[root] for root in roots] == [after[moved[root]] for root in roots]
    return sum(new[index].op == "mul" for index in new.reachable(moved[root] for root in roots))


def test_what_a_collected_sum_has_in_common_with_others_is_multiplied_once() -> None:
    """k v - k c o - k q a - k q b = k (v - c o - q (a + b)): k stays outside, where the other terms have it."""
    g = Graph()
    k, (v, c, o, q, a, b) = g.const(3.0, "K"), (g.input(name) for name in "vcoqab")
    kq = g.op("mul", k, q)
    first = g.op("sub", g.op("mul", k, v), g.op("mul", k, g.op("mul", c, o)))
    total = g.op("sub", first, g.op("mul", kq, g.op("add", a, b)))
    assert products(g, [total], collect) == 3

    half = g.op("add", g.op("mul", k, v), g.op("add", g.op("mul", kq, a), g.op("mul", q, b)))
    assert products(g, [half], collect) == 3, "what one of the terms alone holds goes in with it"


def one_after_another(graph: Graph, roots: list[int], pipeline: Any) -> tuple[Graph, list[int]]:
    """A pipeline with nothing remembered: each pass on what the one before it made."""
    for step in pipeline:
        graph, moved = step(graph, roots)
        roots = [moved[root] for root in roots]
    return graph, roots


def test_a_pipeline_is_its_passes_one_after_another() -> None:
    """What several ways have in common is done once; each must still end where it ends alone."""
    ended_apart = 0
    for seed in range(3000, 3040):
        rng = np.random.default_rng(seed)
        graph, roots = random_graph(rng, int(rng.integers(10, 80)), seed % 2 == 0)
        ways, ends = _Ways(graph, tuple(roots)), []
        for pipeline in PIPELINES:
            new, places = ways.run(pipeline)
            ends.append((new.nodes, list(places)))
            alone, ended = one_after_another(graph, roots, pipeline)
            assert ends[-1] == (alone.nodes, ended), (seed, pipeline)
            moved = ways.moved(pipeline)
            assert [moved.get(root) for root in roots] == ended, (seed, pipeline)
        ended_apart += any(end != ends[0] for end in ends[1:-1])
    assert ended_apart > 5, "the ways differ"


def test_the_same_graph_with_other_roots_is_other_work() -> None:
    """Two ways reach one graph, whose first root is not the same node: a pass on it is no repetition."""
    graph = Graph()
    a, b = graph.input("a"), graph.input("b")

    def swap(graph: Graph, roots: list[int]) -> tuple[Graph, dict[int, int]]:
        return graph, dict(zip(roots, reversed(roots), strict=True))

    def negate_first(graph: Graph, roots: list[int]) -> tuple[Graph, dict[int, int]]:
        new = Graph()
        moved = {root: new.adopt(graph[root], []) for root in (a, b)}
        return new, moved | {roots[0]: new.op("neg", moved[roots[0]])}

    ways = _Ways(graph, (a, b))
    for pipeline, expected in (((negate_first,), (-3, 7)), ((swap, negate_first), (-7, 3))):
        new, roots = ways.run(pipeline)
        values = exact(new, list(roots), {"a": Fraction(3), "b": Fraction(7)})
        assert values is not None
        assert tuple(values[root] for root in roots) == expected


def test_an_equal_graph_is_rewritten_as_the_first_one_was() -> None:
    """With what its folded constants are made of, of which names come; the sign of a zero makes another graph."""

    def scaled(zero: float) -> tuple[Graph, int]:
        g = Graph()
        inner = g.op("mul", g.const(5.0, "B"), g.input("x"))
        return g, g.op("add", g.op("mul", g.const(3.0, "A"), inner), g.const(zero))

    graphs = [scaled(zero) for zero in (0.0, 0.0, -0.0)]
    first, again, other = (run_passes(graph, [root], ((share_products,),))[0] for graph, root in graphs)
    assert repr(first.nodes) == repr(again.nodes) != repr(other.nodes)
    assert graphs[0][0].folds == graphs[1][0].folds
    assert 15.0 in graphs[1][0].folds


def test_passes_find_what_they_are_for() -> None:
    """Over random graphs work is saved, not only kept."""
    found = [item for seed in range(2000, 2060) if (item := check(seed, run_passes, False))]
    assert sum(after < before for before, after in found) > 0.2 * len(found)


def test_known_products_are_used_again() -> None:
    """(x / 4)^2 beside x / 4: the square of what is known; but not of what only the square itself would need."""
    g = Graph()
    x, y = g.input("x"), g.input("y")
    quarter = g.op("mul", x, g.const(0.25))
    square = g.op("mul", g.op("mul", x, x), g.const(0.0625))
    new, moved = reuse_products(g, [quarter, square])
    assert new[moved[square]].args == (moved[quarter], moved[quarter])
    lonely = g.op("mul", g.op("mul", x, g.const(3.0)), y)
    new, moved = reuse_products(g, [lonely])
    assert weight(new, [moved[lonely]]) == weight(g, [lonely])


def test_all_constants_of_a_product_count() -> None:
    """2 (3 x) is neither 2 x nor 3 x: with 5 y it makes no 10 x y and no 15 x y."""
    g = Graph()
    x, y, two, three = g.input("x"), g.input("y"), g.const(2.0), g.const(3.0)
    known = [g.op("mul", two, g.op("mul", three, x)), g.op("mul", g.const(5.0), y)]
    tops = [g.op("mul", g.op("mul", g.const(size), x), y) for size in (10.0, 15.0)]
    new, moved = reuse_products(g, [*known, *tops])
    values = exact(new, [moved[top] for top in tops], {"x": Fraction(1), "y": Fraction(1)})
    assert values is not None
    assert [values[moved[top]] for top in tops] == [10, 15]


def test_every_exported_pass_is_tested() -> None:
    others = {"PIPELINES", "Pipelines", "WEIGHTS", "optimise", "run_passes", "weight", "without"}
    tested = {name.partition(",")[0] for name in PASSES} | others
    assert set(exported) <= tested
    used = {getattr(step, "func", step) for pipeline in PIPELINES for step in pipeline}
    assert used <= {getattr(rewrite, "func", rewrite) for rewrite in PASSES.values()}


def test_a_pass_that_lies_is_caught() -> None:
    """The check itself: a minus turned is seen at once."""

    def liar(graph: Graph, roots: list[int]) -> tuple[Graph, dict[int, int]]:
        new, moved = Graph(), dict[int, int]()
        for index in graph.reachable(roots):
            node = graph[index]
            args = [moved[arg] for arg in node.args]
            moved[index] = new.op("sub", *args[::-1]) if node.op == "sub" else new.adopt(node, args)
        return new, moved

    caught = 0
    for seed in range(20):
        try:
            check(seed, liar, False)
        except AssertionError:
            caught += 1
    assert caught > 5
