"""Rewriting passes on random graphs, in exact rational arithmetic: no value changes, and no work is added."""

from __future__ import annotations

from fractions import Fraction
from functools import partial

import numpy as np
import pytest

from codegen.graph import Graph
from codegen.passes import (
    PIPELINES,
    pull_signs,
    run_passes,
    share_products,
    share_reciprocals,
    spend_reciprocals,
    weight,
)
from codegen.passes import __all__ as exported
from tests.codegen.graphs import RATIONAL, evaluate, random_graph, random_point

PASSES = {
    "share_reciprocals": share_reciprocals,
    "spend_reciprocals": spend_reciprocals,
    "pull_signs": pull_signs,
    "share_products": share_products,
    "share_products, inner ones kept": partial(share_products, whole=False),
}
PASSES |= {name: getattr(__import__("codegen.passes", fromlist=[name]), name) for name in {"collect"} & set(exported)}


def exact(graph: Graph, roots: list[int], point: dict[str, Fraction]) -> dict[int, Fraction] | None:
    """Values of all nodes, or None if one divides by zero there."""
    try:
        return evaluate(graph, roots, point, RATIONAL, Fraction)
    except ZeroDivisionError:
        return None


def check(seed: int, rewrite: object, functions: bool) -> tuple[int, int] | None:
    """Equal values at roots and at whatever else the pass says it kept; weights before and after."""
    rng = np.random.default_rng(seed)
    graph, roots = random_graph(rng, int(rng.integers(4, 60)), functions)
    new, moved = rewrite(graph, roots)  # type: ignore[operator]
    assert set(roots) <= moved.keys(), "roots survive"
    compared = 0
    for _ in range(5):
        point = random_point(rng)
        before = exact(graph, roots, point)
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


def test_passes_find_what_they_are_for() -> None:
    """Over random graphs work is saved, not only kept."""
    found = [item for seed in range(2000, 2060) if (item := check(seed, run_passes, False))]
    assert sum(after < before for before, after in found) > 0.2 * len(found)


def test_every_exported_pass_is_tested() -> None:
    others = {"PIPELINES", "Pipelines", "WEIGHTS", "run_passes", "weight", "without"}
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
