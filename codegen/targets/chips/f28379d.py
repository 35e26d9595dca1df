"""TI TMS320F28379D: C28x with FPU32 and TMU at 200 MHz."""

from __future__ import annotations

from dataclasses import replace

from codegen.evidence.tmu import TMU32, sin_cos
from codegen.targets.chips.f28335 import TARGET as F28335
from codegen.targets.description import Arithmetic, NativeMath
from codegen.targets.numbers import FLOAT32

CHECKS = """
#ifndef __TMS320C28XX_TMU__
#error "pmsm-ickf: compile with --tmu_support=tmu0; without it sine, cosine and division are software"
#endif"""

NATIVE = NativeMath(
    macro="__TMS320C28XX_TMU__",
    what="instructions of the TMU; intrinsics, because --fp_mode=strict leaves / to the library ------------- */",
    lines=(
        "#define PMSM_DIV(a, b) __divf32((a), (b))",
        "#define PMSM_SINE_OF_TURNS(x) __sinpuf32(x)",
        "#define PMSM_COSINE_OF_TURNS(x) __cospuf32(x)",
        "#ifndef PMSM_SQRT",
        "#define PMSM_SQRT(x) __sqrt(x)",
        "#endif",
    ),
    calls={"__divf32": "div", "__sqrt": "sqrt", "__sinpuf32": "sine", "__cospuf32": "sine"},
)

ARITHMETIC = Arithmetic(
    number=TMU32,
    sin_cos=sin_cos,
    differs="division, root, sine, cosine and flush to zero",
    caveat="(modelled, not measured: each cut to float32, as no published error bound was at hand).",
    story=(
        "Division, root, sine and cosine are instructions of the TMU, and denormals are flushed to zero. What that "
        "adds to the figures above, one step on a model of it against the host's float32, same draws: **modelled, not "
        "measured**. TI publishes what the instructions compute and how long they take; as no error bound was at "
        "hand, each result is taken as the exact one cut to float32, a unit in the last place towards zero."
    ),
    selftest="on the C28x, where they are instructions of the TMU",
)

assert F28335.prices is not None
#: Pipeline cycles of the TMU's instructions: data sheet SPRS880, table "TMU supported instructions".
PRICES = replace(
    F28335.prices,
    clock=200e6,
    cycles={"div": 5, "sqrt": 5, "sine": 4, "branch": 7, "call": 12, "copied": 1},
    reciprocal=0,
    on="C28x + FPU32 + TMU",
    formula="with the TMU's pipeline cycles and 60 for the interrupt",
    sources=(
        "SPRS880 (pipeline cycles of the TMU's instructions), SPRUEO2 (FPU32 instructions), SPRU430 (branches, calls), "
        "SPRU514 (sizes and alignment of types)"
    ),
)

TARGET = replace(
    F28335,
    name="f28379d",
    title="TI TMS320F28379D",
    core="C28x",
    purpose="TI TMS320F28379D (FPU32 and TMU); on the host sine and cosine are arithmetic",
    language="C89 float32 for the TMS320F28379D",
    compiler=replace(
        F28335.compiler,
        macros={**dict(F28335.compiler.macros), "__TMS320C28XX_TMU__": "1"},
        checks=F28335.compiler.checks + CHECKS,
        types_guard="F28_DATA_TYPES",
        device_header="F2837xD",
    ),
    example=replace(F28335.example, device="an F2837xD motor drive"),
    numbers=replace(FLOAT32, divide="PMSM_DIV", turns=("PMSM_SINE_OF_TURNS", "PMSM_COSINE_OF_TURNS")),
    native=NATIVE,
    arithmetic=ARITHMETIC,
    prices=PRICES,
    not_shown=(
        "Nothing was run on the chip, and no C28x compiler was at hand. The text that its compiler would read is "
        "parsed and counted; the instructions' last bits are modelled."
    ),
)
