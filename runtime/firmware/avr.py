"""The 16-bit-int stand-in: ATmega1284P under simavr. int has 16 bits and double 32, as on the C28x in its COFF ABI."""

from __future__ import annotations

from collections.abc import Sequence

from runtime.firmware.build import cross_compile, harness_sources
from runtime.firmware.emulator import Array, Outcome, dumped_words, emulate, outcome
from runtime.firmware.recording import Recording
from runtime.firmware.subject import Subject
from runtime.firmware.tools import find_tool

FLAGS = ("-mmcu=atmega1284p", "-std=c99", "-O2", "-ffp-contract=off")


class Avr:
    """See :class:`runtime.firmware.emulator.Processor`. Floats are software arithmetic (libgcc, avr-libc)."""

    name = "AVR (16-bit int)"
    unit = "cycles"
    known_loop = 64_000.0
    resolution = 256.0  # the timer counts clock / 256
    programs: tuple[str, ...] = ("avr-gcc", "simavr")

    def run(self, subject: Subject, recording: Recording, flags: Sequence[str] = ()) -> Outcome:
        """Run a recording through the subject on an emulated ATmega1284P."""
        text = self._run(subject, recording, flags)
        return outcome(text, recording.steps, f"simavr on {subject.name}", self.resolution)

    def words_at(self, step: int, subject: Subject, recording: Recording, flags: Sequence[str] = ()) -> Array:
        """Return the struct's words after one step."""
        text = self._run(subject, recording, [*flags, f"-DDUMP_STEP={step}"])
        return dumped_words(text, len(subject.words), f"simavr on {subject.name}")

    def _run(self, subject: Subject, recording: Recording, flags: Sequence[str]) -> str:
        compiler, simulator = (find_tool(program) for program in self.programs)
        sources = harness_sources(subject, recording, "avr")
        program = cross_compile(compiler, [*FLAGS, *flags], sources, ["-lm"])
        return emulate([simulator, "-m", "atmega1284p", "-f", "20000000"], program, f"simavr on {subject.name}")
