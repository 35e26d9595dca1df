"""Link B-C: the literal step against the fast one, both generated, both float64."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.filters.program import FilterStep
from runtime.estimator.numpy_backend import NumpyBackend
from runtime.proof.compare import covariance_scale, minuend_scale
from runtime.proof.link_ab import Situations
from runtime.proof.result import Divergence, Link, Row

Array = NDArray[Any]

#: |B - C|, states in sigmas (or relative, if the state is larger), covariances relative to sigma_i sigma_j. The
#: fast form orders every sum and product anew and carries other numbers (L D L^T), so that rounding differs
#: throughout; what a step amplifies it by (see link A-B) lies below 1e5 inside the box.
ALLOWED = 1e-9


@dataclass(frozen=True)
class _Taken:
    """One step from every situation: x (N, n), P (N, n, n); P_pred and x_pred; the iterates' x_next."""

    x: Array
    P: Array
    x_pred: Array
    P_pred: Array
    x_next: list[Array]
    counts: Array
    condition: Array  # of Pyy, (N,); 0 where the form does not name it
    change_error: Array | None  # of |x^{j+1} - x^j|^2 against this form's own iterates, relative


def link_bc(literal: ModuleType, fast: ModuleType, step: FilterStep, drive: str, situations: Situations) -> Link:
    """One step of either form from every situation; x_pred, P_pred, every iterate, x and P compared.

    Parameters
    ----------
    literal, fast : module
        The generated Python of either form.
    step : FilterStep
        Tells kind and gain, for the table.
    drive : str
        The drive's name, for the table.
    situations : Situations
        N of them.
    """
    b, c = (_take(module, step.kind, situations) for module in (literal, fast))
    pairs = [
        ("16", "x_pred", _state_error(b.x_pred, c.x_pred, b.P_pred, fast.ANGLE)),
        ("17", "P_pred", _covariance_error(b.P_pred, c.P_pred)),
    ]
    for j, (x_b, x_c) in enumerate(zip(b.x_next, c.x_next, strict=False)):
        real = (b.counts > j) & (c.counts > j)
        error = _state_error(x_b, x_c, b.P_pred, fast.ANGLE)
        error[~real] = 0.0
        pairs.append(("31", f"x_next, j = {j}", error))
    if c.change_error is not None:  # a small state's share of it shows in no iterate
        pairs.append(("33", "|x^{j+1} - x^j|^2", c.change_error))
    pairs += [
        ("25, 34", "x", _state_error(b.x, c.x, b.P, fast.ANGLE)),
        ("26, 32", "P", _covariance_error(b.P, c.P, b)),
    ]
    rows = [Row(equation, stage, "", float(error.max()), ALLOWED, int(error.size)) for equation, stage, error in pairs]
    rows.append(_counted(b.counts, c.counts))
    claim = "literal form = fast form, float64"
    first = _first(pairs, fast.STATES)
    return Link("B-C", claim, drive, step.kind, step.gain, situations.name, tuple(rows), first)


def _take(module: ModuleType, kind: str, s: Situations) -> _Taken:
    backend = NumpyBackend(module, kind, "float64")
    backend.reset(s.x.T.copy(), module.pack(np.moveaxis(s.P, 0, 2)))
    stages: dict[str, Any] = {}
    with _heard(module) as passes:
        backend.step(s.u.T.copy(), s.y.T.copy(), stages)
    x, words = backend.state()
    n = len(x)
    P_pred = np.empty((len(s.u), n, n))
    rows, columns = np.tril_indices(n)
    P_pred[:, rows, columns] = P_pred[:, columns, rows] = np.array(stages["P_pred"]).T
    iterates = stages.get("iterates") or ([stages] if "x_next" in stages else [])
    return _Taken(
        x.T,
        np.moveaxis(module.unpack(words), 2, 0),
        np.array(stages["x_pred"]).T,
        P_pred,
        [np.array(item["x_next"]).T for item in iterates],
        backend.iterations,
        _condition((stages.get("iterates") or [stages])[0].get("Pyy"), len(s.u)),
        np.array([_change_error(*one) for one in passes]).max(axis=0) if passes else None,
    )


def _condition(Pyy: Any, lanes: int) -> Array:
    """Of the lower triangle of a 2x2 covariance, (lanes,)."""
    if Pyy is None:
        return np.zeros(lanes)
    a, b, c = (np.broadcast_to(np.asarray(entry, dtype=float), (lanes,)) for entry in Pyy)
    return np.asarray(np.linalg.cond(np.moveaxis(np.array([[a, b], [b, c]]), -1, 0)))


@contextmanager
def _heard(module: ModuleType) -> Iterator[list[tuple[Array, Array, Array]]]:
    """Every pass of the ICKF's loop while this is open: x^j, x^{j+1} (n, N) and its |x^{j+1} - x^j|^2 (N,)."""
    iterate, passes = getattr(module, "ickf_iterate", None), list[tuple[Array, Array, Array]]()

    def heard(x_j: Any, *rest: Any) -> Any:
        found = iterate(x_j, *rest)  # type: ignore[misc]
        passes.append((np.array(x_j), np.array(found[0]), np.array(found[-1][0])))
        return found

    if iterate is not None:
        vars(module)["ickf_iterate"] = heard
    try:
        yield passes
    finally:
        if iterate is not None:
            vars(module)["ickf_iterate"] = iterate


def _change_error(before: Array, after: Array, change: Array) -> Array:
    moved = np.sum((after - before) ** 2, axis=0)
    return _finite(np.abs(change - moved) / np.maximum(moved, np.finfo(float).tiny))


def _state_error(expected: Array, found: Array, P: Array, angle: int) -> Array:
    difference = found - expected
    difference[:, angle] = np.remainder(difference[:, angle] + np.pi, 2 * np.pi) - np.pi
    scale = np.maximum(np.sqrt(np.einsum("kii->ki", P)), np.abs(expected))
    return _finite(np.abs(difference) / scale)


def _covariance_error(expected: Array, found: Array, literal: _Taken | None = None) -> Array:
    """Relative to sigma_i sigma_j; of P, which the literal form takes from P_pred, to a share of P_pred's at least."""
    scale = covariance_scale(expected)
    if literal is not None:
        sigma = np.sqrt(np.einsum("kii->ki", literal.P_pred))
        scale = np.maximum(scale, minuend_scale(sigma, literal.condition))
    return _finite(np.abs(found - expected) / scale)


def _finite(error: Array) -> Array:
    return np.where(np.isfinite(error), error, np.inf)


def _counted(b: Array, c: Array) -> Row:
    return Row("33", "same number of passes", "both loops stop alike", float(np.sum(b != c)), 0.0, int(b.size))


def _first(pairs: list[tuple[str, str, Array]], states: tuple[str, ...]) -> Divergence | None:
    """The first stage, in the order of the equations, that deviates; there the worst of the situations."""
    for equation, stage, error in pairs:
        if error.max() > ALLOWED:
            where = np.unravel_index(int(np.argmax(error)), error.shape)
            element = ", ".join(states[int(i)] for i in where[1:])
            worst = float(error[where])
            return Divergence(int(where[0]), equation, stage, element, 0.0, worst, f"{ALLOWED:g} relative")
    return None
