"""Any C99 compiler whose float is IEEE's, and whose int has 16 bits or more: nothing in the text is a processor's."""

from __future__ import annotations

from dataclasses import replace

from codegen.targets.chips.cortex_m4f import TARGET as CORTEX_M4F
from codegen.targets.description import Compiler, Sections

TARGET = replace(
    CORTEX_M4F,
    name="c99",
    title="plain C99",
    core="processor",
    purpose="any C99 compiler with IEEE float",
    language="C99 (and C89) float32",
    compiler=Compiler(),
    sections=Sections(),
    data=replace(CORTEX_M4F.data, source="float32 and int 4: where int has 16 bits it is less"),
    board=None,
    not_shown="It is run on the host alone: `pmsm-ickf verify` compares its bits with NumPy's.",
)
