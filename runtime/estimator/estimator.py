"""The estimator: one face over the NumPy and the C form of a generated filter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from runtime.estimator.folder import GeneratedFolder, find_folder
from runtime.system.errors import UserError

Array = NDArray[Any]


@dataclass(frozen=True)
class Trace:
    """The record of a run: x (N, n), P (N, n, n), iterations (N,), status (N,); a batch adds a last axis B.

    ``status`` is 0 where all is well, else the sum of these bits: 1 input rejected, 2 not converged, 4 command
    rejected (controllers), 8 covariance repaired, 16 diverged, 32 restarted; docs/firmware.md says what each asks for.
    P is worked
    out of the filter's own ``words`` (N, n(n+1)/2) when it is first asked for.
    """

    x: Array
    iterations: Array
    status: Array
    words: Array = field(repr=False)
    unpack: Callable[[Array], Array] = field(repr=False)

    @cached_property
    def P(self) -> Array:
        """Covariances, symmetric."""
        return self.unpack(self.words)

    def __reduce__(self) -> tuple[Any, ...]:
        """Between processes a trace travels with its P worked out: what unpacks it belongs to a generated module."""
        return _unpacked_trace, (self.x, self.iterations, self.status, self.words, self.P)


def _unpacked_trace(x: Array, iterations: Array, status: Array, words: Array, P: Array) -> Trace:
    return Trace(x, iterations, status, words, lambda _: P)


class Backend(Protocol):
    """The back end that executes the steps. Lanes are the last axis; P travels as the filter's own n(n+1)/2 words."""

    @property
    def iterations(self) -> Array:
        """Measurement updates made in the last step."""

    @property
    def status(self) -> Array:
        """Status bits of the last step."""

    def reset(self, x0: Array, words: Array) -> None:
        """Start from a state and covariance words.

        Parameters
        ----------
        x0 : ndarray, (n[, B])
            State; without B for a single filter.
        words : ndarray, (n(n+1)/2[, B])
            The filter's own covariance words.
        """

    def state(self) -> tuple[Array, Array]:
        """x and the covariance words, copies."""

    def snapshot(self) -> Any:
        """All that the next step depends on; :meth:`restore` goes on from it."""

    def restore(self, snapshot: Any) -> None:
        """Go back to where a snapshot was taken; not across a reset.

        Parameters
        ----------
        snapshot : Any
            What :meth:`snapshot` gave.
        """

    def estimate(self) -> Array:
        """x, a copy."""

    def step(self, u: Array, y: Array) -> None:
        """Step every lane once.

        Parameters
        ----------
        u : ndarray, (2[, B])
            Mean voltage over the interval that ends now, V.
        y : ndarray, (2[, B])
            Currents now, A.
        """

    def bound_step(self) -> Callable[[ArrayLike, ArrayLike], Array | None] | None:
        """For a single filter: step and estimate in one, where that is quicker; to be taken again after a reset.

        The function takes pairs of plain numbers and returns None, having done nothing, for anything else.
        """

    def run(self, u: Array, y: Array, last_only: bool = False) -> tuple[Array, Array, Array, Array]:
        """Run N steps.

        Parameters
        ----------
        u, y : ndarray, (N, 2[, B])
            Voltages, V, and currents, A.
        last_only : bool
            Keep the last step alone: N = 1 in what is returned.

        Returns
        -------
        tuple of ndarray
            x (N, n[, B]), covariance words, iterations, status.
        """


class Estimator:
    """A generated filter, ready to run; made by :func:`load`.

    >>> import runtime
    >>> f = runtime.load("paper_spmsm", filter="ckf")
    >>> f.step([0.0, 0.0], [0.0, 0.0]).round(6) + 0.0
    array([0., 0., 0., 0.])
    """

    def __init__(self, folder: GeneratedFolder, kind: str, backend: Backend, dtype: str) -> None:
        module = folder.module
        self.drive = folder.drive
        self.filter = kind
        self.dtype = dtype
        self.state_names: tuple[str, ...] = module.STATES
        self.state_units: tuple[str, ...] = module.UNITS
        self.sample_time: float = module.SAMPLE_TIME
        self.tuning: dict[str, Any] = dict(module.DEFAULTS)
        self._backend = backend
        self._batch: int | None = None
        self._pack, self._unpacked = module.pack, module.unpack
        self.reset()

    @property
    def backend(self) -> Backend:
        """The back end that executes the steps; its state is the filter's own, bit for bit."""
        return self._backend

    @property
    def x(self) -> Array:
        """The estimate, (n,) or (n, B)."""
        return self._backend.estimate()

    @property
    def P(self) -> Array:
        """Its covariance, (n, n) or (n, n, B)."""
        return self._unpack(self._backend.state()[1], axis=0)

    @property
    def status(self) -> Array:
        """Status of the last step: 0 or bits, one a lane."""
        return self._backend.status

    @property
    def iterations(self) -> Array:
        """Measurement updates made in the last step, one number a lane."""
        return self._backend.iterations

    def reset(self, x0: ArrayLike | None = None, P0: ArrayLike | None = None) -> None:
        """Start over.

        Parameters
        ----------
        x0 : array_like, (n,) or (n, B), optional
            Default: the drive's x_0. A batch axis starts B filters.
        P0 : array_like, (n,) variances, (n, n) or (n, n, B), optional
            Default: the drive's P_0.

        Raises
        ------
        UserError
            On a wrong shape or a covariance that is not positive definite.
        """
        n = len(self.state_names)
        x = np.array(self.tuning["x_0"] if x0 is None else x0, dtype=self.dtype)
        P = np.asarray(self.tuning["P_0"] if P0 is None else P0, dtype=float)
        if x.ndim not in {1, 2} or x.shape[0] != n:
            raise UserError(
                f"x0 has shape {x.shape}; this drive needs ({n},) or ({n}, B): {', '.join(self.state_names)}."
            )
        if P.shape == (n,):
            P = np.diag(P)
        if P.shape[:2] != (n, n) or P.ndim not in {2, 3}:
            raise UserError(f"P0 has shape {P.shape}; this drive needs ({n},), ({n}, {n}) or ({n}, {n}, B).")
        matrices = P[None] if P.ndim == 2 else np.moveaxis(P, 2, 0)
        if not np.all(np.isfinite(P)) or np.min(np.linalg.eigvalsh((matrices + matrices.swapaxes(1, 2)) / 2)) <= 0:
            raise UserError("P0 is not positive definite.")
        lanes = {a.shape[-1] for a, batched in ((x, x.ndim == 2), (P, P.ndim == 3)) if batched}
        if len(lanes) > 1:
            raise UserError(f"x0 has {x.shape[-1]} lanes, P0 has {P.shape[-1]}.")
        words = np.asarray(self._pack(P)).astype(self.dtype)
        self._start(x, words, lanes.pop() if lanes else None)

    def step(self, u: ArrayLike, y: ArrayLike) -> Array:
        """One time update with u, then one measurement update with y.

        Parameters
        ----------
        u : array_like, (2,) or (2, B)
            v_alpha, v_beta in V, mean over the interval ending now.
        y : array_like, (2,) or (2, B)
            i_alpha, i_beta in A, now.

        Returns
        -------
        numpy.ndarray, (n,) or (n, B)
            The new estimate (a copy).
        """
        quick = self._bound_step
        if quick is not None:
            x = quick(u, y)
            if x is not None:
                return x
        u, y = np.asarray(u, dtype=self.dtype), np.asarray(y, dtype=self.dtype)
        if u.shape != y.shape or u.shape[:1] != (2,) or u.ndim > 2:
            raise UserError(f"u has shape {u.shape}, y {y.shape}; step needs (2,) or (2, B) for both.")
        if (u.shape[1] if u.ndim == 2 else None) != self._batch:
            self._broadcast(u.shape[1:])
        self._backend.step(u, y)
        return self._backend.estimate()

    def run(self, u: ArrayLike, y: ArrayLike, keep: str = "all") -> Trace:
        """All steps of a trajectory.

        Parameters
        ----------
        u, y : array_like, (N, 2) or (N, 2, B)
        keep : {"all", "last"}
            ``"last"`` leaves a trace of the last step alone (N = 1): a large batch then writes next to nothing.

        Returns
        -------
        Trace
        """
        u, y = np.asarray(u, dtype=self.dtype), np.asarray(y, dtype=self.dtype)
        if u.shape != y.shape or u.ndim not in {2, 3} or u.shape[1] != 2:
            raise UserError(f"u has shape {u.shape}, y {y.shape}; run needs (N, 2) or (N, 2, B) for both.")
        if (u.shape[2] if u.ndim == 3 else None) != self._batch:
            self._broadcast(u.shape[2:])
        if keep not in {"all", "last"}:
            raise UserError(f"keep '{keep}' is not all or last.")
        x, words, iterations, status = self._backend.run(u, y, keep == "last")
        return Trace(x, iterations, status, words, self.unpack)

    def unpack(self, words: Array) -> Array:
        """Work out covariances of the filter's words.

        Parameters
        ----------
        words : ndarray, (N, n(n+1)/2[, B])
            As a trace has them.

        Returns
        -------
        ndarray, (N, n, n[, B])
            P, symmetric.
        """
        return self._unpack(words, axis=1)

    def _start(self, x: Array, words: Array, batch: int | None) -> None:
        self._batch = batch
        if batch is not None:
            x = np.broadcast_to(x if x.ndim == 2 else x[:, None], (x.shape[0], batch))
            words = np.broadcast_to(words if words.ndim == 2 else words[:, None], (words.shape[0], batch))
        self._backend.reset(np.ascontiguousarray(x), np.ascontiguousarray(words))
        self._bound_step = self._backend.bound_step() if batch is None else None

    def _broadcast(self, lanes: tuple[int, ...]) -> None:
        """A single filter met a batch: every lane goes on from its state."""
        if self._batch is not None:
            given = f"{lanes[0]} lanes" if lanes else "no batch axis"
            raise UserError(f"this estimator runs {self._batch} lanes; the input has {given}. Call reset() first.")
        x, words = self._backend.state()
        self._start(x, words, lanes[0])

    def _unpack(self, words: Array, axis: int) -> Array:
        """Covariance words on ``axis`` -> two axes (n, n), symmetric."""
        P = np.asarray(self._unpacked(np.moveaxis(words, axis, 0)))
        return np.moveaxis(P, (0, 1), (axis, axis + 1)).astype(self.dtype)


def load(drive: str | Path, filter: str | None = None, backend: str = "numpy", dtype: str = "float64") -> Estimator:
    """Load a generated filter.

    Parameters
    ----------
    drive : str or Path
        A shipped name (``"paper_spmsm"``), or the path of a generated folder.
    filter : str, optional
        A kind the drive was generated for; default its ``ickf``, else its first.
    backend : {"numpy", "c"}
        ``"c"`` compiles the generated C with the system's compiler (once; cached by content).
    dtype : {"float64", "float32"}
        float32 computes the bits of the firmware, on both back ends.

    Raises
    ------
    UserError
        With one line: unknown drive or filter, a folder edited by hand, no C compiler.
    """
    return load_folder(find_folder(drive), filter, backend, dtype)


def load_folder(folder: GeneratedFolder, kind: str | None, backend: str, dtype: str) -> Estimator:
    """Load a filter of a folder already found; see :func:`load`.

    Parameters
    ----------
    folder : GeneratedFolder
    kind : str or None
        Filter kind; None: the ickf where there is one, else the first.
    backend : {"numpy", "c"}
    dtype : {"float32", "float64"}
    """
    kind = folder.chosen(kind)
    if dtype not in {"float32", "float64"}:
        raise UserError(f"dtype '{dtype}' is not float32 or float64.")
    return Estimator(folder, kind, _backend(folder, kind, backend, dtype), dtype)


def _backend(folder: GeneratedFolder, kind: str, backend: str, dtype: str) -> Backend:
    if backend == "numpy":
        from runtime.estimator.numpy_backend import NumpyBackend

        return NumpyBackend(folder.module, kind, dtype)
    if backend == "c":
        from runtime.estimator.c_backend import CBackend

        return CBackend(folder, kind, dtype)
    raise UserError(f"backend '{backend}' is not numpy or c.")
