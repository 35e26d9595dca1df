"""The control law accelerator (CLA) of TI's F2837x: TI's CLA C compiler, a subset of C (SPRU514, chapter 10)."""

from __future__ import annotations

from dataclasses import replace

from codegen.evidence.fpu32 import FPU32
from codegen.targets.chips.f28335 import TARGET as F28335
from codegen.targets.description import Arithmetic, Compiler, DataModel, NativeMath, Sections
from codegen.targets.numbers import FLOAT32

DATA = DataModel(
    char_bits=16,
    sizes={"char": 1, "short": 1, "int": 2, "long": 2, "float": 2, "double": 2, "long long": 2, "long double": 2},
    pointer=1,
    alignment=2,
    source="float32 and int 2, 32-bit fields on even addresses",
)

NATIVE = NativeMath(
    macro="__TMS320C28XX_CLA__",
    what="CLAmath: the CLA has no C library ------------------------------------------------------------------- */",
    lines=(
        '#include "CLAmath.h"',
        "#define PMSM_DIV(a, b) CLAdiv((a), (b))",
        "#ifndef PMSM_SQRT",
        "#define PMSM_SQRT(x) CLAsqrt(x)",
        "#endif",
    ),
    calls={"CLAdiv": "div", "CLAsqrt": "sqrt"},
)

ARITHMETIC = Arithmetic(
    number=FPU32,
    differs="division, root and flush to zero",
    caveat="(modelled by the FPU32's Newton steps, not measured).",
    story=(
        "The CLA divides and takes roots by library functions that refine the seeds of MEINVF32 and MEISQRTF32, and "
        "flushes denormals to zero; they are taken to be as good as the FPU32's. What that adds to the figures above, "
        "one step on a model of it against the host's float32, same draws: **modelled, not measured**."
    ),
    selftest="on the CLA, where they are Newton steps",
)

TARGET = replace(
    F28335,
    name="f2837x_cla",
    title="CLA of TI's TMS320F2837x",
    core="CLA",
    purpose="the CLA of TI's TMS320F2837x, in its C subset",
    language="C89 float32 in the C subset of the CLA",
    data=DATA,
    compiler=Compiler(
        macro="__TMS320C28XX_CLA__",
        macros={"__TMS320C28XX_CLA__": "1"},
        types_guard="F28_DATA_TYPES",
        device_header="F2837xD",
        types=(
            ("short", "int16"),
            ("long", "int32"),
            ("unsigned short", "Uint16"),
            ("unsigned long", "Uint32"),
        ),
    ),
    numbers=replace(FLOAT32, divide="PMSM_DIV"),
    native=NATIVE,
    sections=Sections(),
    arithmetic=ARITHMETIC,
    prices=None,
    subset="cla",
    not_shown=(
        "Nothing was run on a CLA or read by its compiler; cycles are not known, as nobody published what prices "
        "compiled C there. `pmsm-ickf firmware` holds the text of filter, controller, supervisor and drive against the "
        "rules of the CLA's C subset. Self-tests and example belong to the C28x beside it. An int "
        "has 32 bits here and 16 there: the structs are the CLA's own, hand numbers over by float32 alone."
    ),
)
