"""Executes the generated C through cffi: the file that goes to the chip, compiled for this machine."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from runtime.estimator.compiler import build_library, open_library
from runtime.estimator.folder import GeneratedFolder
from runtime.estimator.lanes import open_lanes
from runtime.estimator.threads import share_lanes
from runtime.system.errors import UserError

Array = NDArray[Any]

BoundStep = Callable[[ArrayLike, ArrayLike], Array | None]

#: Arguments that come in pairs on the quick way of a single step.
_NUMBERS = frozenset({float, int, np.float64, np.float32})

_FORMATS: dict[str, Literal["f", "d"]] = {"float32": "f", "float64": "d"}

RUNNER = Path(__file__).with_name("runner.c")


class CBackend:
    """One generated filter in C; see :class:`runtime.estimator.estimator.Backend`.

    A float32 batch runs in the lane form, many filters side by side with the scalar form's bits; without ``lanes``
    in the scalar form, one after the other.
    """

    def __init__(
        self,
        folder: GeneratedFolder,
        kind: str,
        dtype: str,
        optimisation: tuple[str, ...] = ("-O2",),
        lanes: bool = True,
        lane_flags: tuple[str, ...] | None = None,
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
        self._real = "float *" if dtype == "float32" else "double *"
        flags = () if lane_flags is None else (lane_flags,)
        self._lane_form = partial(open_lanes, folder, kind, self._ffi, *flags) if lanes and dtype == "float32" else None
        self._lane_library: Any = None

    def reset(self, x0: Array, words: Array) -> None:
        """Start from a state and covariance words; see :meth:`Backend.reset`.

        Parameters
        ----------
        x0 : ndarray, (n[, B])
            State, in the units of the model.
        words : ndarray, (n(n+1)/2[, B])
            The carried covariance.
        """
        batch = x0.shape[1:]
        self._lanes = batch[0] if batch else 1
        self._batch = batch
        self._filters = self._ffi.new(f"{self._prefix}_t[]", self._lanes)
        self._x, self._words = self._views(x0.shape[0], words.shape[0])
        for b in range(self._lanes):
            self._init(self._filters + b)
            self._reset(self._filters + b)
        self._x[:], self._words[:] = x0.reshape(x0.shape[0], -1).T, words.reshape(words.shape[0], -1).T
        self._call = self._ffi.new("runner_call_t *", {"filter": self._filters})
        self._codes: Array | int = np.zeros(self._lanes, dtype=np.int32) if batch else 0

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
        """Status bits of the last step, ([B],)."""
        return np.array(self._codes, dtype=np.int32)

    @property
    def iterations(self) -> Array:
        """Measurement updates made in the last step, ([B],)."""
        counts = [self._filters[b].iterations for b in range(self._lanes)]
        return np.array(counts, dtype=np.int32).reshape(self._batch)

    @property
    def filters(self) -> Any:
        """The structs themselves, to change tuning live: ``backend.filters[0].Q[2] = 0.1``."""
        return self._filters

    def state(self) -> tuple[Array, Array]:
        """Copy x and the covariance words."""
        if not self._batch:
            return self._x[0].copy(), self._words[0].copy()
        return self._x.T.copy(), self._words.T.copy()

    def snapshot(self) -> bytes:
        """Copy the structs."""
        return bytes(self._ffi.buffer(self._filters))

    def restore(self, snapshot: bytes) -> None:
        """Go back to where a snapshot was taken; see :meth:`Backend.restore`.

        Parameters
        ----------
        snapshot : bytes
        """
        self._ffi.buffer(self._filters)[:] = snapshot

    def estimate(self) -> Array:
        """Copy x."""
        return (self._x.T if self._batch else self._x[0]).copy()

    def step(self, u: Array, y: Array) -> None:
        """Step every lane once.

        Parameters
        ----------
        u : ndarray, (2[, B])
            Mean voltage over the interval that ends now, V.
        y : ndarray, (2[, B])
            Currents now, A.
        """
        if self._batch:
            self._codes = self.run(u[None], y[None], last_only=True)[3][0]
        else:
            self._call.inputs = [*u.tolist(), *y.tolist()]
            self._codes = self._library.runner_step(self._call)

    def bound_step(self) -> BoundStep:
        """Bind a single filter's step, see :meth:`Backend.bound_step`."""
        call, function = self._call, self._library.runner_step
        estimate: Callable[[], Array] = self._x[0].copy
        inputs = memoryview(self._ffi.buffer(self._ffi.addressof(call, "inputs")))
        put = struct.Struct(f"4{_FORMATS[self.dtype.name]}").pack_into
        array, numbers = np.ndarray, _NUMBERS  # looked up once, and types tested by `is` first: nanoseconds count here

        def step(u: Any, y: Any) -> Array | None:
            if type(u) is not list:
                if type(u) is array:
                    u = u.tolist()
                elif type(u) is not tuple:
                    return None
            if type(y) is not list:
                if type(y) is array:
                    y = y.tolist()
                elif type(y) is not tuple:
                    return None
            try:
                v_alpha, v_beta = u
                i_alpha, i_beta = y
                if not (
                    type(v_alpha) is type(v_beta) is type(i_alpha) is type(i_beta) is float
                    or numbers.issuperset((type(v_alpha), type(v_beta), type(i_alpha), type(i_beta)))
                ):
                    return None
                put(inputs, 0, v_alpha, v_beta, i_alpha, i_beta)
            except (TypeError, ValueError, struct.error):  # not a pair, or an integer beyond all floats
                return None
            self._codes = function(call)
            return estimate()

        return step

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
        steps = u.shape[0]
        kept = min(steps, 1) if last_only else steps
        u, y = np.ascontiguousarray(u), np.ascontiguousarray(y)
        n, packed = self._x.shape[1], self._words.shape[1]
        x = np.empty((kept, n, *self._batch), dtype=self.dtype)
        words = np.empty((kept, packed, *self._batch), dtype=self.dtype)
        iterations, status = np.empty((2, kept, *self._batch), dtype=np.int32)
        inputs = [self._pointer(array) for array in (u, y)]
        outputs = [self._pointer(array) for array in (x, words)]
        outputs += [self._ffi.cast("int *", array.ctypes.data) for array in (iterations, status)]
        run, group = self._runner
        share_lanes(
            lambda first, count: run(
                self._filters, first, count, self._lanes, steps, *inputs, int(last_only), *outputs
            ),
            self._lanes,
            group,
            steps,
        )
        if steps:
            self._codes = status[-1].copy()
        return x, words, iterations, status

    @property
    def _runner(self) -> tuple[Any, int]:
        """The C function that runs this batch, and how many lanes it likes to keep together."""
        if not self._batch or self._lane_form is None:
            return self._library.runner_run, 1
        if self._lane_library is None:
            self._lane_library = self._lane_form()
        return self._lane_library.lanes_run, self._lane_library.lanes_group()

    def _pointer(self, array: Array) -> Any:
        return self._ffi.cast(self._real, array.ctypes.data)


def c_sources(folder: GeneratedFolder, kind: str, dtype: str) -> tuple[str, dict[str, str]]:
    """Find a filter's C name and the texts to compile, by flat file name.

    Parameters
    ----------
    folder : GeneratedFolder
    kind : str
        Filter kind, such as "ickf".
    dtype : {"float32", "float64"}
        The firmware's flavour, or the host's.
    """
    tag, place = ("", "") if dtype == "float32" else ("_f64", "host/")
    prefix = f"{folder.drive}_{kind}{tag}"
    sources = {f"{prefix}{end}": folder.text(f"{place}{prefix}{end}") for end in (".h", ".c")}
    return prefix, {**sources, "pmsm_port.h": folder.text("pmsm_port.h")}


def declarations(header: str, prefix: str, dtype: str) -> str:
    """Reduce a header to what cffi wants: its struct and prototypes, without comments and preprocessor.

    Parameters
    ----------
    header : str
        Text of the generated header.
    prefix : str
        The filter's C name.
    dtype : {"float32", "float64"}
        What ``float32`` or ``float64`` of the port header stands for.
    """
    text = re.sub(r"/\*.*?\*/", "", header, flags=re.DOTALL)
    kept = (line for line in text.splitlines() if not line.startswith(("#", "typedef double", 'extern "C"')))
    text = "\n".join(kept)
    text = text[: text.rindex(";") + 1]
    real = "float" if dtype == "float32" else "double"
    runners = "".join(
        f"void {name}({prefix}_t *f, int first, int count, int batch, int steps, const {dtype} *u, const {dtype} *y, "
        f"int last_only, {dtype} *x, {dtype} *words, int *iterations, int *status);"
        for name in ("runner_run", "lanes_run")
    )
    single = (
        f"typedef struct {{ {prefix}_t *filter; {dtype} inputs[4]; }} runner_call_t;"
        "int runner_step(runner_call_t *call);"
    )
    return f"typedef {real} {dtype};\n{text}\n{runners}int lanes_group(void);{single}"


def _open(library: Path, cdef: str) -> tuple[Any, Any]:
    try:
        import cffi
    except ImportError:
        raise UserError('the C back end needs cffi: pip install cffi; or use backend="numpy".') from None
    ffi = cffi.FFI()
    ffi.cdef(cdef)
    return ffi, open_library(ffi, library)
