"""Link D-E: the float32 step executed by NumPy against the generated C, scalar and lane form, bit for bit."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from codegen.evidence.box import BoxSamples
from model.filters.program import FilterStep
from runtime.estimator.c_backend import CBackend
from runtime.estimator.compiler import compiler_name
from runtime.estimator.folder import GeneratedFolder
from runtime.estimator.numpy_backend import NumpyBackend
from runtime.proof.probe import Entries, c_entries, first_parted, locate, numpy_entries, parted
from runtime.proof.result import Divergence, Link, Row
from runtime.proof.starts import Start, from_box, pieces

Array = NDArray[Any]

#: How the C is compiled: plain, as usual, and with everything this processor offers (FMA contraction stays off).
OPTIMISATIONS: tuple[tuple[str, ...], ...] = (("-O0",), ("-O2",), ("-O3", "-march=native"))


def same_bits(a: Array, b: Array) -> Array:
    """Entry by entry: identical bit patterns (so NaN equals the same NaN, and 0 differs from -0).

    Parameters
    ----------
    a, b : ndarray of float32
        Of one shape.
    """
    return np.asarray(np.ascontiguousarray(a).view(np.uint32) == np.ascontiguousarray(b).view(np.uint32))


class Bits:
    """Runs D once and compares as many compilations of E with it as are wanted."""

    def __init__(self, folder: GeneratedFolder, step: FilterStep, u: Array, y: Array, box: BoxSamples) -> None:
        self.folder, self.step, module = folder, step, folder.module
        self.u, self.y = u.astype(np.float32), y.astype(np.float32)
        self.x0 = np.array(module.DEFAULTS["x_0"], dtype=np.float32)
        self.words0 = module.pack(np.diag(module.DEFAULTS["P_0"])).astype(np.float32)
        numpy = NumpyBackend(module, step.kind, "float32")
        numpy.reset(self.x0.copy(), self.words0.copy())
        self.trace = numpy.run(self.u, self.y)
        self.singles = tuple(from_box(module, box))
        self.starts = (*self.singles, pieces(module, self.u, self.y))
        self.expected = [self._run(NumpyBackend(module, step.kind, "float32"), start) for start in self.starts]

    def link(self, optimisation: tuple[str, ...]) -> Link:
        """Compare one compilation, along the trajectory and from every start; the plain one, inside the step too.

        Parameters
        ----------
        optimisation : tuple of str
            The compiler's flags, such as ("-O2",).
        """
        backend = CBackend(self.folder, self.step.kind, "float32", optimisation, lanes=False)
        backend.reset(self.x0.copy(), self.words0.copy())
        trace = backend.run(self.u, self.y)
        data = f"{len(self.u)} steps and {self.singles[0].lanes} draws, {compiler_name()} {' '.join(optimisation)}"
        inside, parts = self._inside() if optimisation == OPTIMISATIONS[0] else ((), None)
        rows = (*_rows("trajectory", self.trace, trace), *self._from_starts(backend), *inside)
        return self._link("NumPy float32 = C, bit for bit", data, rows, self._first(trace) or parts)

    def lane_link(self) -> Link:
        """Compare the lane form as batches run it: from every start, all lanes side by side."""
        backend = CBackend(self.folder, self.step.kind, "float32")
        steps = len(self.starts[-1].u)
        lanes, draws = self.starts[-1].lanes, self.singles[0].lanes
        data = f"{steps} steps of {lanes} lanes and {draws} draws, lane form, {compiler_name()}"
        rows = self._from_starts(backend)
        first = self._first_lane(self.expected[-1], self._run(backend, self.starts[-1]))
        return self._link("NumPy float32 = each lane of a batch in C, bit for bit", data, rows, first)

    def _from_starts(self, backend: CBackend) -> tuple[Row, ...]:
        """Rows of every start."""
        rows: list[Row] = []
        for start, expected in zip(self.starts, self.expected, strict=True):
            found = self._run(backend, start)
            rows += [*_rows(start.where, expected[:4], found[:4]), *_kept_rows(start.where, expected[4:], found[4:])]
        return tuple(rows)

    def _run(self, backend: CBackend | NumpyBackend, start: Start) -> tuple[Array, ...]:
        start.load(backend)
        return (*backend.run(start.u, start.y), *self._kept(backend, start.lanes))

    def _kept(self, backend: CBackend | NumpyBackend, lanes: int) -> tuple[Array, Array]:
        """The fields of the struct beside the estimate when a run is over: reals and counts, a row a lane."""
        names = [name for name in ("nis", "repairs") if name in self.folder.text(self._header)]
        if isinstance(backend, NumpyBackend):
            f = backend.filter
            held = np.stack([np.broadcast_to(v, lanes) for v in f.u_held], axis=1)
            others = [np.broadcast_to(getattr(f, name), lanes) for name in names]
        else:
            held = np.array([list(backend.filters[k].u_held) for k in range(lanes)])
            others = [np.array([getattr(backend.filters[k], name) for k in range(lanes)]) for name in names]
        reals = [held.T, *(v[None] for name, v in zip(names, others, strict=True) if name == "nis")]
        counts = [v for name, v in zip(names, others, strict=True) if name == "repairs"]
        return np.concatenate(reals).astype(np.float32), np.array(counts, dtype=np.int64)

    @property
    def _header(self) -> str:
        return f"{self.folder.drive}_{self.step.kind}.h"

    # --- inside a step

    @cached_property
    def entries(self) -> list[Entries]:
        """The intermediate values that NumPy computes from the single steps' starts."""
        return [numpy_entries(self.folder, self.step.kind, start) for start in self._once]

    @property
    def _once(self) -> list[Start]:
        """The single steps' starts; of a loop one pass, so that it is the last one of every lane."""
        return [replace(s, tuning={**s.tuning, "max_iterations": np.ones(s.lanes, int)}) for s in self.singles]

    def _inside(self) -> tuple[tuple[Row, ...], Divergence | None]:
        """Every named entry of every stage, in every lane that passes by: what is rounded off later is seen here."""
        rows, first = [], None
        for start, expected in zip(self._once, self.entries, strict=True):
            found = c_entries(self.folder, self.step.kind, start)
            counts = [(int(different.sum()), compared) for _, different, compared in parted(expected, found)]
            worst, compared = (sum(column) for column in zip(*counts, strict=True))
            rows.append(Row("13-34", f"stages, {start.where}", "every named entry", float(worst), 0.0, compared))
            first = first or first_parted(self.step, expected, found, 0, f"draw of the {start.where}")
        return tuple(rows), first

    def _link(self, claim: str, data: str, rows: tuple[Row, ...], first: Divergence | None) -> Link:
        return Link("D-E", claim, self.folder.drive, self.step.kind, self.step.gain, data, rows, first)

    def _first_lane(self, expected: tuple[Array, ...], found: tuple[Array, ...]) -> Divergence | None:
        """The first step in which a lane of the trajectory's pieces parts."""
        different = np.concatenate([~same_bits(a, b) for a, b in zip(expected[:2], found[:2], strict=True)], axis=1)
        if not different.any():
            return None
        k, element, lane = (int(v) for v in np.argwhere(different)[0])
        n = len(self.x0)
        port, index = (0, element) if element < n else (1, element - n)
        name = ("x", self.folder.module.COVARIANCE)[port] + f"[{index}], lane {lane}"
        wanted, got = (float(trace[port][k, index, lane]) for trace in (expected, found))
        return Divergence(k, "25-34", "output of the step", name, wanted, got, "identical bits")

    def _first(self, trace: tuple[Array, ...]) -> Divergence | None:
        """The first step whose bits differ, then the first stage inside it."""
        n = len(self.x0)
        equal = np.concatenate([same_bits(self.trace[0], trace[0]), same_bits(self.trace[1], trace[1])], axis=1)
        if equal.all():
            return None
        k, element = (int(v) for v in np.argwhere(~equal)[0])
        x, words = (self.x0, self.words0) if k == 0 else (self.trace[0][k - 1], self.trace[1][k - 1])
        start = Start("trajectory", x[:, None], words[:, None], self.u[k, :, None][None], self.y[k, :, None][None])
        inside = locate(self.folder, self.step, start, k)
        if inside is not None:
            return inside
        port, index = (0, element) if element < n else (1, element - n)
        name = ("x", self.folder.module.COVARIANCE)[port] + f"[{index}]"
        found, expected = float(trace[port][k, index]), float(self.trace[port][k, index])
        return Divergence(k, "25-34", "output of the step", name, expected, found, "identical bits")


def _rows(where: str, expected: tuple[Array, ...], found: tuple[Array, ...]) -> tuple[Row, ...]:
    return (
        _row("25, 34", f"x, {where}", "estimate", expected[0], found[0]),
        _row("26, 32", f"P, {where}", "covariance", expected[1], found[1]),
        _integers("33", f"status, iterations, {where}", expected[2:], found[2:]),
    )


def _kept_rows(where: str, expected: tuple[Array, ...], found: tuple[Array, ...]) -> tuple[Row, ...]:
    return (
        _row("-", f"voltage held, innovations' average, {where}", "struct", expected[0], found[0]),
        _integers("-", f"repairs, {where}", expected[1:], found[1:]),
    )


def _row(equation: str, stage: str, meaning: str, expected: Array, found: Array) -> Row:
    different = int(np.sum(~same_bits(expected, found)))
    return Row(equation, stage, meaning, float(different), 0.0, int(expected.size))


def _integers(equation: str, stage: str, expected: tuple[Array, ...], found: tuple[Array, ...]) -> Row:
    different = sum(int(np.sum(a != b)) for a, b in zip(expected, found, strict=True))
    return Row(equation, stage, "control flow", float(different), 0.0, sum(int(a.size) for a in expected))
