"""Link A-B: the hand-written reference against the generated float64 step, every stage and every iterate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.filters.program import FilterStep
from model.quantities import Stage
from runtime.estimator.numpy_backend import NumpyBackend
from runtime.proof.compare import Sigmas, entries_of, relative_error
from runtime.proof.motors import Plant
from runtime.proof.reference import make_reference
from runtime.proof.result import Divergence, Link, Row

Array = NDArray[Any]

#: |A - B| relative to the row's scale. Both are float64 and differ in the order of operations only: some
#: hundred roundings of 1e-16 each, times what the step amplifies them by (the condition of Pyy and of the
#: Cholesky factors, below 1e4 inside the box).
ALLOWED = 1e-10


@dataclass(frozen=True)
class Situations:
    """Steps to take: before each, x (N, n) and P (N, n, n); inputs u (N, 2) V, y (N, 2) A; A's stages."""

    name: str
    x: Array
    P: Array
    u: Array
    y: Array
    stages: dict[str, Array]
    iterates: list[dict[str, Array]]
    counts: Array

    @property
    def condition(self) -> Array:
        """Of Pyy, (N,)."""
        return np.asarray(np.linalg.cond(self.iterates[0]["Pyy"] if self.iterates else self.stages["Pyy"]))


def reference_run(
    name: str,
    parameters: Mapping[str, Any],
    step: FilterStep,
    starts: tuple[Array, Array],
    u: Array,
    y: Array,
    motor: Plant | None = None,
) -> Situations:
    """Run the reference from several starts side by side; situations come start by start, in each step by step.

    Where iterating is proved idle the reference iterates N_max times regardless of (33), to show it.

    Parameters
    ----------
    starts : tuple
        x (M, n) and P (M, n, n): where each run begins.
    u, y : array, (steps, M, 2)
        V and A of each run.
    motor : Plant, optional
        The second statement of a machine that is not shipped.
    """
    reference = make_reference(parameters, step.kind, step.gain, starts[0], motor)
    reference.P = starts[1].copy()
    if step.iteration_proof:
        reference.eps = -1.0
    before_x, before_P, records = [], [], []
    for u_k, y_k in zip(u, y, strict=True):
        before_x.append(reference.x.copy())
        before_P.append(reference.P.copy())
        records.append(reference.step(u_k, y_k))
    counts = _in_order([r.get("iterations", np.zeros(len(starts[0]), dtype=int)) for r in records])
    iterates = []
    for j in range(max(len(r.get("iterates", ())) for r in records)):  # a step that ended earlier repeats its last one
        chosen = [r["iterates"][min(j, len(r["iterates"]) - 1)] for r in records]
        iterates.append({key: _in_order([item[key] for item in chosen]) for key in chosen[0]})
    names = [key for key in records[0] if key not in ("iterates", "iterations")]
    stages = {key: _in_order([r[key] for r in records]) for key in names}
    befores = _in_order(before_x), _in_order(before_P), _in_order(list(u)), _in_order(list(y))
    return Situations(name, *befores, stages, iterates, counts)


def _in_order(values: Sequence[Array]) -> Array:
    """(steps, M, ...) -> (M steps, ...)."""
    array = np.swapaxes(np.asarray(values), 0, 1)
    return array.reshape(-1, *array.shape[2:])


def pieces_of(run: tuple[Array, Array], start: tuple[Array, Array], piece: int) -> tuple[Array, Array]:
    """Where the pieces of a trajectory begin, as a filter's own run has it: x (M, n), P (M, n, n).

    Parameters
    ----------
    run : tuple
        x (N, n), P (N, n, n) after each step.
    start : tuple
        x_0 (n,), P_0 (n, n): where the first piece begins, and every piece at whose beginning the run is no longer a
        filter's: no number, or a P without a root. What is compared with the run there shows it.
    """
    x_0, P_0 = start
    x, P = (
        np.concatenate([first[None], after[piece - 1 : -1 : piece]]) for first, after in zip(start, run, strict=True)
    )
    for k in range(len(x)):
        if not (np.isfinite(x[k]).all() and np.isfinite(P[k]).all() and np.linalg.eigvalsh(P[k])[0] > 0):
            x[k], P[k] = x_0, P_0
    return x, P


def link_ab(module: ModuleType, step: FilterStep, drive: str, situations: Situations, R: Array) -> Link:
    """Evaluate the generated step on every situation at once and compare stage by stage.

    Parameters
    ----------
    module : ModuleType
        The generated Python module.
    step : FilterStep
        The step of the filter.
    drive : str
        A shipped name, the path of a TOML file, or a generated folder.
    situations : Situations
        States, covariances and inputs to compare at.
    R : ndarray
        Variances of the measurement noise, A^2.
    """
    found, iterates, counts, theta = _evaluate(module, step.kind, situations)
    sigmas = _sigmas(situations, R)
    comparisons = [*_pairs(step, situations, found, iterates)]
    rows, first = [], None
    for equation, label, stage, expected, values, lanes in comparisons:
        error = relative_error(stage, expected[lanes], values[lanes], _take(sigmas, lanes), module.ANGLE)
        worst = float(error.max(initial=0.0))
        rows.append(Row(equation, label, stage.meaning, worst, ALLOWED, int(error.size)))
        if worst > ALLOWED:
            candidate = _first(equation, label, stage, error, lanes, expected, values)
            first = candidate if first is None or candidate.step < first.step else first
    if not step.iteration_proof and step.kind == "ickf":
        rows.append(
            Row(
                "33",
                "same number of iterates",
                "both loops stop alike",
                float(np.abs(counts - situations.counts).max()),
                0.0,
                len(counts),
            )
        )
    outside = int(np.sum(~((theta >= -np.pi) & (theta < np.pi))))
    rows.append(Row("34", "theta in [-pi, pi)", "angles outside", float(outside), 0.0, len(theta)))
    return Link(
        "A-B", "reference = generated float64", drive, step.kind, step.gain, situations.name, tuple(rows), first
    )


def _evaluate(
    module: ModuleType, kind: str, s: Situations
) -> tuple[dict[str, Array], list[dict[str, Array]], Array, Array]:
    """The generated step with one lane a situation; stages as (N, entries), iterations and theta after it (N,)."""
    backend = NumpyBackend(module, kind, "float64")
    backend.reset(s.x.T.copy(), module.pack(np.moveaxis(s.P, 0, 2)))
    stages: dict[str, Any] = {}
    backend.step(s.u.T.copy(), s.y.T.copy(), stages)
    lanes = len(s.u)
    iterates = [{key: _lanes(values, lanes) for key, values in item.items()} for item in stages.pop("iterates", [])]
    found = {key: _lanes(values, lanes) for key, values in stages.items()}
    return found, iterates, backend.iterations, np.asarray(backend.filter.x[module.ANGLE])


def _lanes(values: Any, count: int) -> Array:
    """A tuple of scalars and lanes -> (N, entries)."""
    return np.stack([np.broadcast_to(np.asarray(value, dtype=float), (count,)) for value in values], axis=1)


def _sigmas(s: Situations, R: Array) -> Sigmas:
    Pyy = s.iterates[0]["Pyy"] if s.iterates else s.stages["Pyy"]
    state, innovation = (np.sqrt(np.einsum("kii->ki", c)) for c in (s.stages["P_pred"], Pyy))
    offset = np.max(np.abs(s.stages["x_pred"]) / state, axis=1)
    return Sigmas(state, innovation, np.sqrt(R), s.condition, offset)


def _take(sigmas: Sigmas, lanes: Array) -> Sigmas:
    ill = sigmas.condition[lanes], np.asarray(sigmas.offset)[lanes]
    return Sigmas(sigmas.state[lanes], sigmas.innovation[lanes], sigmas.noise, *ill)


def _pairs(step: FilterStep, s: Situations, found: dict[str, Array], iterates: list[dict[str, Array]]) -> Any:
    """(equation, label, stage, expected, found, lanes): every stage, then every iterate's."""
    everyone = np.arange(len(s.u))
    looped = {stage.name for block in step.blocks if block.name.endswith("iterate") for stage in block.stages}
    for block in step.blocks:
        for stage in block.stages:
            if stage.scale == "none":
                continue
            if stage.name in looped and block.name.endswith("iterate"):
                for j, expected in enumerate(s.iterates):
                    lanes = np.flatnonzero(s.counts > j)
                    values = (
                        iterates[j][stage.name] if j < len(iterates) else np.full_like(iterates[-1][stage.name], np.nan)
                    )
                    yield stage.equation, f"{stage.name}, j = {j}", stage, expected[stage.name], values, lanes
            elif stage.name in s.stages:
                yield stage.equation, stage.name, stage, s.stages[stage.name], found[stage.name], everyone
            else:
                yield stage.equation, stage.name, stage, s.iterates[0][stage.name], found[stage.name], everyone
                if stage.name == "x_next":
                    for j, expected in enumerate(s.iterates[1:], start=1):
                        yield "33", f"x_next, j = {j} (idle)", stage, expected["x_next"], found["x_next"], everyone


def _first(
    equation: str, label: str, stage: Stage, error: Array, lanes: Array, expected: Array, values: Array
) -> Divergence:
    where = int(np.flatnonzero((error > ALLOWED).any(axis=1))[0])
    k = int(np.argmax(error[where] > ALLOWED))
    lane = int(lanes[where])
    wanted = entries_of(stage, expected[lane : lane + 1])[0, k]
    return Divergence(
        lane, equation, label, stage.names[k], float(wanted), float(values[lane, k]), f"{ALLOWED:g} of the row's scale"
    )


def own_run(module: ModuleType, kind: str, starts: tuple[Array, Array], u: Array, y: Array) -> tuple[Array, Array]:
    """B on its own along u, y (N, 2) from x_0 (n,), P_0 (n, n): x (N, n) and P (N, n, n) after each step.

    Parameters
    ----------
    module : ModuleType
        The generated Python module.
    kind : str
        Filter kind, such as "ickf".
    starts : tuple[Array, Array]
    u : ndarray
        Voltages, V, (N, 2).
    y : ndarray
        Currents, A, (N, 2).
    """
    backend = NumpyBackend(module, kind, "float64")
    backend.reset(starts[0].copy(), module.pack(starts[1]))
    x, words, _, _ = backend.run(u, y)
    return x, np.moveaxis(module.unpack(words.T), 2, 0)


def free_run(step: FilterStep, drive: str, situations: Situations, run: tuple[Array, Array], angle: int) -> Link:
    """B's own run against A's pieces, each begun where B's run then was: errors must not build up in any.

    Piece by piece A ends where the next begins, so B's whole run is A's as well.

    Parameters
    ----------
    step : FilterStep
        The step of the filter.
    drive : str
        A shipped name, the path of a TOML file, or a generated folder.
    situations : Situations
        States, covariances and inputs to compare at.
    run : tuple[Array, Array]
    angle : int
        Electrical angle, rad.
    """
    x, P = run
    A_x, A_P = situations.stages["x"], situations.stages["P"]
    sigma = np.sqrt(np.einsum("kii->ki", A_P))
    dx = x - A_x
    dx[:, angle] = np.remainder(dx[:, angle] + np.pi, 2 * np.pi) - np.pi
    error_x = np.abs(dx) / np.maximum(sigma, np.abs(A_x))
    error_P = np.abs(P - A_P) / (sigma[:, :, None] * sigma[:, None, :])
    rows_out = (
        Row("25, 34", "x, run on its own", "estimate", _worst(error_x), ALLOWED, error_x.size),
        Row("26, 32", "P, run on its own", "covariance", _worst(error_P), ALLOWED, error_P.size),
    )
    return Link(
        "A-B", "reference = generated float64", drive, step.kind, step.gain, f"{situations.name}, free run", rows_out
    )


def _worst(error: Array) -> float:
    return float(error.max()) if np.isfinite(error).all() else float("inf")
