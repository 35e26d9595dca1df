"""sin(d) / d and cos(d) - 1 from z = d^2 / n: what the fast form asks of an angle it turns by.

A column of the points turns an angle by d = sqrt(n D) l (n + kappa for the UKF). The coefficients take n in, so that
z = D l^2 costs no product with it; below, n = 1.

Both are even functions of d, so no square root is needed and small angles lose no digits. Up to ``LIMIT`` a
polynomial does; up to ``UNKNOWN``, beyond which no angle is taken, one of more terms.

Float32 coefficients are minimax (Remez) on [0, LIMIT] and [0, UNKNOWN], of sinc and of cosm1 / z;
``tests/codegen/test_small_angle.py`` shows their equal ripple.
Float64 takes as many terms of the series as its precision asks for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from codegen.ir.bounds import rounding_error
from codegen.ir.graph import Graph
from codegen.ir.layout import Listing, Section, Statement
from codegen.ir.trig import SINGLE, Precision, helper_listing, polynomial

#: Largest z the polynomials serve: |d| <= 0.7071 rad, two sigmas of theta at sigma = 20 degrees.
LIMIT = 0.5

#: d = pi: there the two points of a column are one, and beyond it they alias. The step gives such an angle up.
UNKNOWN = math.pi**2

#: sinc and cosm1 where half of UNKNOWN is left.
LEFT_SINC, LEFT_COSM1 = math.sin(math.sqrt(UNKNOWN / 2)) / math.sqrt(UNKNOWN / 2), math.cos(math.sqrt(UNKNOWN / 2)) - 1

#: sinc = 1 + z (S0 + S1 z), 9.4e-7 at the worst;  cosm1 = z (C0 + C1 z + C2 z^2), 3.9e-7 of z / 2. A third
#: coefficient of sinc would bring 1e-8 and cost two operations a column.
SINC_COEFFICIENTS = (-0.16664553389661672, 0.008196313513515368)
COSM1_COEFFICIENTS = (-0.49999990418937185, 0.041663211079514505, -0.0013704120390129683)


#: The same up to UNKNOWN: sinc 6.8e-8 at the worst, cosm1 3.2e-7 of z.
WIDE_SINC_COEFFICIENTS = (
    -0.1666663489178205,
    0.008332873063786333,
    -0.00019819568296259568,
    2.710828180975325e-06,
    -2.0772646253426672e-08,
)
WIDE_COSM1_COEFFICIENTS = (
    -0.4999996756611467,
    0.04166500500238244,
    -0.0013875250046698796,
    2.4407762409801512e-05,
    -2.2848028108122512e-07,
)


def coefficients(
    precision: Precision, n: float = 1.0, wide: bool = False
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Of sinc and cosm1 in z = d^2 / n, lowest power first.

    Parameters
    ----------
    precision : Precision
        float32: minimax; float64: nine terms of the series, fifteen of the wide one.
    n : float, optional
        d^2 over z.
    wide : bool, optional
        Up to ``UNKNOWN`` instead of ``LIMIT``.
    """
    sinc: tuple[float, ...] = WIDE_SINC_COEFFICIENTS if wide else SINC_COEFFICIENTS
    cosm1: tuple[float, ...] = WIDE_COSM1_COEFFICIENTS if wide else COSM1_COEFFICIENTS
    if precision.bits != 24:
        # What is left out is below LIMIT^9 / 21! = 4e-23 of the first term, and UNKNOWN^16 / 32! = 3e-20.
        terms = range(1, 16 if wide else 10)
        sinc = tuple((-1) ** k / math.factorial(2 * k + 1) for k in terms)
        cosm1 = tuple((-1) ** k / math.factorial(2 * k) for k in terms)
    return tuple(s * n**k for k, s in enumerate(sinc, 1)), tuple(c * n**k for k, c in enumerate(cosm1, 1))


@cache
def small_angle_listing(precision: Precision, n: float, wide: bool = False) -> Listing:
    """The polynomials, for n z <= LIMIT or, where ``wide``, UNKNOWN.

    Parameters
    ----------
    precision : Precision
    n : float
        d^2 over z.
    wide : bool, optional
    """
    g = Graph()
    z = g.input("z")
    sinc, cosm1 = _values(g, z, precision, n, wide)
    section = Section("", "", [Statement(sinc, "sinc"), Statement(cosm1, "cosm1")])
    names = {z: "z", sinc: "sinc", cosm1: "cosm1"}
    return helper_listing(
        f"{'wide' if wide else 'small'}_angle_{n:g}", g, names, [section], {"sinc": [sinc], "cosm1": [cosm1]}
    )


def _values(g: Graph, z: int, precision: Precision, n: float, wide: bool) -> tuple[int, int]:
    s, c = coefficients(precision, n, wide)
    sinc = g.op("add", g.op("mul", polynomial(g, z, s), z), g.const(1.0))
    return sinc, g.op("mul", polynomial(g, z, c), z)


@dataclass(frozen=True)
class SmallAngleBound:
    """Error of float32 sinc, and of cosm1 relative to d^2 / 2, proved for every d^2 up to the limit."""

    limit: float
    sinc: float
    cosm1: float


@cache
def small_angle_bound(n: float = 1.0, wide: bool = False) -> SmallAngleBound:
    """Approximation (against float64 at 20 001 points) + rounding of the operations printed, over 256 pieces.

    Parameters
    ----------
    n : float, optional
        d^2 over z.
    wide : bool, optional
        Of the polynomials up to ``UNKNOWN``.
    """
    limit = UNKNOWN if wide else LIMIT
    u = 2.0**-24
    g = Graph()
    z = g.input("z")
    nodes = _values(g, z, SINGLE, n, wide)
    edges = np.linspace(0.0, limit / n, 257)
    grid = np.linspace(1e-9, limit, 20_001) / n
    d = np.sqrt(grid * n)
    s, c = (np.float32(np.array(k)).astype(float) for k in coefficients(SINGLE, n, wide))
    sinc_error = np.max(np.abs(1 + grid * np.polyval(s[::-1], grid) - np.sin(d) / d))
    # cosm1 / z is bounded apart from its last multiplication, which adds one rounding.
    inner = polynomial(g, z, coefficients(SINGLE, n, wide)[1])
    exact = -2 * np.sin(d / 2) ** 2 / grid
    cosm1_error = np.max(np.abs(np.polyval(c[::-1], grid) - exact)) + rounding_error(g, inner, "z", edges, u)
    rounding = rounding_error(g, nodes[0], "z", edges, u)
    return SmallAngleBound(limit, float(1.01 * sinc_error + rounding), float(2 * cosm1_error / n + 2 * u))
