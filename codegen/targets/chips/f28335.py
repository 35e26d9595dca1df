"""TI TMS320F28335: C28x with FPU32 at 150 MHz, TI's C2000 compiler in its COFF ABI."""

from __future__ import annotations

from codegen.evidence.fpu32 import FPU32
from codegen.targets.description import (
    Arithmetic,
    Compiler,
    DataModel,
    Example,
    Prices,
    Sections,
    StandIn,
    Target,
)

DATA = DataModel(
    char_bits=16,
    sizes={"char": 1, "short": 1, "int": 1, "long": 2, "float": 2, "double": 2, "long long": 4, "long double": 4},
    pointer=2,
    alignment=2,
    source="float32 2, int 1, 32-bit fields on even addresses",  # SPRU514, table 6-1
)

CHECKS = """\
#ifndef __TMS320C28XX_FPU32__
#error "pmsm-ickf: compile with --float_support=fpu32; without the FPU a step takes many times as long"
#endif
#ifdef __TI_STRICT_FP_MODE__
#if !__TI_STRICT_FP_MODE__
#error "pmsm-ickf: compile with --fp_mode=strict; relaxed may remove the rounding steps of sin_cos and wrap_angle"
#endif
#endif"""

COMPILER = Compiler(
    macro="__TMS320C28XX__",
    macros={"__TMS320C28XX__": "1", "__TMS320C28XX_FPU32__": "1"},
    checks=CHECKS,
    types_guard="DSP28_DATA_TYPES",
    device_header="F2833x",
    types=(
        ("int", "int16"),
        ("long", "int32"),
        ("long long", "int64"),
        ("unsigned int", "Uint16"),
        ("unsigned long", "Uint32"),
        ("unsigned long long", "Uint64"),
        ("long double", "float64"),
    ),
    keyword="interrupt",
    builtin_sqrt=False,
)

SECTIONS = Sections(
    style="pragma",
    where="defined(__TMS320C28XX__) && !defined(__cplusplus)",
    why="On the C28x these run from RAM, because flash has wait states.",
    names=(("__TI_COMPILER_VERSION__ >= 15009000", ".TI.ramfunc"), ("", "ramfuncs")),
)

ARITHMETIC = Arithmetic(
    number=FPU32,
    differs="division, root and flush to zero",
    caveat="(modelled, not measured; seeds after an emulator's tables, unverified on silicon).",
    story=(
        "The F28335 divides and takes roots by Newton steps from 8-bit seeds (within 3 units in the last place, about "
        "half the results exact) and flushes denormals to zero. What that adds to the figures above, one step on a "
        "model of it against the host's float32, same draws: **modelled, not measured; seeds after an emulator's "
        "tables, unverified on silicon**."
    ),
    selftest="on the C28x, where they are Newton steps",
)

#: At k: additions and multiplications, with the delay slot that each has (SPRUEO2), and what else the FPU does to
#: numbers in one cycle, between loads and a store: a comparison (CMPF32; MOVST0, which hands its flags on, takes the
#: slot's place) and a selection (MOV32 on a condition). MAXF32 or MINF32 would do both at once; a compiler that makes a
#: branch of a selection takes a few cycles more. Division and root are TI's figures for its fastRTS library, with the
#: call. Sine and cosine are not that library's but the text's own, whose arithmetic is counted. A branch takes 7 cycles
#: where it is taken and 4 where it is not (SPRU430): 7 either way; a side of 4 that ends in a jump of 4 over the other
#: would be a cycle more. A call is LCR 4 and LRETR 8 (SPRU430). 60 is the interrupt's entry and exit; a 16-bit word of
#: a struct that is copied takes a cycle (MOV32 loads and stores two words).
#:
#: A reciprocal in line is EINVF32 and twice MPYF32, SUBF32, MPYF32, each with its slot (2 cycles, SPRUEO2), a load and
#: a store: 16 in the place of 25, which have the call in them.
#:
#: Are branches and calls in k already? The parts that are published of it are two loads, the operation, its delay slot
#: and the store: 5 in all, the bound, of which 2.5 remain where results stay in registers. None is a jump, so branches
#: and calls are counted beside it. If the listings from which 2.5 was taken had jumps in them, or a compiler expands
#: small functions in place, or uses BF (4 cycles, taken or not), the chip is faster than the sum: it errs upwards.
PRICES = Prices(
    clock=150e6,
    factors=(2.5, 4.0, 5.0),
    at_k=("add", "mul", "compare", "select"),
    cycles={"div": 25, "sqrt": 29, "branch": 7, "call": 12, "copied": 1},
    interrupt=60,
    reciprocal=16,
    on="C28x + FPU32",
    formula="with TI's fastRTS figures for division and root, and 60 for the interrupt",
    k=(
        "k covers loads, the operation, its delay slot and the store: 2.5 is typical of published compiler listings of "
        "float motor code, 4 high, 5 the bound. Branches and calls are not in k: the sum has them as terms of their "
        "own. Left out of the sum: arithmetic of whole numbers, copies of single numbers, registers that functions "
        "save, wait states of flash."
    ),
    sources=(
        "the C28x FPU fastRTS library user guide (division, root, with the call), SPRUEO2 (FPU32 instructions), "
        "SPRU430 (branches, calls), SPRU514 (sizes and alignment of types)"
    ),
)

STAND_IN = StandIn(
    name="Cortex-M4F",
    short="M4F",
    compiler="arm-none-eabi-gcc",
    package="gcc-arm-none-eabi",
    flags=("-mcpu=cortex-m4", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", "-O2", "-std=c89", "-ffp-contract=off"),
)

EXAMPLE = Example(
    device="an F2833x motor drive",
    acknowledge="Clear the ADC's interrupt flag and acknowledge its PIE group.",
    gates="trip zone",
    serial="SCI",
)

TARGET = Target(
    name="f28335",
    title="TI TMS320F28335",
    core="C28x",
    purpose="TI TMS320F28335 and, unchanged, the host",
    language="C89 float32 for the TMS320F28335",
    data=DATA,
    stand_in=STAND_IN,
    example=EXAMPLE,
    compiler=COMPILER,
    sections=SECTIONS,
    arithmetic=ARITHMETIC,
    prices=PRICES,
    not_shown="Nothing was run on the chip, and no C28x compiler was at hand.",
)
