"""A board made of this machine with a motor behind it: the bench's C compiled as a program, at a pseudo-terminal.

The motor, its switching inverter and its sensors are ``simulated_motor.c``. It proves nothing of a chip.
"""

from __future__ import annotations

import os
import subprocess
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from runtime.design.facts import Facts
from runtime.estimator.compiler import build_program
from runtime.folders.resolve import drive_folder
from runtime.system.errors import UserError

HERE = Path(__file__).parent
OWN = ("simulated_board.c", "simulated_motor.c", "simulated_motor.h")
#: The bench's files are the same in every folder.
FOLDER = "paper_spmsm"


@dataclass(frozen=True)
class Truth:
    """The motor that is simulated, and what its inverter and sensors do: V of a switch, A of the two sensors, N m."""

    facts: Facts
    drop: float = 0.0
    offset: tuple[float, float] = (0.0, 0.0)
    dry: float = 0.0
    theta: float = 0.0
    seed: int = 1
    delay: int = 1
    baud: int = 115200

    def words(self) -> list[str]:
        """Arguments of the program."""
        f = self.facts
        values = {"R": f.R, "L_d": f.L_d, "L_q": f.L_q, "psi_m": f.psi_m, "pole_pairs": f.p, "J": f.J, "D": f.D}
        values |= {"dry": self.dry, "dc_link": f.dc_link, "T": f.T, "dead_time": f.dead_time, "drop": self.drop}
        values |= {"range": f.range, "bits": f.bits, "noise": f.noise, "theta": self.theta, "seed": self.seed}
        values |= {"offset_a": self.offset[0], "offset_b": self.offset[1], "delay": self.delay, "baud": self.baud}
        values |= {"limit_current": f.max_current, "limit_speed": 1.1 * f.omega_e, "limit_seconds": 240.0}
        return [f"{name}={value!r}" for name, value in values.items()]


def board_sources() -> dict[str, str]:
    """The texts of the board's program, by flat file name."""
    folder = drive_folder(FOLDER)
    shared = [f"pmsm_{part}{end}" for part in ("link", "telemetry", "commission") for end in (".h", ".c")]
    shared.append("pmsm_commission_talk.c")
    sources = {name: folder.text(f"board/{name}") for name in shared}
    own = {name: (HERE / name).read_text(encoding="utf-8") for name in OWN}
    return {**sources, "pmsm_port.h": folder.text("pmsm_port.h"), **own}


class SimulatedMotor:
    """The program on a pseudo-terminal; ``port`` is the name to open, as if it were a serial port."""

    def __init__(self, truth: Truth, report: Path | None = None) -> None:
        if os.name != "posix":
            raise UserError("the simulated board needs a system with pseudo-terminals (Linux, macOS).")
        import tty

        program = build_program(board_sources(), {})
        ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        self.port = os.ttyname(self._theirs)
        words = [str(program), *truth.words()]
        if report is not None:
            words.append(f"report={report}")
        self._process: subprocess.Popen[Any] = subprocess.Popen(words, stdin=ours, stdout=ours)
        os.close(ours)

    def close(self) -> None:
        """Switch it off."""
        self._process.terminate()
        self._process.wait()
        os.close(self._theirs)

    def __enter__(self) -> SimulatedMotor:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()
