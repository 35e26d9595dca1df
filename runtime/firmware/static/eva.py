"""Gate: Frama-C's EVA proves that one step from any state in a box, with any input, makes no run-time error.

No NaN, no infinity, no division by zero, no read of what was not written, nothing out of bounds. EVA computes with
intervals: what it proves holds for every float32 in them; what it cannot prove is an alarm, not yet an error.

Four kinds of fact are handed to it, each proved elsewhere. A wrapped angle lies within a turn: that of two ways it is
what is inside already is beyond intervals. Sine and cosine stay within 1 plus the error that the
generator proved for them; EVA checks that fact's condition (the argument's range) at every call, and the function's
body for errors like any other. Small angles' sinc and cosm1 stay within what their polynomials, or sine and cosine,
were proved to. And divisors stay above the bound that :mod:`runtime.firmware.static.divisions` proved:
in ``g = D f; a = R + f g`` EVA does not see that f g = D f^2 is not negative.
"""

from __future__ import annotations

import re
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from codegen.ir.small_angle import small_angle_bound
from codegen.ir.trig import sin_cos_bound
from codegen.output.folder import read_manifest
from runtime.firmware.static.bans import parse
from runtime.firmware.static.box import BELOW_PI, Box, Interval, filter_box, known_machine
from runtime.firmware.static.check import Check
from runtime.firmware.static.divisions import Range, divisions
from runtime.firmware.static.tool import missing, run

NAME = "no run-time error"

#: 16-bit int, IEEE floats; the header's own question about excess precision answered as on the chip.
#: Subdividing lets EVA see that x * x is not negative; slevel keeps both ways through a branch apart for a while.
OPTIONS = [
    "-eva",
    "-machdep=x86_16",
    "-warn-special-float=non-finite",
    "-eva-subdivide-non-linear=16",
    "-eva-slevel=3000",
    "-main=proof",
]
PREPROCESSOR = "-msse2 -mfpmath=sse -U__GNUC__"

#: Alarms that a check repeats.
SHOWN = 3

_ALARM = re.compile(
    r"^\[eva:alarm\] (?P<place>[^:\s]+:\d+): Warning:\s*(?P<text>.*?)(?=^\[|\Z)", re.MULTILINE | re.DOTALL
)
_COVERAGE = re.compile(r"(\d+) statements reached \(out of (\d+)\)")

#: Names of the facts handed over, as they appear in EVA's words; one of them unproved by EVA is no alarm. Of two files
#: that have a function of a name EVA numbers the second.
_GIVEN = re.compile(r"function (?:sin_cos|wrap_angle)(?:_\d+)?: postcondition|assertion 'range'")

#: The guard asks by squares whether a sum, a mean or a word is a number and not absurd, and wrapping whether an angle
#: is inside already; a square that overflows to infinity is its answer, on which it acts, and no error. EVA's words
#: for just these products.
_ASKED = tuple(f"\\mul_float({name}, {name})" for name in ("check[0]", "size", "x", "f->x[3]", "f_0->x[3]"))


@dataclass(frozen=True)
class Verdict:
    """The result of EVA: alarms as ``file:line: text``, statements reached of all, and whether it got to the end."""

    alarms: tuple[str, ...]
    reached: int
    statements: int
    seconds: float
    failure: str

    @property
    def proved(self) -> bool:
        """Whether no alarm is left."""
        return not self.alarms and not self.failure


def covariance_field(folder: Path, prefix: str) -> str:
    """The struct's field that carries P: ``P`` itself, or ``LD`` its factors."""
    header = (folder / f"{prefix}.h").read_text(encoding="utf-8")
    return "LD" if re.search(r"\bLD\[\d+\];", header) else "P"


def eva_checks(folder: Path) -> list[Check]:
    """One check a filter of the folder."""
    absent = missing(NAME, folder.name, "frama-c")
    if absent:
        return [absent]
    manifest = read_manifest(folder)
    return [eva_check(folder, kind) for kind in manifest["filters"]]


def eva_check(folder: Path, kind: str, box: Box | None = None) -> Check:
    """EVA on one filter; ``box`` replaces the drive's own."""
    absent = missing(NAME, f"{folder.name}, {kind}", "frama-c")
    if absent:
        return absent
    manifest = read_manifest(folder)
    prefix = f"{manifest['drive']}_{kind}"
    if box is None and not known_machine(manifest):
        reason = f"{prefix}: not proved. EVA was not run: no bounds on this machine's states and H are known."
        return Check(NAME, f"{folder.name}, {kind}", "not proved", "no box", "EVA needs a box of states", (reason,))
    verdict = analyse_step(folder, prefix, box or filter_box(manifest, covariance_field(folder, prefix)))
    return check_of(verdict, f"{folder.name}, {kind}", prefix, "one step from any state")


def check_of(verdict: Verdict, subject: str, file: str, what: str) -> Check:
    """A verdict as a row: ``file`` is named where something is amiss, ``what`` was analysed."""
    figure = (
        f"{len(verdict.alarms)} alarms, {verdict.reached} of {verdict.statements} statements, {verdict.seconds:.1f} s"
    )
    how = f"proved by EVA for {what} in the box" if verdict.proved else f"EVA, {what}"
    return Check(NAME, subject, _state(verdict), figure, how, _detail(file, verdict))


def _state(verdict: Verdict) -> Literal["passed", "failed", "not proved"]:
    """An alarm is what intervals cannot exclude, no error yet; an analysis that did not get through is one."""
    if verdict.failure:
        return "failed"
    return "passed" if verdict.proved else "not proved"


def _detail(prefix: str, verdict: Verdict) -> tuple[str, ...]:
    if verdict.failure:
        return (f"{prefix}: {verdict.failure}",)
    if verdict.proved:
        return ()
    shown = verdict.alarms[:SHOWN]
    head = f"{prefix}: not proved. Intervals alone cannot exclude {len(verdict.alarms)} errors; the first {len(shown)}:"
    return (head, *shown)


def analyse_step(folder: Path, prefix: str, box: Box) -> Verdict:
    """Run EVA on a driver that calls ``<prefix>_init`` once and ``<prefix>_step`` from the box."""
    path = folder / f"{prefix}.c"
    source = with_turns(with_contract(path.read_text(encoding="utf-8")))
    source = with_bounds(source, divisor_bounds(path))
    return analyse({f"{prefix}.c": source, "driver.c": driver(prefix, box)}, folder)


def divisor_bounds(path: Path) -> dict[tuple[str, str], float]:
    """(function, name) -> proved lower bound of a divisor; Q and R as the drive's tuning has them."""
    tuning = read_manifest(path.parent)["parameters"]["filter"]
    noise = {"Q": tuning["process_noise"], "R": tuning["measurement_noise"]}
    loaded = {f"{name}[{k}]": float(np.float32(v)) for name, values in noise.items() for k, v in enumerate(values)}
    inputs = {name: Range(value, value) for name, value in loaded.items()}
    return {
        (division.function, division.divisor): division.range.low
        for division in divisions(parse(path).functions(), inputs)
        if division.range.low > 0.0 and division.divisor.isidentifier()
    }


def with_bounds(source: str, bounds: dict[tuple[str, str], float]) -> str:
    """The source with an assertion behind the definition of each divisor."""
    for (function, name), low in bounds.items():
        start = re.search(rf"^(?:static )?\w+ {function}\([^;{{]*\)\n\{{", source, re.M)
        definition = re.compile(rf"const float32 {name} = [^;]*;").search(source, start.end()) if start else None
        if definition:
            fact = f" /*@ assert range: {name} >= {low:.9e}; */"
            source = source[: definition.end()] + fact + source[definition.end() :]
    return source


def driver(prefix: str, box: Box) -> str:
    """C of a caller whose struct and inputs may be anything in the box; the tuning is what ``_init`` loads."""
    lines = [f"    {place} = {anything_in(interval)}" for place, interval in box.places.items()]
    return "\n".join(
        [
            f'#include "{prefix}.h"',
            '#include "__fc_builtin.h"',
            f"static {prefix}_t f;",
            "int proof(void);",
            "int proof(void)",
            "{",
            "    float32 u[2];",
            "    float32 y[2];",
            f"    {prefix}_init(&f);",
            *lines,
            *(["    f.repairs = Frama_C_interval(0, 32767);"] if "f.nis" in box.places else []),
            f"    return {prefix}_step(&f, u, y);",
            "}\n",
        ]
    )


def with_contract(source: str) -> str:
    """The source with the generator's bounds on sine and cosine and on wrapped angles as contracts, if it has them."""
    bound = sin_cos_bound()
    size = 1.0 + 2.0 * bound.proved
    contract = (
        f"/*@ requires \\is_finite(x) && -{bound.limit!r} <= x <= {bound.limit!r};\n    assigns \\nothing;\n"
        + "".join(
            f"    ensures \\is_finite(\\result.{name}) && -{size:.8f} <= \\result.{name} <= {size:.8f};\n"
            for name in ("sine", "cosine")
        )
        + "*/\n"
    )
    turn = (
        "/*@ requires \\is_finite(x);\n    assigns \\nothing;\n"
        f"    ensures \\is_finite(\\result) && -{BELOW_PI!r} <= \\result <= {BELOW_PI!r};\n*/\n"
    )
    source = source.replace("static float32 wrap_angle(float32 x)", f"{turn}static float32 wrap_angle(float32 x)")
    return source.replace("static pmsm_pair sin_cos(float32 x)", f"{contract}static pmsm_pair sin_cos(float32 x)")


_TURNS = re.compile(r"^ *status \|= \w+_turns\([^;]*, (?P<turn>turn\w*)\);\n", re.MULTILINE)


def with_turns(source: str) -> str:
    """The source with what is proved of small angles behind each call that computes some.

    The polynomials, small or wide, are within their proved error of sin(d) / d, which falls from 1 to 0 at d = pi,
    beyond which no angle is taken, and of cos(d) - 1, which falls from 0 to -2; that error is one of d^2 / 2.
    """
    spread = re.search(r"from z = d\^2 / ([\d.]+):", source)
    n = float(spread[1]) if spread else 1.0
    bounds = [small_angle_bound(n, wide) for wide in (False, True)]
    error = max(bound.sinc + bound.cosm1 * bound.limit / 2 for bound in bounds)
    sizes = {name: int(size) for name, size in re.findall(r"^    float32 (turn\w*)\[(\d+)\];", source, re.MULTILINE)}

    def add(match: re.Match[str]) -> str:
        turn = match["turn"]
        facts = [
            f"-{error:.3e} <= {turn}[{2 * k}] <= 1.0 + {error:.3e} && "
            f"-2.0 - {error:.3e} <= {turn}[{2 * k + 1}] <= {error:.3e}"
            for k in range(sizes[turn] // 2)
        ]
        return match.group() + "".join(f"    /*@ assert range: {fact}; */\n" for fact in facts)

    return _TURNS.sub(add, source)


def analyse(files: dict[str, str], headers: Path, options: tuple[str, ...] = ()) -> Verdict:
    """EVA on some C texts whose entry is ``proof``; their headers are found in a folder, sqrtf in Frama-C's library."""
    _, share = run(["frama-c", "-print-share-path"])
    with tempfile.TemporaryDirectory() as scratch:
        paths = [Path(scratch) / name for name in files]
        for path, text in zip(paths, files.values(), strict=True):
            path.write_text(text, encoding="utf-8")
        extra = f"-I{share.strip()}/libc -I{headers.resolve()} {PREPROCESSOR}"
        begin = time.monotonic()
        code, said = run(["frama-c", *OPTIONS, *options, f"-cpp-extra-args={extra}", *map(str, paths)])
    return _verdict(code, said, time.monotonic() - begin)


def _verdict(code: int, said: str, seconds: float) -> Verdict:
    alarms = tuple(
        f"{Path(match['place']).name}: {' '.join(match['text'].split())}"
        for match in _ALARM.finditer(said)
        if not _GIVEN.search(match["text"]) and not any(asked in match["text"] for asked in _ASKED)
    )
    coverage = _COVERAGE.search(said)
    failure = ""
    if code or coverage is None:
        errors = [line for line in said.splitlines() if "rror" in line]
        failure = errors[-1] if errors else f"frama-c ended with {code}"
    elif "NON TERMINATING FUNCTION" in said:
        failure = "no execution reaches the end of the step"
    reached, statements = (int(coverage[1]), int(coverage[2])) if coverage else (0, 0)
    return Verdict(alarms, reached, statements, seconds, failure)


def anything_in(interval: Interval) -> str:
    """C of any float32 in an interval, to its semicolon."""
    return f"Frama_C_float_interval({_c(interval.low)}, {_c(interval.high)});"


def _c(value: float) -> str:
    """A float32 literal of C; the box's ends are rounded to float32."""
    text = str(np.float32(value))
    return f"{text if any(mark in text for mark in '.e') else text + '.0'}f"
