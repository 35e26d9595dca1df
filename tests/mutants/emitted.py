"""Mutants of the emitted text, C and Python: drawn with a fixed seed from the places where an error could stand.

Every operator knows how such a place looks and what would stand there instead. Places whose change says the same are
left out by construction: ``<`` for ``<=`` in a minimum, a sum of two that changes sides, a name that is a comment's.
"""

from __future__ import annotations

import json
import random
import re
import struct
from bisect import bisect_right
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from tests.mutants.mutant import ROOT, Mutant

GENERATED = ROOT / "generated"
SEED = 20190625

Edit = tuple[int, int, str]


def drives() -> list[str]:
    return sorted(path.parent.name for path in GENERATED.glob("*/manifest.json"))


@dataclass(frozen=True)
class Code:
    """A text, where its code stands (no comments, no heads), and its functions."""

    text: str
    spans: tuple[tuple[int, int], ...]

    @classmethod
    def c(cls, text: str) -> Code:
        start = text.index('#include "')
        blank = re.sub(r"/\*.*?\*/", lambda m: " " * len(m.group()), text, flags=re.DOTALL)
        found = [m.span() for m in re.finditer(r"^.*$", blank, re.MULTILINE) if m.start() > start and m.group().strip()]
        return cls(blank, tuple(found))

    @classmethod
    def python(cls, text: str) -> Code:
        start = text.index("\n\ndef _within") if "\n\ndef _within" in text else 0
        blank = re.sub(r'"""(?:.|\n)*?"""|#[^\n]*', lambda m: re.sub(r"[^\n]", " ", m.group()), text)
        found = [m.span() for m in re.finditer(r"^.*$", blank, re.MULTILINE) if m.start() > start and m.group().strip()]
        return cls(blank, tuple(found))

    def lines(self) -> Iterator[tuple[int, str]]:
        for start, end in self.spans:
            yield start, self.text[start:end]

    @cached_property
    def heads(self) -> tuple[list[int], list[str]]:
        """Where functions begin, and their names."""
        found = [
            (m.start(), m.group(1))
            for m in re.finditer(r"^(?:def |[a-zA-Z][^\n(;#]*\b)(\w+)\(", self.text, re.MULTILINE)
        ]
        return [at for at, _ in found], [name for _, name in found]

    def function(self, at: int) -> tuple[str, str]:
        """Name of the function around a place, and its text up to there."""
        starts, names = self.heads
        k = bisect_right(starts, at) - 1
        return (names[k], self.text[starts[k] : at]) if k >= 0 else ("", "")


Operator = Callable[[Code], Iterator[Edit]]

#: Lines that steer, not compute; small functions where a tie gives the same.
_STEERING = re.compile(r"^\s*(?:for|#|static|int |void|typedef|return \()|\(2 \* k\)|sizeof|range\(")
_EXTREMA = {"smaller", "larger", "_smaller", "_larger"}


def _pattern(pattern: str, new: Callable[[re.Match[str]], str | None], steering: bool = False) -> Operator:
    compiled = re.compile(pattern)

    def places(code: Code) -> Iterator[Edit]:
        for start, line in code.lines():
            if not steering and _STEERING.search(line):
                continue
            for match in compiled.finditer(line):
                text = new(match)
                if text is not None and code.function(start + match.start())[0] not in _EXTREMA:
                    yield start + match.start(), start + match.end(), text

    return places


def next_float(literal: str) -> str:
    """The float32 after a literal (away from zero), as a literal of its language."""
    suffix = "f" if literal.endswith("f") else ""
    (word,) = struct.unpack("<I", struct.pack("<f", float(literal.rstrip("f"))))
    (value,) = struct.unpack("<f", struct.pack("<I", word + 1))
    text = f"{value:.9g}"
    return (text if "." in text or "e" in text else text + ".0") + suffix


def _last_bit(code: Code) -> Iterator[Edit]:
    """The last bit of a constant that is no power of two times a small number."""
    number = r"(?<![\w.])(\d+\.\d+(?:e[-+]\d+)?f)\b"
    for start, line in code.lines():
        if line.startswith("#define") or _STEERING.search(line) is None:
            for match in re.finditer(number, line):
                if float(match.group(1)[:-1]) not in (0.0, 1.0, 2.0, 4.0, 0.5, 0.25):
                    yield start + match.start(), start + match.end(), next_float(match.group(1))


def _wrong_operand(code: Code) -> Iterator[Edit]:
    """``L_pred_21`` where ``L_pred_20`` stood, if the function knows it by then."""
    for start, line in code.lines():
        if _STEERING.search(line):
            continue
        right = line.find("=") + 1
        for match in re.finditer(r"\b([A-Za-z]\w*_)(\d)\b(?!\[)", line[right:]):
            at = start + right + match.start()
            digit = int(match.group(2))
            other = match.group(1) + str(digit - 1 if digit else 1)
            if re.search(rf"\b{other} =", code.function(at)[1]):
                yield at, at + len(match.group()), other


def _swapped_arguments(code: Code) -> Iterator[Edit]:
    """Two arrays of a block's call, exchanged."""
    for start, line in code.lines():
        for match in re.finditer(r"(?<=[(, ])((?:f->)?\w+), ((?:f->)?\w+)(?=[,)])", line):
            names = {match.group(1).split("->")[-1], match.group(2).split("->")[-1]}
            arrays = {
                "x",
                "LD",
                "Q",
                "R",
                "y",
                "u_held",
                "turn",
                "x_pred",
                "LD_pred",
                "x_j",
                "HL",
                "noise",
                "i",
                "rotor",
            }
            if names <= arrays and len(names) == 2 and ("(f->" in line or "(x_" in line or "control(" in line):
                yield start + match.start(), start + match.end(), f"{match.group(2)}, {match.group(1)}"


def _dropped(code: Code) -> Iterator[Edit]:
    """A statement that stores something in the struct or an output."""
    store = re.compile(r"^ +(?:f->|c->|rotor\[|status \|=|\w+_out\[|moving = )[^;]*;\s*$")
    for start, line in code.lines():
        if store.match(line) and not line.strip().startswith("f->LD[k]"):
            yield start, start + len(line.rstrip()), line[: len(line) - len(line.lstrip())] + ";"


def _index(code: Code) -> Iterator[Edit]:
    """The neighbour's entry of an array that is read."""
    for start, line in code.lines():
        right = line.find("=") + 1
        if not right or line.lstrip().startswith("f->"):
            continue
        for match in re.finditer(r"\b([A-Za-z]\w*)\[(\d+)\]", line[right:]):
            k = int(match.group(2))
            if match.group(1) not in {"change", "new_change", "nis", "check"}:
                yield (
                    start + right + match.start(),
                    start + right + match.end(),
                    f"{match.group(1)}[{k - 1 if k else 1}]",
                )


def _reassociated(match: re.Match[str]) -> str:
    return f"{match.group(1)} {match.group(2)} ({match.group(3)} {match.group(2)} {match.group(4)})"


_NAME = r"(?:\w+(?:\[\d\])?)"
_PRODUCT = rf"{_NAME}(?: \* {_NAME})*"

C_OPERATORS: dict[str, Operator] = {
    "plus for minus": _pattern(r"(?<=[\w)]) - (?=[\w(])", lambda m: " + "),
    "minus for plus": _pattern(r"(?<=[\w)]) \+ (?=[\w(])", lambda m: " - "),
    "plus for times": _pattern(r"(?<=[\w)]) \* (?=[\w(])", lambda m: " + "),
    "times for divided by": _pattern(
        r"(?<=[\w)]) / (?=[\w(])|\bPMSM_RECIPROCAL(?=\()", lambda m: " * " if "/" in m[0] else ""
    ),
    "last bit of a constant": _last_bit,
    "wrong operand": _wrong_operand,
    "wrong index": _index,
    "swapped arguments": _swapped_arguments,
    "dropped statement": _dropped,
    "a + (b + c)": _pattern(rf"(?<== )({_PRODUCT}) (\+) ({_PRODUCT}) \+ ({_PRODUCT})(?=;| \+)", _reassociated),
    "a * (b * c)": _pattern(rf"(?<== )({_NAME}) (\*) ({_NAME}) \* ({_NAME})(?=;| \+| -)", _reassociated),
    "smaller for larger": _pattern(
        r"\b(larger|smaller)(?=\()", lambda m: {"larger": "smaller", "smaller": "larger"}[m[1]]
    ),
    "floor dropped": _pattern(
        r"\b(?:larger|floored)\((\w+), (?:Q|R|noise)_\d+(?:, flags)?\)", lambda m: f"({m.group(1)})"
    ),
    "< for <=, > for >=": _pattern(
        r" (<=|>) (?=\(?[\w.]+(?:->\w+)?[ )*])(?!= )", lambda m: {"<=": " < ", ">": " >= "}[m.group(1)], steering=True
    ),
    "== for !=": _pattern(r" (!=|==) 0\)", lambda m: {"!=": " == 0)", "==": " != 0)"}[m.group(1)], steering=True),
    "wrong status": _pattern(
        r"\bPMSM_(INPUT_REJECTED|NOT_CONVERGED|COMMAND_REJECTED|COVARIANCE_REPAIRED|DIVERGED|RESTARTED)\b",
        lambda m: {"INPUT_REJECTED": "PMSM_NOT_CONVERGED", "NOT_CONVERGED": "PMSM_INPUT_REJECTED"}.get(m[1], "0"),
        steering=True,
    ),
    "status not returned": _pattern(r"return status;", lambda m: "return 0;", steering=True),
    "loop one short": _pattern(r"(?<=k < )(N_STATES|count|2)(?=; k\+\+)", lambda m: f"{m[1]} - 1", steering=True),
}

PYTHON_OPERATORS: dict[str, Operator] = {
    **{name: C_OPERATORS[name] for name in list(C_OPERATORS)[:4]},
    "wrong operand": _wrong_operand,
    "wrong index": _index,
    "a + (b + c)": C_OPERATORS["a + (b + c)"],
    "_smaller for _larger": _pattern(
        r"\b(_larger|_smaller)(?=\()", lambda m: {"_larger": "_smaller", "_smaller": "_larger"}[m[1]]
    ),
    "swapped selection": _pattern(
        r"_select\((\w+), (\w+), ((?:f\.)?\w+)\)", lambda m: f"_select({m[1]}, {m[3]}, {m[2]})", steering=True
    ),
}


def draw(code: Code, operators: dict[str, Operator], rng: random.Random, each: int) -> Iterator[tuple[str, Edit]]:
    """``each`` places of every operator, where there are so many."""
    for name, operator in operators.items():
        places = list(operator(code))
        for edit in rng.sample(places, min(each, len(places))):
            yield name, edit


def _line(text: str, at: int) -> str:
    return text[text.rfind("\n", 0, at) + 1 :].split("\n", 1)[0]


def _mutants(
    kind: str, file: str, text: str, code: Code, operators: dict[str, Operator], check: str, places: int, seed: int
) -> Iterator[Mutant]:
    """So many of each operator; their names say what stood there."""
    drive, filter_kind = check.split()[1:3]
    rng = random.Random(f"{seed} {file}")
    for name, (start, end, new) in draw(code, operators, rng, places):
        line = " ".join(_line(text, start).split())
        yield Mutant(
            kind=kind,
            name=f"{Path(file).name}: {name} in {code.function(start)[0] or 'a constant'}: {line[:70]}",
            checks=(check,),
            file=f"{drive}/{file}",
            text=text[:start] + new + text[end:],
            group=f"{drive} {filter_kind}",
            sort=name,
        )


def emitted_mutants(places: int = 1, seed: int = SEED) -> list[Mutant]:
    """Of every shipped drive: its filters, their lane form, the controller, and the module."""
    found: list[Mutant] = []
    for number, drive in enumerate(drives()):
        both = json.loads((GENERATED / drive / "manifest.json").read_text(encoding="utf-8"))["filters"]
        for filter_kind in both:
            one_of_pair = len(both) == 1 or number % 2 == (filter_kind == "ickf")  # their texts are much alike
            stem = f"{drive}_{filter_kind}"
            kinds = {}
            if drive in {"paper_spmsm", "ipmsm_flux"} or one_of_pair:
                kinds |= {"filter, C": (f"{stem}.c", "scalar")}
            if one_of_pair:
                kinds |= {"lanes, C": (f"host/{stem}_lanes.c", "lanes"), "controller, C": (f"{stem}_foc.c", "foc")}
                kinds |= {"Python": (f"{drive}.py", "module")}
            for kind, (file, check) in kinds.items():
                text = (GENERATED / drive / file).read_text(encoding="utf-8")
                language = Code.python if file.endswith(".py") else Code.c
                operators = PYTHON_OPERATORS if file.endswith(".py") else C_OPERATORS
                if kind == "lanes, C":
                    names = ("plus for minus", "last bit of a constant", "wrong operand", "a + (b + c)", "== for !=")
                    operators = {name: operators[name] for name in names}
                about = f"{check} {drive} {filter_kind}"
                found += _mutants(kind, file, text, language(text), operators, about, places, seed)
    return found
