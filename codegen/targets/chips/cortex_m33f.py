"""Arm Cortex-M33F (RP2350 and others): Armv8-M with a single-precision FPU."""

from __future__ import annotations

from dataclasses import replace

from codegen.targets.chips.cortex_m4f import TARGET as CORTEX_M4F
from codegen.targets.chips.cortex_m4f import stand_in
from codegen.targets.description import Board

CPU = ("-mcpu=cortex-m33", "-mfloat-abi=hard", "-mfpu=fpv5-sp-d16")

TARGET = replace(
    CORTEX_M4F,
    name="cortex_m33f",
    title="Arm Cortex-M33F (RP2350)",
    core="Cortex-M33F",
    purpose="a Cortex-M33F (RP2350) and, unchanged, the host",
    language="C89 float32 for a Cortex-M33F",
    stand_in=stand_in("Cortex-M33F", "M33F", CPU),
    # Secure memory, in which the board's processor begins.
    board=Board("mps2-an505", "cortex-m33", (*CPU, "-mthumb"), code=0x10000000, data=0x38000000, clock=20e6),
)
