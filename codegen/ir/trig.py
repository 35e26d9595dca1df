"""Sine, cosine and angle wrapping as plain arithmetic, so that every platform computes the same bits.

No branch, no table, no integer: a compiler can put it in vector lanes, a 16-bit int is enough, and NaN
passes through. float64 forms call the platform's sin and cos and only share :func:`wrap_listing`.

Coefficients are minimax (Remez) for |r| <= pi/2; ``tests/codegen/test_trig.py`` derives them again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from codegen.ir.bounds import rounding_error
from codegen.ir.graph import Graph
from codegen.ir.layout import Listing, Section, Statement
from model.quantities import Block, Port

#: sin r = r + r^3 (S0 + S1 r^2 + ...),  cos r = 1 - r^2 / 2 + r^4 (C0 + C1 r^2 + ...)
SIN_COEFFICIENTS = (-0.1666665705860025, 0.008333016355659941, -0.00019806547121805626, 2.5999032895283066e-06)
COS_COEFFICIENTS = (0.0416666557299502, -0.0013888568213324846, 2.4769240676692124e-05, -2.619248419059995e-07)

#: Arguments the error bound is stated for, rad. A wrapped angle plus any sensible spread stays far inside.
ARGUMENT_LIMIT = 1000.0


#: Just below pi^2: an angle whose square is no larger lies inside already, and subtracting turns would leave it alone.
INSIDE = 9.8696


@dataclass(frozen=True)
class Precision:
    """Properties of a floating-point format that the arithmetic uses."""

    name: str
    bits: int

    @property
    def rounding(self) -> float:
        """1.5 * 2^(bits - 1): adding and subtracting it rounds to the nearest integer."""
        return 1.5 * 2.0 ** (self.bits - 1)

    @property
    def below_pi(self) -> float:
        """The largest number of the format below the double nearest to pi."""
        if self.bits == 24:
            return float(np.nextafter(np.float32(math.pi), np.float32(0)))
        return float(np.nextafter(math.pi, 0.0))


SINGLE = Precision("float32", 24)
DOUBLE = Precision("float64", 53)

#: pi as a double's head and tail: 107 bits, from pi's published digits.
_PI_TAIL = 1.2246467991473532e-16


def split_pi(precision: Precision) -> tuple[float, ...]:
    """Pi in two parts, the first so short that k times it is exact (Cody and Waite).

    Parameters
    ----------
    precision : Precision
        Each part is a number of this format.
    """
    if precision.bits == 24:
        first = round(math.pi * 2**10) / 2**10
        return first, float(np.float32(math.pi - first + _PI_TAIL))
    first = round(math.pi * 2**30) / 2**30
    return first, math.pi - first + _PI_TAIL


def _reduce(g: Graph, x: int, parts: tuple[float, ...], per_period: float, precision: Precision) -> tuple[int, int]:
    """Nearest whole number k of periods in x, and x - k period."""
    magic = g.const(precision.rounding, "ROUND")
    k = g.op("sub", g.op("add", g.op("mul", x, g.const(per_period)), magic), magic)
    r = x
    for part in parts:
        r = g.op("sub", r, g.op("mul", k, g.const(part)))
    return k, r


def polynomial(g: Graph, z: int, coefficients: tuple[float, ...]) -> int:
    """Horner's rule in z.

    Parameters
    ----------
    g : Graph
    z : int
        Node of the variable.
    coefficients : tuple of float
        Lowest power first.

    Returns
    -------
    int
        Node of the value.
    """
    value = g.const(coefficients[-1])
    for c in reversed(coefficients[:-1]):
        value = g.op("add", g.op("mul", value, z), g.const(c))
    return value


def _series(first: int, terms: int) -> tuple[float, ...]:
    """Taylor coefficients of sine (``first`` 3) or cosine (4), every other power, from that power on."""
    powers = range(first, first + 2 * terms, 2)
    return tuple((-1) ** (power // 2) / math.factorial(power) for power in powers)


#: float64: as many terms of the series as (pi/2)^n / n! needs to vanish.
DOUBLE_COEFFICIENTS = (_series(3, 10), _series(4, 10))


@cache
def sin_cos_listing(precision: Precision = SINGLE) -> Listing:
    """Sine and cosine of one angle: reduce to |r| <= pi/2, two polynomials, one common sign.

    The float64 one serves the simulated motor, so that a run has the same bits on every machine.

    Parameters
    ----------
    precision : Precision, optional
        float32: minimax polynomials; float64: ten terms of the series.
    """
    g = Graph()
    x = g.input("x")
    k, r = _reduce(g, x, split_pi(precision), 1 / math.pi, precision)
    magic = g.const(precision.rounding, "ROUND")
    coarse = g.const(2.0 * precision.rounding, "ROUND_EVEN")  # beside it numbers are two apart
    odd = g.op("sub", k, g.op("sub", g.op("add", k, coarse), coarse))
    sign = g.op("sub", g.const(1.0), g.op("mul", g.const(2.0), g.op("mul", odd, odd)))
    sine, cosine = _sine_cosine(g, r, precision)
    z = g.op("mul", r, r)
    outputs = {"sine": [g.op("mul", sign, sine)], "cosine": [g.op("mul", sign, cosine)]}
    names = {x: "x", magic: "ROUND", coarse: "ROUND_EVEN", k: "k", r: "r", odd: "odd", sign: "sign", z: "z"}
    reduction = Section("", "x = k pi + r with |r| <= pi / 2, pi in two parts", [Statement(k, "k"), Statement(r, "r")])
    parity = Section("", "the sign is -1 for odd k", [Statement(odd, "odd"), Statement(sign, "sign")])
    kind = "minimax polynomials" if precision.bits == SINGLE.bits else "series"
    values = Section("", f"{kind} in z = r^2", [Statement(z, "z")])
    return helper_listing("sin_cos", g, names, [reduction, parity, values], outputs)


def _sine_cosine(g: Graph, r: int, precision: Precision = SINGLE) -> tuple[int, int]:
    """The two polynomials on |r| <= pi/2."""
    s, c = (SIN_COEFFICIENTS, COS_COEFFICIENTS) if precision.bits == SINGLE.bits else DOUBLE_COEFFICIENTS
    z = g.op("mul", r, r)
    sine = g.op("add", r, g.op("mul", g.op("mul", r, z), polynomial(g, z, s)))
    quarter = g.op("mul", g.op("mul", z, z), polynomial(g, z, c))
    cosine = g.op("add", g.op("sub", g.const(1.0), g.op("mul", g.const(0.5), z)), quarter)
    return sine, cosine


@cache
def wrap_listing(precision: Precision) -> Listing:
    """The angle in [-pi, pi): itself where it is inside, as it nearly always is, else less the nearest number of turns.

    Parameters
    ----------
    precision : Precision
    """
    g = Graph()
    x = g.input("x")
    two_pi = tuple(2 * part for part in split_pi(precision))
    turns, r = _reduce(g, x, two_pi, 1 / (2 * math.pi), precision)
    bound = g.const(precision.below_pi, "BELOW_PI")
    lower = g.const(-precision.below_pi)
    outside = g.op("max", g.op("min", r, bound), lower)
    result = g.op("select", g.op("mul", x, x), g.const(INSIDE), x, outside)
    names = {x: "x", turns: "turns", r: "r", bound: "BELOW_PI", g.const(precision.rounding, "ROUND"): "ROUND"}
    heading = "r = x - 2 pi turns, kept inside, where x is not inside itself"
    section = Section("", heading, [Statement(turns, "turns"), Statement(r, "r")])
    return helper_listing("wrap_angle", g, names, [section], {"wrapped": [result]})


def helper_listing(
    name: str, g: Graph, names: dict[int, str], sections: list[Section], outputs: dict[str, list[int]]
) -> Listing:
    """A helper of one scalar, ready to print.

    Parameters
    ----------
    name : str
        The function's.
    g : Graph
        Has one input.
    names : dict of int to str
        Names of nodes.
    sections : list of Section
        The statements, in order.
    outputs : dict of str to list of int
        Nodes of the results.
    """
    ports = tuple(Port(key, (), (key,)) for key in outputs)
    (argument,) = (node.name for node in g.nodes if node.op == "input")
    block = Block(name, "", (Port(argument, (), (argument,)),), ports, ())
    live = frozenset(g.reachable(node for nodes in outputs.values() for node in nodes))
    return Listing(block, g, names, sections, outputs, {}, live)


@dataclass(frozen=True)
class SinCosBound:
    """Error of the float32 sine and cosine for |x| <= ``limit``: proved, and the worst met in a scan."""

    limit: float
    proved: float
    seen: float
    samples: int


@cache
def sin_cos_bound() -> SinCosBound:
    """Bound |float32 result - true value|: argument reduction + approximation + rounding of the evaluation.

    Reduction: k p1 is exact for these k, x - k p1 is exact (the result has at most 24 bits), so only
    the product k p2 and its subtraction round; sine and cosine pass the error of r on with a slope of at
    most 1. Approximation: polynomial against the library's float64 sine at 20 001 points. Rounding: error
    propagation through the very operations printed, over 256 pieces of the interval.
    """
    u = 2.0**-24
    k_max = math.ceil(ARGUMENT_LIMIT / math.pi)
    parts = split_pi(SINGLE)
    r_max = math.pi / 2 + 2 * u * ARGUMENT_LIMIT / math.pi + 1e-6  # k may round the other way near a tie
    tail = abs(math.pi - parts[0] - parts[1] + _PI_TAIL)
    reduction = k_max * tail + u * k_max * abs(parts[1]) + u  # |r| < 2: half a unit in the last place is u
    proved = 0.0
    grid = np.linspace(-r_max, r_max, 20_001)
    for which, exact in enumerate((np.sin, np.cos)):
        g = Graph()
        node = _sine_cosine(g, g.input("r"))[which]
        rounding = rounding_error(g, node, "r", np.linspace(-r_max, r_max, 257), u)
        approximation = float(np.max(np.abs(_evaluate_polynomial(which, grid) - exact(grid))))
        proved = max(proved, reduction + rounding + 1.01 * approximation)
    return SinCosBound(ARGUMENT_LIMIT, proved, *_scan())


def _evaluate_polynomial(which: int, r: np.ndarray) -> np.ndarray:
    """The polynomials with their float32-rounded coefficients, evaluated in float64."""
    z = r * r
    s, c = (np.float32(np.array(values)).astype(float) for values in (SIN_COEFFICIENTS, COS_COEFFICIENTS))
    if which == 0:
        return np.asarray(r + r * z * np.polyval(s[::-1], z))
    return np.asarray(1 - 0.5 * z + z * z * np.polyval(c[::-1], z))


def _scan() -> tuple[float, int]:
    """Worst error over a deterministic scan, dense near zero and over the whole range."""
    near = np.linspace(-2 * math.pi, 2 * math.pi, 100_001)
    far = np.linspace(-ARGUMENT_LIMIT, ARGUMENT_LIMIT, 100_001)
    x = np.concatenate([near, far]).astype(np.float32)
    sine, cosine = evaluate_sin_cos(x)
    exact = x.astype(float)
    return float(max(np.max(np.abs(sine - np.sin(exact))), np.max(np.abs(cosine - np.cos(exact))))), x.size


def evaluate_sin_cos(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Execute the float32 graph on an array, operation by operation.

    Parameters
    ----------
    x : ndarray
        Angles, rad; rounded to float32.

    Returns
    -------
    sine, cosine : ndarray of float32
        Of the shape of x.
    """
    listing = sin_cos_listing()
    values: dict[int, np.ndarray] = {}
    for index in listing.graph.reachable(n for nodes in listing.outputs.values() for n in nodes):
        node = listing.graph[index]
        args = [values[arg] for arg in node.args]
        if node.op == "input":
            values[index] = x.astype(np.float32)
        elif node.op == "const":
            values[index] = np.float32(node.value)  # type: ignore[assignment]
        else:
            values[index] = {"add": np.add, "sub": np.subtract, "mul": np.multiply}[node.op](*args)
    return values[listing.outputs["sine"][0]], values[listing.outputs["cosine"][0]]
