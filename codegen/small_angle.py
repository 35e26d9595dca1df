"""sin(d) / d and cos(d) - 1 from z = d^2: what the fast form asks of an angle it turns by.

Both are even functions of d, so no square root is needed and small angles lose no digits. Up to ``LIMIT`` a
polynomial does. Beyond, d is halved until it is small, and doubled again::

    sin(2 d) / (2 d) = sin(d) / d  cos(d),        cos(2 d) - 1 = 2 (cos(d) - 1) (2 + (cos(d) - 1))

Float32 coefficients are minimax (Remez) on [0, LIMIT]; ``tests/codegen/test_small_angle.py`` shows their equal ripple.
Float64 takes as many terms of the series as its precision asks for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from codegen.bounds import rounding_error
from codegen.graph import Graph
from codegen.layout import Listing, Section, Statement
from codegen.trig import SINGLE, Precision, helper_listing, polynomial

#: Largest z the polynomials serve: |d| <= 0.7071 rad, two sigmas of theta at sigma = 20 degrees.
LIMIT = 0.5

#: How often d may be halved, and the z that this leaves small: |d| <= 5.66 rad. With sqrt(n) sigma beyond nearly a
#: whole turn the points alias and the angle is not known at all: its sine and cosine then average out, sinc = 0 and
#: cosm1 = -1. (To alias them truly would not be better, and would cost a square root and a division.)
DOUBLINGS = 3
WIDEST = LIMIT * 4.0**DOUBLINGS

#: sinc = 1 + z (S0 + S1 z + S2 z^2),  cosm1 = z (C0 + C1 z + C2 z^2)
SINC_COEFFICIENTS = (-0.16666665599949523, 0.008332948732190088, -0.00019635721053736524)
COSM1_COEFFICIENTS = (-0.49999990418937185, 0.041663211079514505, -0.0013704120390129683)


def coefficients(precision: Precision) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Of sinc and cosm1, lowest power first."""
    if precision.bits == 24:
        return SINC_COEFFICIENTS, COSM1_COEFFICIENTS
    terms = range(1, 10)  # the tenth term is below LIMIT^9 / 21! = 4e-23 of the first
    sinc = tuple((-1) ** k / math.factorial(2 * k + 1) for k in terms)
    return sinc, tuple((-1) ** k / math.factorial(2 * k) for k in terms)


@cache
def small_angle_listing(precision: Precision) -> Listing:
    """The polynomials, for z <= LIMIT."""
    g = Graph()
    z = g.input("z")
    sinc, cosm1 = _values(g, z, precision)
    section = Section("", "", [Statement(sinc, "sinc"), Statement(cosm1, "cosm1")])
    names = {z: "z", sinc: "sinc", cosm1: "cosm1"}
    return helper_listing("small_angle", g, names, [section], {"sinc": [sinc], "cosm1": [cosm1]})


def _values(g: Graph, z: int, precision: Precision) -> tuple[int, int]:
    s, c = coefficients(precision)
    sinc = g.op("add", g.op("mul", polynomial(g, z, s), z), g.const(1.0))
    return sinc, g.op("mul", polynomial(g, z, c), z)


@dataclass(frozen=True)
class SmallAngleBound:
    """Error of float32 sinc, and of cosm1 relative to z / 2, proved for every z up to the limit."""

    limit: float
    sinc: float
    cosm1: float


@cache
def small_angle_bound() -> SmallAngleBound:
    """Approximation (against float64 at 20 001 points) + rounding of the operations printed, over 256 pieces."""
    u = 2.0**-24
    g = Graph()
    z = g.input("z")
    nodes = _values(g, z, SINGLE)
    edges = np.linspace(0.0, LIMIT, 257)
    grid = np.linspace(1e-9, LIMIT, 20_001)
    d = np.sqrt(grid)
    s, c = (np.float32(np.array(k)).astype(float) for k in coefficients(SINGLE))
    sinc_error = np.max(np.abs(1 + grid * np.polyval(s[::-1], grid) - np.sin(d) / d))
    # cosm1 / z is bounded apart from its last multiplication, which adds one rounding.
    inner = polynomial(g, z, COSM1_COEFFICIENTS)
    exact = -2 * np.sin(d / 2) ** 2 / grid
    cosm1_error = np.max(np.abs(np.polyval(c[::-1], grid) - exact)) + rounding_error(g, inner, "z", edges, u)
    rounding = rounding_error(g, nodes[0], "z", edges, u)
    return SmallAngleBound(LIMIT, float(1.01 * sinc_error + rounding), float(2 * cosm1_error + 2 * u))
