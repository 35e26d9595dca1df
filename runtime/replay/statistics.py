"""Whether a filter is consistent with its data: normalised innovation squared and whiteness.

After Bar-Shalom, Li, Kirubarajan 2001, section 5.4. Two measurements make every chi-square here one of even degree,
so its distribution is elementary.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.replay.innovations import Innovations

Array = NDArray[Any]

LAGS = 20
#: Beyond this mean of the normalised innovation squared no tuning makes up for what is wrong.
MISFIT = 30.0
#: An autocorrelation beyond this is not that of noise of the wrong size.
PERSISTENT = 0.5
#: Steps taken at once: their arrays stay in the processor's cache.
BLOCK = 8192
#: Two-sided 95 % of a normal variable.
Z_95 = 1.959963984540054
#: Two-sided 95 % of the NIS of one step, chi-square with 2 degrees: an exponential of mean 2.
NIS_BAND = (-2 * math.log(0.975), -2 * math.log(0.025))


@dataclass(frozen=True)
class Consistency:
    """Of ``steps`` measurements that were taken.

    nis_mean, expected 2, with the 95 % band of a mean of so many; nis_inside: share of steps within their own 95 %
    band; bias (2,): mean of the whitened innovations, with its band +-; correlation (2, LAGS): their autocorrelation at
    lags 1, 2, ... with its band +-; outside: share of these beyond it (expected 0.05); ljung_box (2,): p of white noise
    having correlations so large.
    """

    steps: int
    nis_mean: float
    nis_band: tuple[float, float]
    nis_inside: float
    bias: tuple[float, ...]
    bias_band: float
    correlation: tuple[tuple[float, ...], ...]
    correlation_band: float
    outside: float
    ljung_box: tuple[float, ...]

    @property
    def fits(self) -> bool:
        """Whether currents, voltages and motor may be of one machine, as far as any tuning goes."""
        return self.nis_mean <= MISFIT

    @property
    def suspicious(self) -> bool:
        """Whether innovations are too large and go on in one direction: wrong data, not wrong noise."""
        return not self.fits or (self.nis_mean > self.nis_band[1] and max(map(max, self.correlation)) > PERSISTENT)

    @property
    def verdict(self) -> str:
        """In words."""
        low, high = self.nis_band
        if not self.fits:
            size = "innovations far larger than the filter expects: currents, voltages and motor do not fit each other"
        elif self.nis_mean > high:
            size = "innovations larger than the filter expects: P, Q or R are too small for this data"
        elif self.nis_mean < low:
            size = "innovations smaller than the filter expects: P, Q or R are too large for this data"
        else:
            size = "innovations of the size the filter expects"
        return size + (", white" if min(self.ljung_box) >= 0.01 else ", correlated in time")

    def to_json(self) -> dict[str, Any]:
        """Return every figure as plain data."""
        return {**asdict(self), "verdict": self.verdict}


def consistency(innovations: Innovations) -> Consistency | None:
    """Work out the statistics of a run; None if fewer than 2 LAGS measurements were taken.

    Parameters
    ----------
    innovations : Innovations
    """
    low, high = NIS_BAND
    N = len(innovations.nu)
    z, steps, inside, total = np.empty((2, N)), 0, 0, 0.0
    for first in range(0, N, BLOCK):
        rows = slice(first, min(first + BLOCK, N))
        block = innovations.whitened(rows).T
        good = np.isfinite(block[0]) & np.isfinite(block[1])
        z[:, rows] = np.where(good, block, 0.0)
        nis = (block[0] ** 2 + block[1] ** 2)[good]
        steps, total = steps + len(nis), total + float(nis.sum())
        inside += int(np.count_nonzero((nis >= low) & (nis <= high)))
    if steps <= 2 * LAGS:
        return None
    correlation = [autocorrelation(column, LAGS) for column in z]
    band = Z_95 / math.sqrt(steps)
    return Consistency(
        steps=steps,
        nis_mean=total / steps,
        nis_band=mean_band(steps),
        nis_inside=inside / steps,
        bias=tuple(float(column.sum() / steps) for column in z),
        bias_band=band,
        correlation=tuple(tuple(float(r) for r in row) for row in correlation),
        correlation_band=band,
        outside=float(np.mean(np.abs(correlation) > band)),
        ljung_box=tuple(ljung_box(row, steps) for row in correlation),
    )


def mean_band(steps: int) -> tuple[float, float]:
    """Return where 95 % of the means of chi-square variables of degree 2 lie (Wilson and Hilferty's cube root).

    Parameters
    ----------
    steps : int
        How many a mean is of.
    """
    degree = 2 * steps
    spread = 2 / (9 * degree)
    low, high = (2 * (1 - spread + sign * Z_95 * math.sqrt(spread)) ** 3 for sign in (-1, 1))
    return low, high


def autocorrelation(z: Array, lags: int) -> Array:
    """Estimate the autocorrelation, the mean taken as zero: the filter claims so.

    Parameters
    ----------
    z : ndarray, (N,)
        Normalised innovations.
    lags : int
        Lags 1 .. lags are returned.
    """
    power = float(z @ z)
    products = np.zeros(lags)
    for first in range(0, len(z), BLOCK):  # a block and what it is multiplied with stay in the cache
        block = z[first : first + BLOCK]
        for lag in range(1, lags + 1):
            begin = max(first, lag)
            products[lag - 1] += block[begin - first :] @ z[begin - lag : first + len(block) - lag]
    return products / power if power else products


def ljung_box(correlation: Array, steps: int) -> float:
    """Return the p-value of Ljung and Box's test.

    Parameters
    ----------
    correlation : ndarray, (lags,)
        At an even number of lags.
    steps : int
        Number of samples.
    """
    lags = len(correlation)
    Q = steps * (steps + 2) * float(np.sum(correlation**2 / (steps - np.arange(1, lags + 1))))
    return chi_square_tail(Q, lags)


def chi_square_tail(q: float, degree: int) -> float:
    """Return P(chi-square > q) for an even degree: a Poisson sum.

    Parameters
    ----------
    q : float
    degree : int
        Even.

    Examples
    --------
    >>> round(chi_square_tail(31.41, 20), 4)
    0.05
    """
    log_terms = [k * math.log(q / 2) - math.lgamma(k + 1) for k in range(degree // 2)] if q > 0 else [0.0]
    top = max(log_terms)
    return min(1.0, math.exp(top - q / 2) * sum(math.exp(term - top) for term in log_terms)) if q > 0 else 1.0
