"""Link D-E: the float32 step executed by NumPy against the generated C, scalar and lane form, bit for bit."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from codegen.box import BoxSamples
from codegen.certificate import full_matrices
from codegen.small_angle import LIMIT, UNKNOWN
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

#: Angles at which the last bit of each coefficient of sine and cosine shows, sought among four million.
TELLING = (1.5846115350723267, -1.4174660444259644, 3.141575574874878, 1.687328815460205, 1.6679680347442627)


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
        rows = (
            *_rows("trajectory", self.trace, trace),
            *_rows("box", self.lanes, self._box(backend)),
            *_rows("box, wide turns", self.wide, self._box(backend, self._wide_words())),
            *_rows("box, angle alone unknown", self.sharp, self._sharp(backend)),
            *_rows("pieces", self.pieces[:4], (pieces := self._run_pieces(backend))[:4]),
            *_kept_rows(self.pieces[4:], pieces[4:]),
        )
        return self._link("NumPy float32 = C, bit for bit", data, rows, self._first(trace))

    def lane_link(self) -> Link:
        """Compare the lane form as batches run it: pieces of the trajectory side by side, and every draw of the box."""
        backend = CBackend(self.folder, self.step.kind, "float32")
        runs = self.pieces, self._run_pieces(backend)
        steps = len(self.pieces[0])
        data = f"{steps} steps of {PIECES} lanes and {self.box.x.shape[1]} draws, lane form, {find_compiler()[0]}"
        rows = (
            *_rows("pieces", *(run[:4] for run in runs)),
            *_kept_rows(*(run[4:] for run in runs)),
            *_rows("box", self.lanes, self._box(backend)),
            *_rows("box, wide turns", self.wide, self._box(backend, self._wide_words())),
            *_rows("box, angle alone unknown", self.sharp, self._sharp(backend)),
        )
        return self._link("NumPy float32 = each lane of a batch in C, bit for bit", data, rows, self._first_lane(*runs))

    def _box(self, backend: CBackend | NumpyBackend, words: Array | None = None) -> tuple[Array, ...]:
        """One step from every draw of the box, or from its states with other covariances."""
        backend.reset(self.box.x.astype(np.float32), (self.box_words if words is None else words).copy())
        return backend.run(self.box.u.astype(np.float32)[None], self.box.y.astype(np.float32)[None])

    @cached_property
    def pieces(self) -> tuple[Array, ...]:
        """What NumPy makes of the pieces."""
        return self._run_pieces(NumpyBackend(self.folder.module, self.step.kind, "float32"))

    @cached_property
    def wide(self) -> tuple[Array, ...]:
        """What NumPy makes of the box where every column turns far."""
        return self._box(NumpyBackend(self.folder.module, self.step.kind, "float32"), self._wide_words())

    @cached_property
    def sharp(self) -> tuple[Array, ...]:
        """What NumPy makes of the box where everything is known but the angle."""
        return self._sharp(NumpyBackend(self.folder.module, self.step.kind, "float32"))

    def _sharp(self, backend: CBackend | NumpyBackend) -> tuple[Array, ...]:
        """One step at rest, nothing uncertain or about to be but the angle, every other measurement rejected.

        What only a bend moves is then not rounded off in what is larger.
        """
        module = self.folder.module
        x, y, words = self.box.x.copy(), self.box.y.copy(), np.zeros_like(self.box_words)
        x[2], x[module.ANGLE, : len(TELLING)], y[0, ::2] = 0.0, TELLING, np.nan
        Q = 1e-12 * np.array(module.DEFAULTS["Q"])
        for place, state in enumerate(self._order):
            words[place * (place + 3) // 2] = 1e6 * Q[state]
        backend.reset(x.astype(np.float32), self._turned(words, UNKNOWN))
        self._set(backend, {"Q": np.tile(Q[:, None], words.shape[1])})
        return backend.run(self.box.u.astype(np.float32)[None], y.astype(np.float32)[None])

    def _wide_words(self) -> Array:
        """The draws' covariances, but the angle as uncertain along every column as a bend is well seen at."""
        return self._turned(self.box_words.copy(), 2 * LIMIT)

    def _turned(self, words: Array, widest: float) -> Array:
        """Covariances in which every column turns theta by a d^2 up to ``widest``, in place; P as it is."""
        n, angle = len(self.x0), self._order.index(self.folder.module.ANGLE)
        if self.folder.module.COVARIANCE != "LD":
            return words
        rng = np.random.default_rng(2)
        row = angle * (angle + 1) // 2
        for column in range(angle):
            z = rng.uniform(0, widest / n, words.shape[1])
            words[row + column] = np.sqrt(z / words[column * (column + 3) // 2])
        words[row + angle] = rng.uniform(0, widest / n, words.shape[1])
        return words

    @property
    def _order(self) -> tuple[int, ...]:
        """Which state has which row of the covariance's words."""
        return tuple(getattr(self.folder.module, "ORDER", range(len(self.x0))))

    def _run_pieces(self, backend: CBackend | NumpyBackend) -> tuple[Array, ...]:
        """The trajectory cut up, its pieces side by side, each with a tuning of its own."""
        u, y, x0, words0 = self._pieces()
        backend.reset(x0, words0)
        self._tune(backend)
        return (*backend.run(u, y), *self._kept(backend))

    def _kept(self, backend: CBackend | NumpyBackend) -> tuple[Array, Array]:
        """What the struct holds beside the estimate when a run is over: reals and counts, a row a lane."""
        names = [name for name in ("nis", "repairs") if name in self.folder.text(self._header)]
        lanes = range(PIECES)
        if isinstance(backend, NumpyBackend):
            f = backend.filter
            held = np.stack([np.broadcast_to(v, PIECES) for v in f.u_held], axis=1)
            others = [np.broadcast_to(getattr(f, name), PIECES) for name in names]
        else:
            held = np.array([list(backend.filters[k].u_held) for k in lanes])
            others = [np.array([getattr(backend.filters[k], name) for k in lanes]) for name in names]
        reals = [held.T, *(v[None] for name, v in zip(names, others, strict=True) if name == "nis")]
        counts = [v for name, v in zip(names, others, strict=True) if name == "repairs"]
        return np.concatenate(reals).astype(np.float32), np.array(counts, dtype=np.int64)

    @property
    def _header(self) -> str:
        return f"{self.folder.drive}_{self.step.kind}.h"

    def _pieces(self) -> tuple[Array, Array, Array, Array]:
        """The trajectory cut up, and where each piece starts: u, y, x and covariance words with a lane axis.

        Every third piece starts with an angle so uncertain that its turns are wide, one each with turns that are
        exactly what counts as small, and as not too wide. Three inputs are to be rejected, four are just allowed.
        """
        steps, limits = len(self.u) // PIECES, self.folder.module.DEFAULTS
        u, y = (a[: steps * PIECES].reshape(PIECES, steps, 2).transpose(1, 2, 0).copy() for a in (self.u, self.y))
        u[steps // 2, 0, 1], y[steps // 3, 1, 2], y[steps // 4, 0, -1] = np.nan, np.inf, 1e9
        for axis, lane in ((0, 4), (1, 7)):
            u[-1, axis, lane], y[-1, axis, lane + 1] = limits["u_max"], limits["y_max"]
        uncertain = np.where(np.arange(PIECES) % 3 == 0, np.float32(16), np.float32(1))
        words = self.words0[:, None] * uncertain
        x = np.repeat(self.x0[:, None], PIECES, axis=1)
        spread = np.arange(PIECES, dtype=np.float32) - np.float32(9.5)
        x[2], x[self.folder.module.ANGLE] = 20 * spread, 0.25 * spread  # at rest a turn turns nothing
        x[2, 12], x[self.folder.module.ANGLE, 12] = 0.0, 3.1415925  # where sine is all that is left of pi's parts
        self._corner(x, words)
        return u, y, x, words

    def _corner(self, x: Array, words: Array) -> None:
        """What state and covariance are at their worst, in place: D is its diagonal in either form while L is 1.

        Turns that halved are exactly what counts as small, that are exactly not too wide, that are too wide by the
        angle's own column; wide in one column alone, and in all. A variance below nothing, which must meet its floor.
        """
        n, order = len(self.x0), self._order
        angle, omega = order.index(self.folder.module.ANGLE), order.index(2)
        place = {(i, j): i * (i + 1) // 2 + j for i in range(n) for j in range(i + 1)}
        for lane, z in ((7, 4 * UNKNOWN), (10, 4 * LIMIT), (13, UNKNOWN)):
            words[place[angle, angle], lane], words[place[omega, omega], lane] = z / n, 0.0
        if self.folder.module.COVARIANCE != "LD":
            return  # a Cholesky factor has no floor: one of these would be no number, and no number has many bits
        for column in range(angle):
            wide = np.sqrt(2 * LIMIT / n / words[place[column, column], 1])
            words[place[angle, column], 2 + 3 * column] = words[place[angle, column], 1] = wide
        words[place[angle, angle], 1] = 2 * LIMIT / n
        words[place[angle, 0], 10] = words[place[angle, 0], 2]  # a wide one beside it: else nobody asks again
        x[2, 6] = 2e12
        words[0, 3], words[0, 9] = np.nan, -1e13  # no number, and absurd: to be restarted
        words[place[angle, angle], 0] = 8 * UNKNOWN / n  # unknown, but nothing else to repair
        Q = np.array(self.folder.module.DEFAULTS["Q"])[list(order)]
        for i in range(n):
            for j in range(n):
                words[place[j, j], 14 + i] = -0.25 * Q[j] if i == j else 1e-3 * Q[j]

    def _tune(self, backend: CBackend | NumpyBackend) -> None:
        """Q, R, P_0 and limits of each lane are data, so is its first mean; N_max is the drive file's plus one."""
        given = self.folder.module.DEFAULTS
        lane = np.arange(PIECES)
        one_axis_worse = np.where(
            lane % 5 == 3, np.array([[64.0], [1.0]]), np.where(lane % 5 == 1, [[1.0], [64.0]], 1.0)
        )
        tuned = {
            "Q": np.outer(given["Q"], 2.0 ** (lane % 3)),
            "R": np.outer(given["R"], 2.0 ** (lane % 2)) * one_axis_worse,
            "P_0": np.outer(given["P_0"], 2.0 ** (lane % 2)),
            "tolerance": np.where(lane % 5 == 4, 0.0, given["tolerance"] * 2.0 ** (lane % 4)),
        }
        if "nis_max" in given:
            tuned["nis_max"] = np.where(lane % 4 == 1, 1.0, given["nis_max"])
            tuned["nis_weight"] = given["nis_weight"] * 2.0 ** (lane % 3)
            tuned["nis"] = np.where(lane == 5, 4e9, 0.0)  # absurd, but nothing to repair
        self._set(backend, tuned)
        for each in [backend.filter] if isinstance(backend, NumpyBackend) else backend.filters:
            each.max_iterations = given["max_iterations"] + 1

    @staticmethod
    def _set(backend: CBackend | NumpyBackend, tuned: dict[str, Array]) -> None:
        """Tuning of every lane, each entry (lanes,) or (entries, lanes)."""
        single = {name: np.asarray(value, dtype=np.float32) for name, value in tuned.items()}
        if isinstance(backend, NumpyBackend):
            vars(backend.filter).update({name: tuple(v) if v.ndim == 2 else v for name, v in single.items()})
            return
        for name, value in single.items():
            for k, entry in enumerate(value.T.tolist()):
                setattr(backend.filters[k], name, entry)

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


def _kept_rows(expected: tuple[Array, ...], found: tuple[Array, ...]) -> tuple[Row, ...]:
    return (
        _row("-", "voltage held, innovations' average", "struct after the pieces", expected[0], found[0]),
        _integers("-", "repairs", expected[1:], found[1:]),
    )


def _row(equation: str, stage: str, meaning: str, expected: Array, found: Array) -> Row:
    different = int(np.sum(~same_bits(expected, found)))
    return Row(equation, stage, meaning, float(different), 0.0, int(expected.size))


def _integers(equation: str, stage: str, expected: tuple[Array, ...], found: tuple[Array, ...]) -> Row:
    different = sum(int(np.sum(a != b)) for a, b in zip(expected, found, strict=True))
    return Row(equation, stage, "control flow", float(different), 0.0, sum(int(a.size) for a in expected))
