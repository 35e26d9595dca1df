"""A board made of this machine: the folder's bench C compiled as a program, on the far end of a pseudo-terminal.

It lets one try ``pil`` and ``record`` without hardware, and the tests damage its line. It proves nothing of a chip.
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path
from types import TracebackType
from typing import Any

from runtime.estimator.compiler import build_program
from runtime.estimator.folder import GeneratedFolder
from runtime.system.errors import UserError

NAME = "simulated"
MAIN = Path(__file__).with_name("simulated_board.c")


def board_sources(folder: GeneratedFolder, kind: str) -> dict[str, str]:
    """The texts of a board's program, by flat file name: the filter and the bench's files.

    Parameters
    ----------
    folder : GeneratedFolder
        The generated folder.
    kind : str
        Filter kind, such as "ickf".
    """
    p = f"{folder.drive}_{kind}"
    shared = [f"pmsm_{part}{end}" for part in ("link", "pil", "telemetry") for end in (".h", ".c")]
    sources = {name: folder.text(f"board/{name}") for name in (*shared, f"{p}_pil.h", f"{p}_pil.c")}
    sources |= {name: folder.text(name) for name in (f"{p}.h", f"{p}.c", "pmsm_port.h")}
    return {**sources, "simulated_board.c": MAIN.read_text(encoding="utf-8")}


def build_board(folder: GeneratedFolder, kind: str, sources: dict[str, str] | None = None) -> Path:
    """Compile the board's program; ``sources`` replaces the folder's own texts.

    Parameters
    ----------
    folder : GeneratedFolder
        The generated folder.
    kind : str
        Filter kind, such as "ickf".
    sources : dict of str to str, optional
        Texts by file name.
    """
    folder.require(kind)
    p = f"{folder.drive}_{kind}"
    defines = {"FILTER": p, "HEADER": f'"{p}_pil.h"'}
    return build_program(sources or board_sources(folder, kind), defines)


class SimulatedBoard:
    """The program on a pseudo-terminal; ``port`` is the name to open, as if it were a serial port."""

    def __init__(self, folder: GeneratedFolder, kind: str, telemetry: bool = False) -> None:
        if os.name != "posix":
            raise UserError("the simulated board needs a system with pseudo-terminals (Linux, macOS).")
        import tty

        program = build_board(folder, kind)
        ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)  # held open: the terminal lives until close
        self.port = os.ttyname(self._theirs)
        words = [str(program), "telemetry"] if telemetry else [str(program)]
        self._process: subprocess.Popen[Any] = subprocess.Popen(words, stdin=ours, stdout=ours)
        os.close(ours)

    def close(self) -> None:
        """Switch it off."""
        self._process.terminate()
        self._process.wait()
        os.close(self._theirs)

    def __enter__(self) -> SimulatedBoard:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()
