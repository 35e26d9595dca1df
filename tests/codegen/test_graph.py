"""The graph and the printers: every operator they claim, in both languages, against CasADi's own evaluation."""

from __future__ import annotations

import ctypes
import math
from typing import Any

import casadi as ca
import numpy as np
import pytest

from codegen.ir.graph import Graph, UnsupportedOperationError, read_tape
from codegen.ir.layout import lay_out
from codegen.ir.trig import DOUBLE, INSIDE, wrap_listing
from codegen.render.printers.c import CPrinter
from codegen.render.printers.python import PythonPrinter
from codegen.targets.numbers import FLOAT64
from model.filters.program import BlockBuilder
from model.quantities import Block
from runtime.estimator.compiler import build_library

pytestmark = pytest.mark.unit


def every_operator() -> Block:
    """One block with every operation a printer knows, in orders that need parentheses."""
    b = BlockBuilder("operators", "Every operator")
    a, c, d = b.input("v", ["a", "c", "d"])
    results = [
        a + c, a - (c - d), a - c - d, a * (c + d), a / (c * d), (a / c) * d, a / (c / d), -a * c, -(a + c), a * -c,
        ca.sqrt(a * a + c * c), ca.sin(a * c), ca.cos(a * c) + ca.sin(d), ca.remainder(a * 5, 2 * math.pi),
        a**2 + 2 * c, 1 / a, a / 8, (a + c) * (a + c), a - (c + d) * 0.1, ca.SX(3.0),
    ]  # fmt: skip
    b.stage("everything", "0", "", results, [f"result_{k}" for k in range(len(results))])
    b.output("w", results)
    return b.build()


def _expected(block: Block, point: list[float]) -> np.ndarray:
    function = ca.Function("f", [ca.vertcat(*block.inputs[0].entries)], [ca.vertcat(*block.outputs[0].entries)])
    return np.array(function(point)).ravel()


POINTS = [[0.7, -1.3, 2.1], [-3.0, 0.25, -0.5], [12.5, 7.0, 1e-3]]


@pytest.mark.parametrize("point", POINTS)
def test_python_prints_every_operator(point: list[float]) -> None:
    listing = lay_out(every_operator(), [])
    wrap = PythonPrinter().format_helper(wrap_listing(DOUBLE), "f64")
    namespace: dict[str, Any] = {
        "np": np,
        "_smaller": lambda a, b: np.where(a < b, a, b)[()],
        "_larger": lambda a, b: np.where(a > b, a, b)[()],
    }
    exec(f"{wrap}\n{PythonPrinter().format_block(listing)}", namespace)

    class Math:
        dtype = np.float64
        sin_cos = staticmethod(lambda x: (np.sin(x), np.cos(x)))
        wrap = staticmethod(namespace["_wrap_angle_f64"])

    values = tuple(np.float64(v) for v in point)
    (found,) = (namespace["operators"](values, Math),)
    np.testing.assert_allclose(np.array(found, dtype=float), _expected(every_operator(), point), rtol=1e-14, atol=1e-14)
    lanes = namespace["operators"](tuple(np.array(POINTS).T), Math)
    for value, lane in zip(found, lanes, strict=True):
        assert np.broadcast_to(lane, (len(POINTS),))[POINTS.index(point)] == pytest.approx(value, rel=1e-15, abs=1e-15)


@pytest.mark.process
@pytest.mark.parametrize("point", POINTS)
def test_c_prints_every_operator(point: list[float]) -> None:
    printer = CPrinter(FLOAT64)
    listing = lay_out(every_operator(), [])
    size = len(listing.outputs["w"])
    source = "\n".join(
        [
            "#include <math.h>",
            "typedef double float64; typedef struct { float64 sine, cosine; } pmsm_pair_f64;",
            "#define ROUND 6755399441055744.0",
            "#define BELOW_PI 3.1415926535897927",
            f"#define INSIDE {printer.format_literal(INSIDE)}",
            "static pmsm_pair_f64 sin_cos(float64 x)",
            "{ pmsm_pair_f64 r; r.sine = sin(x); r.cosine = cos(x); return r; }",
            "static float64 smaller(float64 a, float64 b) { return (a < b) ? a : b; }",
            "static float64 larger(float64 a, float64 b) { return (a > b) ? a : b; }",
            printer.format_helper(wrap_listing(DOUBLE)),
            printer.format_block(listing),
            "void call(const float64 *v, float64 *w) { operators(v, w); }",
        ]
    )
    library = ctypes.CDLL(str(build_library({"operators.c": source}, {})))
    found, values = (ctypes.c_double * size)(), (ctypes.c_double * 3)(*point)
    library.call(values, found)
    np.testing.assert_allclose(np.array(found), _expected(every_operator(), point), rtol=1e-14, atol=1e-14)


def test_common_subexpressions_are_computed_once() -> None:
    g = Graph()
    a, b = g.input("a"), g.input("b")
    assert g.op("mul", a, b) == g.op("mul", b, a)
    assert g.op("sub", a, b) != g.op("sub", b, a)


def test_exact_rewrites() -> None:
    g = Graph()
    a = g.input("a")
    assert g.op("mul", g.const(1.0), a) == a
    assert g[g.op("div", a, g.const(8.0))].op == "mul"
    assert g[g.op("div", a, g.const(10.0))].op == "div", "1/10 is not exact: the division must stay"


def test_unknown_operation_is_named() -> None:
    x = ca.SX.sym("x")
    function = ca.Function("f", [x], [ca.atan(x)])
    with pytest.raises(UnsupportedOperationError, match="OP_ATAN"):
        read_tape(Graph(), function, [[0]])


def test_remainder_other_than_a_turn_is_refused() -> None:
    x = ca.SX.sym("x")
    g = Graph()
    with pytest.raises(UnsupportedOperationError):
        read_tape(g, ca.Function("f", [x], [ca.remainder(x, 3.0)]), [[g.input("x")]])


@pytest.mark.parametrize(
    ("value", "text"), [(0.1, "0.1f"), (2.0, "2.0f"), (1e-7, "1e-07f"), (-0.5, "-0.5f"), (8388608.0, "8.388608e+06f")]
)
def test_float_literals_read_back_to_the_same_bits(value: float, text: str) -> None:
    from codegen.targets.numbers import FLOAT32

    printed = CPrinter(FLOAT32).format_literal(value)
    assert printed == text
    assert np.float32(printed.rstrip("f")) == np.float32(value)
