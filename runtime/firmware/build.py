"""From a subject and a recording to a program: the harness's texts, and the cross compiler."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from runtime.estimator.compiler import cached, run_compiler
from runtime.firmware.recording import Recording
from runtime.firmware.subject import INPUTS, Subject

HARNESS = Path(__file__).with_name("harness")


def harness_sources(subject: Subject, recording: Recording, processor: str) -> dict[str, str]:
    """Everything to compile for a processor: the generated files, the harness, its port, and subject.h."""
    port = {path.name: path.read_text(encoding="utf-8") for path in sorted((HARNESS / processor).iterdir())}
    harness = (HARNESS / "harness.c").read_text(encoding="utf-8")
    return {**subject.sources, **port, "harness.c": harness, "subject.h": subject_header(subject, recording)}


def subject_header(subject: Subject, recording: Recording) -> str:
    """subject.h: names, the struct's fields, and the recording as tables of 32-bit words."""
    name = subject.name
    controller = subject.controller
    inputs = np.concatenate([segment.inputs for segment in recording.segments])
    parameters = ["subject_t *s", "const float32 *a", "const float32 *b", *(["float32 *out"] if controller else [])]
    arguments = ["&subject", "input", "input + 2", *(["output"] if controller else [])]
    segments = _segment_words(subject, recording)
    fields = [
        f"{{ offsetof(subject_t, {f.name}), {f.count}, SIZE({f.name}) / {f.count}, {int(f.is_int)} }}"
        for f in subject.fields
    ]
    lines = [
        f'#include "{name}.h"',
        f"typedef {name}_t subject_t;",
        f"#define PARAMETERS ({', '.join(parameters)})",
        f"#define ARGUMENTS ({', '.join(arguments)})",
        "typedef int step_function PARAMETERS;",
        f"#define SUBJECT_STEP {name}_step",
        f"#define SUBJECT_INIT(option) {name}_init(&subject{', option' if controller else ''})",
        f"#define SUBJECT_RESET() {subject.filter_name}_reset({_filter(subject)})",
        f"#define INPUTS {INPUTS}",
        f"#define OUTPUTS {subject.outputs}",
        f"#define WORDS {len(subject.words)}",
        f"#define STEPS {recording.steps}",
        f"#define RUNS {len(fields)}",
        f"#define SEGMENT_WORDS {len(segments)}",
        "#define SIZE(field) sizeof(((subject_t *)0)->field)",
        "static const struct { uint16_t offset, count, size; uint8_t is_int; } layout[RUNS] = {",
        *(f"    {field}," for field in fields),
        "};",
        *_table("segments", segments),
        *_table("inputs", float_words(inputs.ravel())),
    ]
    return "\n".join(lines) + "\n"


def _filter(subject: Subject) -> str:
    """The filter's address."""
    return f"&subject.{subject.filter_place}".removesuffix(".")


def float_words(values: Iterable[float]) -> list[int]:
    """The bits of numbers rounded to float32."""
    return [int(word) for word in np.array(list(values), dtype=np.float32).view(np.uint32)]


def _segment_words(subject: Subject, recording: Recording) -> list[int]:
    """The table that harness.c's start_segment reads."""
    index = {name: k for k, name in enumerate(subject.struct_words)}
    integer = subject.integers[len(subject.words) - len(subject.struct_words) :]
    words, first = [], 0
    for segment in recording.segments:
        words += [first, segment.option, len(segment.fields)]
        for name, value in segment.fields.items():
            at = index[name]
            words += [at, int(value) & 0xFFFFFFFF if integer[at] else float_words([value])[0]]
        first += len(segment.inputs)
    return words


def _table(name: str, words: Sequence[int]) -> list[str]:
    rows = [", ".join(f"0x{word:08x}UL" for word in words[k : k + 8]) for k in range(0, len(words), 8)]
    return [f"static const uint32_t {name}[{len(words)}] TABLE = {{", *(f"    {row}," for row in rows), "};"]


def cross_compile(compiler: str, flags: Sequence[str], sources: Mapping[str, str], link: Sequence[str] = ()) -> Path:
    """Compile and link for a processor, or find the program in the cache.

    Parameters
    ----------
    compiler : str
        Path of the cross compiler.
    flags : sequence of str
        For compiling and linking.
    sources : mapping
        File name -> text; ``.c`` files are compiled, the others may be included.
    link : sequence of str
        What follows the files: libraries.

    Raises
    ------
    UserError
        The compiler refuses, or nothing can be written.
    """
    stat = Path(compiler).stat()
    identity = repr((sorted(sources.items()), compiler, stat.st_size, stat.st_mtime_ns, list(flags), list(link)))

    def make(folder: Path) -> Path:
        for name, text in sources.items():
            (folder / name).write_text(text, encoding="utf-8")
        files = [name for name in sources if name.endswith(".c")]
        run_compiler([compiler, *flags, *files, "-o", "out.elf", *link], folder, Path(compiler).name)
        return folder / "out.elf"

    return cached(f"{hashlib.sha256(identity.encode()).hexdigest()[:32]}.elf", make)
