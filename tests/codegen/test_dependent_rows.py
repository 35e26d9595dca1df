"""Rows of f that follow from other rows; what rows have in common."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from codegen.fast.dependent_rows import _along, find_dependent_rows
from codegen.fast.factored import from_packed
from codegen.fast.rows import common_factor
from codegen.fast.tape import Tape
from codegen.ir.expr import Expr, GraphBuilder
from codegen.ir.graph import Graph
from model.drives.load import load_drive
from model.machines.state_space import build
from tests.codegen.graphs import FLOAT, evaluate

pytestmark = pytest.mark.unit

THETA, OMEGA = 3, 2


def number(entry: Expr, inputs: dict[str, float]) -> float:
    return evaluate(entry.graph, [entry.node], inputs, FLOAT)[entry.node]


def leaning_of(name: str) -> tuple:
    model = build(load_drive(name))
    n = len(model.states)
    b = GraphBuilder("b", "")
    x = b.input("x", [state.name for state in model.states])
    u = b.input("u", ["v_alpha", "v_beta"])
    packed = b.input("LD", [f"LD_{i}{j}" for i in range(n) for j in range(i + 1)])
    f, named = model.propagate(ca.vertsplit(model.x), ca.vertsplit(model.u))
    L, _ = from_packed(packed, range(n))
    return model, b.graph, L, find_dependent_rows(b, Tape(model, [model.x, model.u], f, named), [x, u], L)


@pytest.mark.parametrize("name", ["spmsm_load_torque", "ipmsm", "ipmsm_adaptive"])
def test_theta_leans_on_omega(name: str) -> None:
    """CasADi's Jacobian of f_theta - a f_omega is constant, and along the columns of L it is what the row holds."""
    model, graph, L, found = leaning_of(name)
    assert list(found) == [THETA]
    ((row, factor),) = found[THETA].rows
    assert row == OMEGA
    rest = model.numeric(model.f[THETA] - factor.value * model.f[OMEGA])
    slope = ca.Function("slope", [model.x, model.u], [ca.jacobian(rest, model.x)])
    rng = np.random.default_rng(0)
    values = {node.name: rng.normal() for node in graph.nodes if node.op == "input"}
    columns = np.array([[number(entry, values) for entry in line] for line in L])
    own = [number(entry, values) for entry in found[THETA].own]
    for _ in range(3):
        at = np.array(slope(rng.normal(size=len(L)), rng.normal(size=2)))[0]
        np.testing.assert_allclose(own, at @ columns, rtol=1e-12, atol=1e-15)


def test_a_linear_value_along_a_column() -> None:
    """Sums, differences, numbers and signs: what value(x + s column) - value(x) is to s."""
    g = Graph()
    x, column = ([Expr(g, g.input(f"{name}{k}")) for k in range(3)] for name in ("x", "c"))
    value = -(x[0] * 2.0 - x[1]) - (x[2] * 3.0 + x[0])
    found = _along(value, {entry.node: k for k, entry in enumerate(x)}, (), column)
    assert number(found, {"c0": 1.0, "c1": 10.0, "c2": 100.0}) == -(2.0 - 10.0) - (300.0 + 1.0)


def test_a_row_that_no_other_gives_leans_on_none() -> None:
    assert leaning_of("paper_spmsm")[3] == {}


def test_common_factor_of_a_negative_constant() -> None:
    """Its name stands for the number with its sign: the size must not go by it."""
    g = Graph()
    k, a, b = Expr(g, g.const(-3.0, "K")), Expr(g, g.input("a")), Expr(g, g.input("b"))
    scale, rest = common_factor([k * a, k * b])
    assert scale.value == -3.0
    assert rest == [a, b]
    assert {(node.name, node.value) for node in g.nodes if node.name == "K"} == {("K", -3.0)}


def test_common_factor_keeps_signs() -> None:
    g = Graph()
    w, a, b = (Expr(g, g.input(name)) for name in "wab")
    scale, rest = common_factor([-(w * a), w * b])
    assert [number(scale * entry, {"w": 2.0, "a": 3.0, "b": 5.0}) for entry in rest] == [-6.0, 10.0]


def test_common_factor_leaves_other_constants_in_their_entries() -> None:
    g = Graph()
    k, m = Expr(g, g.const(3.0, "K")), Expr(g, g.const(5.0, "M"))
    a, b = Expr(g, g.input("a")), Expr(g, g.input("b"))
    scale, rest = common_factor([k * a, k * (m * b)])
    assert scale == k
    assert rest[0] == a
    assert number(rest[1], {"b": 7.0}) == 35.0
