"""Ranges read off C text enclose what the C computes; divisors are told apart rightly."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pycparser import c_parser

from runtime.firmware.static.divisions import Range, divisions

GUARDED = {
    "literal": "return x[0] / 3.0f;",
    "square and floor": "const float a = x[0]; return 1.0f / (a * a + 0.01f);",
    "named factor": "const float a = x[0]; const float g = R[0] * a; return 1.0f / (R[1] + g * a);",
    "quotient's square": "const float v = x[0]; const float n = v / R[0]; return 1.0f / (R[1] + v * n);",
    "larger": "return 1.0f / larger(x[0], R[0]);",
    "ternary floor": "const float a = x[0]; const float b = (a > 0.1f) ? a : 0.1f; return x[1] / b;",
    "root of a floor": "return 1.0f / sqrtf(larger(x[0], 1.0f));",
    "documented positive": "return x[0] / R[1];",
    "branch": "const float a = x[0]; if (a > 0.5f) { return 1.0f / a; } return 0.0f;",
    "guarding ternary": "const float a = x[0]; return (a > 0.0f) ? (x[1] / a) : 0.0f;",
    "many squares and the least positive": "const float a = x[0]; return 1.0f / (a * a + a * a + a * a + R[0]);",
    "negative": "const float a = x[0]; return 1.0f / (-(a * a) - 0.5f);",
    "saliency": "const float q = x[0]; const float d = 2.0f - sqrtf(4.0f + q * q); return q / (1.0f - 0.5f * d);",
}
UNGUARDED = {
    "input": "return 1.0f / x[0];",
    "square alone": "const float a = x[0]; return 1.0f / (a * a);",
    "sum of unlike": "return 1.0f / (x[0] * x[1] + 0.01f);",
    "difference": "return 1.0f / (R[0] - R[1]);",
    "sum of squares, nothing added": "const float a = x[0]; const float b = x[1]; return 1.0f / (a * a + b * b);",
    "determinant": "const float c = x[0]; return 1.0f / (R[0] * R[1] - c * c);",
    "product that underflows": "return 1.0f / (R[0] * R[1]);",
    "underflow on the way": "return 1.0f / (1e-30f * 1e-30f * 1e30f * 1e30f);",
    "overflow on the way": "const float a = x[0]; return 1.0f / (R[0] * (R[1] / (a * a + 1e-30f)) * 1e-30f);",
    "smaller": "return 1.0f / smaller(x[0], R[0]);",
    "root": "return 1.0f / sqrtf(x[0]);",
    "wrong branch": "const float a = x[0]; if (a > 0.5f) { return a; } return 1.0f / a;",
    "guard of zero or more": "const float a = x[0]; return (a >= 0.0f) ? (x[1] / a) : 0.0f;",
    "changed since": "float a = 1.0f; a = x[0]; return 1.0f / a;",
    "behind a pointer": "float a = 1.0f; change(&a); return 1.0f / a;",
    "in place": "float a = 1.0f; a /= x[0]; return a;",
    "remainder": "return 5 % k;",
}


def found(body: str) -> list[bool]:
    text = f"float f(const float x[2], const float R[2], int k) {{ {body} }}"
    return [d.range.avoids_zero for d in divisions(list(c_parser.CParser().parse(text).ext))]


@pytest.mark.parametrize("body", GUARDED.values(), ids=GUARDED)
def test_guarded_divisors_are_seen(body: str) -> None:
    assert all(found(body))


@pytest.mark.parametrize("body", UNGUARDED.values(), ids=UNGUARDED)
def test_unguarded_divisors_are_seen(body: str) -> None:
    assert not all(found(body))


STEP = """
static void make(const float x[1], const float Q[1], float D_out[2])
{{ const float a = x[0]; const float d = a * a + Q[0]; D_out[0] = d; D_out[1] = a; }}
static void take(const float D[2], const float R[1], float y_out[1])
{{ const float d = D[{k}]; const float s = R[0] + d; y_out[0] = 1.0f / s; }}
void step(const float x[1], const float Q[1], const float R[1], float y[1])
{{ float D[2]; make(x, Q, D); {between} take(D, R, y); }}
"""


@pytest.mark.parametrize(
    ("k", "between", "guarded"),
    [(0, "", True), (1, "", False), (0, "D[0] = x[0];", False), (0, "spoil(D);", False)],
)
def test_arrays_carry_ranges_from_block_to_block(k: int, between: str, guarded: bool) -> None:
    """Unless something else writes to them."""
    functions = list(c_parser.CParser().parse(STEP.format(k=k, between=between)).ext)
    (division,) = divisions(functions)
    assert division.range.avoids_zero is guarded


# --- ranges against float32 arithmetic

NAMES = st.sampled_from(["x[0]", "x[1]", "R[0]", "R[1]", "0.25f", "3.0f", "1e-20f", "1e20f"])


def combine(parts: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    binary = st.tuples(parts, st.sampled_from("+-*/"), parts).map(lambda t: f"({t[0]} {t[1]} {t[2]})")
    square = parts.map(lambda t: f"({t} * {t})")
    root = parts.map(lambda t: f"sqrtf({t})")
    extreme = st.tuples(st.sampled_from(["larger", "smaller"]), parts, parts).map(lambda t: f"{t[0]}({t[1]}, {t[2]})")
    return st.one_of(binary, square, root, extreme)


FLOATS = st.floats(width=32, allow_nan=False, allow_infinity=False, allow_subnormal=False)
POSITIVE_FLOATS = st.floats(min_value=2.0**-126, max_value=2.0**100, width=32, allow_subnormal=False)


def flushed(value: np.floating) -> np.float32:
    """A result as the FPU32 leaves it: no denormals."""
    return np.float32(0.0) if abs(value) < np.float32(2.0**-126) else np.float32(value)


class Flushing:
    """A float32 whose every result is flushed; C's operators, larger, smaller, sqrtf."""

    def __init__(self, value: float) -> None:
        self.v = flushed(np.float32(value))

    def __add__(self, o: Flushing) -> Flushing:
        return Flushing(self.v + o.v)

    def __sub__(self, o: Flushing) -> Flushing:
        return Flushing(self.v - o.v)

    def __mul__(self, o: Flushing) -> Flushing:
        return Flushing(self.v * o.v)

    def __truediv__(self, o: Flushing) -> Flushing:
        return Flushing(self.v / o.v)


@settings(max_examples=300, deadline=None)
@given(
    st.recursive(NAMES, combine, max_leaves=6), st.tuples(FLOATS, FLOATS), st.tuples(POSITIVE_FLOATS, POSITIVE_FLOATS)
)
def test_a_range_encloses_every_float32_result(expression: str, x: tuple[float, float], R: tuple[float, float]) -> None:
    """On IEEE machines and on those that flush denormals."""
    text = f"float f(const float x[2], const float R[2]) {{ return 1.0f / ({expression}); }}"
    enclosure = divisions(list(c_parser.CParser().parse(text).ext))[0].range
    python = expression.replace("sqrtf", "root")
    for token in ("0.25f", "3.0f", "1e-20f", "1e20f"):
        python = python.replace(token, f"N({token[:-1]})")
    with np.errstate(all="ignore"):
        plain = eval(
            python,
            {
                "x": [np.float32(v) for v in x],
                "R": [np.float32(v) for v in R],
                "N": np.float32,
                "root": np.sqrt,
                "larger": lambda a, b: a if a > b else b,
                "smaller": lambda a, b: a if a < b else b,
            },
        )
        flush = eval(
            python,
            {
                "x": [Flushing(v) for v in x],
                "R": [Flushing(v) for v in R],
                "N": Flushing,
                "root": lambda a: Flushing(np.sqrt(a.v)),
                "larger": lambda a, b: a if a.v > b.v else b,
                "smaller": lambda a, b: a if a.v < b.v else b,
            },
        ).v
    for value in (float(plain), float(flush)):
        assert math.isnan(value) or enclosure.low <= value <= enclosure.high, (expression, enclosure)


def test_rounding_never_narrows() -> None:
    for low, high in [(1.0, 2.0), (-2.0, -1.0), (-1.0, 1.0), (2.0**-126, 1.0), (0.0, math.inf)]:
        wide = Range(low, high).widened()
        assert wide.low <= low
        assert wide.high >= high
