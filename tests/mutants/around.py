"""Mutants of the emitted text around the filters: the example interrupt and the self-tests, drawn with a seed.

Places whose change says the same are left out: a limit that is met exactly by no test and none can tell, the branch
behind ``wait on``, a tie of two ways that give the same number there.
"""

from __future__ import annotations

import random
import re
from collections.abc import Iterator

from tests.mutants.emitted import GENERATED, SEED, Code, Edit, Operator, _pattern
from tests.mutants.mutant import Mutant

EXAMPLE = (
    "pytest tests/codegen/test_example.py tests/codegen/test_modes_start.py tests/codegen/test_modes_read.py "
    "tests/codegen/test_modes_rival.py -k {drive}"
)
WORDS = "pytest tests/codegen/test_selftest_words.py -k '{drive}-foc'"
FILTER_WORDS = "pytest tests/codegen/test_selftest_words.py -k '{drive} and not foc'"

#: The sources of the draws: file, kind, test.
SUBJECTS = tuple(
    (f"{drive}/{file}", kind, check.format(drive=drive))
    for drive, files in {
        "paper_spmsm": (
            ("example_isr.c", "example interrupt", EXAMPLE),
            ("paper_spmsm_ickf_selftest.c", "self-test", FILTER_WORDS),
            ("paper_spmsm_ickf_foc_selftest.c", "self-test", WORDS),
        ),
        "ipmsm_flux": (
            ("example_isr.c", "example interrupt", EXAMPLE),
            ("ipmsm_flux_ickf_selftest.c", "self-test", FILTER_WORDS),
            ("ipmsm_flux_ickf_foc_selftest.c", "self-test", WORDS),
        ),
        "ipmsm_adaptive": (("example_isr.c", "example interrupt", EXAMPLE),),
    }.items()
    for file, kind, check in files
)

_FLIPPED = {"<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "!=", "!=": "=="}


def _other(names: tuple[str, ...]) -> Operator:
    """The next of some names in the place of one."""
    pattern = rf"(?<!define )\b({'|'.join(names)})\b"
    return _pattern(pattern, lambda m: names[(names.index(m[1]) + 1) % len(names)], steering=True)


def _macros(code: Code) -> Iterator[Edit]:
    """A macro's number: one more, or a quarter more."""
    for match in re.finditer(r"^#define \w+ ([\d.]+(?:e[+-]?\d+)?)(f?)(?= |$)", code.text, re.MULTILINE):
        value = float(match[1])
        new = f"{value * 1.25:.9g}" if match[2] else str(int(value) + 1)
        yield match.start(1), match.end(1), new if "." in new or "e" in new or not match[2] else new + ".0"


def _literals(code: Code) -> Iterator[Edit]:
    """A number in the code: zero and one exchanged, floats a quarter more."""
    for start, line in code.lines():
        if line.startswith(("#", "static const", "INTERRUPT", "typedef")) or re.match(r"\s+\S+ \w+(?:\[\w+\])?;", line):
            continue
        for match in re.finditer(r"(?<![\w.\]\[])(\d+\.\d+)f\b|(?<![\w.\[])(\d+)(?![\w.\]])", line):
            if match[1]:
                value = 1.25 * float(match[1]) or 1.0
                yield start + match.start(1), start + match.end(1), f"{value:.6f}"
            else:
                yield start + match.start(2), start + match.end(2), "1" if match[2] == "0" else str(int(match[2]) + 1)


def _dropped(code: Code) -> Iterator[Edit]:
    """A statement that stores or calls."""
    for start, line in code.lines():
        if re.match(r"^ +(?!const |return|static |int |float32 )[\w.>\[\]-]+(?: = [^;]*|\([^;]*\)|\+\+);\s*$", line):
            yield start, start + len(line.rstrip()), line[: len(line) - len(line.lstrip())] + ";"


def _indices(code: Code) -> Iterator[Edit]:
    """The neighbour's entry of an array."""
    for start, line in code.lines():
        for match in re.finditer(r"(?<=\w)\[(\d)\](?!;$)", line):
            if not re.match(r"^\s*(?:typedef|static|extern|float32|int|void|const float32 \w+\[|Uint)", line):
                yield start + match.start(1), start + match.end(1), "1" if match[1] == "0" else str(int(match[1]) - 1)


def _table_bits(code: Code) -> Iterator[Edit]:
    """A bit of a recorded word; one word of an allowance."""
    for match in re.finditer(r"0x([0-9A-F]{7})([0-9A-F])UL", code.text):
        yield match.start(2), match.end(2), f"{int(match[2], 16) ^ 1:X}"


OPERATORS: dict[str, Operator] = {
    "plus for minus": _pattern(r"(?<=[\w)\]]) - (?=[\w(])", lambda m: " + ", steering=True),
    "minus for plus": _pattern(r"(?<=[\w)\]]) \+ (?=[\w(])", lambda m: " - ", steering=True),
    "plus for times": _pattern(r"(?<=[\w)\]]) \* (?=[\w(])", lambda m: " + ", steering=True),
    "times for divided by": _pattern(r"(?<=[\w)\]]) / (?=[\w(])", lambda m: " * ", steering=True),
    "sign dropped": _pattern(r"(?<=[=(,?:] )-(?=[A-Za-z(])|(?<=\()-(?=[A-Za-z])", lambda m: "", steering=True),
    "comparison": _pattern(r" (<=|>=|==|!=|<|>) (?=\S)", lambda m: f" {_FLIPPED[m[1]]} ", steering=True),
    "and for or": _pattern(r" (&&|\|\|) ", lambda m: " || " if m[1] == "&&" else " && ", steering=True),
    "another place": _other(("OMEGA", "THETA")),
    "macro": _macros,
    "number": _literals,
    "dropped statement": _dropped,
    "wrong index": _indices,
    "recorded bit": _table_bits,
}

#: A change that says the same, by what stands in its line: why.
SAME: tuple[tuple[str, str, str], ...] = (
    ("macro", r"#define WHOLE_CONTROLLER ", "any number but 0 asks for the whole controller"),
    ("number", r"float32 v\[2\] = \{0\.0f, 0\.0f\};", "your_current_loop writes both before anybody reads them"),
    ("number", r"^judge_run\(.* -> 2$", "a truth is asked whether it is 0"),
    ("number", r"agrees\(.*, 0, 0\.0f\).* -> 1\.0+$", "nothing is allowed, with any tolerance"),
)


def same(sort: str, line: str, new: str) -> str:
    """Why a change of this sort in this line says the same; empty if it does not."""
    return next((why for of, pattern, why in SAME if of == sort and re.search(pattern, f"{line} -> {new}")), "")


def around_mutants(places: int = 2, seed: int = SEED) -> list[Mutant]:
    """So many places of each operator in each file."""
    found: list[Mutant] = []
    for file, kind, check in SUBJECTS:
        text = (GENERATED / file).read_text(encoding="utf-8")
        code, rng = Code.c(text), random.Random(f"{seed} {file}")
        for sort, operator in OPERATORS.items():
            edits = [edit for edit in operator(code) if text[edit[0] : edit[1]].strip()]
            for start, end, new in rng.sample(edits, min(places, len(edits))):
                line = " ".join(text[text.rfind("\n", 0, start) + 1 :].split("\n", 1)[0].split())
                found.append(
                    Mutant(
                        kind=f"{kind}, drawn",
                        name=f"{file}: {sort} in {code.function(start)[0] or 'a table'}: {line[:70]} ({start}: {new})",
                        checks=(check,),
                        file=file,
                        text=text[:start] + new + text[end:],
                        group=f"text {file}",
                        sort=sort,
                        equivalent=same(sort, line, new),
                    )
                )
    return found
