"""The certificate: the generated float32 step against the same text in float64, over the operating box."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from codegen.box import BoxSamples

SAMPLES = 2000


@dataclass(frozen=True)
class Certificate:
    """Worst deviation of one float32 step: x in each state's unit, P relative to sqrt(P_ii P_jj)."""

    samples: int
    x: tuple[float, ...]
    P: float
    failures: int


def certify(module: dict[str, Any], kind: str, box: BoxSamples) -> Certificate:
    """Run one step from every sample in both precisions.

    Parameters
    ----------
    module : dict
        Namespace of the generated Python module.
    kind : str
        Filter kind in the module's STEPS.
    box : BoxSamples
        Values that float32 holds exactly, so that only the arithmetic differs.
    """
    single, double = (one_step(module, kind, box, dtype) for dtype in ("float32", "float64"))
    dx = np.abs(single[0] - double[0])
    angle = module["ANGLE"]
    dx[angle] = np.abs(np.remainder(single[0][angle] - double[0][angle] + np.pi, 2 * np.pi) - np.pi)
    n = len(module["STATES"])
    index = [(i, j) for i in range(n) for j in range(i + 1)]
    sigma = np.sqrt([double[1][index.index((i, i))] for i in range(n)])
    dP = np.array([np.abs(single[1][k] - double[1][k]) / (sigma[i] * sigma[j]) for k, (i, j) in enumerate(index)])
    good = np.all(np.isfinite(single[0]), axis=0) & np.all(np.isfinite(single[1]), axis=0)
    worst = tuple(float(np.max(row[good])) for row in dx)
    return Certificate(int(good.size), worst, float(np.max(dP[:, good])), int(np.sum(~good)))


def one_step(module: dict[str, Any], kind: str, box: BoxSamples, dtype: str) -> tuple[np.ndarray, np.ndarray]:
    """x and packed P after one step from every sample, as float64 arrays with a trailing sample axis."""
    math = module["MATH"][dtype]
    state = SimpleNamespace(**{key: _cast(value, math.dtype) for key, value in module["DEFAULTS"].items()})
    state.x, state.P = tuple(box.x.astype(math.dtype)), tuple(box.P.astype(math.dtype))
    state.u_held = tuple(np.zeros_like(box.u, dtype=math.dtype))
    module["STEPS"][kind](state, tuple(box.u.astype(math.dtype)), tuple(box.y.astype(math.dtype)), math)
    return np.array(state.x, dtype=float), np.array(state.P, dtype=float)


def _cast(value: Any, dtype: Any) -> Any:
    if isinstance(value, tuple):
        return tuple(dtype(item) for item in value)
    return value if isinstance(value, int) else dtype(value)
