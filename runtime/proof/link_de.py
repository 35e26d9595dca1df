"""Link D-E: the float32 step executed by NumPy against the generated C, bit for bit."""

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
        self.numpy.reset(box.x.astype(np.float32), self.box_words.copy())
        self.lanes = self.numpy.run(box.u.astype(np.float32)[None], box.y.astype(np.float32)[None])

    def link(self, optimisation: tuple[str, ...]) -> Link:
        """Compare one compilation, along the trajectory and from every draw of the box."""
        backend = CBackend(self.folder, self.step.kind, "float32", optimisation)
        backend.reset(self.x0.copy(), self.words0.copy())
        trace = backend.run(self.u, self.y)
        first = self._first(trace)
        backend.reset(self.box.x.astype(np.float32), self.box_words.copy())
        lanes = backend.run(self.box.u.astype(np.float32)[None], self.box.y.astype(np.float32)[None])
        rows = (
            _row("25, 34", "x, trajectory", "estimate", self.trace[0], trace[0]),
            _row("26, 32", "P, trajectory", "covariance", self.trace[1], trace[1]),
            _integers("33", "status, iterations", self.trace[2:], trace[2:]),
            _row("25, 34", "x, box", "estimate", self.lanes[0], lanes[0]),
            _row("26, 32", "P, box", "covariance", self.lanes[1], lanes[1]),
        )
        steps = f"{len(self.u)} steps and {self.box.x.shape[1]} draws, {find_compiler()[0]} {' '.join(optimisation)}"
        claim = "NumPy float32 = C, bit for bit"
        return Link("D-E", claim, self.folder.drive, self.step.kind, self.step.gain, steps, rows, first)

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


def _row(equation: str, stage: str, meaning: str, expected: Array, found: Array) -> Row:
    different = int(np.sum(~same_bits(expected, found)))
    return Row(equation, stage, meaning, float(different), 0.0, int(expected.size))


def _integers(equation: str, stage: str, expected: tuple[Array, ...], found: tuple[Array, ...]) -> Row:
    different = sum(int(np.sum(a != b)) for a, b in zip(expected, found, strict=True))
    return Row(equation, stage, "control flow", float(different), 0.0, sum(int(a.size) for a in expected))
