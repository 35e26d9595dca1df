"""The step of :mod:`runtime.identify.equations` compiled: C in which LANES parameter sets go side by side."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from codegen.ir.graph import Graph, read_tape
from codegen.ir.trig import DOUBLE, sin_cos_listing
from runtime.estimator.compiler import build_library, open_library
from runtime.estimator.lanes import OPTIMISATION
from runtime.estimator.threads import thread_count
from runtime.identify.equations import ROW, TOLD, Equations

Array = NDArray[Any]

RUNNER = Path(__file__).with_name("lanes.c")
#: Parameter sets that one call takes side by side: a vector register of doubles, where the processor has such.
LANES = 8

_SPELLED = {
    "add": "{0} + {1}",
    "sub": "{0} - {1}",
    "mul": "{0} * {1}",
    "div": "{0} / {1}",
    "neg": "-{0}",
    "sqrt": "sqrt({0})",
    "min": "({0} < {1}) ? {0} : {1}",
    "max": "({0} > {1}) ? {0} : {1}",
}


class _Arithmetic(Graph):
    """A graph in which sines and cosines are arithmetic: a loop over lanes that calls nothing stays in vectors."""

    def op(self, op: str, *args: int) -> int:
        """An operation; a sine or cosine as the generated float64 one is made.

        Parameters
        ----------
        op : str
        *args : int
            The operands' nodes.
        """
        if op not in {"sin", "cos"}:
            return super().op(op, *args)
        listing = sin_cos_listing(DOUBLE)
        result = listing.outputs["sine" if op == "sin" else "cosine"][0]
        ours: dict[int, int] = {}
        for index in listing.graph.reachable([result]):
            node = listing.graph[index]
            ours[index] = args[0] if node.op == "input" else self.adopt(node, [ours[a] for a in node.args])
        return ours[result]


def kernel_text(equations: Equations) -> str:
    """The C of a step for all lanes, and of the loop over a recording's rows.

    Parameters
    ----------
    equations : Equations
    """
    function = equations.step
    graph = _Arithmetic()
    sizes = {name: function.nnz_in(k) for k, name in enumerate(("s", "p", "row"))}
    inputs = [[graph.input(f"{name}{k}") for k in range(size)] for name, size in sizes.items()]
    outputs = read_tape(graph, function, inputs)
    spelled = {
        node: f"row[{k}]" if name == "row" else f"{name}[{k}].of[l]"
        for name, nodes in zip(sizes, inputs, strict=True)
        for k, node in enumerate(nodes)
    }
    body = []
    for index in graph.reachable(node for part in outputs for node in part):
        node = graph[index]
        if node.op == "const":
            spelled[index] = f"({node.value!r})"
            continue
        text = spelled[index] if node.op == "input" else _SPELLED[node.op].format(*(spelled[a] for a in node.args))
        body.append(f"const double v{index} = {text};")
        spelled[index] = f"v{index}"
    for target, nodes in zip(("s_out", "told"), outputs, strict=True):
        body += [f"{target}[{k}].of[l] = {spelled[node]};" for k, node in enumerate(nodes)]
    defines = {"LANES": LANES, "STATE_LENGTH": sizes["s"], "PARAMETERS": sizes["p"]}
    defines |= {"ROW_LENGTH": len(ROW), "TOLD_LENGTH": len(TOLD)}
    head = "".join(f"#define {name} {value}\n" for name, value in defines.items())
    return head + RUNNER.read_text(encoding="utf-8").replace("/* the step */", "\n        ".join(body))


class Kernel:
    """The compiled step: the innovations of a recording under many parameter sets."""

    def __init__(self, equations: Equations) -> None:
        import cffi

        self.equations = equations
        self._ffi = cffi.FFI()
        self._ffi.cdef("void innovate_run(int steps, const double *, const double *, double *, double *);")
        library = build_library({"innovate.c": kernel_text(equations)}, {}, OPTIMISATION)
        self._library = open_library(self._ffi, library)

    def run(self, rows: Array, parameters: Array, state: Array) -> Array:
        """Innovations of all rows, and their covariances.

        Parameters
        ----------
        rows : (N, 15) float
            Of a recording, see :data:`runtime.identify.equations.ROW`.
        parameters : (P, B) float
            A column a set.
        state : (S, B) float
            Before the first row; changed to that after the last.

        Returns
        -------
        (N, 5, B) float
        """
        steps, sets = len(rows), parameters.shape[1]
        groups = -(-sets // LANES)
        lanes = np.minimum(np.arange(groups * LANES), sets - 1)  # those beyond the last set repeat it
        given, states = (
            np.ascontiguousarray(values[:, lanes].reshape(len(values), groups, LANES).swapaxes(0, 1))
            for values in (parameters, state)
        )
        told = np.empty((groups, steps, len(TOLD), LANES))
        rows = np.ascontiguousarray(rows, dtype=float)

        def work(group: int) -> None:
            arrays = (rows, given[group], states[group], told[group])
            self._library.innovate_run(steps, *(self._ffi.cast("double *", a.ctypes.data) for a in arrays))

        with ThreadPoolExecutor(min(thread_count(), groups)) as pool:
            list(pool.map(work, range(groups)))
        state[:] = states.swapaxes(0, 1).reshape(len(state), -1)[:, :sets]
        return np.asarray(told.transpose(1, 2, 0, 3).reshape(steps, len(TOLD), -1)[:, :, :sets])
