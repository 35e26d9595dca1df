"""The single-precision FPU stand-in: Cortex-M4F under qemu, with an exact count of instructions.

With ``-icount shift=10`` an instruction takes 1024 ns of the emulated time, in which SysTick counts 25 MHz:
instructions = ticks * 40 / 1024. The board's 24-bit counter spans 655 000 instructions.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from runtime.firmware.build import cross_compile, harness_sources
from runtime.firmware.emulator import Array, Outcome, dumped_words, emulate, outcome
from runtime.firmware.recording import Recording
from runtime.firmware.subject import Subject
from runtime.firmware.tools import find_tool

FLAGS = (
    *("-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"),
    *("-std=c99", "-O2", "-ffp-contract=off", "-nostartfiles", "-T", "board.ld"),
)
LIBRARIES = ("-lm", "-lc", "-lgcc")
MACHINE = (
    *("-M", "mps2-an386", "-cpu", "cortex-m4", "-icount", "shift=10", "-display", "none", "-monitor", "none"),
    *("-serial", "none", "-semihosting-config", "enable=on,target=native", "-kernel"),
)
INSTRUCTIONS_PER_TICK = 40 / 1024


class CortexM4:
    """See :class:`runtime.firmware.emulator.Processor`."""

    name = "Cortex-M4F"
    unit = "instructions"
    known_loop = 20_003.0  # the call and the return of the 20001 counted
    resolution = 0.0
    programs: tuple[str, ...] = ("arm-none-eabi-gcc", "qemu-system-arm")

    def run(self, subject: Subject, recording: Recording, flags: Sequence[str] = ()) -> Outcome:
        """Run a recording through the subject on an emulated Cortex-M4F."""
        text = self._run(subject, recording, flags)
        found = outcome(text, recording.steps, f"qemu on {subject.name}", INSTRUCTIONS_PER_TICK)
        return Outcome(found.checksums, np.round(found.cost), round(found.known_loop))

    def words_at(self, step: int, subject: Subject, recording: Recording, flags: Sequence[str] = ()) -> Array:
        """Return the struct's words after one step."""
        text = self._run(subject, recording, [*flags, f"-DDUMP_STEP={step}"])
        return dumped_words(text, len(subject.words), f"qemu on {subject.name}")

    def _run(self, subject: Subject, recording: Recording, flags: Sequence[str]) -> str:
        compiler, emulator = (find_tool(program) for program in self.programs)
        sources = harness_sources(subject, recording, "cortex_m4")
        program = cross_compile(compiler, [*FLAGS, *flags], sources, LIBRARIES)
        return emulate([emulator, *MACHINE], program, f"qemu on {subject.name}")
