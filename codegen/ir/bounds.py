"""Rounding-error propagation through a graph: the proof behind the bound printed with sine and cosine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from codegen.ir.graph import Graph


@dataclass(frozen=True)
class _Enclosure:
    """Exact value in [low, high]; the computed one differs by at most ``error`` (arrays over pieces)."""

    low: np.ndarray
    high: np.ndarray
    error: np.ndarray

    @property
    def magnitude(self) -> np.ndarray:
        return np.asarray(np.maximum(np.abs(self.low), np.abs(self.high)))


def rounding_error(graph: Graph, node: int, variable: str, edges: np.ndarray, unit_roundoff: float) -> float:
    """Largest |computed - exact| of ``node`` over all pieces, in the standard model fl(a op b) = (a op b)(1 + d).

    Parameters
    ----------
    graph, node
        The expression; operations add, sub, mul.
    variable : str
        Its one input, taken as exact, over the pieces between neighbouring ``edges``.
    unit_roundoff : float
        Bound of |d|: 2**-24 for float32.
    """
    u = unit_roundoff
    values: dict[int, _Enclosure] = {}
    zero = np.zeros(edges.size - 1)
    for index in graph.reachable([node]):
        item = graph[index]
        if item.op == "input":
            assert item.name == variable
            values[index] = _Enclosure(edges[:-1], edges[1:], zero)
        elif item.op == "const":
            rounds = float(np.float32(item.value)) != item.value  # else it is a number of any such format
            values[index] = _Enclosure(zero + item.value, zero + item.value, zero + abs(item.value) * u * rounds)
        else:
            values[index] = _combine(
                item.op, values[item.args[0]], values[item.args[1]], item.args[0] == item.args[1], u
            )
    return float(np.max(values[node].error))


def _combine(op: str, a: _Enclosure, b: _Enclosure, square: bool, u: float) -> _Enclosure:
    if op == "add":
        low, high, passed = a.low + b.low, a.high + b.high, a.error + b.error
    elif op == "sub":
        low, high, passed = a.low - b.high, a.high - b.low, a.error + b.error
    elif op == "mul":
        corners = np.stack([a.low * b.low, a.low * b.high, a.high * b.low, a.high * b.high])
        low, high = corners.min(axis=0), corners.max(axis=0)
        low = np.maximum(low, 0.0) if square else low
        passed = a.magnitude * b.error + b.magnitude * a.error + a.error * b.error
    else:
        raise ValueError(f"no error model for operation '{op}'")
    result = np.maximum(np.abs(low), np.abs(high)) + passed
    return _Enclosure(low, high, passed + u * result)
