"""Link D-E: the float32 step executed by NumPy against the generated C, scalar and lane form, bit for bit."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from codegen.box import BoxSamples
from codegen.certificate import full_matrices
from model.filters.program import FilterStep
from runtime.estimator.c_backend import CBackend
from runtime.estimator.compiler import find_compiler
from runtime.estimator.folder import GeneratedFolder
from runtime.estimator.numpy_backend import NumpyBackend
from runtime.proof.probe import locate
from runtime.proof.result import Divergence, Link, Row

Array = NDArray[Any]

#: How the C is compiled: plain, as usual, and with everything this processor offers (FMA contraction stays off).
OPTIMISATIONS: tuple[tuple[str, ...], ...] = (("-O0",), ("-O2",), ("-O3", "-march=native"))

#: Pieces the trajectory is cut into for the lane form: no multiple of any vector's length.
PIECES = 21


def same_bits(a: Array, b: Array) -> Array:
    """Entry by entry: identical bit patterns (so NaN equals the same NaN, and 0 differs from -0)."""
    return np.asarray(np.ascontiguousarray(a).view(np.uint32) == np.ascontiguousarray(b).view(np.uint32))


class Bits:
    """Runs D once and compares as many compilations of E with it as are wanted."""

    def __init__(self, folder: GeneratedFolder, step: FilterStep, u: Array, y: Array, box: BoxSamples) -> None:
        self.folder, self.step = folder, step
        self.u, self.y = u.astype(np.float32), y.astype(np.float32)
        self.box = box
        self.numpy = NumpyBackend(folder.module, step.kind, "float32")
        module = folder.module
        self.x0 = np.array(module.DEFAULTS["x_0"], dtype=np.float32)
        self.words0 = module.pack(np.diag(module.DEFAULTS["P_0"])).astype(np.float32)
        self.box_words = module.pack(full_matrices(box.P, len(self.x0))).astype(np.float32)
        self.numpy.reset(self.x0.copy(), self.words0.copy())
        self.trace = self.numpy.run(self.u, self.y)
        self.lanes = self._box(self.numpy)

    def link(self, optimisation: tuple[str, ...]) -> Link:
        """Compare one compilation, along the trajectory and from every draw of the box."""
        backend = CBackend(self.folder, self.step.kind, "float32", optimisation, lanes=False)
        backend.reset(self.x0.copy(), self.words0.copy())
        trace = backend.run(self.u, self.y)
        data = f"{len(self.u)} steps and {self.box.x.shape[1]} draws, {find_compiler()[0]} {' '.join(optimisation)}"
        rows = (*_rows("trajectory", self.trace, trace), *_rows("box", self.lanes, self._box(backend)))
        return self._link("NumPy float32 = C, bit for bit", data, rows, self._first(trace))

    def lane_link(self) -> Link:
        """Compare the lane form as batches run it: pieces of the trajectory side by side, and every draw of the box."""
        u, y, x0, words0 = self._pieces()
        backend = CBackend(self.folder, self.step.kind, "float32")
        runs = []
        for each in (self.numpy, backend):
            each.reset(x0.copy(), words0.copy())
            runs.append(each.run(u, y))
        data = f"{len(u)} steps of {PIECES} lanes and {self.box.x.shape[1]} draws, lane form, {find_compiler()[0]}"
        rows = (*_rows("trajectory", *runs), *_rows("box", self.lanes, self._box(backend)))
        return self._link("NumPy float32 = each lane of a batch in C, bit for bit", data, rows, self._first_lane(*runs))

    def _box(self, backend: CBackend | NumpyBackend) -> tuple[Array, ...]:
        """One step from every draw of the box."""
        backend.reset(self.box.x.astype(np.float32), self.box_words.copy())
        return backend.run(self.box.u.astype(np.float32)[None], self.box.y.astype(np.float32)[None])

    def _pieces(self) -> tuple[Array, Array, Array, Array]:
        """The trajectory cut up, and where each piece starts: u, y, x and covariance words with a lane axis.

        Every third piece starts with an angle so uncertain that its turns are wide; three inputs are to be rejected.
        """
        steps = len(self.u) // PIECES
        u, y = (a[: steps * PIECES].reshape(PIECES, steps, 2).transpose(1, 2, 0).copy() for a in (self.u, self.y))
        u[steps // 2, 0, 1], y[steps // 3, 1, 2], y[steps // 4, 0, -1] = np.nan, np.inf, 1e9
        uncertain = np.where(np.arange(PIECES) % 3 == 0, np.float32(16), np.float32(1))
        return u, y, np.repeat(self.x0[:, None], PIECES, axis=1), self.words0[:, None] * uncertain

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
        before = (self.x0, self.words0) if k == 0 else (self.trace[0][k - 1], self.trace[1][k - 1])
        inside = locate(self.folder, self.step, before, self.u[k], self.y[k], k)
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


def _row(equation: str, stage: str, meaning: str, expected: Array, found: Array) -> Row:
    different = int(np.sum(~same_bits(expected, found)))
    return Row(equation, stage, meaning, float(different), 0.0, int(expected.size))


def _integers(equation: str, stage: str, expected: tuple[Array, ...], found: tuple[Array, ...]) -> Row:
    different = sum(int(np.sum(a != b)) for a, b in zip(expected, found, strict=True))
    return Row(equation, stage, "control flow", float(different), 0.0, sum(int(a.size) for a in expected))
