"""The stator frame may be turned: a symmetry of f and h that is tested for, then used.

Turn a motor's stator frame by an angle and nothing changes but the numbers of its vectors: the first two
states, the voltages and the currents turn, the electrical angle shifts. Where a model has this symmetry its
even and odd parts may be taken in the frame in which the angle's base is zero, and turned back once.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from codegen.ir.expr import Expr
from codegen.ir.graph import Graph
from model.machines.state_space import StateSpaceModel

Pair = tuple[Expr, Expr]

#: Draws of the test, and the largest deviation rounding explains, relative to the largest value (float64).
DRAWS, ROUNDING = 20, 1e-12


@dataclass(frozen=True)
class Frame:
    """A frame turned by ``angle``."""

    angle: Expr
    sine: Expr
    cosine: Expr

    @classmethod
    def at(cls, angle: Expr) -> Frame:
        """Make the frame that is turned by an angle."""
        return cls(angle, angle.apply("sin"), angle.apply("cos"))

    def into(self, vector: list[Expr]) -> list[Expr]:
        """Components in the turned frame; further entries stay."""
        a, b, *rest = vector
        return [self.cosine * a + self.sine * b, self.cosine * b - self.sine * a, *rest]

    def out(self, vector: list[Expr]) -> list[Expr]:
        """Back to the stator frame."""
        a, b, *rest = vector
        return [self.cosine * a - self.sine * b, self.sine * a + self.cosine * b, *rest]

    def out_matrix(self, P: list[list[Expr]]) -> list[list[Expr]]:
        """A symmetric matrix back to the stator frame, rows and columns."""
        half = [self.out(list(row)) for row in P]
        a, b, c = P[0][0], P[1][0], P[1][1]
        tilt = self.tilt(P)
        half[0][0] = a - self.sine * tilt
        half[1][0] = self.cosine * tilt - b
        half[1][1] = c + self.sine * tilt
        return [[half[max(i, j)][min(i, j)] for j in range(len(P))] for i in range(len(P))]

    def tilt(self, P: list[list[Expr]]) -> Expr:
        """The term that turning back takes from the first diagonal entry of a symmetric matrix, by the sine."""
        return self.sine * (P[0][0] - P[1][1]) + self.cosine * P[1][0] * 2.0

    def into_diagonal(self, R: list[Expr]) -> list[list[Expr]]:
        """A diagonal 2x2 matrix, turned into the frame."""
        zero = R[0] * 0.0
        difference = self.cosine * self.sine * (R[1] - R[0])
        first = R[0] * (self.cosine * self.cosine) + R[1] * (self.sine * self.sine)
        return [[first, zero + difference], [difference, R[0] + R[1] - first]]


class AngleFinder:
    """Replays a tape in a graph and remembers what sines and cosines were taken of."""

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        self.angles: list[int] = []

    def const(self, value: float) -> int:
        """Return what a number is, seen as an angle."""
        return self.graph.const(value)

    def is_two_pi(self, value: int) -> bool:
        """Whether a value is a whole turn."""
        return self.graph.is_two_pi(value)

    def op(self, op: str, *args: int) -> int:
        """Return what an operation makes of its arguments, seen as angles."""
        if op in {"sin", "cos"}:
            self.angles.append(args[0])
        return self.graph.op(op, *args)


@cache
def turns_freely(model: StateSpaceModel) -> bool:
    """Whether f and h are equivariant under a turn of the stator frame, at random points to rounding.

    f and h are analytic, so an identity that holds at random points holds everywhere.
    """
    f = ca.Function("f", model.arguments, [model.numeric(model.f)])
    h = ca.Function("h", [model.x], [model.numeric(model.h)])
    G = [ca.Function("G", model.arguments, [model.numeric(ca.densify(column))]) for column in model.G.values()]
    rng = np.random.default_rng(1)
    x, *inputs = (rng.normal(size=(column.numel(), DRAWS)) for column in model.arguments)
    angle = rng.uniform(-3, 3, size=DRAWS)
    moved, image = _turned(x, angle, model.angle), _call(f, x, *inputs)
    turned = [_turned(vector, angle) for vector in inputs]
    pairs = [(_turned(image, angle, model.angle), _call(f, moved, *turned))]
    pairs.append((_turned(_call(h, x), angle), _call(h, moved)))
    pairs += [(_turned(_call(column, x, *inputs), angle), _call(column, moved, *turned)) for column in G]
    return not any(
        np.any(np.abs(expected - found) > ROUNDING * np.maximum(1.0, np.max(np.abs(expected), axis=0)))
        for expected, found in pairs
    )


def _turned(vector: Any, angle: Any, shifted: int | None = None) -> Any:
    """Vectors side by side, each turned by its own angle."""
    c, s = np.cos(angle), np.sin(angle)
    result = np.array(vector)
    result[:2] = c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]
    if shifted is not None:
        result[shifted] += angle
    return result


def _call(function: Any, *args: Any) -> Any:
    return np.array(function(*args))
