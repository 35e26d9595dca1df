"""Targets: what a piece of C has to know of where it runs. Adding one is one more line here.

1. Say its name and floating type.  2. Say the literal suffix and the square root.  3. Say whether sine and
cosine are generated arithmetic or the platform's.  The printer does the rest.
"""

from __future__ import annotations

from dataclasses import dataclass

from codegen.ir.trig import DOUBLE, SINGLE, Precision


@dataclass(frozen=True)
class Target:
    """One flavour of generated C.

    ``real`` is the type's name in the port header, ``suffix`` ends a literal, ``sqrt`` is how the square root is
    called and ``libm`` the name of that in the C library; ``tag`` is appended to file and function names so that
    two flavours can live in one program.
    """

    name: str
    real: str
    suffix: str
    sqrt: str
    libm: str
    precision: Precision
    generated_trig: bool
    tag: str
    purpose: str


F28335 = Target(
    "f28335",
    "float32",
    "f",
    "PMSM_SQRT",
    "sqrtf",
    SINGLE,
    True,
    "",
    "TI TMS320F28335 and, unchanged, the host",
)
HOST64 = Target(
    "host64",
    "float64",
    "",
    "sqrt",
    "sqrt",
    DOUBLE,
    False,
    "_f64",
    "the host, for comparison: float64, the platform's sin and cos",
)
