"""How C spells one floating-point format: all that a printer has to know."""

from __future__ import annotations

from dataclasses import dataclass, replace

from codegen.ir.trig import DOUBLE, SINGLE, Precision


@dataclass(frozen=True)
class NumberFormat:
    """A floating-point format in C.

    Attributes
    ----------
    real : str
        The type's name in the port header.
    suffix : str
        What ends a literal.
    sqrt, libm : str
        The call of a square root, and the name of that function in the C library.
    precision : Precision
    generated_trig : bool
        Sine and cosine are generated arithmetic; else the platform's.
    tag : str
        Appended to file and function names, so that two formats can live in one program.
    divide : str
        Macro of the port header by which two numbers are divided; empty: the operator ``/``.
    reciprocal : str
        Macro of the port header for 1 / x; empty: 1 is divided as any other number.
    turns : tuple of str
        Macros of the port header that give sine and cosine of an angle in turns, where the processor has instructions
        for them; empty: there are none. Where a macro is not defined, the generated arithmetic takes its place.
    """

    real: str
    suffix: str
    sqrt: str
    libm: str
    precision: Precision
    generated_trig: bool
    tag: str
    divide: str = ""
    reciprocal: str = ""
    turns: tuple[str, ...] = ()


#: float32 in plain operators; sine and cosine are generated arithmetic, the same bits on every IEEE machine.
FLOAT32 = NumberFormat("float32", "f", "PMSM_SQRT", "sqrtf", SINGLE, True, "")
#: The same in a file for a processor, where a reciprocal may be had for less than a division.
PORTED = replace(FLOAT32, reciprocal="PMSM_RECIPROCAL")
#: float64 for comparison on the host, with the platform's sine and cosine.
FLOAT64 = NumberFormat("float64", "", "sqrt", "sqrt", DOUBLE, False, "_f64")
