"""The generated sine, cosine and angle wrapping: the bound holds, and the coefficients are minimax."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from codegen.ir.layout import lay_out
from codegen.ir.trig import (
    COS_COEFFICIENTS,
    DOUBLE,
    SIN_COEFFICIENTS,
    SINGLE,
    evaluate_sin_cos,
    sin_cos_bound,
    sin_cos_listing,
    split_pi,
    wrap_listing,
)
from codegen.render.printers.python import PythonPrinter
from model.quantities import Block, Port

pytestmark = pytest.mark.unit

NAMESPACE: dict[str, Any] = {
    "np": np,
    "_smaller": lambda a, b: np.where(a < b, a, b)[()],
    "_larger": lambda a, b: np.where(a > b, a, b)[()],
}
exec(PythonPrinter().format_helper(wrap_listing(SINGLE), "f32"), NAMESPACE)
exec(PythonPrinter().format_helper(wrap_listing(DOUBLE), "f64"), NAMESPACE)
wrap_f32, wrap_f64 = NAMESPACE["_wrap_angle_f32"], NAMESPACE["_wrap_angle_f64"]

exec(PythonPrinter().format_helper(sin_cos_listing(DOUBLE), "f64"), NAMESPACE)


def test_float64_sine_and_cosine_of_the_simulated_motor() -> None:
    """mpmath as the oracle: two units in the last place of 1, at large arguments and near multiples of pi/2."""
    rng = np.random.default_rng(12)
    near = np.arange(-600, 601) * (np.pi / 2) + rng.normal(0, 1e-6, 1201)
    x = np.concatenate([rng.uniform(-1e5, 1e5, 2000), rng.uniform(-4, 4, 2000), near, [0.0, np.pi]])
    sine, cosine = NAMESPACE["_sin_cos_f64"](x)
    with mp.workdps(40):
        exact = np.array([(float(mp.sin(mp.mpf(float(v)))), float(mp.cos(mp.mpf(float(v))))) for v in x])
    assert np.max(np.abs(np.column_stack([sine, cosine]) - exact)) <= 2 * 2.0**-52


def test_bound_is_what_the_header_promises() -> None:
    bound = sin_cos_bound()
    assert bound.seen <= bound.proved <= 9e-7  # the proof may be three times the truth, not more
    assert (
        bound.seen <= 4e-7
    )  # 2 c^2 - 1 is off by four times what c is: half a unit near 1, and its polynomial's error


def test_bound_holds_at_arguments_it_was_not_computed_from() -> None:
    """mpmath as the oracle, at random arguments and at the worst places: near multiples of pi/2."""
    rng = np.random.default_rng(11)
    near = np.arange(-2, 3)[:, None] * (np.pi / 2) + rng.normal(0, 1e-4, (5, 500))
    small = rng.uniform(-1, 1, 1000) * 10.0 ** rng.uniform(-30, 0, 1000)
    x = np.concatenate([rng.uniform(-np.pi, np.pi, 6000), near.ravel(), small]).astype(np.float32)
    x = x[np.abs(x) <= sin_cos_bound().limit]
    sine, cosine = evaluate_sin_cos(x)
    with mp.workdps(30):
        exact = np.array([(float(mp.sin(float(v))), float(mp.cos(float(v)))) for v in x])
    worst = max(np.max(np.abs(sine - exact[:, 0])), np.max(np.abs(cosine - exact[:, 1])))
    assert worst <= sin_cos_bound().proved


@pytest.mark.slow
def test_bound_holds_for_every_float_of_a_turn() -> None:
    """Exhaustive over every eighth float32 in [2^-10, pi], 12 million of them and their negatives by symmetry."""
    first, last = np.float32(2**-10).view(np.int32), np.float32(math.pi).view(np.int32)
    for start in range(int(first), int(last), 1 << 23):
        bits = np.arange(start, min(start + (1 << 23), int(last)), 8, dtype=np.int32)
        x = bits.view(np.float32)
        sine, cosine = evaluate_sin_cos(x)
        exact = x.astype(float)
        assert np.max(np.abs(sine - np.sin(exact))) <= sin_cos_bound().proved
        assert np.max(np.abs(cosine - np.cos(exact))) <= sin_cos_bound().proved


def test_symmetry_is_exact() -> None:
    x = np.linspace(0, 3.14159, 10_001).astype(np.float32)
    (sine, cosine), (minus_sine, minus_cosine) = evaluate_sin_cos(x), evaluate_sin_cos(-x)
    np.testing.assert_array_equal(sine, -minus_sine)
    np.testing.assert_array_equal(cosine, minus_cosine)


def test_sine_is_of_an_angle_within_a_turn() -> None:
    """Of a block's angles but the state's, which a step leaves within one; any angle where it is asked for."""
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
    names = ("i_alpha", "i_beta", "omega", "theta")
    state, input_ = Port("x", tuple(ca.vertsplit(x)), names), Port("u", (u,), ("theta_given",))
    angles = [x[3], u, x[3] + u, 2 * x[3]]
    results = [f(angle) for angle in angles for f in (ca.sin, ca.cos)]
    block = Block("turned", "", (state, input_), (Port("y", tuple(results), tuple(f"y_{k}" for k in range(8))),), ())
    for any_angle in (False, True):
        listing = lay_out(block, [], any_angle)
        asked = {listing.graph[node].args[0] for node in listing.live if listing.graph[node].op in {"sin", "cos"}}
        found = [listing.graph[node] for node in asked]
        assert len(found) == 4
        assert sum(node.op == "wrap" for node in found) == (0 if any_angle else 3)
        assert any_angle or [node.name for node in found if node.op != "wrap"] == ["theta"]


@pytest.mark.parametrize("which", ["sin", "cos"])
def test_coefficients_are_minimax(which: str) -> None:
    """Chebyshev's theorem: the error of the best polynomial alternates len + 1 times at (nearly) its maximum."""
    x = np.linspace(1e-4, math.pi, 20_001)
    coefficients = SIN_COEFFICIENTS if which == "sin" else COS_COEFFICIENTS
    with mp.workdps(30):
        half = [mp.mpf(v) / 2 for v in x]
        exact = np.array([float(2 * mp.sin(v) - 2 * v) if which == "sin" else float(mp.cos(v) - 1) for v in half])
    power = 3 if which == "sin" else 2
    error = exact - x**power * np.polyval(coefficients[::-1], x * x)
    peak = np.max(np.abs(error))
    assert peak < {"sin": 1e-8, "cos": 6e-8}[which]
    strong = error[np.abs(error) > 0.9 * peak]
    assert 1 + np.sum(np.diff(np.sign(strong)) != 0) == len(coefficients) + 1


@pytest.mark.parametrize("precision", [SINGLE, DOUBLE])
def test_parts_of_pi_add_up_to_pi(precision: Any) -> None:
    with mp.workdps(50):
        total = sum((mp.mpf(part) for part in split_pi(precision)), mp.mpf(0))
        assert abs(total - mp.pi) < mp.mpf(2) ** (-40 if precision is SINGLE else -80)


@settings(max_examples=500, deadline=None)
@given(st.floats(-3000, 3000, width=32))
def test_wrapped_angles_lie_in_one_turn_and_are_congruent(angle: float) -> None:
    for wrap, dtype, spacing in ((wrap_f32, np.float32, 2.4e-7), (wrap_f64, np.float64, 4.5e-16)):
        wrapped = float(wrap(dtype(angle)))
        assert -math.pi <= wrapped < math.pi
        turns = (angle - wrapped) / (2 * math.pi)
        assert abs(turns - round(turns)) * 2 * math.pi <= 3 * spacing + abs(angle) * spacing


@pytest.mark.parametrize(("wrap", "dtype"), [(wrap_f32, np.float32), (wrap_f64, np.float64)])
def test_wrapping_leaves_an_angle_inside_alone(wrap: Any, dtype: Any) -> None:
    inside = np.linspace(-3.1415, 3.1415, 1001).astype(dtype)
    np.testing.assert_array_equal(wrap(inside), inside)
    near = math.pi + np.linspace(-1e-6, 1e-6, 101)
    edge = wrap(np.concatenate([[math.pi, 3 * math.pi], near, -near]).astype(dtype)).astype(float)
    assert np.all((edge >= -math.pi) & (edge < math.pi))
