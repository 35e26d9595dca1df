"""Link C-D: float64 against float32 over a long run at speed, through the compiled C of both."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.machines.adaptive import ADAPTIVE
from runtime.estimator.estimator import Estimator, Trace, load_folder
from runtime.estimator.folder import GeneratedFolder
from runtime.proof.result import Link, Row

Array = NDArray[Any]

#: The error that float32 may add while the filter runs at speed: a hundredth of the sigma the filter itself
#: claims at that step (as noise it would add a ten-thousandth to the variance), and a hundredth of a variance. The
#: shipped drives show ten to a thousand times less; tests/runtime/test_proof.py holds the two basic ones to absolute
#: figures.
ALLOWED = 1e-2

#: The same where motor data are states: a twentieth. At constant speed with i_d = 0 the data show nothing but
#: R i_q + omega_e psi_m, and along that line a rounding of 2^-24 of psi_m every step is held back only by the slow
#: states' return, thousands of steps later. A twentieth adds a four-hundredth to the variance.
ALLOWED_ADAPTIVE = 5e-2


@dataclass(frozen=True)
class Drift:
    """|float32 - float64| along a run: x (N, n) in the states' units, P (N,) relative; and the float64 run.

    Link D-chip compares the modelled chip with float32 in the same way.
    """

    x: Array
    P: Array
    exact: Trace

    def envelope(self) -> Envelope:
        """The points of it for a plot: a thousandth of the numbers."""
        steps, x = envelope(self.x)
        return Envelope(steps, x, envelope(self.P)[1])


@dataclass(frozen=True)
class Envelope:
    """The largest of each slice of a :class:`Drift`: ``steps`` (M,) at whose ends, x (M, n), P (M,)."""

    steps: Array
    x: Array
    P: Array


def envelope(values: Array, slices: int = 600) -> tuple[Array, Array]:
    """The largest of values (N, ...) in each of at most so many slices, and the step, from 1, at which each ends.

    Parameters
    ----------
    values : ndarray, (N, ...)
        What is left after the last whole slice is not looked at.
    slices : int, optional

    Returns
    -------
    ends : ndarray of int, (M,)
    largest : ndarray, (M, ...)
    """
    width = max(1, len(values) // slices)
    count = len(values) // width
    cut = values[: count * width].reshape(count, width, *values.shape[1:])
    return width * np.arange(1, count + 1), cut.max(axis=1)


def drift(single: Estimator, double: Estimator, u: Array, y: Array) -> Drift:
    """Run both precisions on the same inputs (rounded to float32 first, so that only arithmetic differs).

    Parameters
    ----------
    single : Estimator
    double : Estimator
    u : ndarray
        Voltages, V, (N, 2).
    y : ndarray
        Currents, A, (N, 2).
    """
    u, y = u.astype(np.float32), y.astype(np.float32)
    a, b = single.run(u, y), double.run(u, y)
    dx = np.abs(a.x - b.x)
    angle = double.state_names.index("theta")
    dx[:, angle] = np.abs(np.remainder(a.x[:, angle] - b.x[:, angle] + np.pi, 2 * np.pi) - np.pi)
    sigma = np.sqrt(np.einsum("kii->ki", b.P))
    dP = np.abs(a.P - b.P) / (sigma[:, :, None] * sigma[:, None, :])
    return Drift(dx, dP.max(axis=(1, 2)), b)


def link_cd(folder: GeneratedFolder, kind: str, gain: str, u: Array, y: Array, settled: int) -> tuple[Link, Drift]:
    """Judge the run from step ``settled`` on; before it the covariance still falls from P_0.

    Parameters
    ----------
    folder : GeneratedFolder
        The generated folder.
    kind : str
        Filter kind, such as "ickf".
    gain : str
        "cubature" or "jacobian"; matters to the ICKF alone.
    u : ndarray
        Voltages, V, (N, 2).
    y : ndarray
        Currents, A, (N, 2).
    settled : int
    """
    single, double = (load_folder(folder, kind, "c", dtype) for dtype in ("float32", "float64"))
    result = drift(single, double, u, y)
    rows = drift_rows(double, result, settled)
    data = f"{len(u) - settled} steps at speed"
    return Link("C-D", "float64 = float32, within a bound", folder.drive, kind, gain, data, rows), result


def drift_rows(estimator: Estimator, result: Drift, settled: int) -> tuple[Row, ...]:
    """Worst deviation from step ``settled`` on, a row a state and one for P; allowed: a share of that step's sigma.

    Parameters
    ----------
    estimator : Estimator
        Gives the states' names and units.
    result : Drift
    settled : int
        Steps at the beginning that are not judged.
    """
    tail, steps = slice(settled, None), len(result.P) - settled
    share = ALLOWED_ADAPTIVE if set(estimator.state_names) & set(ADAPTIVE) else ALLOWED
    sigma = np.sqrt(np.einsum("kii->ki", result.exact.P[tail]))
    rows = []
    for k, (name, unit) in enumerate(zip(estimator.state_names, estimator.state_units, strict=True)):
        deviation = result.x[tail, k]
        step = int(np.argmax(deviation / sigma[:, k])) if np.isfinite(deviation).all() else 0
        worst = float(deviation[step]) if np.isfinite(deviation).all() else float("inf")
        rows.append(Row("25, 34", name, unit, worst, share * float(sigma[step, k]), steps))
    return (*rows, Row("26, 32", "P", "relative", _worst(result.P[tail]), ALLOWED, steps))


def _worst(error: Array) -> float:
    return float(error.max()) if np.isfinite(error).all() else float("inf")
