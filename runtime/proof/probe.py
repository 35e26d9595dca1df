"""Look inside a step of the generated C: the shipped text, with a probe behind every named stage entry."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.filters.program import FilterStep
from model.quantities import Stage
from runtime.errors import UserError
from runtime.estimator.c_backend import c_sources, declarations
from runtime.estimator.compiler import build_library
from runtime.estimator.folder import GeneratedFolder
from runtime.estimator.numpy_backend import NumpyBackend
from runtime.proof.result import Divergence

Array = NDArray[Any]

_DECLARATION = re.compile(r"^    const float32 (\w+) =[^;]*;", re.MULTILINE)
_FUNCTION = re.compile(r"^static void (\w+)\(", re.MULTILINE)


def locate(
    folder: GeneratedFolder, step: FilterStep, before: tuple[Array, Array], u: Array, y: Array, number: int
) -> Divergence | None:
    """The first stage entry in which C and NumPy part in one step, or None if no named entry does.

    Parameters
    ----------
    folder, step
        The generated filter and the stages it is made of.
    before : (x, packed P)
        The state both start from.
    u, y : array, (2,)
        The step's inputs.
    number : int
        The step's index, for the message.
    """
    expected = _numpy_stages(folder, step, before, u, y)
    try:
        found = _c_stages(folder, step, before, u, y)
    except UserError:
        return None  # the probed text does not compile: the caller reports the outputs instead
    for block in step.blocks:
        for stage in block.stages:
            values = expected.get(stage.name)
            for name, value in zip(stage.names, values or (), strict=False):
                probed = found.get((block.name, name))
                if probed is not None and np.float32(value).tobytes() != np.float32(probed).tobytes():
                    return _divergence(number, stage, name, float(value), float(probed))
    return None


def _divergence(number: int, stage: Stage, name: str, expected: float, found: float) -> Divergence:
    return Divergence(number, stage.equation, stage.name, name, expected, found, "identical bits")


def _numpy_stages(
    folder: GeneratedFolder, step: FilterStep, before: tuple[Array, Array], u: Array, y: Array
) -> dict[str, Any]:
    backend = NumpyBackend(folder.module, step.kind, "float32")
    backend.reset(*before)
    stages: dict[str, Any] = {}
    backend.step(u, y, stages)
    iterates = stages.pop("iterates", [])
    return {**stages, **(iterates[-1] if iterates else {})}  # a probe in a loop keeps the last pass


def _c_stages(
    folder: GeneratedFolder, step: FilterStep, before: tuple[Array, Array], u: Array, y: Array
) -> dict[tuple[str, str], float]:
    import cffi

    prefix, sources = c_sources(folder, step.kind, "float32")
    text, probes = _with_probes(sources[f"{prefix}.c"])
    library = build_library({**sources, f"{prefix}.c": text}, {}, ("-O0",))
    ffi = cffi.FFI()
    plain = declarations(sources[f"{prefix}.h"], prefix, "float32").replace("void runner_run", "void not_linked_run")
    ffi.cdef(plain + f"\nextern float32 probes[{max(1, len(probes))}];")
    loaded = ffi.dlopen(str(library))
    filters = ffi.new(f"{prefix}_t *")
    getattr(loaded, f"{prefix}_init")(filters)
    for name, values in zip(("x", "P"), before, strict=True):
        for k, value in enumerate(values):
            getattr(filters, name)[k] = float(value)
    getattr(loaded, f"{prefix}_step")(filters, [float(v) for v in u], [float(v) for v in y])
    return {key: float(loaded.probes[k]) for k, key in enumerate(probes)}


def _with_probes(source: str) -> tuple[str, list[tuple[str, str]]]:
    """The text with ``probes[k] = name;`` behind each declaration, and what each probe holds."""
    probes: list[tuple[str, str]] = []
    functions = [(match.start(), match.group(1)) for match in _FUNCTION.finditer(source)]

    def add(match: re.Match[str]) -> str:
        owner = [name for start, name in functions if start < match.start()]
        if not owner:
            return match.group(0)
        probes.append((owner[-1], match.group(1)))
        return f"{match.group(0)} probes[{len(probes) - 1}] = {match.group(1)};"

    text = _DECLARATION.sub(add, source)
    head, include, tail = text.partition('.h"\n')
    return f"{head}{include}float32 probes[{max(1, len(probes))}];\n{tail}", probes
