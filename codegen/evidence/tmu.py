"""A NumPy model of the C28x's FPU32 with its trigonometric math unit (TMU).

Adding, multiplying and flushing are the FPU32's. Division and root are instructions (DIVF32, SQRTF32), sine and cosine
are those of an angle in turns (SINPUF32, COSPUF32), behind one multiplication by 1 / (2 pi). TI publishes what they
compute and how long it takes; a bound of their errors was not at hand. So each is taken as the exact value cut to
float32, towards zero: off by less than a unit in the last place, and always to the same side. Modelled, not measured.

>>> float(TMU32(1.0) / 3.0) <= 1 / 3 < float(TMU32(1.0) / 3.0) + 2.0**-24
True
"""

from __future__ import annotations

from typing import Any

import numpy as np

from codegen.evidence.fpu32 import Flushed, Value, flush

#: 1 / (2 pi), the constant of the C.
PER_TURN = np.float32(0.15915494)


def cut(exact: Any) -> Value:
    """float32 towards zero; denormals become zero.

    Parameters
    ----------
    exact : float64 or ndarray of float64
    """
    nearest = np.asarray(exact).astype(np.float32)
    beyond = np.abs(nearest.astype(np.float64)) > np.abs(exact)
    return flush(np.where(beyond, np.nextafter(nearest, np.float32(0)), nearest)[()])


def divide(a: Value, b: Value) -> Value:
    """DIVF32: A / b, cut.

    Parameters
    ----------
    a, b : float32 or ndarray of float32
    """
    return cut(np.asarray(a, dtype=np.float64) / np.asarray(b, dtype=np.float64))


def square_root(x: Value) -> Value:
    """SQRTF32: sqrt(x), cut.

    Parameters
    ----------
    x : float32 or ndarray of float32
    """
    return cut(np.sqrt(np.asarray(x, dtype=np.float64)))


class TMU32(Flushed):
    """float32 as an FPU32 with a TMU computes it."""

    __slots__ = ()
    _quotient = staticmethod(divide)
    _root = staticmethod(square_root)


def sin_cos(x: Any) -> tuple[Any, Any]:
    """SINPUF32 and COSPUF32 of x / (2 pi), each cut.

    Parameters
    ----------
    x : TMU32
        rad.

    Returns
    -------
    sine, cosine : TMU32
    """
    turns = np.asarray((x * PER_TURN).value, dtype=np.float64)
    with np.errstate(invalid="ignore"):
        angle = 2 * np.pi * (turns - np.floor(turns))
    return TMU32(cut(np.sin(angle))), TMU32(cut(np.cos(angle)))
