"""Running the tools the gates lean on: a missing one is said, with the Debian package that brings it."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

from runtime.firmware.static.check import Check
from runtime.system.needs import PROGRAMS
from runtime.system.programs import run_to_end

#: Debian package of each tool.
PACKAGES = {"gcc": "gcc"} | {program.name: program.debian[0] for program in PROGRAMS}

#: Seconds after which a tool is taken to hang; each needs a few, on a busy machine some minutes.
PATIENCE = 900


def missing(name: str, subject: str, tool: str) -> Check | None:
    """A "not run" check if the tool is not there, else None."""
    if shutil.which(tool):
        return None
    return Check(name, subject, "not run", "", f"{tool} not found", (f"apt install {PACKAGES[tool]}",))


def run(command: Sequence[str], cwd: Path | None = None) -> tuple[int, str]:
    """Exit code and everything said, standard output first; UserError if it cannot be started or does not end."""
    done = run_to_end(command, patience=PATIENCE, folder=cwd)
    return done.code, done.out + done.err


#: The example interrupt is two programs in one file; this is the one its own default leaves out.
OTHER_EXAMPLE = "WHOLE_CONTROLLER=0"


def is_example(source: Path) -> bool:
    """The file an application copies and makes its own: it holds state and names functions that are not ours."""
    return source.stem.startswith("example_")


def is_bench(source: Path) -> bool:
    """Processor-in-the-loop C: it stands on functions that the board's own code supplies."""
    return source.parent.name == "board"


def firmware_sources(folder: Path) -> list[Path]:
    """Every C file of a generated folder that goes onto the chip: all but the host's flavour."""
    return sorted(path for path in folder.rglob("*.c") if "host" not in path.relative_to(folder).parts)
