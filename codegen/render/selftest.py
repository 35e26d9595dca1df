"""The self-tests in C: recorded words as tables, and the few lines that replay them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from codegen.evidence.recording import DRAWS, MARGIN, UNITS, Recording, execute
from codegen.evidence.selftest import ControlRun, Segment
from codegen.ir.trig import INSIDE, wrap_listing
from codegen.render.fill import render
from codegen.render.filter import Description
from codegen.render.printers.c import CPrinter
from codegen.render.printers.expression import wrap_line
from codegen.render.trig import sin_cos_text
from codegen.targets.numbers import FLOAT32

Array = NDArray[Any]

#: Dividends (also the roots' arguments), divisors and angles of the check of the arithmetic itself.
SAMPLES = ((1.0, 3.0, 0.5), (2.0, 7.0, 3.0), (3.0, 1.1, -3.1), (0.001, 0.3, 100.0), (50000.0, 17.0, -999.0))


@dataclass(frozen=True)
class SelfTest:
    """Header and source; ``words``: 16-bit words of constants."""

    header: str
    source: str
    vectors: int
    words: int


def render_filter_selftest(
    about: Description, kind: str, module: str, runs: list[Segment], recording: Recording
) -> SelfTest:
    """Self-test of one filter.

    Parameters
    ----------
    about : Description
    kind : str
        Filter kind, such as "ickf".
    module : str
        Text of the generated Python module.
    runs : list of Segment
        The inputs, N vectors in all.
    recording : Recording
        What comes out, of N vectors.
    """
    covariance = execute(module, "named")["COVARIANCE"]
    n, outputs = len(about.model.states), recording.words.shape[1]
    vectors = len(recording.words)
    firsts = np.cumsum([0, *(len(run.u) for run in runs)])
    u, y = (np.vstack([getattr(run, name) for run in runs]) for name in ("u", "y"))
    words = vectors * _even(8 + 2 + 3 * outputs) + len(runs) * _even(1 + 4 * n) + len(SAMPLES) * 18
    plan = [(0, 0, "the arithmetic itself: stage 1 division, 2 square root, 3 sine, 4 cosine, 5 wrapped angle")]
    plan += [(int(a) + 1, int(b), run.title) for a, b, run in zip(firsts[:-1], firsts[1:], runs, strict=True)]
    stages = [
        ("1", "the status"),
        ("2", "the number of iterations"),
        ("10 + k", "x[k]"),
        ("20 + k", f"{covariance}[k]"),
    ]
    p = f"{about.drive.name}_{kind}"
    common = {**_common(about, p, vectors, words), "plan": plan, "stages": stages, "has_iterations": True}
    story = "a start with two bad inputs in it, and corners of the operating box"
    header = render("selftest.h.j2", **common, story=story, init=f"{p}_init")
    printer = CPrinter(FLOAT32)
    source = render(
        "selftest.c.j2",
        **common,
        n=n,
        outputs=outputs,
        covariance=covariance,
        samples=_samples(module),
        starts=[_start(int(first), run) for first, run in zip(firsts, runs, strict=False)],
        rows=[_vector(k, (u[k], "u", "V"), (y[k], "y", "A"), recording, n, True) for k in range(vectors)],
        compare=render("selftest_compare.j2", p=p),
        round=printer.format_literal(FLOAT32.precision.rounding),
        below_pi=printer.format_literal(FLOAT32.precision.below_pi),
        inside=printer.format_literal(INSIDE),
        sin_cos=sin_cos_text(printer),
        wrap_angle=printer.format_helper(wrap_listing(FLOAT32.precision)),
    )
    return SelfTest(header, source, vectors, words)


def render_control_selftest(about: Description, kind: str, run: ControlRun, recording: Recording) -> SelfTest:
    """Self-test of the controller around one filter.

    Parameters
    ----------
    about : Description
    kind : str
        Filter kind, such as "ickf".
    run : ControlRun
        The inputs, N samples.
    recording : Recording
        What comes out, of N samples.
    """
    vectors, outputs = recording.words.shape
    words = vectors * _even(8 + 2 + 3 * outputs)
    p = f"{about.drive.name}_{kind}_foc"
    plan = [(1, vectors, "currents that turn; the last two ask for more speed than there is")]
    stages = [("1", "the status"), ("10 + k", "duty[k]"), ("20 + k", "integrator[k]")]
    common = {**_common(about, p, vectors, words), "plan": plan, "stages": stages, "has_iterations": False}
    story = "interrupts of a controller that has just been told to start"
    header = render("selftest.h.j2", **common, story=story, init=f"{p}_init with delay {run.delay}")
    inputs = [((run.phase[k], "phase", "A"), (run.command[k], "command", "rad/s, V")) for k in range(vectors)]
    source = render(
        "foc_selftest.c.j2",
        **common,
        outputs=outputs,
        delay=run.delay,
        rows=[_vector(k, *given, recording, 3, False) for k, given in enumerate(inputs)],
        compare=render("selftest_compare.j2", p=p),
    )
    return SelfTest(header, source, vectors, words)


def _common(about: Description, p: str, vectors: int, words: int) -> dict[str, Any]:
    facts = {"p": p, "drive": about.drive.name, "sha": about.drive.sha256, "vectors": vectors, "words": words}
    return {**facts, "units": UNITS, "margin": MARGIN, "draws": DRAWS}


def _even(words: int) -> int:
    """Structs with 32-bit members take whole pairs of 16-bit words."""
    return words + words % 2


def word(value: Any) -> str:
    """The bits of a float32 as a C literal.

    Parameters
    ----------
    value : float
        Rounded to float32.

    >>> word(1.0)
    '0x3F800000UL'
    """
    return f"0x{int(np.float32(value).view(np.uint32)):08X}UL"


def _list(items: list[str]) -> str:
    return "{" + ", ".join(items) + "}"


def _values(values: Array) -> str:
    return ", ".join(f"{float(value):.6g}" for value in values)


def _samples(module: str) -> list[str]:
    """Operands and float32 results, with four units in the last place allowed to quotient and root."""
    math = execute(module, "samples")["MATH"]["float32"]
    items = []
    for values in SAMPLES:
        a, b, angle = (np.float32(value) for value in values)
        quotient, root = a / b, np.sqrt(a)
        results = [quotient, root, *math.sin_cos(math.wrap(angle)), math.wrap(angle)]
        allowed = [int(np.frexp(value)[1]) - 1 + 127 - 23 + 2 for value in (quotient, root)]
        line = ", ".join([word(value) for value in (a, b, angle, *results)] + [str(value) for value in allowed])
        items.append(f"    /* a = {a:g}, b = {b:g}, angle = {angle:g} */\n" + wrap_line("{" + line + "}", "    ", " "))
    return items


def _start(first: int, run: Segment) -> str:
    lists = ", ".join(_list([word(value) for value in values]) for values in (run.x_0, run.P_0))
    comment = wrap_line(f"/* {run.title}: x_0 = {_values(run.x_0)}; P_0 = {_values(run.P_0)} */", "    ", "   ")
    return comment + "\n" + wrap_line(f"{{{first}, {lists}}}", "    ", " ")


def _vector(
    k: int,
    first: tuple[Array, str, str],
    second: tuple[Array, str, str],
    recording: Recording,
    leading: int,
    iterations: bool,
) -> str:
    """One row of the table: inputs, integers, expected words, allowed exponents; the values in a comment above."""
    words = recording.words[k]
    says = "; ".join(f"{name} = {_values(values)} {unit}" for values, name, unit in (first, second))
    comment = wrap_line(
        f"/* {k + 1}: {says} -> {_values(words[:leading])} | {_values(words[leading:])} */", "    ", "   "
    )
    integers = [str(int(recording.status[k]))] + ([str(int(recording.iterations[k]))] if iterations else [])
    inputs = [_list([word(value) for value in values]) for values, _, _ in (first, second)]
    lines = [
        "    {" + ", ".join([*inputs, *integers]) + ",",
        wrap_line(_list([word(value) for value in words]) + ",", "     ", " "),
        wrap_line(_list([str(int(value)) for value in recording.allowed[k]]), "     ", " ") + "}",
    ]
    return "\n".join([comment, *lines])
