"""Even and odd parts of a function along a direction.

Along a column the points are x +- s l, with s^2 = q known and s itself never needed. Write every quantity
of f(x +- s l) as::

    base + even +- s odd          base: at x;  even: what both sides add alike;  odd: half their difference / s

Sums add part by part. Products, sines and quotients close up in the same three parts, because s appears in
them as s^2 = q alone::

    (a b):   even = a0 b_e + a_e b + q a_o b_o,  odd = a b_o + a_o b          (a = a0 + a_e, the even total)
    sin a:   even = sin a0 (cos d - 1),          odd = cos a0 a_o sinc d      (d = s a_o, a_e = 0)
    1 / a:   total = a / (a^2 - q a_o^2),        odd = -a_o / (a^2 - q a_o^2)

so one evaluation replaces two, an affine row has even = 0 found as a structural zero, and one sine and
cosine of a0 serve every column (angle addition). With q = 0 these are dual numbers: odd is the derivative
along l.

In a turning frame (see :class:`codegen.fast.steps.FilterBuilder`) the angle the frame follows has base 0: its sine
is purely odd and its cosine purely even, and half of every product vanishes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from codegen.ir.expr import Expr


@dataclass(frozen=True)
class Split:
    """base + even +- s odd; ``total`` is base + even where that has a shorter form than the sum."""

    base: Expr
    even: Expr
    odd: Expr
    total: Expr


class SplitAlgebra:
    """Replays a tape in even and odd parts (see :func:`codegen.ir.graph.read_tape`).

    Parameters
    ----------
    variance : Expr
        s^2 of the direction is ``n`` times it; a structural zero makes the algebra that of first derivatives.
    frame : Expr, optional
        The angle a turning frame follows: sines and cosines are those of the angle less this one.
    n : float
        Small angles take it into their coefficients.
    """

    def __init__(self, variance: Expr, frame: Expr | None = None, n: float = 1.0) -> None:
        self.variance, self.n = variance, n
        self.q = variance * n
        self.frame = frame
        self.zero = variance * 0.0
        #: Every z = d^2 / n met, with the angle that turns by d.
        self.turns: list[tuple[Split, Expr]] = []

    def const(self, value: float) -> Split:
        """Return a number, which has no odd part."""
        return self.constant(self.zero + value)

    def constant(self, base: Expr) -> Split:
        """A quantity that does not change along the direction."""
        return Split(base, self.zero, self.zero, base)

    def along(self, base: Expr, slope: Expr) -> Split:
        """base +- s slope: a coordinate."""
        return Split(base, self.zero, slope, base)

    def is_two_pi(self, value: Split) -> bool:
        """Whether a value is a whole turn."""
        known = value.base.value
        return known is not None and abs(known - 2 * math.pi) < 1e-12

    def op(self, op: str, *args: Split) -> Split:
        """Return an operation on split numbers."""
        if op not in {"sin", "cos"} and all(arg.even.is_zero() and arg.odd.is_zero() for arg in args):
            return self.constant(self._plain(op, *(arg.base for arg in args)))
        special: dict[str, Callable[..., Split]] = {
            "add": self._add,
            "sub": self._sub,
            "neg": self._neg,
            "mul": self._mul,
            "div": self._div,
            "sin": self._sin,
            "cos": self._cos,
        }
        return special[op](*args) if op in special else self._two_sided(op, *args)

    @staticmethod
    def _plain(op: str, *args: Expr) -> Expr:
        arithmetic: dict[str, Callable[..., Expr]] = {
            "add": Expr.__add__,
            "sub": Expr.__sub__,
            "mul": Expr.__mul__,
            "div": Expr.__truediv__,
            "neg": Expr.__neg__,
        }
        return arithmetic[op](*args) if op in arithmetic else args[0].apply(op, *args[1:])

    def _add(self, a: Split, b: Split) -> Split:
        return self._sum(a.base + b.base, a.even + b.even, a.odd + b.odd)

    def _sub(self, a: Split, b: Split) -> Split:
        return self._sum(a.base - b.base, a.even - b.even, a.odd - b.odd)

    def _neg(self, a: Split) -> Split:
        return Split(-a.base, -a.even, -a.odd, -a.total)

    @staticmethod
    def _sum(base: Expr, even: Expr, odd: Expr) -> Split:
        return Split(base, even, odd, base + even)

    def _mul(self, a: Split, b: Split) -> Split:
        even = a.base * b.even + a.even * b.total + self.q * a.odd * b.odd
        odd = a.total * b.odd + a.odd * b.total
        return self._sum(a.base * b.base, even, odd)

    def _div(self, a: Split, b: Split) -> Split:
        size = b.total * b.total - self.q * b.odd * b.odd
        base, total = 1.0 / b.base, b.total / size
        return self._mul(a, Split(base, total - base, -b.odd / size, total))

    def _sin(self, a: Split) -> Split:
        (sine, cosine), (cos_d, cos_d_less_1, sin_d) = self._at(a.total), self._turn(a)
        even = sine * cos_d_less_1
        base = sine if a.even.is_zero() else self._at(a.base)[0]
        return Split(base, sine - base + even, cosine * sin_d, sine * cos_d)

    def _cos(self, a: Split) -> Split:
        (sine, cosine), (cos_d, cos_d_less_1, sin_d) = self._at(a.total), self._turn(a)
        even = cosine * cos_d_less_1
        base = cosine if a.even.is_zero() else self._at(a.base)[1]
        return Split(base, cosine - base + even, -(sine * sin_d), cosine * cos_d)

    def _at(self, angle: Expr) -> tuple[Expr, Expr]:
        """Sine and cosine of an angle in the frame."""
        if self.frame is not None:
            angle = angle - self.frame
        if angle.is_zero():
            return self.zero, self.zero + 1.0
        return angle.apply("sin"), angle.apply("cos")

    def _turn(self, a: Split) -> tuple[Expr, Expr, Expr]:
        """For d = s odd: cos d, cos d - 1 and sin d / s, by the even functions of :mod:`codegen.ir.small_angle`."""
        odd = a.odd
        if self.q.is_zero() or odd.is_zero():
            return self.zero + 1.0, self.zero, odd
        z = self.variance * (odd * odd)
        self.turns.append((a, z))
        sinc, less = self.halves(z)
        return less + 1.0, less, odd * sinc

    def halves(self, z: Expr) -> tuple[Expr, Expr]:
        """sin(d) / d and cos(d) - 1 for z = d^2 / n."""
        n = self.zero + self.n
        return z.apply("sinc", n), z.apply("cosm1", n)

    def _two_sided(self, op: str, *args: Split) -> Split:
        """Any other operation: both sides evaluated, with s = sqrt(q)."""
        s = self.q.apply("sqrt")
        above, below = (self._plain(op, *(arg.total + arg.odd * (s * side) for arg in args)) for side in (1.0, -1.0))
        base = self._plain(op, *(arg.base for arg in args))
        return self._sum(base, (above + below) * 0.5 - base, (above - below) / (s * 2.0))
