"""The text of sine and cosine: generated arithmetic, the platform's, or a processor's instructions."""

from __future__ import annotations

from codegen.ir.trig import Precision, sin_cos_bound, sin_cos_listing
from codegen.render.printers.c import INDENT, CPrinter
from codegen.targets.numbers import NumberFormat


def trig_note(numbers: NumberFormat) -> list[str]:
    """Return the comment's lines above sine and cosine: how they are made, and their error."""
    if not numbers.generated_trig:
        return ["Sine and cosine of the platform."]
    bound = sin_cos_bound()
    return [
        "Sine and cosine as arithmetic: no branch, the same bits on every IEEE machine.",
        f"Error for |x| <= pi, as wrap_angle leaves it: proved {bound.proved:.1e}, "
        f"worst of {bound.samples} arguments {bound.seen:.1e}.",
    ]


def sin_cos_arithmetic(printer: CPrinter, precision: Precision) -> str:
    """Sine and cosine in one precision; those that take any angle with a macro of their own first."""
    text = printer.format_helper(sin_cos_listing(precision))
    if "ROUND_EVEN" not in text:
        return text
    coarse = printer.format_literal(2.0 * precision.rounding)
    return f"#define ROUND_EVEN {coarse} /* adding and subtracting it rounds to the nearest even integer */\n{text}"


def sin_cos_text(printer: CPrinter) -> str:
    """The function behind its note: as arithmetic, or the platform's."""
    if printer.numbers.generated_trig:
        generated = sin_cos_arithmetic(printer, printer.numbers.precision)
        return _native_sin_cos(printer, generated) if printer.numbers.turns else generated
    lines = [f"static {printer.pair} sin_cos(float64 x)", "{", f"{INDENT}{printer.pair} result;"]
    return "\n".join(
        [*lines, f"{INDENT}result.sine = sin(x);", f"{INDENT}result.cosine = cos(x);", f"{INDENT}return result;", "}"]
    )


def _native_sin_cos(printer: CPrinter, generated: str) -> str:
    """Sine and cosine by the processor's instructions where they are; elsewhere the generated arithmetic."""
    sine, cosine = printer.numbers.turns
    real = printer.numbers.real
    return "\n".join(
        [
            f"#ifdef {sine}",
            "/* Instructions of the processor, of an angle in turns. */",
            f"static {printer.pair} sin_cos({real} x)",
            "{",
            f"{INDENT}const {real} turns = x * {printer.format_literal(0.15915494309189535)};",
            f"{INDENT}{printer.pair} result;",
            f"{INDENT}result.sine = {sine}(turns);",
            f"{INDENT}result.cosine = {cosine}(turns);",
            f"{INDENT}return result;",
            "}",
            "#else",
            generated,
            "#endif",
        ]
    )
