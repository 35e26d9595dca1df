"""sin(d) / d and cos(d) - 1 from z = d^2 / n: what the fast form asks of an angle it turns by.

A column of the points turns an angle by d = sqrt(n D) l (n + kappa for the UKF). The coefficients take n in, so that
z = D l^2 costs no product with it; below, n = 1.

Both are even functions of d, so no square root is needed and small angles lose no digits. Up to ``LIMIT`` a
polynomial does. Beyond, d is halved until it is small, and doubled again::

    sin(2 d) / (2 d) = sin(d) / d  cos(d),        cos(2 d) - 1 = 2 (cos(d) - 1) (2 + (cos(d) - 1))

Float32 coefficients are minimax (Remez) on [0, LIMIT], of sinc and of cosm1 / z;
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

#: How often d may be halved, and the z that this leaves small: |d| <= 5.66 rad.
DOUBLINGS = 3
WIDEST = LIMIT * 4.0**DOUBLINGS

#: d = pi: there the two points of a column are one, and beyond it they alias. The step gives such an angle up.
UNKNOWN = math.pi**2

#: sinc = 1 + z (S0 + S1 z), 9.4e-7 at the worst;  cosm1 = z (C0 + C1 z + C2 z^2), 3.9e-7 of z / 2. A third
#: coefficient of sinc would bring 1e-8 and cost two operations a column.
SINC_COEFFICIENTS = (-0.16664553389661672, 0.008196313513515368)
COSM1_COEFFICIENTS = (-0.49999990418937185, 0.041663211079514505, -0.0013704120390129683)


def coefficients(precision: Precision, n: float = 1.0) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Of sinc and cosm1 in z = d^2 / n, lowest power first.

    Parameters
    ----------
    precision : Precision
        float32: minimax; float64: nine terms of the series.
    n : float, optional
        d^2 over z.
    """
    sinc, cosm1 = SINC_COEFFICIENTS, COSM1_COEFFICIENTS
    if precision.bits != 24:
        terms = range(1, 10)  # the tenth term is below LIMIT^9 / 21! = 4e-23 of the first
        sinc = tuple((-1) ** k / math.factorial(2 * k + 1) for k in terms)
        cosm1 = tuple((-1) ** k / math.factorial(2 * k) for k in terms)
    return tuple(s * n**k for k, s in enumerate(sinc, 1)), tuple(c * n**k for k, c in enumerate(cosm1, 1))


@cache
def small_angle_listing(precision: Precision, n: float) -> Listing:
    """The polynomials, for n z <= LIMIT.

    Parameters
    ----------
    precision : Precision
    n : float
        d^2 over z.
    """
    g = Graph()
    z = g.input("z")
    sinc, cosm1 = _values(g, z, precision, n)
    section = Section("", "", [Statement(sinc, "sinc"), Statement(cosm1, "cosm1")])
    names = {z: "z", sinc: "sinc", cosm1: "cosm1"}
    return helper_listing(f"small_angle_{n:g}", g, names, [section], {"sinc": [sinc], "cosm1": [cosm1]})


def _values(g: Graph, z: int, precision: Precision, n: float) -> tuple[int, int]:
    s, c = coefficients(precision, n)
    sinc = g.op("add", g.op("mul", polynomial(g, z, s), z), g.const(1.0))
    return sinc, g.op("mul", polynomial(g, z, c), z)


@dataclass(frozen=True)
class SmallAngleBound:
    """Error of float32 sinc, and of cosm1 relative to d^2 / 2, proved for every d^2 up to the limit."""

    limit: float
    sinc: float
    cosm1: float


@cache
def small_angle_bound(n: float = 1.0) -> SmallAngleBound:
    """Approximation (against float64 at 20 001 points) + rounding of the operations printed, over 256 pieces.

    Parameters
    ----------
    n : float, optional
        d^2 over z.
    """
    u = 2.0**-24
    g = Graph()
    z = g.input("z")
    nodes = _values(g, z, SINGLE, n)
    edges = np.linspace(0.0, LIMIT / n, 257)
    grid = np.linspace(1e-9, LIMIT, 20_001) / n
    d = np.sqrt(grid * n)
    s, c = (np.float32(np.array(k)).astype(float) for k in coefficients(SINGLE, n))
    sinc_error = np.max(np.abs(1 + grid * np.polyval(s[::-1], grid) - np.sin(d) / d))
    # cosm1 / z is bounded apart from its last multiplication, which adds one rounding.
    inner = polynomial(g, z, coefficients(SINGLE, n)[1])
    exact = -2 * np.sin(d / 2) ** 2 / grid
    cosm1_error = np.max(np.abs(np.polyval(c[::-1], grid) - exact)) + rounding_error(g, inner, "z", edges, u)
    rounding = rounding_error(g, nodes[0], "z", edges, u)
    return SmallAngleBound(LIMIT, float(1.01 * sinc_error + rounding), float(2 * cosm1_error / n + 2 * u))
