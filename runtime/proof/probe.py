"""Look inside a step of the generated C: the shipped text, with a probe behind every named entry."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType, ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from codegen.ir.layout import lay_out
from codegen.passes import optimise
from model.filters.program import FilterStep
from runtime.estimator.c_backend import c_sources, declarations
from runtime.estimator.compiler import build_library, open_library
from runtime.estimator.folder import GeneratedFolder
from runtime.estimator.numpy_backend import NumpyBackend
from runtime.proof.result import Divergence
from runtime.proof.starts import Start, set_tuning
from runtime.system.errors import UserError

Array = NDArray[Any]

#: (function, name) -> its value in every lane, in the order the C computes them.
Entries = dict[tuple[str, str], Array]

#: The value of a probe that was not passed: a NaN no arithmetic makes.
UNTOUCHED = 0x7FABCDEF

_DECLARATION = re.compile(r"^    const float32 (\w+) =[^;]*;", re.MULTILINE)
_FUNCTION = re.compile(r"^(?:static )?\w+ (\w+)\(.*$", re.MULTILINE)


def numpy_entries(folder: GeneratedFolder, kind: str, start: Start) -> Entries:
    """Every local of every block at its return, single step from ``start``; of a loop, those of the last pass.

    Parameters
    ----------
    folder : GeneratedFolder
        The generated folder.
    kind : str
        Filter kind, such as "ickf".
    start : Start
        Where the filter starts.
    """
    backend = NumpyBackend(folder.module, kind, "float32")
    start.load(backend)
    found: Entries = {}
    with watched_locals(folder.module) as seen:
        backend.step(start.u[0], start.y[0])
    for key, value in seen.items():
        if isinstance(value, np.float32 | np.ndarray) and np.asarray(value).dtype == np.float32:
            found[key] = np.broadcast_to(value, start.lanes)
    return found


@contextmanager
def watched_locals(module: ModuleType) -> Iterator[dict[tuple[str, str], Any]]:
    """Collect every local that a module's functions have when they return, by function and name.

    Parameters
    ----------
    module : module
        A generated one.
    """
    found: dict[tuple[str, str], Any] = {}

    def watch(frame: FrameType, event: str, argument: Any) -> None:
        if event == "return" and frame.f_globals is vars(module):
            found.update(((frame.f_code.co_name, name), value) for name, value in frame.f_locals.items())

    previous = sys.getprofile()
    sys.setprofile(watch)
    try:
        yield found
    finally:
        sys.setprofile(previous if callable(previous) else None)  # a C profiler cannot be set from here again


def c_entries(folder: GeneratedFolder, kind: str, start: Start) -> Entries:
    """The same of the C, compiled plainly. Bits :data:`UNTOUCHED` where a lane did not come by.

    Parameters
    ----------
    folder : GeneratedFolder
        The generated folder.
    kind : str
        Filter kind, such as "ickf".
    start : Start
        Where the filter starts.

    Raises
    ------
    UserError
        The text does not compile.
    """
    import cffi

    prefix, sources = c_sources(folder, kind, "float32")
    text, probes = _with_probes(sources[f"{prefix}.c"])
    library = build_library({**sources, f"{prefix}.c": text}, {}, ("-O0",))
    ffi = cffi.FFI()
    plain = declarations(sources[f"{prefix}.h"], prefix, "float32").replace("void runner_run", "void not_linked_run")
    ffi.cdef(plain + f"\nextern float32 probes[{max(1, len(probes))}];")
    loaded = open_library(ffi, library)
    values = np.frombuffer(ffi.buffer(loaded.probes), dtype=np.uint32)
    kept = np.empty((len(probes), start.lanes), dtype=np.uint32)
    step = getattr(loaded, f"{prefix}_step")
    u, y = start.u[0].T.tolist(), start.y[0].T.tolist()
    for lane in range(start.lanes):
        filters = ffi.new(f"{prefix}_t[1]")
        getattr(loaded, f"{prefix}_init")(filters)
        filters[0].x = start.x[:, lane].tolist()
        setattr(filters[0], folder.module.COVARIANCE, start.words[:, lane].tolist())
        set_tuning(filters, {name: value[..., lane : lane + 1] for name, value in start.tuning.items()})
        values[:] = UNTOUCHED
        step(filters, u[lane], y[lane])
        kept[:, lane] = values[: len(probes)]
    return dict(zip(probes, kept.view(np.float32), strict=True))


def parted(expected: Entries, found: Entries) -> Iterator[tuple[tuple[str, str], Array, int]]:
    """Entry by entry, in the order of the C: in which lanes it has other bits, and how many lanes were compared.

    Parameters
    ----------
    expected : Entries
        NumPy's; an entry that is missing here is passed over.
    found : Entries
        The C's.

    Yields
    ------
    key : (str, str)
        Function and name.
    other : ndarray of bool, (lanes,)
    compared : int
    """
    for key, value in found.items():
        passed = value.view(np.uint32) != UNTOUCHED
        if key in expected:
            wanted = np.ascontiguousarray(expected[key])
            yield key, passed & (wanted.view(np.uint32) != value.view(np.uint32)), int(passed.sum())


def first_parted(
    step: FilterStep, expected: Entries, found: Entries, number: int, where: str = ""
) -> Divergence | None:
    """The first entry of a stage with other bits, in the first lane that has them; None if there is none.

    Parameters
    ----------
    step
        The stages the filter is made of: they have the equations' numbers.
    expected, found
        NumPy's entries and the C's.
    number : int
        The step's index, for the message; ``where`` follows the entry's name there, with the lane.
    """
    for (function, name), different, _ in parted(expected, found):
        place = _stage_of(step, function, name) if different.any() else None
        if place is not None:
            lane = int(np.argmax(different))
            a, b = (float(entries[function, name][lane]) for entries in (expected, found))
            element = f"{name}, {where} {lane}" if where else name
            return Divergence(number, *place, element, a, b, "identical bits")
    return None


def locate(folder: GeneratedFolder, step: FilterStep, start: Start, number: int) -> Divergence | None:
    """The first entry in which C and NumPy part in one step from ``start``, or None if no named entry does.

    Parameters
    ----------
    folder : GeneratedFolder
    step : FilterStep
        The stages the filter is made of: they have the equations' numbers.
    start : Start
    number : int
        Number of the step, for the report.
    """
    try:
        found = c_entries(folder, step.kind, start)
    except UserError:
        return None  # the probed text does not compile: the caller reports the outputs instead
    return first_parted(step, numpy_entries(folder, step.kind, start), found, number)


def _stage_of(step: FilterStep, function: str, name: str) -> tuple[str, str] | None:
    """Equation and name of an entry's stage; work that no stage names belongs to its section; None for what is read."""
    for block in (block for block in step.blocks if block.name == function):
        for stage in block.stages:
            if name in stage.names and stage.meaning:
                return stage.equation, stage.name
        for section in lay_out(optimise(block), step.model.constants).sections:
            if any(name in (s.pair or (s.name,)) for s in section.statements):
                return section.equation, block.name
    return None


def _with_probes(source: str) -> tuple[str, list[tuple[str, str]]]:
    """The text with ``probes[k] = name;`` behind each declaration, and what each probe holds."""
    probes: list[tuple[str, str]] = []
    functions = [(match.start(), match.group(1)) for match in _FUNCTION.finditer(source)]

    def add(match: re.Match[str]) -> str:
        owner = [name for start, name in functions if start < match.start()][-1]
        probes.append((owner, match.group(1)))
        return f"{match.group(0)} probes[{len(probes) - 1}] = {match.group(1)};"

    text = _DECLARATION.sub(add, source)
    head, include, tail = text.partition('.h"\n')
    return f"{head}{include}float32 probes[{max(1, len(probes))}];\n{tail}", probes
