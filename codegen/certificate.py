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
    """Deviation of one float32 step from float64.

    ``x``: worst, in each state's unit. ``P``: worst, and ``P_99``: of 99 % of the draws, both relative to
    sqrt(P_ii P_jj). ``not_finite`` and ``indefinite`` count draws after which float32 holds no usable
    covariance although float64 does.
    """

    samples: int
    x: tuple[float, ...]
    P_99: float
    P: float
    not_finite: int
    indefinite: int


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
    P, exact = (_matrices(packed, len(module["STATES"])) for packed in (single[1], double[1]))
    sigma = np.sqrt(np.einsum("bii->bi", exact))
    scale = sigma[:, :, None] * sigma[:, None, :]
    dP = np.max(np.abs(P - exact) / scale, axis=(1, 2))
    good = np.all(np.isfinite(single[0]), axis=0) & np.isfinite(dP)
    lowest = np.linalg.eigvalsh(P[good] / scale[good])[:, 0]
    return Certificate(
        samples=int(good.size),
        x=tuple(float(np.max(row[good])) for row in dx),
        P_99=float(np.quantile(dP[good], 0.99)),
        P=float(np.max(dP[good])),
        not_finite=int(np.sum(~good)),
        indefinite=int(np.sum(lowest <= 0)),
    )


def _matrices(packed: np.ndarray, n: int) -> np.ndarray:
    """(n(n+1)/2, B) -> (B, n, n), symmetric."""
    full = np.empty((packed.shape[1], n, n))
    rows, columns = np.tril_indices(n)
    full[:, rows, columns] = full[:, columns, rows] = packed.T
    return full


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
