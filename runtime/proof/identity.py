"""Whether two formulas are the same function: exact arithmetic at random points of a finite field.

Sines, cosines, exponentials and extrema are replaced by letters bound by sin^2 + cos^2 = 1 alone, which makes a
formula a rational function with rational coefficients. Two different ones of degree d agree at a random point modulo a
prime P with a chance of at most d / P (Schwartz 1980, Zippel 1979): below 1e-15 here, for one point; three are taken.
Nothing is rounded, and nothing need be simplified, which for a salient machine's Jacobian takes minutes.

>>> a, b = sp.symbols("a b")
>>> identical((a + b) ** 2, a**2 + 2 * a * b + b**2), identical((a + b) ** 2, a**2 + b**2)
(True, False)
>>> identical(sp.sin(a) ** 2 * b, b - b * sp.cos(a) ** 2)
True
>>> identical(sp.Max(-1, a + b), sp.Max(b + a, -1)), identical(sp.Max(-1, a), sp.Min(-1, a))
(True, False)
"""

from __future__ import annotations

import random

import sympy as sp

#: A Mersenne prime: sums and products of its residues are exact in Python's integers.
PRIME = 2**61 - 1
POINTS = 3


def identical(a: sp.Expr, b: sp.Expr) -> bool:
    """Whether a and b are the same rational function of their letters, sines, cosines and exponentials.

    Related exponentials, exp(x) and exp(x / 2) say, count as unrelated, and a least or largest of some values as a
    letter that belongs to these values alone: a True is never wrong for that.

    Parameters
    ----------
    a, b : Expr
        Rational numbers and decimal fractions are taken exactly.

    Raises
    ------
    ValueError
        If a formula holds anything else, a logarithm say.
    """
    return all(_Point(seed).value(a) == _Point(seed).value(b) for seed in range(1, POINTS + 1))


def is_derivative(slope: sp.Expr, f: sp.Expr, letter: sp.Symbol) -> bool:
    """Whether ``slope`` is df/d(letter), by the chain rule at the same points: no formula of the derivative is made.

    Parameters
    ----------
    slope : Expr
        The derivative to be judged.
    f : Expr
    letter : Symbol

    >>> x, y = sp.symbols("x y")
    >>> is_derivative(y * sp.cos(x * y), sp.sin(x * y), x), is_derivative(y * sp.cos(x * y), sp.sin(x * y), y)
    (True, False)

    Raises
    ------
    ValueError
        As of :func:`identical`.
    """
    return all(_Point(seed).value(slope) == _Point(seed).slope(f, letter) for seed in range(1, POINTS + 1))


class _Point:
    """A random point: every letter's value is drawn from the seed and its name, so that both formulas see the same."""

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self.known: dict[sp.Basic, int] = {}
        self.slopes: dict[tuple[sp.Basic, sp.Symbol], int] = {}

    def value(self, e: sp.Basic) -> int:
        """``e`` modulo PRIME."""
        if e not in self.known:
            self.known[e] = self._evaluate(e) % PRIME
        return self.known[e]

    def slope(self, e: sp.Basic, letter: sp.Symbol) -> int:
        """The derivative of ``e`` with respect to a letter, modulo PRIME."""
        if (e, letter) not in self.slopes:
            self.slopes[e, letter] = self._differentiate(e, letter) % PRIME
        return self.slopes[e, letter]

    def _differentiate(self, e: sp.Basic, letter: sp.Symbol) -> int:
        if not e.args:
            return int(e == letter)
        inner = [self.slope(term, letter) for term in e.args]
        if isinstance(e, sp.Add):
            return sum(inner)
        if isinstance(e, sp.Mul):
            product, total = 1, 0
            for factor, rate in zip(e.args, inner, strict=True):
                product, total = product * self.value(factor) % PRIME, total * self.value(factor) + product * rate
            return total
        if isinstance(e, sp.Pow) and e.exp.is_Integer:
            return int(e.exp) * pow(self.value(e.base), int(e.exp) - 1, PRIME) * inner[0]
        outer = {sp.exp: (1, sp.exp), sp.sin: (1, sp.cos), sp.cos: (-1, sp.sin)}.get(e.func)
        if outer is None:
            raise ValueError(f"{e} is no rational function of letters, sines, cosines and exponentials.")
        sign, function = outer
        return sign * self.value(function(e.args[0])) * inner[0]

    def _evaluate(self, e: sp.Basic) -> int:
        if isinstance(e, sp.Add):
            return sum(self.value(term) for term in e.args)
        if isinstance(e, sp.Mul):
            product = 1
            for factor in e.args:
                product = product * self.value(factor) % PRIME
            return product
        if isinstance(e, sp.Pow) and e.exp.is_Integer:
            return pow(self.value(e.base), int(e.exp), PRIME)
        if isinstance(e, sp.Float | sp.Rational):
            number = sp.Rational(e)  # a Float is the exact binary fraction it stores
            return int(number.p) * pow(int(number.q), -1, PRIME)
        if isinstance(e, sp.Symbol):
            return self._drawn(str(e))
        if isinstance(e, sp.Min | sp.Max):  # known by what it is taken of
            return self._drawn(f"{e.func.__name__} {sorted(self.value(term) for term in e.args)}")
        if isinstance(e, sp.exp):  # known by its argument, 1.0 x and x alike
            return self._drawn(f"exp {sp.nsimplify(e.args[0], rational=True)}")
        if isinstance(e, sp.sin | sp.cos):  # the circle's rational points
            t = self._drawn(f"half {e.args[0]}")
            numerator = 2 * t if isinstance(e, sp.sin) else 1 - t * t
            return numerator * pow(1 + t * t, -1, PRIME)
        raise ValueError(f"{e} is no rational function of letters, sines, cosines and exponentials.")

    def _drawn(self, name: str) -> int:
        return random.Random(f"{self.seed} {name}").randrange(1, PRIME)
