"""TI TMS320F280049C: the F28379D's core, with FPU32 and TMU, at 100 MHz."""

from __future__ import annotations

from dataclasses import replace

from codegen.targets.chips.f28379d import PRICES
from codegen.targets.chips.f28379d import TARGET as F28379D

TARGET = replace(
    F28379D,
    name="f280049c",
    title="TI TMS320F280049C",
    purpose="TI TMS320F280049C (FPU32 and TMU); on the host sine and cosine are arithmetic",
    language="C89 float32 for the TMS320F280049C",
    compiler=replace(F28379D.compiler, device_header="F28004x"),
    example=replace(F28379D.example, device="an F28004x motor drive"),
    # Data sheet SPRS945 has the same table of the TMU's pipeline cycles.
    prices=replace(PRICES, clock=100e6, sources=PRICES.sources.replace("SPRS880", "SPRS945")),
)
