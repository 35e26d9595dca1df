"""Executes the generated C through cffi: the file that goes to the chip, compiled for this machine."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.errors import UserError
from runtime.estimator.compiler import build_library
from runtime.estimator.folder import GeneratedFolder

Array = NDArray[Any]

RUNNER = Path(__file__).with_name("runner.c")


class CBackend:
    """One generated filter in C; see :class:`runtime.estimator.estimator.Backend`."""

    def __init__(
        self, folder: GeneratedFolder, kind: str, dtype: str, optimisation: tuple[str, ...] = ("-O2",)
    ) -> None:
        prefix, sources = c_sources(folder, kind, dtype)
        self._covariance: str = folder.module.COVARIANCE
        defines = {"FILTER": prefix, "HEADER": f'"{prefix}.h"', "REAL": dtype, "COVARIANCE": self._covariance}
        library = build_library({**sources, "runner.c": RUNNER.read_text(encoding="utf-8")}, defines, optimisation)
        self._ffi, self._library = _open(library, declarations(sources[f"{prefix}.h"], prefix, dtype))
        self.dtype = np.dtype(dtype)
        self._prefix = prefix
        self._init = getattr(self._library, f"{prefix}_init")
        self._reset = getattr(self._library, f"{prefix}_reset")
        self._step = getattr(self._library, f"{prefix}_step")
        self._real = "float *" if dtype == "float32" else "double *"

    def reset(self, x0: Array, words: Array) -> None:
        batch = x0.shape[1:]
        self._lanes = batch[0] if batch else 1
        self._batch = batch
        self._filters = self._ffi.new(f"{self._prefix}_t[]", self._lanes)
        self._x, self._words = self._views(x0.shape[0], words.shape[0])
        for b in range(self._lanes):
            self._init(self._filters + b)
            self._reset(self._filters + b)
        self._x[:], self._words[:] = x0.reshape(x0.shape[0], -1).T, words.reshape(words.shape[0], -1).T
        self._u, self._y = np.zeros((2, 2), dtype=self.dtype)
        self._u_pointer, self._y_pointer = self._pointer(self._u), self._pointer(self._y)
        self._codes = np.zeros(self._lanes, dtype=np.int32)

    def _views(self, n: int, packed: int) -> tuple[Array, Array]:
        """x and the covariance words of every lane as arrays over the structs' own memory."""
        size = self._ffi.sizeof(f"{self._prefix}_t")
        raw = np.frombuffer(self._ffi.buffer(self._filters), dtype=np.uint8).reshape(self._lanes, size)
        views = []
        for field, length in (("x", n), (self._covariance, packed)):
            start = self._ffi.offsetof(f"{self._prefix}_t", field)
            views.append(raw[:, start : start + length * self.dtype.itemsize].view(self.dtype))
        return views[0], views[1]

    @property
    def status(self) -> Array:
        return self._codes.copy().reshape(self._batch)

    @property
    def iterations(self) -> Array:
        counts = [self._filters[b].iterations for b in range(self._lanes)]
        return np.array(counts, dtype=np.int32).reshape(self._batch)

    @property
    def filters(self) -> Any:
        """The structs themselves, to change tuning live: ``backend.filters[0].Q[2] = 0.1``."""
        return self._filters

    def state(self) -> tuple[Array, Array]:
        if not self._batch:
            return self._x[0].copy(), self._words[0].copy()
        return self._x.T.copy(), self._words.T.copy()

    def estimate(self) -> Array:
        return (self._x.T if self._batch else self._x[0]).copy()

    def step(self, u: Array, y: Array) -> None:
        if not self._batch:
            self._u[:], self._y[:] = u, y
            self._codes[0] = self._step(self._filters, self._u_pointer, self._y_pointer)
            return
        self._codes[:] = self.run(u[None], y[None])[3][0]

    def run(self, u: Array, y: Array) -> tuple[Array, Array, Array, Array]:
        steps = u.shape[0]
        u, y = np.ascontiguousarray(u), np.ascontiguousarray(y)
        n, packed = self._x.shape[1], self._words.shape[1]
        x = np.empty((steps, n, *self._batch), dtype=self.dtype)
        words = np.empty((steps, packed, *self._batch), dtype=self.dtype)
        iterations, status = np.empty((2, steps, *self._batch), dtype=np.int32)
        pointers = [self._pointer(array) for array in (u, y, x, words)]
        integers = [self._ffi.cast("int *", array.ctypes.data) for array in (iterations, status)]
        self._library.runner_run(self._filters, self._lanes, steps, n, packed, *pointers, *integers)
        if steps:
            self._codes[:] = status[-1]
        return x, words, iterations, status

    def _pointer(self, array: Array) -> Any:
        return self._ffi.cast(self._real, array.ctypes.data)


def c_sources(folder: GeneratedFolder, kind: str, dtype: str) -> tuple[str, dict[str, str]]:
    """The C name of a filter and the texts to compile, by flat file name."""
    tag, place = ("", "") if dtype == "float32" else ("_f64", "host/")
    prefix = f"{folder.drive}_{kind}{tag}"
    sources = {f"{prefix}{end}": folder.text(f"{place}{prefix}{end}") for end in (".h", ".c")}
    return prefix, {**sources, "pmsm_port.h": folder.text("pmsm_port.h")}


def declarations(header: str, prefix: str, dtype: str) -> str:
    """The header's struct and prototypes as cffi wants them: no comments, no preprocessor."""
    text = re.sub(r"/\*.*?\*/", "", header, flags=re.DOTALL)
    kept = (line for line in text.splitlines() if not line.startswith(("#", "typedef double", 'extern "C"')))
    text = "\n".join(kept)
    text = text[: text.rindex(";") + 1]
    real = "float" if dtype == "float32" else "double"
    runner = (
        f"void runner_run({prefix}_t *f, int lanes, int steps, int n, int packed, const {dtype} *u, const {dtype} *y, "
        f"{dtype} *x, {dtype} *words, int *iterations, int *status);"
    )
    return f"typedef {real} {dtype};\n{text}\n{runner}"


def _open(library: Path, cdef: str) -> tuple[Any, Any]:
    try:
        import cffi
    except ImportError:
        raise UserError('the C back end needs cffi: pip install cffi; or use backend="numpy".') from None
    ffi = cffi.FFI()
    ffi.cdef(cdef)
    return ffi, ffi.dlopen(str(library))
