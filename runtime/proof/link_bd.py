"""Link B-D: float64 against float32 over a long run at speed, through the compiled C of both."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.estimator.estimator import Estimator, Trace, load_folder
from runtime.estimator.folder import GeneratedFolder
from runtime.proof.result import Link, Row

Array = NDArray[Any]

#: What float32 may add to the estimate while the filter runs at speed, by unit. A float32 current of some
#: amperes is known to 2e-7 A, a speed of 105 rad/s to 4e-6 rad/s, an angle to 1e-7 rad; the filter feeds a
#: step's rounding back through a gain below one, over some hundred steps of memory.
ALLOWED_X = {"A": 1e-5, "Wb": 2e-6, "rad/s": 1e-3, "rad": 2e-6, "N m": 1e-3}
#: P relative to sqrt(P_ii P_jj): a rounding of 6e-8 times the ratio of P_pred to P (some hundred).
ALLOWED_P = 1e-4
#: The two bounds above hold while rounding a state moves it by less than this many of its sigmas. The spread of
#: the points is a difference of such states: where a sigma is finer (an angle known to 1e-3 rad while it turns up
#: to pi), the spread is rounded more coarsely in proportion, and so the bounds grow in proportion.
RESOLUTION = 2e-5


def resolution(x: Array, sigma: Array) -> float:
    """Largest float32 rounding of a state in its own sigmas along a run; x, sigma (N, n)."""
    return float(np.max(2.0**-24 * np.max(np.abs(x), axis=0) / np.min(sigma, axis=0)))


@dataclass(frozen=True)
class Drift:
    """|float32 - float64| along a run: x (N, n) in the states' units, P (N,) relative; and the float64 run."""

    x: Array
    P: Array
    exact: Trace


def drift(single: Estimator, double: Estimator, u: Array, y: Array) -> Drift:
    """Run both precisions on the same inputs (rounded to float32 first, so that only arithmetic differs)."""
    u, y = u.astype(np.float32), y.astype(np.float32)
    a, b = single.run(u, y), double.run(u, y)
    dx = np.abs(a.x - b.x)
    angle = double.state_names.index("theta")
    dx[:, angle] = np.abs(np.remainder(a.x[:, angle] - b.x[:, angle] + np.pi, 2 * np.pi) - np.pi)
    sigma = np.sqrt(np.einsum("kii->ki", b.P))
    dP = np.abs(a.P - b.P) / (sigma[:, :, None] * sigma[:, None, :])
    return Drift(dx, dP.max(axis=(1, 2)), b)


def link_bd(folder: GeneratedFolder, kind: str, gain: str, u: Array, y: Array, settled: int) -> tuple[Link, Drift]:
    """Judge the run from step ``settled`` on; before it the covariance still falls from P_0."""
    single, double = (load_folder(folder, kind, "c", dtype) for dtype in ("float32", "float64"))
    result = drift(single, double, u, y)
    tail = slice(settled, None)
    sigma = np.sqrt(np.einsum("kii->ki", result.exact.P[tail]))
    slack = max(1.0, resolution(result.exact.x[tail], sigma) / RESOLUTION)
    rows = [
        Row("25, 34", name, unit, _worst(result.x[tail, k]), ALLOWED_X[unit] * slack, len(u) - settled)
        for k, (name, unit) in enumerate(zip(double.state_names, double.state_units, strict=True))
    ]
    rows.append(
        Row("26, 32", "P", "relative to sqrt(P_ii P_jj)", _worst(result.P[tail]), ALLOWED_P * slack, len(u) - settled)
    )
    data = f"{len(u) - settled} steps at speed"
    return Link("B-D", "float64 = float32, within a bound", folder.drive, kind, gain, data, tuple(rows)), result


def _worst(error: Array) -> float:
    return float(error.max()) if np.isfinite(error).all() else float("inf")
