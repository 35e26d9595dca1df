"""Sine, cosine and angle wrapping as plain arithmetic, so that every platform computes the same bits.

No branch, no table, no integer: a compiler can put it in vector lanes, a 16-bit int is enough, and NaN
passes through. float64 forms call the platform's sin and cos and only share :func:`wrap_listing`.

The float32 sine and cosine take an angle within a turn, as :func:`wrap_listing` leaves it: half of it is within a
quarter turn, where two polynomials do, and doubling brings it back. Nothing is taken off, no sign is asked for.
Coefficients are minimax (Remez) for |x| <= pi; ``tests/codegen/test_trig.py`` derives them again.
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

#: 2 sin(x / 2) = x + x^3 (S0 + S1 x^2 + ...),  cos(x / 2) = 1 + x^2 (C0 + C1 x^2 + ...)
SIN_COEFFICIENTS = (-0.041666642741263902, 0.00052081358072319862, -3.0947836252608927e-06, 1.0156463938480245e-08)
COS_COEFFICIENTS = (-0.12499983073263368, 0.0026039993409279051, -2.1649886225831018e-05, 9.0603072235576211e-08)

#: Just below pi^2: an angle whose square is no larger lies inside already, and subtracting turns would leave it alone.
INSIDE = 9.8696


#: Arguments of sine and cosine, rad: a wrapped angle stays below, and what a tuning calls pi does not pass it.
ARGUMENT_LIMIT = float(np.float32(math.pi))


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
    """Sine and cosine of one angle.

    The float32 ones take an angle of at most ``ARGUMENT_LIMIT``; the float64 ones, which serve the simulated motor, so
    that a run has the same bits on every machine, take any.

    Parameters
    ----------
    precision : Precision, optional
        float32: minimax polynomials of half the angle; float64: the turns taken off, ten terms of the series.
    """
    return _doubled() if precision.bits == SINGLE.bits else _reduced(precision)


def _doubled() -> Listing:
    """Sine and cosine of half the angle by polynomials, doubled."""
    g = Graph()
    x = g.input("x")
    z = g.op("mul", x, x)
    (s, c), (sine, cosine) = _half_angle(g, x, z)
    names = {x: "x", z: "z", s: "s", c: "c"}
    values = [Statement(z, "z"), Statement(s, "s"), Statement(c, "c")]
    section = Section("", "s = 2 sin(x / 2), c = cos(x / 2), minimax polynomials in z = x^2", values)
    return helper_listing("sin_cos", g, names, [section], {"sine": [sine], "cosine": [cosine]})


def _half_angle(g: Graph, x: int, z: int) -> tuple[tuple[int, int], tuple[int, int]]:
    """2 sin(x / 2) and cos(x / 2) from x and z = x^2; sin x and cos x from these."""
    one = g.const(1.0)
    s = g.op("mul", x, g.op("add", g.op("mul", polynomial(g, z, SIN_COEFFICIENTS), z), one))
    c = g.op("add", g.op("mul", polynomial(g, z, COS_COEFFICIENTS), z), one)
    twice = g.op("mul", g.const(2.0), g.op("mul", c, c))
    return (s, c), (g.op("mul", s, c), g.op("sub", twice, one))


def _reduced(precision: Precision) -> Listing:
    """Reduce to |r| <= pi/2, two series, one common sign."""
    g = Graph()
    x = g.input("x")
    k, r = _reduce(g, x, split_pi(precision), 1 / math.pi, precision)
    magic = g.const(precision.rounding, "ROUND")
    coarse = g.const(2.0 * precision.rounding, "ROUND_EVEN")  # beside it numbers are two apart
    odd = g.op("sub", k, g.op("sub", g.op("add", k, coarse), coarse))
    sign = g.op("sub", g.const(1.0), g.op("mul", g.const(2.0), g.op("mul", odd, odd)))
    z = g.op("mul", r, r)
    s, c = DOUBLE_COEFFICIENTS
    sine = g.op("add", r, g.op("mul", g.op("mul", r, z), polynomial(g, z, s)))
    quarter = g.op("mul", g.op("mul", z, z), polynomial(g, z, c))
    cosine = g.op("add", g.op("sub", g.const(1.0), g.op("mul", g.const(0.5), z)), quarter)
    outputs = {"sine": [g.op("mul", sign, sine)], "cosine": [g.op("mul", sign, cosine)]}
    names = {x: "x", magic: "ROUND", coarse: "ROUND_EVEN", k: "k", r: "r", odd: "odd", sign: "sign", z: "z"}
    reduction = Section("", "x = k pi + r with |r| <= pi / 2, pi in two parts", [Statement(k, "k"), Statement(r, "r")])
    parity = Section("", "the sign is -1 for odd k", [Statement(odd, "odd"), Statement(sign, "sign")])
    values = Section("", "series in z = r^2", [Statement(z, "z")])
    return helper_listing("sin_cos", g, names, [reduction, parity, values], outputs)


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
    result = g.op("select", g.op("mul", x, x), g.const(INSIDE, "INSIDE"), x, outside)
    names = {x: "x", turns: "turns", r: "r", bound: "BELOW_PI", g.const(precision.rounding, "ROUND"): "ROUND"}
    names[g.const(INSIDE, "INSIDE")] = "INSIDE"
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
    """Bound |float32 result - true value| for |x| <= ``ARGUMENT_LIMIT``.

    Approximation: the polynomials, doubled, with their float32 coefficients in float64, against the library's float64
    sine and cosine at 20 001 points. Rounding: error propagation through the very operations printed, over 256 pieces
    of the interval.
    """
    u = 2.0**-24
    proved = 0.0
    grid = np.linspace(-ARGUMENT_LIMIT, ARGUMENT_LIMIT, 20_001)
    for which, exact in enumerate((np.sin, np.cos)):
        g = Graph()
        x = g.input("x")
        node = _half_angle(g, x, g.op("mul", x, x))[1][which]
        rounding = rounding_error(g, node, "x", np.linspace(-ARGUMENT_LIMIT, ARGUMENT_LIMIT, 257), u)
        approximation = float(np.max(np.abs(_evaluate_polynomial(which, grid) - exact(grid))))
        proved = max(proved, rounding + 1.01 * approximation)
    return SinCosBound(ARGUMENT_LIMIT, proved, *_scan())


def _evaluate_polynomial(which: int, x: np.ndarray) -> np.ndarray:
    """Sine or cosine by the polynomials with their float32-rounded coefficients, evaluated in float64."""
    z = x * x
    s, c = (np.float32(np.array(values)).astype(float) for values in (SIN_COEFFICIENTS, COS_COEFFICIENTS))
    cosine = 1 + z * np.polyval(c[::-1], z)
    if which == 0:
        return np.asarray(x * (1 + z * np.polyval(s[::-1], z)) * cosine)
    return np.asarray(2 * cosine * cosine - 1)


#: Pieces of the scan, each small enough for a processor's cache.
PIECES = 64


def _scan() -> tuple[float, int]:
    """Worst error over a deterministic scan, denser near zero."""
    near = np.linspace(-0.1, 0.1, 100_001)
    far = np.linspace(-ARGUMENT_LIMIT, ARGUMENT_LIMIT, 400_001)
    x = np.concatenate([near, far]).astype(np.float32)
    worst = 0.0
    for part in np.array_split(x, PIECES):
        exact = part.astype(float)
        for found, true in zip(evaluate_sin_cos(part), (np.sin(exact), np.cos(exact)), strict=True):
            worst = max(worst, float(np.max(np.abs(found - true))))
    return worst, x.size


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
