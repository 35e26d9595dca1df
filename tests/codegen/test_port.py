"""The port header: types by width on every compiler at hand, and one clear line where a target does not fit."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from model.schema import Drive
from runtime.estimator.folder import GENERATED
from tests.codegen.strict import STRICT, interrupt_files, need

PORT = GENERATED / "paper_spmsm" / "pmsm_port.h"
C28X = ["-D__TMS320C28XX__", "-D__TI_COMPILER_VERSION__=6002000"]
FPU = "-D__TMS320C28XX_FPU32__"


def _compile(text: str, folder: Path, *flags: str, compiler: str = "gcc") -> subprocess.CompletedProcess[str]:
    source = folder / "x.c"
    source.write_text(text)
    command = [compiler, *flags, f"-I{PORT.parent}", "-c", str(source), "-o", str(folder / "x.o")]
    return subprocess.run(command, capture_output=True, text=True, check=False)


#: The compiler's own knowledge of its types, against the header's choice; 1 << 16 and the like would overflow.
WIDTHS = """
#include "pmsm_port.h"
typedef int a[((int16)-1 < 0 && (Uint16)-1 > 0 && (Uint16)-1 == 0xFFFFUL) ? 1 : -1];
typedef int b[((int32)-1 < 0 && (Uint32)-1 > 0 && (Uint32)-1 == 0xFFFFFFFFUL) ? 1 : -1];
float32 root(float32 x);
float32 root(float32 x) { return PMSM_SQRT(x); }
"""


@pytest.mark.parametrize(
    "compiler",
    [
        ["gcc"],
        ["clang"],
        ["clang", "--target=msp430"],
        ["avr-gcc", "-mmcu=atmega1284p"],
        ["arm-none-eabi-gcc", "-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"],
    ],
    ids=" ".join,
)
def test_types_have_their_width(compiler: list[str], tmp_path: Path) -> None:
    """16-bit and 32-bit ints, 32-bit and 64-bit longs and doubles: the same names, the same widths."""
    strict = [flag for flag in STRICT if compiler[0] != "clang" or flag != "-Wunsuffixed-float-constants"]
    done = _compile(WIDTHS, tmp_path, *compiler[1:], *strict, compiler=need(compiler[0]))
    assert done.returncode == 0, done.stderr


def test_device_header_may_come_first(tmp_path: Path) -> None:
    """The device header's types are taken as they are, and measured too."""
    device = "#define DSP28_DATA_TYPES\ntypedef short int16; typedef int int32; typedef {} float32;\n"
    device += "typedef unsigned short Uint16; typedef unsigned int Uint32;\n"
    assert _compile(device.format("float") + WIDTHS, tmp_path, *STRICT).returncode == 0
    done = _compile(device.format("double") + WIDTHS, tmp_path, *STRICT)
    assert "pmsm_float32_must_have_32_bits" in done.stderr


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["-ffast-math"], "-ffast-math and -Ofast change the results"),
        (C28X, "compile with --float_support=fpu32"),
        ([*C28X, FPU, "-D__TI_STRICT_FP_MODE__=0"], "compile with --fp_mode=strict"),
        ([*C28X, FPU, "-D__TI_STRICT_FP_MODE__=1"], "pmsm_int16_must_have_16_bits"),
        (["-UFLT_MANT_DIG", "-D__FLT_MANT_DIG__=11"], "pmsm_float32_must_have_24_bits_of_mantissa"),
    ],
    ids=["fast-math", "no FPU", "relaxed", "int of 32 bits taken for the C28x's", "short mantissa"],
)
def test_a_target_that_does_not_fit_is_told_why(flags: list[str], message: str, tmp_path: Path) -> None:
    done = _compile('#include "pmsm_port.h"\n', tmp_path, *flags)
    assert done.returncode != 0
    assert message in done.stderr


def test_square_root_is_named_in_the_port_header_alone(drive: Drive) -> None:
    folder = GENERATED / drive.name
    for path in [*folder.glob("*.c"), *folder.glob("*.h")]:
        code = re.sub(r"/\*.*?\*/", "", path.read_text(), flags=re.DOTALL)
        assert ("sqrtf" in code) == (path.name == "pmsm_port.h")
        assert not re.search(r"^extern\b(?! \"C\")", code, flags=re.MULTILINE)


@pytest.mark.parametrize(("version", "section"), [(6002000, "ramfuncs"), (15009000, ".TI.ramfunc")])
def test_all_that_runs_in_the_interrupt_is_placed_in_ram(drive: Drive, version: int, section: str) -> None:
    """As the TI compiler sees the file: all but what runs once have their pragma, before their definition."""
    flags = ["-D__TMS320C28XX__", FPU, f"-D__TI_COMPILER_VERSION__={version}"]
    example = GENERATED / drive.name / "example_isr.c"
    read = [*((path, 1) for path in interrupt_files(drive.name)), (example, 1), (example, 0)]
    for path, whole in read:
        command = ["gcc", "-E", "-P", *flags, f"-DWHOLE_CONTROLLER={whole}", str(path)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        text = done.stdout
        placed = re.findall(r'#pragma CODE_SECTION\((\w+), "([\w.]+)"\)', text)
        defined = set(re.findall(r"^(?:\w+ )+(\w+)\([^;{]*?\)\s*\{", text, flags=re.MULTILINE))
        hot = {name for name in defined if not name.endswith(("_init", "_reset", "_setup", "_refuse"))}
        assert {name for name, _ in placed} == hot
        declared = re.sub(r"#pragma CODE_SECTION.*", "", text[: text.rindex("#pragma CODE_SECTION")])
        assert "(" not in declared, "a pragma that follows a declaration may be ignored (SPRU514, pragma directives)"
        assert {name for _, name in placed} == {section}
        assert len(placed) == len(hot) > 3
