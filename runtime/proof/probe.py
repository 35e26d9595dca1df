"""Look inside a step of the generated C: the shipped text, with a probe behind every named stage entry."""

from __future__ import annotations

import re
import sys
from types import FrameType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from codegen.layout import lay_out
from model.filters.program import FilterStep
from model.quantities import Block
from runtime.errors import UserError
from runtime.estimator.c_backend import c_sources, declarations
from runtime.estimator.compiler import build_library, open_library
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
    before : (x, covariance words)
        The state both start from.
    u, y : array, (2,)
        The step's inputs.
    number : int
        The step's index, for the message.
    """
    expected = _numpy_locals(folder, step, before, u, y)
    try:
        found = _c_locals(folder, step, before, u, y)
    except UserError:
        return None  # the probed text does not compile: the caller reports the outputs instead
    constants = step.model.constants
    for block in step.blocks:
        for section in lay_out(block, constants).sections:
            names = [name for s in section.statements for name in (s.pair or (s.name,)) if name]
            for name in names:
                a, b = expected.get((block.name, name)), found.get((block.name, name))
                if a is not None and b is not None and np.float32(a).tobytes() != np.float32(b).tobytes():
                    equation, stage = _stage_of(block, name, section.equation)
                    return Divergence(number, equation, stage, name, float(a), float(b), "identical bits")
    return None


def _stage_of(block: Block, name: str, equation: str) -> tuple[str, str]:
    """Equation and name of the stage an entry belongs to; work that no stage names belongs to its section."""
    for stage in block.stages:
        if name in stage.names and stage.meaning:
            return stage.equation, stage.name
    return equation, block.name


def _numpy_locals(
    folder: GeneratedFolder, step: FilterStep, before: tuple[Array, Array], u: Array, y: Array
) -> dict[tuple[str, str], Any]:
    """Every local of every block at its return; of a loop, those of the last pass, as a probe keeps them."""
    backend = NumpyBackend(folder.module, step.kind, "float32")
    backend.reset(*before)
    blocks = {block.name for block in step.blocks}
    found: dict[tuple[str, str], Any] = {}

    def watch(frame: FrameType, event: str, argument: Any) -> None:
        name = frame.f_code.co_name
        if event == "return" and name in blocks:
            found.update({(name, local): value for local, value in frame.f_locals.items() if np.isscalar(value)})

    previous = sys.getprofile()
    sys.setprofile(watch)
    try:
        backend.step(u, y)
    finally:
        sys.setprofile(previous)
    return found


def _c_locals(
    folder: GeneratedFolder, step: FilterStep, before: tuple[Array, Array], u: Array, y: Array
) -> dict[tuple[str, str], float]:
    import cffi

    prefix, sources = c_sources(folder, step.kind, "float32")
    text, probes = _with_probes(sources[f"{prefix}.c"])
    library = build_library({**sources, f"{prefix}.c": text}, {}, ("-O0",))
    ffi = cffi.FFI()
    plain = declarations(sources[f"{prefix}.h"], prefix, "float32").replace("void runner_run", "void not_linked_run")
    ffi.cdef(plain + f"\nextern float32 probes[{max(1, len(probes))}];")
    loaded = open_library(ffi, library)
    filters = ffi.new(f"{prefix}_t *")
    getattr(loaded, f"{prefix}_init")(filters)
    for name, values in zip(("x", folder.module.COVARIANCE), before, strict=True):
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
