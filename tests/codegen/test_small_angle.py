"""sin(d) / d and cos(d) - 1 from z = d^2, small and wide: minimax coefficients, and the bounds at other arguments."""

from __future__ import annotations

from typing import Any

import mpmath as mp
import numpy as np
import pytest

from codegen.ir.small_angle import (
    COSM1_COEFFICIENTS,
    LIMIT,
    SINC_COEFFICIENTS,
    UNKNOWN,
    WIDE_COSM1_COEFFICIENTS,
    WIDE_SINC_COEFFICIENTS,
    coefficients,
    small_angle_bound,
)
from codegen.ir.trig import DOUBLE, SINGLE
from runtime.estimator.folder import find_folder

pytestmark = pytest.mark.unit

#: One precision's unit roundoff.
ROUNDING = {"float32": 2.0**-24, "float64": 2.0**-53}


def exact(z: Any) -> tuple[np.ndarray, np.ndarray]:
    with mp.workdps(40):
        d = [mp.sqrt(mp.mpf(float(v))) for v in z]
        sinc = np.array([float(mp.sin(v) / v) if v else 1.0 for v in d])
        return sinc, np.array([float(-2 * mp.sin(v / 2) ** 2) for v in d])


def generated(dtype: str, wide: bool = False) -> Any:
    """The printed function of a shipped drive, of d^2 as the tests have it; it takes z = d^2 / 4, which is exact."""
    math = find_folder("paper_spmsm").module.MATH[dtype]
    function = math.wide_turn_4 if wide else math.turn_4
    return lambda square: function(square / np.array(4, dtype)[()])


@pytest.mark.parametrize("wide", [False, True])
@pytest.mark.parametrize("which", ["sinc", "cosm1"])
def test_coefficients_are_minimax(which: str, wide: bool) -> None:
    """Chebyshev's theorem for sinc and cosm1 / z: len + 1 alternations at (nearly) the largest error."""
    z = np.linspace(1e-6, UNKNOWN if wide else LIMIT, 8001)
    with mp.workdps(40):
        d = [mp.sqrt(mp.mpf(v)) for v in z]
        goal = [mp.sin(v) / v - 1 if which == "sinc" else -2 * mp.sin(v / 2) ** 2 / v**2 for v in d]
        wanted = np.array([float(v) for v in goal])
    found: tuple[float, ...] = SINC_COEFFICIENTS if which == "sinc" else COSM1_COEFFICIENTS
    if wide:
        found = WIDE_SINC_COEFFICIENTS if which == "sinc" else WIDE_COSM1_COEFFICIENTS
    error = wanted - np.polyval(found[::-1], z) * (z if which == "sinc" else 1.0)
    peak = np.max(np.abs(error))
    assert peak < {"sinc": (1e-6, 7e-8), "cosm1": (2e-7, 3.3e-7)}[which][wide]
    strong = error[np.abs(error) > 0.9 * peak]
    assert 1 + np.sum(np.diff(np.sign(strong)) != 0) == len(found) + 1


def test_wide_turns_go_to_where_points_meet() -> None:
    """At d = pi the two points of a column are one; what is beyond is given up before."""
    assert np.pi**2 == UNKNOWN


@pytest.mark.parametrize(("wide", "limit"), [(False, LIMIT), (True, UNKNOWN)])
def test_double_has_the_series(wide: bool, limit: float) -> None:
    """1 / (2 k + 1)! and 1 / (2 k)!, alternating, as many as the limit asks for at 2^-53."""
    for k, part in enumerate(coefficients(DOUBLE, wide=wide)):
        exact_terms = [(-1) ** j / mp.factorial(2 * j + 1 - k) for j in range(1, len(part) + 1)]
        np.testing.assert_allclose(part, [float(term) for term in exact_terms], rtol=1e-15)
        left_out = limit ** (len(part) + 1) / mp.factorial(2 * len(part) + 3 - k)
        assert left_out < 2.0**-60
    assert coefficients(SINGLE) == (SINC_COEFFICIENTS, COSM1_COEFFICIENTS)
    assert coefficients(SINGLE, wide=True) == (WIDE_SINC_COEFFICIENTS, WIDE_COSM1_COEFFICIENTS)


@pytest.mark.parametrize("n", [3.0, 4.0, 7.0])
def test_n_in_the_coefficients(n: float) -> None:
    """The same polynomials of n z, and a bound that is hardly another: only the coefficients round anew."""
    for wide, limit in ((False, LIMIT), (True, UNKNOWN)):
        z = np.linspace(0.0, limit / n, 101)
        for precision in (SINGLE, DOUBLE):
            plain_parts, folded_parts = coefficients(precision, wide=wide), coefficients(precision, n, wide)
            for plain, folded in zip(plain_parts, folded_parts, strict=True):
                expected = n * z * np.polyval(plain[::-1], n * z)
                np.testing.assert_allclose(z * np.polyval(folded[::-1], z), expected, rtol=1e-13)
        plain_bound, bound = small_angle_bound(wide=wide), small_angle_bound(n, wide)
        assert bound.sinc == pytest.approx(plain_bound.sinc, rel=0.3)
        assert bound.cosm1 == pytest.approx(plain_bound.cosm1, rel=0.3)


@pytest.mark.parametrize(("wide", "limit"), [(False, LIMIT), (True, UNKNOWN)])
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_bounds_hold_at_random_arguments(dtype: str, wide: bool, limit: float) -> None:
    """mpmath as the oracle, small z of every size among them; float64 within a few roundings of the largest term."""
    rng = np.random.default_rng(8)
    z = np.concatenate([rng.uniform(0, limit, 2000), limit * 10.0 ** rng.uniform(-12, 0, 2000), [0.0, limit]])
    z = np.minimum(z.astype(dtype), np.array(limit, dtype))
    sinc, cosm1 = generated(dtype, wide)(z)
    assert sinc.dtype == cosm1.dtype == dtype
    expected = exact(z)
    bound = small_angle_bound(wide=wide)
    allowed = (bound.sinc, bound.cosm1) if dtype == "float32" else (4 * ROUNDING[dtype], 8 * ROUNDING[dtype])
    assert np.max(np.abs(sinc - expected[0])) <= allowed[0]
    assert np.all(np.abs(cosm1 - expected[1]) <= allowed[1] * z / 2)


@pytest.mark.parametrize(("wide", "limit"), [(False, LIMIT), (True, UNKNOWN)])
def test_the_bound_is_not_idle(wide: bool, limit: float) -> None:
    """The proof may be five times the truth, not more; of the wide turns, whose terms cancel, ten times."""
    z = np.linspace(1e-4, limit, 4001).astype(np.float32)
    sinc, cosm1 = generated("float32", wide)(z)
    expected = exact(z)
    bound, share = small_angle_bound(wide=wide), 10 if wide else 5
    assert np.max(np.abs(sinc - expected[0])) >= bound.sinc / share
    assert np.max(np.abs(cosm1 - expected[1]) * 2 / z) >= bound.cosm1 / share


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_the_two_ways_join(dtype: str) -> None:
    """At LIMIT: apart by no more than both ways' errors."""
    z = np.array(LIMIT, dtype)[()]
    allowed = 16 * ROUNDING[dtype]
    if dtype == "float32":
        allowed = sum(max(bound.sinc, bound.cosm1) for bound in (small_angle_bound(), small_angle_bound(wide=True)))
    for small, wide in zip(generated(dtype)(z), generated(dtype, wide=True)(z), strict=True):
        assert abs(float(small) - float(wide)) <= allowed
