"""What the project needs beside Python, and what is skipped without it: programs by package, extras of pip."""

from __future__ import annotations

import importlib.util
import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata

DISTRIBUTION = "pmsm-ickf"


@dataclass(frozen=True)
class Program:
    """A program: its Debian packages, its formula of Homebrew ("" where that has none), and what takes it."""

    name: str
    debian: tuple[str, ...]
    brew: str
    use: str


#: All of them, those that most commands need first.
PROGRAMS = (
    Program("cc", ("gcc", "libc6-dev"), "gcc", "C back end, simulate, replay, identify, faults, export fmu, proof D-E"),
    Program("make", ("make",), "make", "make run, make test"),
    Program("arm-none-eabi-gcc", ("gcc-arm-none-eabi", "libnewlib-arm-none-eabi"), "arm-none-eabi-gcc",
            "generate: sizes on a stand-in; firmware: Cortex-M"),
    Program("qemu-system-arm", ("qemu-system-arm",), "qemu", "firmware: bits on an emulated Cortex-M"),
    Program("avr-gcc", ("gcc-avr", "avr-libc"), "avr-gcc", "firmware: bits where int has 16 bits"),
    Program("simavr", ("simavr",), "simavr", "firmware: that processor"),
    Program("clang", ("clang", "libclang-rt-dev"), "llvm", "firmware: warnings of a second compiler; fuzz; page"),
    Program("wasm-ld", ("lld",), "lld", "page: a filter in the browser"),
    Program("cppcheck", ("cppcheck",), "cppcheck", "firmware: MISRA C:2012"),
    Program("frama-c", ("frama-c-base",), "", "firmware: no undefined behaviour (EVA)"),
    Program("chromium", ("chromium",), "chromium", "tests: what a page does in a browser"),
    Program("valgrind", ("valgrind",), "", "benchmarks: instructions on the host"),
    Program("g++", ("g++",), "gcc", "make test: the generated C's operations, counted as they are executed"),
)  # fmt: skip

#: What an extra of pip is for.
EXTRAS = {
    "report": "figures, the report page",
    "board": "pil, record: serial ports",
    "design": "editing drive and facts files (--write)",
    "mat": ".mat recordings",
    "mdf": "MDF recordings",
    "study": "study tune (Optuna), study --scheduler (Dask)",
    "compiler": "a C compiler (zig cc), where there is no other",
}


def program_found(program: Program) -> str | None:
    """Where a program is, or None; a C compiler may be the one in the Python package ziglang.

    Parameters
    ----------
    program : Program
    """
    names = ("cc", "gcc", "clang") if program.name == "cc" else (program.name,)
    found = next(filter(None, map(shutil.which, names)), None)
    return packaged_compiler() if found is None and program.name == "cc" else found


def packaged_compiler() -> str | None:
    """The program of the Python package ziglang, whose ``cc`` is clang with a C library of its own; None without it."""
    found = importlib.util.find_spec("ziglang")
    for folder in (found.submodule_search_locations or ()) if found else ():
        program = shutil.which("zig", path=folder)
        if program is not None:
            return program
    return None


def extra_lacks(extra: str) -> list[str]:
    """Distributions of an extra that are not installed, as the project's own metadata lists them.

    Parameters
    ----------
    extra : str
    """
    return [name for name in _listed(extra) if not _installed(name)]


def _listed(extra: str) -> Iterator[str]:
    for line in metadata.requires(DISTRIBUTION) or []:
        marked = re.search(r"extra == ['\"]([\w-]+)['\"]", line)
        if marked and marked[1] == extra:
            name = re.match(r"[\w.-]+", line)
            if name and name[0] != DISTRIBUTION:
                yield name[0]


def _installed(name: str) -> bool:
    try:
        metadata.distribution(name)
    except metadata.PackageNotFoundError:
        return False
    return True
