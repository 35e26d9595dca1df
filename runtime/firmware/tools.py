"""Programs that are not Python's: find them, and say which Debian package brings a missing one."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from pathlib import Path

from runtime.system.errors import UserError
from runtime.system.needs import PROGRAMS
from runtime.system.programs import run_to_end

#: Program -> the Debian package it comes in.
PACKAGES = {program.name: program.debian[0] for program in PROGRAMS}

#: Program -> the package of the C library without which it links nothing, and a file of that library.
LIBRARIES = {
    "avr-gcc": ("avr-libc", "libm.a"),
    "arm-none-eabi-gcc": ("libnewlib-arm-none-eabi", "libm.a"),
}


class MissingTool(UserError):  # noqa: N818 (it is a state of the machine, not only an error)
    """A program is not installed; ``package`` is the Debian package that brings it."""

    def __init__(self, program: str, package: str) -> None:
        super().__init__(f"{program} not found. Install it (Debian: apt-get install {package}).")
        self.program, self.package = program, package


def missing_packages(programs: Iterable[str]) -> list[str]:
    """The Debian packages that would bring what is missing of some programs and their libraries."""
    packages = []
    for program in programs:
        try:
            find_tool(program)
        except MissingTool as error:
            packages.append(error.package)
            if error.program == program and program in LIBRARIES:
                packages.append(LIBRARIES[program][0])
    return packages


def find_tool(program: str) -> str:
    """The path of a program in :data:`PACKAGES`.

    Raises
    ------
    MissingTool
        If it, or the C library it needs, is not installed.
    """
    path = shutil.which(program)
    if path is None:
        raise MissingTool(program, PACKAGES[program])
    if program in LIBRARIES:
        package, name = LIBRARIES[program]
        answer = run_to_end([path, f"-print-file-name={name}"])
        if not Path(answer.out.strip()).is_absolute():
            raise MissingTool(f"{name} of {program}", package)
    return path
