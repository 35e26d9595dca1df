"""Arm Cortex-M4F (STM32F4, STM32G4 and others): single-precision FPU, GCC, Clang or Arm's compiler."""

from __future__ import annotations

from codegen.targets.description import Board, Compiler, DataModel, Example, Sections, StandIn, Target

#: Procedure Call Standard for the Arm Architecture (AAPCS32), fundamental data types.
DATA = DataModel(
    char_bits=8,
    sizes={"char": 1, "short": 2, "int": 4, "long": 4, "float": 4, "double": 8, "long long": 8, "long double": 8},
    pointer=4,
    alignment=8,
    source="float32 and int 4, as the Arm procedure call standard has them",
)

COMPILER = Compiler(
    macro="__arm__",
    macros={"__arm__": "1", "__ARM_FP": "4"},
    checks="""\
#ifndef __ARM_FP
#error "pmsm-ickf: compile with -mfpu=... -mfloat-abi=hard; without the FPU a step takes many times as long"
#endif""",
)

SECTIONS = Sections(
    style="attribute",
    why=(
        "With PMSM_RAM_SECTION defined as the name of a section that the linker script copies to RAM, such as\n"
        ' * ".RamFunc", the functions of the interrupt lie there; without it, where the linker puts code.'
    ),
)

CPU = ("-mcpu=cortex-m4", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16")


def stand_in(name: str, short: str, cpu: tuple[str, ...]) -> StandIn:
    """The processor itself, as GCC compiles for it.

    Parameters
    ----------
    name, short : str
        In prose and in a table's head.
    cpu : tuple of str
        Flags of processor, calling convention and FPU.
    """
    flags = (*cpu, "-O2", "-std=c89", "-ffp-contract=off")
    return StandIn(name, short, "arm-none-eabi-gcc", "gcc-arm-none-eabi", flags)


TARGET = Target(
    name="cortex_m4f",
    title="Arm Cortex-M4F (STM32F4, STM32G4)",
    core="Cortex-M4F",
    purpose="a Cortex-M4F (STM32F4, STM32G4) and, unchanged, the host",
    language="C89 float32 for a Cortex-M4F",
    data=DATA,
    stand_in=stand_in("Cortex-M4F", "M4F", CPU),
    example=Example(
        device="a motor drive",
        acknowledge="Clear the flag of the ADC's interrupt.",
        gates="break input of the PWM timer",
        serial="UART",
    ),
    compiler=COMPILER,
    sections=SECTIONS,
    board=Board("mps2-an386", "cortex-m4", (*CPU, "-mthumb"), code=0x00000000, data=0x20000000, clock=25e6),
    not_shown=(
        "Bits and instructions are those of an emulator (qemu). Cycles are not known: what flash, buses and pipeline "
        "make of the instructions only a board shows."
    ),
)
