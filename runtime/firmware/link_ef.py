"""Link E-F: the generated C on the host against the same file on a 16-bit-int AVR and on Cortex-M cores, bit for bit.

Every word of the struct, the status and the outputs are compared after every step: by checksum first, and where a
checksum differs, word by word from a second run, so that a break is reported at its first divergence.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.estimator.folder import GeneratedFolder
from runtime.firmware.avr import Avr
from runtime.firmware.cortex_m import boards
from runtime.firmware.drive_recording import drive_recording
from runtime.firmware.emulator import Outcome, Processor
from runtime.firmware.host import run_on_host
from runtime.firmware.recording import Recording, controller_recording, filter_recording
from runtime.firmware.static.check import Check
from runtime.firmware.subject import Part, Subject, subjects
from runtime.firmware.tools import missing_packages
from runtime.folders.stated import stated_drive
from runtime.system.errors import UserError

Array = NDArray[Any]
Progress = Callable[[str], None]

STEPS = 1000
PROCESSORS: tuple[Processor, ...] = (Avr(), *boards().values())

#: What each kind of subject is given.
RECORDINGS: Mapping[Part, Callable[[GeneratedFolder, int], Recording]] = {
    "": filter_recording,
    "foc": controller_recording,
    "drive": drive_recording,
}

HOW = "measured on a stand-in"
NAN = 0x7FC00000


@dataclass(frozen=True)
class Divergence:
    """The first word in which a processor and the host part."""

    step: int
    word: str
    expected: str
    found: str

    def __str__(self) -> str:
        return (
            f"first divergence at step {self.step}, {self.word}: host {self.expected}, found {self.found}, "
            "allowed identical bits"
        )


@dataclass(frozen=True)
class Comparison:
    """One step function on one processor against the host."""

    subject: Subject
    processor: Processor
    steps: int
    divergence: Divergence | None
    outcome: Outcome

    @property
    def counted_exactly(self) -> bool:
        """The loop of known length was counted right."""
        return abs(self.outcome.known_loop - self.processor.known_loop) <= self.processor.resolution

    def check(self, nans: int) -> Check:
        """As a row of the table; ``nans`` words of the host's run were no numbers."""
        words = len(self.subject.words)
        name = f"E-F, {self.processor.name}"
        if self.divergence is not None:
            where = f"{self.subject.name} on {self.processor.name}, link E-F: {self.divergence}"
            return Check(name, self.subject.name, "failed", f"differs at step {self.divergence.step}", HOW, (where,))
        median, worst = np.median(self.outcome.cost), np.max(self.outcome.cost)
        figure = (
            f"{self.steps} steps x {words} words identical; {median:,.0f} {self.processor.unit} (worst {worst:,.0f})"
        )
        said = f"{nans} words are NaN on both, after phase currents that are no numbers; which NaN is not compared"
        return Check(name, self.subject.name, "passed", figure, HOW, (said,) if nans else ())


def link_ef(
    folder: GeneratedFolder,
    progress: Progress = lambda text: None,
    steps: int = STEPS,
    processors: Sequence[Processor] = PROCESSORS,
) -> list[Check]:
    """Every filter, controller and drive of a folder on every processor, and whether their counters count right.

    A processor whose tools are missing gives one row that says so.
    """
    ready, rows = [], []
    for processor in processors:
        missing = _missing(processor)
        ready += [] if missing else [processor]
        rows += [missing] if missing else []
    if not ready:
        return rows
    every = subjects(folder)
    recordings = {part: RECORDINGS[part](folder, steps) for part in dict.fromkeys(s.part for s in every)}

    def on_host(subject: Subject) -> Array:
        progress(f"{subject.name}: on the host")
        return run_on_host(subject, recordings[subject.part])

    def away(job: tuple[Processor, Subject, Array]) -> Comparison | Check:
        processor, subject, expected = job
        progress(f"{subject.name}: on {processor.name}")
        try:
            return compare(processor, subject, recordings[subject.part], expected)
        except UserError as error:
            return Check(f"E-F, {processor.name}", subject.name, "failed", "did not run to its end", HOW, (str(error),))

    # The work is done by other processes, so threads are enough to use every core.
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        expected = list(pool.map(on_host, every))
        jobs = [(p, subject, words) for p in ready for subject, words in zip(every, expected, strict=True)]
        results = list(pool.map(away, jobs))
    constant = stated_drive(folder).constant_time
    for (processor, subject, words), result in zip(jobs, results, strict=True):
        rows.append(result.check(int(np.sum(words == NAN))) if isinstance(result, Comparison) else result)
        if constant and isinstance(result, Comparison) and subject.part == "" and not processor.resolution:
            rows.append(same_path(result, words[:, 0]))
    comparisons = [result for result in results if isinstance(result, Comparison)]
    return [*rows, *(_counter(p, [c for c in comparisons if c.processor is p], folder.drive) for p in ready)]


def same_path(comparison: Comparison, status: Array) -> Check:
    """Whether every step whose status is 0 took as long as every other, counted by the processor.

    Parameters
    ----------
    comparison : Comparison
        Of a filter in constant time.
    status : array of uint32, (steps,)
        What the steps returned.
    """
    good = comparison.outcome.cost[status == 0]
    counted = np.unique(good)
    figure = f"{len(good)} steps of status 0"
    if len(counted):
        figure += f", {' to '.join(f'{cost:,.0f}' for cost in dict.fromkeys((counted[0], counted[-1])))}"
        figure += f" {comparison.processor.unit} each"
    name = f"constant time, {comparison.processor.name}"
    return Check(name, comparison.subject.name, "passed" if len(counted) == 1 else "failed", figure, HOW)


def compare(
    processor: Processor,
    subject: Subject,
    recording: Recording,
    expected: Array,
    flags: Sequence[str] = (),
) -> Comparison:
    """Run a step function on a processor and compare every word with the host's.

    Parameters
    ----------
    processor : Processor
    subject : Subject
        What is compiled for it.
    recording : Recording
    expected : array of uint32, (steps, words)
        From :func:`runtime.firmware.host.run_on_host`.
    flags : sequence of str
        Added to the compiler's, as the tests do to break the link.

    Raises
    ------
    UserError
        A tool is missing, or the program does not compile or not end.
    """
    outcome = processor.run(subject, recording, flags)
    sums = np.array([zlib.crc32(row.astype("<u4").tobytes()) for row in expected], dtype=np.uint32)
    different = np.flatnonzero(outcome.checksums != sums)
    divergence = None
    if len(different):
        step = int(different[0])
        found = processor.words_at(step, subject, recording, flags)
        divergence = _first(subject, step, expected[step], found)
    return Comparison(subject, processor, recording.steps, divergence, outcome)


def _first(subject: Subject, step: int, expected: Array, found: Array) -> Divergence:
    words = np.flatnonzero(expected != found)
    if not len(words):
        raise UserError(f"{subject.name}: the checksums of step {step} differ, its words do not; run it again.")
    k = int(words[0])
    values = [_spelled(word, subject.integers[k]) for word in (expected[k], found[k])]
    return Divergence(step, subject.words[k], *values)


def _spelled(word: np.uint32, integer: bool) -> str:
    """A word as a number, with a float's bits beside it."""
    if integer:
        return str(np.int32(word.view(np.int32)))
    return f"{float(word.view(np.float32)):.9g} (0x{int(word):08x})"


def _missing(processor: Processor) -> Check | None:
    """A row that says which packages a processor lacks."""
    packages = " ".join(missing_packages(processor.programs))
    if not packages:
        return None
    name = f"E-F, {processor.name}"
    detail = f"{name} was not run. Install what it needs (Debian: apt-get install {packages})."
    return Check(name, "all", "not run", f"needs {packages}", "not run", (detail,))


def _counter(processor: Processor, comparisons: Sequence[Comparison], drive: str) -> Check:
    """Can the counter be believed? In every run it measured a loop whose length is known."""
    name = f"counter, {processor.name}"
    counted = sorted({comparison.outcome.known_loop for comparison in comparisons})
    exact = bool(comparisons) and all(comparison.counted_exactly for comparison in comparisons)
    figure = f"loop of {processor.known_loop:,.0f} {processor.unit}: counted {', '.join(f'{c:,.0f}' for c in counted)}"
    if processor.resolution:
        figure += f", in steps of {processor.resolution:.0f}"
    return Check(name, drive, "passed" if exact else "failed", figure, HOW)
