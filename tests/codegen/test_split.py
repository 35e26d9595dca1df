"""Even and odd parts: against both sides evaluated directly, against SymPy's own, and as derivatives."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
import sympy as sp

from codegen.fast.split import Split, SplitAlgebra
from codegen.ir.expr import Expr
from codegen.ir.graph import Graph, read_tape
from model.drives.load import load_drive
from model.machines.state_space import StateSpaceModel, build
from model.schema import Drive
from tests.codegen.graphs import FLOAT, SYMBOLIC, evaluate
from tests.conftest import DRIVES, variant

pytestmark = pytest.mark.unit

#: Each operation on coordinates, then on what already has an even part.
FUNCTIONS = {
    "add": lambda m, a, b: m.op("add", a, b),
    "sub": lambda m, a, b: m.op("sub", a, b),
    "neg": lambda m, a, b: m.op("neg", a),
    "mul": lambda m, a, b: m.op("mul", a, b),
    "square": lambda m, a, b: m.op("mul", a, a),
    "div": lambda m, a, b: m.op("div", a, b),
    "reciprocal": lambda m, a, b: m.op("div", m.const(1.0), b),
    "sin": lambda m, a, b: m.op("sin", a),
    "cos": lambda m, a, b: m.op("cos", a),
    "sin of a product": lambda m, a, b: m.op("sin", m.op("mul", a, b)),
    "cos of a product": lambda m, a, b: m.op("cos", m.op("mul", a, b)),
    "back-EMF": lambda m, a, b: m.op("mul", m.op("mul", m.const(0.3), a), m.op("sin", b)),
    "cubic": lambda m, a, b: m.op("mul", m.op("mul", a, b), m.op("sub", a, m.const(2.0))),
    "quotient of products": lambda m, a, b: m.op("div", m.op("mul", a, b), m.op("add", m.op("mul", b, b), a)),
    "sqrt": lambda m, a, b: m.op("sqrt", m.op("mul", b, b)),
    "max": lambda m, a, b: m.op("max", a, b),
    "min": lambda m, a, b: m.op("min", m.op("mul", a, a), b),
}
TWO_SIDED = {"sqrt", "max", "min"}


class Direct:
    """The same expression in plain numbers."""

    def const(self, value: float) -> float:
        return value

    def op(self, op: str, *args: float) -> float:
        return float(FLOAT[op](*args))


def parts(build_it: Any, q: Any = None) -> tuple[Graph, Split]:
    g = Graph()
    x = {name: Expr(g, g.input(name)) for name in ("a", "b", "l_a", "l_b", "q")}
    algebra = SplitAlgebra(x["q"] if q is None else x["q"] * 0.0)
    return g, build_it(algebra, algebra.along(x["a"], x["l_a"]), algebra.along(x["b"], x["l_b"]))


def values(g: Graph, split: Split, point: dict[str, Any], ops: Any, number: Any = float) -> list[Any]:
    nodes = [split.base.node, split.even.node, split.odd.node, split.total.node]
    found = evaluate(g, nodes, point, ops, number)
    return [found[node] for node in nodes]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_both_sides_come_out(name: str) -> None:
    """base + even +- s odd = f(x +- s l) at random points, to rounding: 1e-11 of the larger side (quotients cancel)."""
    rng = np.random.default_rng(5)
    g, split = parts(FUNCTIONS[name])
    for _ in range(50):
        point = {name: float(rng.uniform(0.5, 3.0)) for name in ("a", "b", "l_a", "l_b")}
        point["q"] = float(rng.uniform(0.001, 0.02))
        s = np.sqrt(point["q"])
        base, even, odd, total = values(g, split, point, FLOAT)
        sides = [
            FUNCTIONS[name](Direct(), point["a"] + side * point["l_a"], point["b"] + side * point["l_b"])
            for side in (s, -s)
        ]
        here = FUNCTIONS[name](Direct(), point["a"], point["b"])
        scale = max(abs(here), *map(abs, sides))
        assert base == pytest.approx(here, abs=1e-13 * scale)
        assert total == pytest.approx(base + even, abs=1e-12 * scale)
        assert [base + even + s * odd, base + even - s * odd] == pytest.approx(sides, abs=1e-11 * scale)


@pytest.mark.parametrize("name", sorted(set(FUNCTIONS) - TWO_SIDED))
def test_sympy_finds_the_same_parts(name: str) -> None:
    """d = s l symbolic: even = (f(x + d) + f(x - d)) / 2 - f(x) and odd = (f(x + d) - f(x - d)) / (2 s), exactly."""
    a, b, l_a, l_b, s = sp.symbols("a b l_a l_b s", positive=True)
    g, split = parts(FUNCTIONS[name])
    point = {"a": a, "b": b, "l_a": l_a, "l_b": l_b, "q": s**2}
    base, even, odd, _ = values(g, split, point, SYMBOLIC, sp.nsimplify)
    function = FUNCTIONS[name]

    class Symbolic:
        const = staticmethod(sp.nsimplify)
        op = staticmethod(lambda op, *args: SYMBOLIC[op](*args))

    above, below, here = (function(Symbolic(), a + side * s * l_a, b + side * s * l_b) for side in (1, -1, 0))
    for ours, theirs in ((base, here), (even, (above + below) / 2 - here), (odd, (above - below) / (2 * s))):
        difference = sp.expand_trig(sp.expand(ours - theirs))
        assert sp.simplify(difference) == 0, name


# --- the shipped machines


def functions(model: StateSpaceModel) -> list[tuple[str, Any]]:
    f = ca.Function("f", [model.x, model.u], [ca.densify(model.numeric(model.f))])
    h = ca.Function("h", [model.x, model.u], [ca.densify(model.numeric(model.h))])
    return [("f", f), ("h", h)]


def replay(function: Any, n: int, slopes: list[float | None], zero_q: bool = False) -> tuple[Graph, list[Split]]:
    """A function's split values along ``slopes``: a number, or None for an input ``l_k``."""
    g = Graph()
    q = Expr(g, g.const(0.0)) if zero_q else Expr(g, g.input("q"))
    algebra = SplitAlgebra(q)
    point = []
    for k, slope in enumerate(slopes):
        direction = Expr(g, g.input(f"l_{k}")) if slope is None else Expr(g, g.const(slope))
        point.append(algebra.along(Expr(g, g.input(f"x_{k}")), direction))
    u = [algebra.constant(Expr(g, g.input(f"u_{k}"))) for k in range(2)]
    return g, read_tape(algebra, function, [point, u])[0]


def draw(rng: np.random.Generator, n: int) -> dict[str, float]:
    point = {f"x_{k}": float(v) for k, v in enumerate(rng.normal(size=n) * [*[1.0, 1.0, 50.0, 2.0], *[1.0] * (n - 4)])}
    point |= {f"l_{k}": float(v) for k, v in enumerate(rng.normal(size=n))}
    return (
        point | {f"u_{k}": float(v) for k, v in enumerate(rng.normal(size=2) * 100)} | {"q": float(rng.uniform(0, 2))}
    )


def call(function: Any, point: dict[str, float], n: int, side: float = 0.0) -> np.ndarray:
    x = [point[f"x_{k}"] + side * point.get(f"l_{k}", 0.0) for k in range(n)]
    return np.array(function(x, [point["u_0"], point["u_1"]])).ravel()


@pytest.mark.parametrize("discretization", ["euler", "exact"])
def test_both_sides_of_every_machine(drive: Drive, discretization: str) -> None:
    """Random points and directions, turns of several radians among them."""
    model = build(variant(drive, model={"discretization": discretization}))
    n, rng = len(model.states), np.random.default_rng(6)
    for _, function in functions(model):
        g, split = replay(function, n, [None] * n)
        for _ in range(30):
            point = draw(rng, n)
            s = np.sqrt(point["q"])
            rows = np.array([values(g, part, point, FLOAT) for part in split])
            for side in (s, -s):
                expected = call(function, point, n, side)
                scale = np.maximum(np.abs(expected), np.max(np.abs(rows), axis=1) + 1.0)
                assert np.max(np.abs(rows[:, 0] + rows[:, 1] + side * rows[:, 2] - expected) / scale) <= 1e-12


@pytest.mark.parametrize("discretization", ["euler", "exact"])
def test_affine_rows_have_no_even_part(drive: Drive, discretization: str) -> None:
    """Found as a structural zero exactly where CasADi finds no second derivative."""
    model = build(variant(drive, model={"discretization": discretization}))
    n, found = len(model.states), []
    for name, function in functions(model):
        _, split = replay(function, n, [None] * n)
        x, u = ca.SX.sym("x", n), ca.SX.sym("u", 2)
        image = function(x, u)
        for row, part in enumerate(split):
            affine = ca.hessian(image[row], x)[0].nnz() == 0
            assert part.even.is_zero() == affine, f"{name}[{row}]"
            found.append(affine)
    assert any(found)
    assert not all(found)


@pytest.mark.parametrize("name", DRIVES)
def test_with_q_zero_the_odd_part_is_the_derivative(name: str) -> None:
    """Dual numbers, one unit direction after another, against CasADi's Jacobian: 1e-12 of the row's largest entry."""
    model = build(load_drive(name))
    n, rng = len(model.states), np.random.default_rng(7)
    for _, function in functions(model):
        x, u = ca.SX.sym("x", n), ca.SX.sym("u", 2)
        jacobian = ca.Function("j", [x, u], [ca.densify(ca.jacobian(function(x, u), x))])
        graphs = [replay(function, n, [float(k == i) for i in range(n)], zero_q=True) for k in range(n)]
        for _ in range(10):
            point = draw(rng, n)
            expected = np.array(jacobian([point[f"x_{k}"] for k in range(n)], [point["u_0"], point["u_1"]]))
            found = np.array([[values(g, part, point, FLOAT)[2] for part in split] for g, split in graphs]).T
            scale = np.max(np.abs(expected), axis=1, keepdims=True) + 1e-300
            assert np.max(np.abs(found - expected) / scale) <= 1e-12
        assert all(part.even.is_zero() for _, split in graphs for part in split)


def test_a_wrong_sign_would_be_seen() -> None:
    """The oracle itself: cos's odd part with sin's sign."""

    class Wrong(SplitAlgebra):
        def _cos(self, a: Split) -> Split:
            right = super()._cos(a)
            return Split(right.base, right.even, -right.odd, right.total)

    g = Graph()
    x = {name: Expr(g, g.input(name)) for name in ("a", "l", "q")}
    algebra = Wrong(x["q"])
    split = algebra.op("cos", algebra.along(x["a"], x["l"]))
    point = {"a": 0.7, "l": 1.0, "q": 0.04}
    base, even, odd, _ = values(g, split, point, FLOAT)
    assert base + even + 0.2 * odd != pytest.approx(np.cos(0.9), abs=1e-3)
