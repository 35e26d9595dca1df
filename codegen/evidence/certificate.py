"""The certificate: the generated float32 step against the same text in float64, over the operating box.

And what the chip's own arithmetic is expected to add to it, by the model of :mod:`codegen.evidence.fpu32`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from codegen.evidence.box import BoxSamples
from codegen.evidence.fpu32 import FPU32, Flushed

SAMPLES = 2000


@dataclass(frozen=True)
class Certificate:
    """Deviation of one step in one arithmetic from the same step in another, here float32 from float64.

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


@dataclass(frozen=True)
class ChipModel:
    """The error that the chip is expected to add to host float32: modelled, not measured.

    ``fpu32``: flush to zero, and division and root by Newton steps; ``flushed``: flush to zero alone.
    """

    fpu32: Certificate
    flushed: Certificate


@dataclass(frozen=True)
class Figures:
    """How far one filter's float32 can be trusted: on the host, and what the chip is expected to add.

    ``chip`` is None where the target's arithmetic is IEEE's: it adds nothing.
    """

    certificate: Certificate
    chip: ChipModel | None


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

    Raises
    ------
    FloatingPointError
        No sample stays a number.
    """
    return _compare(module, one_step(module, kind, box, "float32"), one_step(module, kind, box, "float64"))


def certify_chip(
    module: dict[str, Any],
    kind: str,
    box: BoxSamples,
    number: type[Any] = FPU32,
    sin_cos: Callable[[Any], tuple[Any, Any]] | None = None,
) -> ChipModel:
    """The model's step from the same samples against the host's float32.

    Parameters
    ----------
    module : dict
        Namespace of the generated Python module.
    kind : str
        Filter kind, such as "ickf".
    box : BoxSamples
        B samples.
    number : type, optional
        The model's number.
    sin_cos : callable, optional
        The model's sine and cosine, where the chip has instructions for them.

    Raises
    ------
    FloatingPointError
        No sample stays a number.
    """
    host = one_step(module, kind, box, "float32")
    with np.errstate(all="ignore"):  # Newton steps of lanes whose divisor is zero
        fpu32 = one_step(module, kind, box, "float32", number, sin_cos)
        flushed = one_step(module, kind, box, "float32", Flushed)
    return ChipModel(_compare(module, fpu32, host), _compare(module, flushed, host))


def _compare(
    module: dict[str, Any], single: tuple[np.ndarray, np.ndarray], double: tuple[np.ndarray, np.ndarray]
) -> Certificate:
    """Deviation of the first run from the second."""
    dx = np.abs(single[0] - double[0])
    angle = module["ANGLE"]
    dx[angle] = np.abs(np.remainder(single[0][angle] - double[0][angle] + np.pi, 2 * np.pi) - np.pi)
    P, exact = single[1], double[1]
    sigma = np.sqrt(np.einsum("bii->bi", exact))
    scale = sigma[:, :, None] * sigma[:, None, :]
    dP = np.max(np.abs(P - exact) / scale, axis=(1, 2))
    good = np.all(np.isfinite(single[0]), axis=0) & np.isfinite(dP)
    if not np.any(good):
        raise FloatingPointError("no sample of the operating box stays a number")
    return Certificate(
        samples=int(good.size),
        x=tuple(float(np.max(row[good])) for row in dx),
        P_99=float(np.quantile(dP[good], 0.99)),
        P=float(np.max(dP[good])),
        not_finite=int(np.sum(~good)),
        indefinite=_indefinite(P[good] / scale[good]),
    )


def _indefinite(P: np.ndarray) -> int:
    """How many of P (B, n, n) are not positive definite; eigenvalues, ten times dearer, where a factor says so."""
    try:
        np.linalg.cholesky(P)
    except np.linalg.LinAlgError:
        return int(np.sum(np.linalg.eigvalsh(P)[:, 0] <= 0))
    return 0


def full_matrices(packed: np.ndarray, n: int) -> np.ndarray:
    """Packed lower triangles (n(n+1)/2, B) -> (n, n, B), symmetric.

    Parameters
    ----------
    packed : ndarray, (n(n+1)/2, B)
        Row by row.
    n : int
        Rows of a matrix.
    """
    full = np.empty((n, n, packed.shape[1]))
    rows, columns = np.tril_indices(n)
    full[rows, columns] = full[columns, rows] = packed
    return full


def one_step(
    module: dict[str, Any],
    kind: str,
    box: BoxSamples,
    dtype: str,
    number: Callable[[Any], Any] = lambda value: value,
    sin_cos: Callable[[Any], tuple[Any, Any]] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """x (n, B) and P (B, n, n) after one step from every sample, as float64 arrays.

    Parameters
    ----------
    module : dict
        Namespace of the generated Python module.
    kind : str
        Filter kind, such as "ickf".
    box : BoxSamples
        B samples.
    dtype : str
        "float32" or "float64".
    number : callable, optional
        Makes a quantity of the modelled arithmetic from one of NumPy.
    sin_cos : callable, optional
        In the place of the module's own.
    """
    math = module["MATH"][dtype]
    if sin_cos is not None:
        math = type("Math", (math,), {"sin_cos": staticmethod(sin_cos)})
    state = module["new_filter"](lambda value: number(math.dtype(value)))
    words = module["pack"](full_matrices(box.P, len(module["STATES"]))).astype(np.float32)
    x, P, u, y = (tuple(number(row) for row in rows.astype(math.dtype)) for rows in (box.x, words, box.u, box.y))
    state.x = x
    setattr(state, module["COVARIANCE"], P)
    state.u_held = tuple(number(row) for row in np.zeros_like(box.u, dtype=math.dtype))
    module["STEPS"][kind](state, u, y, math)
    left = np.array(getattr(state, module["COVARIANCE"]), dtype=float)
    return np.array(state.x, dtype=float), np.moveaxis(module["unpack"](left), 2, 0)
