"""Arm Cortex-M7 (STM32F7, STM32H7, i.MX RT): its double-precision FPU is not used, the text has no double."""

from __future__ import annotations

from dataclasses import replace

from codegen.targets.chips.cortex_m4f import TARGET as CORTEX_M4F
from codegen.targets.chips.cortex_m4f import stand_in
from codegen.targets.description import Board

CPU = ("-mcpu=cortex-m7", "-mfloat-abi=hard", "-mfpu=fpv5-d16")

TARGET = replace(
    CORTEX_M4F,
    name="cortex_m7",
    title="Arm Cortex-M7 (STM32F7, STM32H7)",
    core="Cortex-M7",
    purpose="a Cortex-M7 (STM32F7, STM32H7) and, unchanged, the host",
    language="C89 float32 for a Cortex-M7",
    stand_in=stand_in("Cortex-M7", "M7", CPU),
    board=Board("mps2-an500", "cortex-m7", (*CPU, "-mthumb"), code=0x00000000, data=0x20000000, clock=25e6),
)
