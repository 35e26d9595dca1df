"""Gate: compilers that are told to complain about everything have nothing to say.

Three views of the same text: GCC, Clang, and Clang for the MSP430, whose int has 16 bits and whose double has 64,
as on the C28x under EABI. What is left out is left out for a reason that stands beside it.
"""

from __future__ import annotations

from pathlib import Path

from runtime.firmware.static.check import Check
from runtime.firmware.static.tool import OTHER_EXAMPLE, firmware_sources, is_example, missing, run

#: One language for all: C89 to the letter, float operations never fused.
LANGUAGE = ["-std=c89", "-pedantic", "-ffp-contract=off", "-Werror"]

#: Beyond -Wall and -Wextra: precision (a double, a literal without suffix, a conversion that loses something),
#: declarations, hidden names, C that C89 compilers may not know, dead code. -O2 because GCC sees uninitialised
#: and null values only while optimising; 2000 bytes of stack are 1000 words, the chip's default stack.
GCC = """
-O2 -Wall -Wextra
-Wconversion -Wsign-conversion -Wfloat-conversion -Wdouble-promotion -Wunsuffixed-float-constants
-Wfloat-equal -Wbad-function-cast -Wcast-qual -Wcast-align=strict -Wpointer-arith -Wwrite-strings
-Wstrict-prototypes -Wmissing-prototypes -Wmissing-declarations -Wold-style-definition
-Wnested-externs -Wredundant-decls -Wshadow -Wundef -Wlong-long -Wvla -Wdeclaration-after-statement
-Wswitch-default -Wswitch-enum -Wlogical-op -Wduplicated-cond -Wduplicated-branches
-Wnull-dereference -Wunused -Wunused-macros -Wunused-const-variable=2 -Wstack-usage=2000
"""

#: All that Clang knows. Not -Wpadded and -Wunsafe-buffer-usage: layout is the ABI's, arrays are the point.
CLANG = ["-Weverything", "-Wno-padded", "-Wno-unknown-warning-option", "-Wno-unsafe-buffer-usage"]

#: Name, tool, options, what the view stands for.
VIEWS = (
    ("warnings, GCC", "gcc", [*GCC.split(), "-c", "-o", "/dev/null"], "compiled for the host"),
    ("warnings, Clang", "clang", [*CLANG, "-fsyntax-only"], "read for the host"),
    (
        "hidden double",
        "clang",
        ["--target=msp430", *CLANG, "-fsyntax-only"],
        "read for a 16-bit int and a 64-bit double, the EABI's model",
    ),
)


def compiler_checks(folder: Path) -> list[Check]:
    """One check a view; a warning in any file fails it."""
    return [_view(folder, *view) for view in VIEWS]


def _view(folder: Path, name: str, tool: str, options: list[str], how: str) -> Check:
    absent = missing(name, folder.name, tool)
    if absent:
        return absent
    sources = firmware_sources(folder)
    said = []
    runs = [(source, options) for source in sources]
    runs += [(source, [f"-D{OTHER_EXAMPLE}", *options]) for source in sources if is_example(source)]
    for source, arguments in runs:
        code, text = run([tool, *LANGUAGE, *arguments, "-I.", str(source.relative_to(folder))], cwd=folder)
        lines = [line for line in text.splitlines() if "error:" in line or "warning:" in line]
        said += lines or ([text.strip() or f"{source.name}: {tool} failed"] if code else [])
    figure = f"{len(said)} warnings in {len(sources)} files"
    return Check(name, folder.name, "failed" if said or not sources else "passed", figure, how, tuple(said))
