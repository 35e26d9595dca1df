"""One filter's C, and what a step of it costs: instructions, bytes, stack, and whether it is the same filter."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.schema import Drive
from runtime.estimator.compiler import build_program, run_compiler
from runtime.firmware.build import cross_compile
from runtime.firmware.callgrind import instructions_per_step
from runtime.firmware.cortex_m import LIBRARIES, boards
from runtime.firmware.recording import Recording, Segment
from runtime.firmware.subject import Subject
from runtime.firmware.tools import MissingTool, find_tool
from runtime.proof.own_trajectory import trajectory_of
from runtime.proof.reference import make_reference
from runtime.system.errors import UserError
from runtime.system.programs import run_to_end

Array = NDArray[Any]

DRIVER = Path(__file__).with_name("driver.c").read_text(encoding="utf-8")
#: Set for the M4 alone: there a square root is one instruction once errno is out of the way.
M4_MORE = ("-fno-math-errno",)
_M4 = boards()["cortex_m4f"]
_PROCESSOR = _M4.board.flags
_COMPILING = ("-std=c99", "-O2", "-ffp-contract=off", *M4_MORE)


@dataclass(frozen=True)
class Missing:
    """A figure that could not be had here, and why."""

    why: str


Figure = float | Missing


@dataclass(frozen=True)
class Candidate:
    """A filter in C: ``<name>.h`` declares ``<name>_t`` (with ``x`` first), ``<name>_init``, ``_reset``, ``_step``.

    ``counted``: the function between whose entry and exit the host's instructions count, ``name``_step unless the
    peer's own step is wrapped. ``operations`` where they are known. ``compiler``: another than the system's C
    compiler, with its flags; it is then not built for the M4.
    """

    label: str
    name: str
    sources: Mapping[str, str]
    counted: str = ""
    operations: Counter[str] = field(default_factory=Counter)
    compiler: tuple[str, ...] = ()
    note: str = ""

    @property
    def step(self) -> str:
        return self.counted or f"{self.name}_step"


@dataclass(frozen=True)
class Inputs:
    """u, y of ``last`` steps as float32 rows; figures are means over the steps after ``first``."""

    rows: Array
    first: int
    last: int
    reference: Array
    sigma: Array

    @classmethod
    def of(cls, drive: Drive, steps: int, settle: int, initial_state: tuple[float, ...], kind: str = "ckf") -> Inputs:
        """The proof's trajectory, and what the reference makes of it in float64."""
        data = trajectory_of(drive, steps=settle + steps)
        rows = np.column_stack([data.u, data.y]).astype(np.float32)
        reference = make_reference(drive.model_dump(), kind, drive.filter.gain, np.array(initial_state))
        x, sigma = [], []
        for row in rows.astype(float):
            reference.step(row[:2], row[2:])
            x.append(reference.x.copy())
            sigma.append(np.sqrt(np.diag(reference.P)))
        return cls(rows, settle, settle + steps, np.array(x), np.array(sigma))


def figure(compute: Callable[[], float]) -> Figure:
    """The result of ``compute``; where a tool or a package is missing, its name."""
    try:
        return compute()
    except MissingTool as error:
        return Missing(f"{error.program} not found (Debian: {error.package})")
    except ImportError as error:
        return Missing(f"{error.name} not installed (pip install 'pmsm-ickf[bench]')")
    except UserError as error:
        return Missing(str(error))


def host_program(candidate: Candidate) -> Path:
    """The candidate and the driver, compiled for the host."""
    sources = {**candidate.sources, "driver.c": DRIVER}
    defines = {"HEADER": f'"{candidate.name}.h"', "FILTER": candidate.name}
    if not candidate.compiler:
        return build_program(sources, defines)
    compiler, *flags = candidate.compiler
    path = shutil.which(compiler)
    if path is None:
        raise MissingTool(compiler, compiler)
    return cross_compile(path, [*flags, *(f"-D{name}={value}" for name, value in defines.items())], sources, ("-lm",))


def host_instructions(candidate: Candidate, inputs: Inputs) -> float:
    """x86-64 instructions a step by callgrind, -O2, sine and cosine included."""
    with tempfile.TemporaryDirectory() as scratch:
        rows = _written(scratch, inputs)
        return instructions_per_step(host_program(candidate), candidate.step, inputs.first, inputs.last, [rows])


def trace(candidate: Candidate, inputs: Inputs) -> Array:
    """x after every step, (steps, n)."""
    with tempfile.TemporaryDirectory() as scratch:
        command = [str(host_program(candidate)), str(inputs.last), _written(scratch, inputs), "print"]
        text = _answer(command)
    return np.array(text.split(), dtype=float).reshape(inputs.last, -1)


def deviation(candidate: Candidate, inputs: Inputs) -> float:
    """Largest |x - float64 reference| over all steps, in sigmas."""
    difference = trace(candidate, inputs) - inputs.reference
    difference[:, 3] = np.remainder(difference[:, 3] + np.pi, 2 * np.pi) - np.pi
    return float(np.max(np.abs(difference) / inputs.sigma))


def _answer(command: list[str]) -> str:
    """What a program says that must end well."""
    done = run_to_end(command)
    if done.code:
        raise UserError(f"{command[0]} failed: {done.crash or done.err.strip()[-200:]}")
    return done.out


def _written(folder: str, inputs: Inputs) -> str:
    path = Path(folder) / "rows.bin"
    path.write_bytes(np.ascontiguousarray(inputs.rows).tobytes())
    return str(path)


def m4_instructions(candidate: Candidate, inputs: Inputs) -> float:
    """Cortex-M4F instructions a step under qemu, the wrapper of a peer included."""
    _c_only(candidate)
    subject = Subject(candidate.name, "", dict(candidate.sources))
    recording = Recording((Segment(inputs.rows.astype(float)),))
    return float(np.mean(_M4.run(subject, recording, M4_MORE).cost[inputs.first :]))


def m4_text(candidate: Candidate) -> float:
    """Bytes of code and constants the linker keeps for the step alone: all it calls, libraries included."""
    _c_only(candidate)
    compiler = find_tool("arm-none-eabi-gcc")
    keep = ["-ffunction-sections", "-fdata-sections", "-nostartfiles", "-Wl,--gc-sections", "-Wl,-n"]
    flags = [*_PROCESSOR, *_COMPILING, *keep, f"-Wl,-e,{candidate.name}_step"]
    program = cross_compile(compiler, flags, candidate.sources, LIBRARIES)
    listing = _answer([compiler.replace("gcc", "size"), "-A", str(program)])
    return float(sum(int(size) for size in re.findall(r"^\.(?:text|rodata)\S*\s+(\d+)", listing, re.MULTILINE)))


def m4_stack(candidate: Candidate) -> float:
    """Deepest sum of frames below the step on the M4 (GCC's call graph); library functions are not in it."""
    _c_only(candidate)
    compiler = find_tool("arm-none-eabi-gcc")
    frames: dict[str, int] = {}
    calls: dict[str, set[str]] = {}
    with tempfile.TemporaryDirectory() as scratch:
        for name, text in candidate.sources.items():
            (Path(scratch) / name).write_text(text, encoding="utf-8")
        for name in (name for name in candidate.sources if name.endswith(".c")):
            command = [compiler, *_PROCESSOR, *_COMPILING, "-fcallgraph-info=su", "-c", name, "-o", f"{name}.o"]
            run_compiler(command, Path(scratch), compiler)
            graph = next(path for path in Path(scratch).glob("*.ci")).read_text(encoding="utf-8")
            for title, size in re.findall(r'title: "([^"]+)" label: "[^"]*?(\d+) bytes', graph):
                frames[title] = int(size)
            for source, target in re.findall(r'sourcename: "([^"]+)" targetname: "([^"]+)"', graph):
                calls.setdefault(source, set()).add(target)
            for path in Path(scratch).glob("*.ci"):
                path.unlink()

    def depth(function: str) -> int:
        return frames.get(function, 0) + max((depth(callee) for callee in calls.get(function, ())), default=0)

    return float(depth(f"{candidate.name}_step"))


def _c_only(candidate: Candidate) -> None:
    if candidate.compiler:
        raise UserError("not built: C++ with Eigen")
