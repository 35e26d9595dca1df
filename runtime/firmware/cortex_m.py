"""Cortex-M cores with an FPU under qemu, with an exact count of instructions; one for each target that has a board.

With ``-icount shift=10`` an instruction takes 1024 ns of the emulated time, in which SysTick counts the board's clock:
at 25 MHz instructions = ticks * 40 / 1024. Its 24 bits span 655 000 instructions there.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from codegen.targets.description import Board
from codegen.targets.find import find_target, target_names
from runtime.firmware.build import cross_compile, harness_sources
from runtime.firmware.emulator import Array, Outcome, dumped_words, emulate, outcome
from runtime.firmware.recording import Recording
from runtime.firmware.subject import Subject
from runtime.firmware.tools import find_tool

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-nostartfiles", "-T", "board.ld")
LIBRARIES = ("-lm", "-lc", "-lgcc")
MACHINE = (
    *("-icount", "shift=10", "-display", "none", "-monitor", "none"),
    *("-serial", "none", "-semihosting-config", "enable=on,target=native", "-kernel"),
)
#: s: an instruction's emulated time.
INSTRUCTION = 1024e-9


class CortexM:
    """See :class:`runtime.firmware.emulator.Processor`.

    Parameters
    ----------
    name : str
        As a table says it.
    board : Board
        The machine of qemu.
    """

    unit = "instructions"
    known_loop = 20_002.0  # between two readings in assembly, the second one included
    resolution = 0.0
    programs: tuple[str, ...] = ("arm-none-eabi-gcc", "qemu-system-arm")

    def __init__(self, name: str, board: Board) -> None:
        self.name, self.board = name, board

    @property
    def flags(self) -> tuple[str, ...]:
        """Of the cross compiler."""
        places = (f"-Wl,--defsym={place}={address:#x}" for place, address in self._places)
        return (*self.board.flags, *FLAGS, *places)

    @property
    def _places(self) -> tuple[tuple[str, int], ...]:
        return ("code_begin", self.board.code), ("data_begin", self.board.data)

    def run(self, subject: Subject, recording: Recording, flags: Sequence[str] = ()) -> Outcome:
        """Run a recording through the subject on the emulated board."""
        text = self._run(subject, recording, flags)
        per_tick = 1 / (self.board.clock * INSTRUCTION)
        found = outcome(text, recording.steps, f"qemu on {subject.name}", per_tick)
        return Outcome(found.checksums, np.round(found.cost), round(found.known_loop))

    def words_at(self, step: int, subject: Subject, recording: Recording, flags: Sequence[str] = ()) -> Array:
        """Return the struct's words after one step."""
        text = self._run(subject, recording, [*flags, f"-DDUMP_STEP={step}"])
        return dumped_words(text, len(subject.words), f"qemu on {subject.name}")

    def _run(self, subject: Subject, recording: Recording, flags: Sequence[str]) -> str:
        compiler, emulator = (find_tool(program) for program in self.programs)
        sources = harness_sources(subject, recording, "cortex_m")
        program = cross_compile(compiler, [*self.flags, *flags], sources, LIBRARIES)
        machine = ("-M", self.board.machine, "-cpu", self.board.cpu, *MACHINE)
        return emulate([emulator, *machine], program, f"qemu on {subject.name}")


def boards() -> dict[str, CortexM]:
    """The emulated processors by target, of those that have one."""
    targets = [find_target(name) for name in target_names()]
    return {target.name: CortexM(target.stand_in.name, target.board) for target in targets if target.board}
