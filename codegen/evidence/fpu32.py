"""A NumPy model of the C28x's FPU32, so that the generated Python runs unchanged on the chip's arithmetic.

The FPU32 rounds to nearest even like the host, but makes no denormals (operands and results are flushed to zero),
compares NaN as infinity, and has no divide or square root: an 8-bit seed (EINVF32, EISQRTF32) is refined by two
Newton steps, each operation rounded (iteration and operand order as in TI's instruction references). The seeds'
tables follow an emulator and are unverified on silicon, so what this model says is modelled, not measured.

>>> x = FPU32(1.0) / 3.0
>>> float(x) == float(np.float32(1) / np.float32(3)), abs(float(x) - 1 / 3) < 3 * 2.0**-25
(True, True)
>>> float(Flushed(1e-38) * 1.0)
0.0
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

#: A float32 scalar or array: the model works on either, lane by lane.
Value = Any

TINY = np.float32(2.0**-126)  # smallest normal number
_INFINITY = np.float32(np.inf)
_FRACTIONS = 1 + np.arange(128) / 128  # mantissas cut to their top 7 bits


def _seed_table(exact: NDArray[np.float64]) -> NDArray[np.float32]:
    """Values in (1, 2], rounded to 7 bits behind the point."""
    return np.asarray(1 + np.floor(128 * (exact - 1) + 0.5) / 128, dtype=np.float32)


_RECIPROCAL = _seed_table(2 / _FRACTIONS)
#: Rows: even and odd exponent.
_INVERSE_ROOT = np.stack([_seed_table(2 / np.sqrt(_FRACTIONS)), _seed_table(2 / np.sqrt(2 * _FRACTIONS))])


def flush(value: Value) -> Value:
    """Denormals become zero with their sign; NaN and infinity pass.

    Parameters
    ----------
    value : float32 or ndarray of float32
    """
    if isinstance(value, np.ndarray):
        return value * (np.abs(value) >= TINY)  # by one or by zero: both keep the sign
    return value * np.float32(0) if -TINY < value < TINY else value


def _split(value: Value) -> tuple[Any, Any]:
    """Top 7 mantissa bits and exponent of |value| = (1 + i / 128 + ...) 2^e; 0 for what is no finite number."""
    finite = np.where(np.isfinite(value), np.abs(value), np.float32(0))
    mantissa, exponent = np.frexp(finite)
    index = np.where(finite > 0, np.floor((2 * mantissa - 1) * 128), 0).astype(int)
    return index, exponent - 1


def reciprocal_seed(value: Value) -> Value:
    """EINVF32: 1 / value to about 8 bits; infinity for 0, 0 for infinity and where 1 / value is denormal.

    Parameters
    ----------
    value : float32 or ndarray of float32
        No denormal.
    """
    index, exponent = _split(value)
    seed = flush(np.ldexp(_RECIPROCAL[index], -1 - exponent))
    seed = np.where(value == 0, _INFINITY, np.where(np.isinf(value), np.float32(0), seed))
    return np.copysign(seed, value)[()]


def inverse_root_seed(value: Value) -> Value:
    """EISQRTF32: 1 / sqrt(value) to about 8 bits; infinity for 0, 0 for infinity.

    Parameters
    ----------
    value : float32 or ndarray of float32
        No denormal; of a negative value the sign is not looked at.
    """
    index, exponent = _split(value)
    seed = np.ldexp(_INVERSE_ROOT[exponent % 2, index], -1 - exponent // 2)
    return np.where(value == 0, _INFINITY, np.where(np.isinf(value), np.float32(0), seed))[()]


def divide(a: Value, b: Value) -> Value:
    """A / b as the fast run-time library does it: y = seed(b), twice y = y (2 - y b), then a y.

    Within 3 units in the last place where 1 / b is normal (|b| <= 2^126); beyond, the quotient is 0. Of a million
    random quotients 52 % are exact, 45 % off by one unit, 3.3 % by two, 0.01 % by three.

    Parameters
    ----------
    a : Value
        Left operand.
    b : Value
        Right operand.
    """
    y = seed = reciprocal_seed(b)
    for _ in range(2):
        y = flush(y * flush(np.float32(2) - flush(y * b)))
    special = (b == 0) | np.isinf(b)
    return flush((a * np.where(special, seed, y))[()])


def square_root(x: Value) -> Value:
    """sqrt(x): y = seed(x), twice y = y (1.5 - y (y x / 2)), then x y; 0 for 0, NaN for a negative x.

    Within 3 units in the last place for x >= 2^-125; below, x / 2 is flushed and the result is wrong. Of a million
    random roots 56 % are exact, 42 % off by one unit, 2.4 % by two, 0.002 % by three.

    Parameters
    ----------
    x : float32 or ndarray of float32
        No denormal.
    """
    y = inverse_root_seed(x)
    half = flush(x * np.float32(0.5))
    for _ in range(2):
        y = flush(y * flush(np.float32(1.5) - flush(y * flush(y * half))))
    root = np.where((x == 0) | (x == _INFINITY), x, flush((x * y)[()]))
    return np.where(x < 0, np.float32(np.nan), root)[()]


def _ordered(value: Value) -> Value:
    """A value as comparisons see it: NaN counts as infinity of its sign."""
    if isinstance(value, np.ndarray):
        return np.where(np.isnan(value), np.copysign(_INFINITY, value), value)
    return value if value == value else np.copysign(_INFINITY, value)


class Flushed:
    """float32 with denormals flushed to zero; division and square root as IEEE has them.

    Holds a scalar or an array of lanes and takes part in ``+ - * /``, ``np.sqrt``, ``np.where`` and comparisons;
    numbers it meets are rounded to float32 first.
    """

    __slots__ = ("value",)

    def __init__(self, value: Any) -> None:
        self.value = flush(np.asarray(value, dtype=np.float32)[()])

    @classmethod
    def _of(cls, result: Value) -> Self:
        new = object.__new__(cls)
        new.value = flush(result)
        return new

    def _raw(self, other: Any) -> Value:
        return other.value if type(other) is type(self) else flush(np.asarray(other, dtype=np.float32)[()])

    # --- arithmetic

    @staticmethod
    def _quotient(a: Value, b: Value) -> Value:
        return a / b

    @staticmethod
    def _root(x: Value) -> Value:
        return np.sqrt(x)

    def __add__(self, other: Any) -> Self:
        return self._of(self.value + self._raw(other))

    __radd__ = __add__

    def __sub__(self, other: Any) -> Self:
        return self._of(self.value - self._raw(other))

    def __rsub__(self, other: Any) -> Self:
        return self._of(self._raw(other) - self.value)

    def __mul__(self, other: Any) -> Self:
        return self._of(self.value * self._raw(other))

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Self:
        return self._of(self._quotient(self.value, self._raw(other)))

    def __rtruediv__(self, other: Any) -> Self:
        return self._of(self._quotient(self._raw(other), self.value))

    def __neg__(self) -> Self:
        return self._of(-self.value)

    def sqrt(self) -> Self:
        """Take the square root by seed and Newton steps, denormals flushed."""
        return self._of(self._root(self.value))

    # --- comparisons

    def __lt__(self, other: Any) -> Any:
        return _ordered(self.value) < _ordered(self._raw(other))

    def __le__(self, other: Any) -> Any:
        return _ordered(self.value) <= _ordered(self._raw(other))

    def __gt__(self, other: Any) -> Any:
        return _ordered(self.value) > _ordered(self._raw(other))

    def __ge__(self, other: Any) -> Any:
        return _ordered(self.value) >= _ordered(self._raw(other))

    # --- NumPy

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        operation = _UFUNCS.get(ufunc)
        if operation is None or method != "__call__" or options:
            return NotImplemented  # a TypeError that names the function: the model must learn it first
        cls = type(self)
        return operation(*(item if isinstance(item, cls) else cls(item) for item in inputs))

    def __array_function__(self, function: Any, types: Any, args: Any, kwargs: Any) -> Any:
        if function is np.where and len(args) == 3:
            return self._of(np.where(args[0], self._raw(args[1]), self._raw(args[2]))[()])
        return NotImplemented

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.array(self.value, dtype=dtype)

    def __getitem__(self, key: Any) -> Self:
        return self if key == () else self._of(self.value[key])

    def __float__(self) -> float:
        return float(self.value)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.value!r})"


class FPU32(Flushed):
    """float32 as the C28x's FPU32 computes it: flushed, and division and square root by Newton steps."""

    __slots__ = ()
    _quotient = staticmethod(divide)
    _root = staticmethod(square_root)


_UFUNCS: dict[Any, Callable[..., Any]] = {
    np.add: lambda a, b: a + b,
    np.subtract: lambda a, b: a - b,
    np.multiply: lambda a, b: a * b,
    np.true_divide: lambda a, b: a / b,
    np.negative: lambda a: -a,
    np.sqrt: lambda a: a.sqrt(),
    np.less: lambda a, b: a < b,
    np.less_equal: lambda a, b: a <= b,
    np.greater: lambda a, b: a > b,
    np.greater_equal: lambda a, b: a >= b,
}
