"""Executes the generated Python: straight-line NumPy, on scalars or on arrays of lanes."""

from __future__ import annotations

import copy
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


class NumpyBackend:
    """One generated filter in NumPy; see :class:`runtime.estimator.estimator.Backend`."""

    def __init__(self, module: ModuleType, kind: str, dtype: str) -> None:
        self._step = module.STEPS[kind]
        self._covariance: str = module.COVARIANCE
        self.math = module.MATH[dtype]
        self.filter = module.new_filter(self.math.dtype)

    def reset(self, x0: Array, words: Array) -> None:
        """Start from a state and covariance words; see :meth:`Backend.reset`.

        Parameters
        ----------
        x0 : ndarray, (n[, B])
        words : ndarray, (n(n+1)/2[, B])
        """
        self.filter.x = tuple(x0)
        setattr(self.filter, self._covariance, tuple(words))
        self.filter.u_held = tuple(np.zeros((2, *x0.shape[1:]), dtype=self.math.dtype))
        self.filter.iterations = np.zeros(x0.shape[1:], dtype=int)
        self.filter.nis, self.filter.repairs = self.math.dtype(0), 0
        self.status: Array = np.zeros(x0.shape[1:], dtype=int)

    @property
    def iterations(self) -> Array:
        """Measurement updates made in the last step, ([B],)."""
        return np.asarray(self.filter.iterations)

    def state(self) -> tuple[Array, Array]:
        """Copy x and the covariance words."""
        return self.estimate(), np.array(getattr(self.filter, self._covariance), dtype=self.math.dtype)

    def snapshot(self) -> Any:
        """Copy the filter; its fields are replaced by every step, never changed."""
        return copy.copy(self.filter)

    def restore(self, snapshot: Any) -> None:
        """Go back to where a snapshot was taken; see :meth:`Backend.restore`.

        Parameters
        ----------
        snapshot : Any
        """
        self.filter = copy.copy(snapshot)

    def estimate(self) -> Array:
        """Copy x."""
        return np.array(self.filter.x, dtype=self.math.dtype)

    def step(self, u: Array, y: Array, stages: dict[str, Any] | None = None) -> None:
        """Step every lane once.

        Parameters
        ----------
        u : ndarray, (2[, B])
            Mean voltage over the interval that ends now, V.
        y : ndarray, (2[, B])
            Currents now, A.
        stages : dict, optional
            Receives every stage's entries by name.
        """
        # A diverging filter shows in its numbers and its status, not in warnings from inside generated code.
        with np.errstate(all="ignore"):
            self.status = np.asarray(self._step(self.filter, tuple(u), tuple(y), self.math, stages))

    def bound_step(self) -> None:
        """Nothing is quicker than :meth:`step`."""

    def run(self, u: Array, y: Array, last_only: bool = False) -> tuple[Array, Array, Array, Array]:
        """Run N steps; see :meth:`Backend.run`.

        Parameters
        ----------
        u, y : ndarray, (N, 2[, B])
            Voltages, V, and currents, A.
        last_only : bool
            Keep the last step alone.

        Returns
        -------
        tuple of ndarray
            x, covariance words, iterations, status.
        """
        steps, lanes = u.shape[0], u.shape[2:]
        if last_only and steps > 1:
            for k in range(steps - 1):
                self.step(u[k], y[k])
            return self.run(u[-1:], y[-1:])
        x = np.empty((steps, len(self.filter.x), *lanes), dtype=self.math.dtype)
        words = np.empty((steps, len(getattr(self.filter, self._covariance)), *lanes), dtype=self.math.dtype)
        iterations, status = np.empty((2, steps, *lanes), dtype=np.int32)
        for k in range(steps):
            self.step(u[k], y[k])
            x[k], words[k] = self.filter.x, getattr(self.filter, self._covariance)
            iterations[k], status[k] = self.filter.iterations, self.status
        return x, words, iterations, status
