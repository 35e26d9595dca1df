"""The generated C run as C++ whose float32 counts its operations: a count that knows nothing of the ledger's.

``counted.hpp`` is the type. Operators are counted by the compiler's own overload resolution, calls by its hooks at
entry and exit; for conditions a word is put into the text (``chosen()`` to the left of ``&&``, ``||`` and ``?``,
``asked()`` into the head of a loop; ``if`` and ``while`` are macros). Nothing is parsed.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from runtime.firmware.build import float_words
from runtime.firmware.subject import Subject

HERE = Path(__file__).parent
#: As ``counted.hpp`` orders them; ``choice`` is a selection or a branch, which executed code does not tell apart.
KINDS = ("add", "mul", "div", "sqrt", "compare", "choice", "call")

Count = dict[str, int]


@dataclass(frozen=True)
class Piece:
    """Steps in a row: words set before the filter's reset and after it, by C name; ``inputs`` (N, 4)."""

    inputs: np.ndarray
    fields: Mapping[str, float] = field(default_factory=dict)
    later: Mapping[str, float] = field(default_factory=dict)
    option: int = 0


@dataclass(frozen=True)
class Executed:
    """What was executed: of each step, and the least and the most of each function's calls, callees included.

    ``modes``: the drive's mode before each step; -1 where it has none.
    """

    steps: list[Count]
    modes: list[int]
    functions: dict[str, tuple[Count, Count]]


def compiler() -> str | None:
    """A C++ compiler that has the hooks, or None."""
    return shutil.which("g++") or shutil.which("clang++")


def run(subject: Subject, pieces: Sequence[Piece], folder: Path) -> Executed:
    """Compile a subject's files unchanged but for the words that count, and run it.

    Parameters
    ----------
    subject : Subject
    pieces : sequence of Piece
    folder : Path
        An empty one.
    """
    for name, text in subject.sources.items():
        (folder / name).write_text(instrumented(text) if name.endswith(".c") else text, encoding="utf-8")
    (folder / "main.cpp").write_text(_main(subject, pieces), encoding="utf-8")
    tool, program = compiler(), folder / "program"
    assert tool is not None
    sources = [str(folder / name) for name in subject.sources if name.endswith(".c")]
    flags = ["-x", "c++", "-std=c++17", "-O0", "-w", "-fno-exceptions", "-ffp-contract=off", "-no-pie", "-I", str(HERE)]
    hooks = ["-finstrument-functions", "-include", "counted.hpp"]
    subprocess.run([tool, *flags, *hooks, *sources, str(folder / "main.cpp"), "-o", str(program), "-lm"], check=True)
    said = subprocess.run([str(program)], check=True, capture_output=True, text=True).stdout
    names = dict(_symbols(program))
    steps, modes, found = [], [], {}
    for kind, *words in map(str.split, said.splitlines()):
        if kind == "S":
            modes.append(int(words[0]))
            steps.append(dict(zip(KINDS, map(int, words[1:]), strict=True)))
        else:
            least, most = (dict(zip(KINDS, map(int, words[k::2]), strict=True)) for k in (1, 2))
            found[int(words[0], 16)] = least, most
    return Executed(steps, modes, _by_name(found, names))


def instrumented(text: str) -> str:
    """C with a word that counts at each ``&&``, ``||`` and ``?``, and in the head of each ``for``.

    Parameters
    ----------
    text : str

    >>> print(instrumented("for (k = 0; k < 3; k++) {\\n    a = (b && c) ? 1 : 2;\\n}"), end="")
    for (k = 0; asked(), k < 3; k++) {
        a = (b + chosen() && c) + chosen() ? 1 : 2;
    }
    """
    lines = text.split("\n")
    for k, line in enumerate(lines):
        if not line.startswith("#"):
            line = re.sub(r" (&&|\|\||\?)(?= |$)", r" + chosen() \1", line)
            lines[k] = re.sub(r"\bfor \(([^;]*); ", r"for (\1; asked(), ", line)
    return "\n".join(lines)


def _main(subject: Subject, pieces: Sequence[Piece]) -> str:
    """The program: pieces, their words and their inputs as tables."""
    option, output = (", option", ", output") if subject.controller else ("", "")
    owner = f"&s.{subject.filter_place}".removesuffix(".")
    integer = dict(zip(subject.words, subject.integers, strict=True))
    words, table = [], []
    for piece in pieces:
        for name, value in (*piece.fields.items(), *piece.later.items()):
            bits = int(value) & 0xFFFFFFFF if integer[name] else float_words([value])[0]
            words.append(f"{{ offsetof(subject_t, {name}), 0x{bits:x}u }},")
        table.append(f"{{ {piece.option}, {len(piece.fields)}, {len(piece.later)}, {len(piece.inputs)} }},")
    inputs = float_words(np.concatenate([piece.inputs for piece in pieces]).ravel())
    lines = [
        f'#include "{subject.name}.h"',
        f"typedef {subject.name}_t subject_t;",
        "static subject_t s;",
        f"static float32 output[{subject.outputs + 1}];",
        f"#define INIT(option) {subject.name}_init(&s{option})",
        f"#define RESET() {subject.filter_name}_reset({owner})",
        f"#define STEP(input) {subject.name}_step(&s, input, input + 2{output})",
        f"#define MODE {'s.supervisor.mode' if subject.part == 'drive' else '-1'}",
        "static const struct { int option, fields, later, steps; } PIECES[] = {",
        *table,
        "};",
        "static const struct { unsigned long place; unsigned bits; } WORDS[] = {",
        *(words or ["{ 0, 0 }"]),
        "};",
        f"static const unsigned INPUTS[] = {{ {', '.join(f'0x{word:x}u' for word in inputs)} }};",
        '#include "counted_main.hpp"',
    ]
    return "\n".join(lines) + "\n"


def _symbols(program: Path) -> Iterator[tuple[int, str]]:
    """Addresses and names, without parameters."""
    listed = subprocess.run(["nm", "-C", str(program)], check=True, capture_output=True, text=True).stdout
    for line in listed.splitlines():
        words = line.split(maxsplit=2)
        if len(words) == 3 and words[1] in "tT":
            yield int(words[0], 16), words[2].partition("(")[0]


def _by_name(found: Mapping[int, tuple[Count, Count]], names: Mapping[int, str]) -> dict[str, tuple[Count, Count]]:
    """Functions by name; those of a name that several files have (``smaller``) together."""
    merged: dict[str, list[tuple[Count, Count]]] = defaultdict(list)
    for address, extremes in found.items():
        merged[names[address]].append(extremes)
    return {
        name: (
            {kind: min(least[kind] for least, _ in several) for kind in KINDS},
            {kind: max(most[kind] for _, most in several) for kind in KINDS},
        )
        for name, several in merged.items()
    }
