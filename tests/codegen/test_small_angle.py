"""sin(d) / d and cos(d) - 1 from z = d^2: minimax coefficients, the bound at other arguments, and the way beyond."""

from __future__ import annotations

from typing import Any

import mpmath as mp
import numpy as np
import pytest

from codegen.ir.small_angle import (
    COSM1_COEFFICIENTS,
    DOUBLINGS,
    LIMIT,
    SINC_COEFFICIENTS,
    WIDEST,
    coefficients,
    small_angle_bound,
)
from codegen.ir.trig import DOUBLE, SINGLE
from runtime.estimator.folder import find_folder

pytestmark = pytest.mark.unit

#: Beyond the limit the angle is made of halves: each doubling at most quadruples an error of cos(d) - 1 (the slope of
#: 2 c (2 + c) is 4 + 4 c, c in -2 .. 0).
GROWTH = 4.0**DOUBLINGS
#: One precision's unit roundoff.
ROUNDING = {"float32": 2.0**-24, "float64": 2.0**-53}


def exact(z: Any) -> tuple[np.ndarray, np.ndarray]:
    with mp.workdps(40):
        d = [mp.sqrt(mp.mpf(float(v))) for v in z]
        sinc = np.array([float(mp.sin(v) / v) if v else 1.0 for v in d])
        return sinc, np.array([float(-2 * mp.sin(v / 2) ** 2) for v in d])


def generated(dtype: str) -> Any:
    """The printed function of a shipped drive, of d^2 as the tests have it; it takes z = d^2 / 4, which is exact."""
    function = find_folder("paper_spmsm").module.MATH[dtype].small_angle_4
    return lambda square: function(square / np.array(4, dtype)[()])


@pytest.mark.parametrize("which", ["sinc", "cosm1"])
def test_coefficients_are_minimax(which: str) -> None:
    """Chebyshev's theorem for sinc and cosm1 / z: len + 1 alternations at (nearly) the largest error."""
    z = np.linspace(1e-6, LIMIT, 8001)
    with mp.workdps(40):
        d = [mp.sqrt(mp.mpf(v)) for v in z]
        goal = [mp.sin(v) / v - 1 if which == "sinc" else -2 * mp.sin(v / 2) ** 2 / v**2 for v in d]
        wanted = np.array([float(v) for v in goal])
    found = SINC_COEFFICIENTS if which == "sinc" else COSM1_COEFFICIENTS
    error = wanted - np.polyval(found[::-1], z) * (z if which == "sinc" else 1.0)
    peak = np.max(np.abs(error))
    assert peak < {"sinc": 1e-6, "cosm1": 2e-7}[which]
    strong = error[np.abs(error) > 0.9 * peak]
    assert 1 + np.sum(np.diff(np.sign(strong)) != 0) == len(found) + 1


def test_turns_are_taken_up_to_nearly_a_whole_one() -> None:
    """Beyond a whole turn points alias; one doubling more would go there."""
    assert WIDEST < (2 * np.pi) ** 2 < 4 * WIDEST


def test_double_has_the_series() -> None:
    """1 / (2 k + 1)! and 1 / (2 k)!, alternating, as many as LIMIT asks for at 2^-53."""
    for k, part in enumerate(coefficients(DOUBLE)):
        exact_terms = [(-1) ** j / mp.factorial(2 * j + 1 - k) for j in range(1, len(part) + 1)]
        np.testing.assert_allclose(part, [float(term) for term in exact_terms], rtol=1e-15)
        left_out = LIMIT ** (len(part) + 1) / mp.factorial(2 * len(part) + 3 - k)
        assert left_out < 2.0**-60
    assert coefficients(SINGLE) == (SINC_COEFFICIENTS, COSM1_COEFFICIENTS)


@pytest.mark.parametrize("n", [3.0, 4.0, 7.0])
def test_n_in_the_coefficients(n: float) -> None:
    """The same polynomials of n z, and a bound that is hardly another: only the coefficients round anew."""
    z = np.linspace(0.0, LIMIT / n, 101)
    for precision in (SINGLE, DOUBLE):
        for plain, folded in zip(coefficients(precision), coefficients(precision, n), strict=True):
            expected = n * z * np.polyval(plain[::-1], n * z)
            np.testing.assert_allclose(z * np.polyval(folded[::-1], z), expected, rtol=1e-13)
    plain_bound, bound = small_angle_bound(), small_angle_bound(n)
    assert bound.sinc == pytest.approx(plain_bound.sinc, rel=0.3)
    assert bound.cosm1 == pytest.approx(plain_bound.cosm1, rel=0.3)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_bounds_hold_at_random_arguments(dtype: str) -> None:
    """mpmath as the oracle, small z of every size among them; float64 within a few roundings."""
    rng = np.random.default_rng(8)
    z = np.concatenate([rng.uniform(0, LIMIT, 2000), LIMIT * 10.0 ** rng.uniform(-12, 0, 2000), [0.0, LIMIT]])
    z = np.minimum(z.astype(dtype), np.array(LIMIT, dtype))
    sinc, cosm1 = generated(dtype)(z)
    assert sinc.dtype == cosm1.dtype == dtype
    expected = exact(z)
    bound = small_angle_bound()
    allowed = (bound.sinc, bound.cosm1) if dtype == "float32" else (4 * ROUNDING[dtype], 8 * ROUNDING[dtype])
    assert np.max(np.abs(sinc - expected[0])) <= allowed[0]
    assert np.all(np.abs(cosm1 - expected[1]) <= allowed[1] * z / 2)


def test_the_bound_is_not_idle() -> None:
    """The proof may be five times the truth, not more."""
    z = np.linspace(1e-4, LIMIT, 4001).astype(np.float32)
    sinc, cosm1 = generated("float32")(z)
    expected = exact(z)
    assert np.max(np.abs(sinc - expected[0])) >= small_angle_bound().sinc / 5
    assert np.max(np.abs(cosm1 - expected[1]) * 2 / z) >= small_angle_bound().cosm1 / 5


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_wide_turns(dtype: str) -> None:
    """Beyond the limit: at most what a polynomial's error at the limit, and a rounding, grow to."""
    z = np.random.default_rng(9).uniform(LIMIT, 0.999 * WIDEST, 4000).astype(dtype)
    found, expected = generated(dtype)(z), exact(z)
    at_limit = small_angle_bound().cosm1 * LIMIT / 2 if dtype == "float32" else 8 * ROUNDING[dtype]
    for ours, theirs in zip(found, expected, strict=True):
        assert np.max(np.abs(ours - theirs)) <= GROWTH * (at_limit + 2 * ROUNDING[dtype])


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_the_two_ways_join(dtype: str) -> None:
    """At LIMIT and at the next number: apart by no more than both ways' errors."""
    z = np.array([LIMIT, np.nextafter(np.array(LIMIT, dtype), np.array(1, dtype))], dtype)
    bound = small_angle_bound()
    allowed = 2 * max(bound.sinc, bound.cosm1) if dtype == "float32" else 16 * ROUNDING[dtype]
    for values in generated(dtype)(z):
        assert abs(float(values[1]) - float(values[0])) <= allowed


def test_a_wide_lane_leaves_its_neighbours_alone() -> None:
    """Bits of small turns do not depend on what is in other lanes."""
    z = np.array([0.01, 0.3, LIMIT, 3.0], np.float32)
    together, alone = generated("float32")(z), [generated("float32")(value) for value in z]
    for k in range(2):
        np.testing.assert_array_equal(together[k], [pair[k] for pair in alone])
