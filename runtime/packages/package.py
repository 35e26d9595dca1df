"""What a package holds, for every build system there is one for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from codegen.output.folder import with_manifest
from codegen.output.version import __version__
from runtime.estimator.folder import GeneratedFolder
from runtime.faults.loop import example_for
from runtime.system.errors import UserError

_EXAMPLE = {
    "example/main.c": "main.c",
    "example/board.c": "board.c",
    "example/board.h": "board.h",
}
_YOURS = "`example/` is a first program: `board.c` is the hardware, yours to write."

#: In front of a source: GCC must not fuse, and the build system takes no flags from a library.
_UNFUSED = (
    '#if defined(__GNUC__) && !defined(__clang__)\n#pragma GCC optimize("fp-contract=off")\n#elif defined(__clang__)\n'
    "#pragma STDC FP_CONTRACT OFF\n#endif\n"
)


@dataclass(frozen=True)
class BuildSystem:
    """One build system: its name for people, files by their template, steps to build, and what was tried here.

    ``interrupt``: whether drive_isr.c and the first program in C come along. ``pragma``: whether sources need a line
    in front, as no flags can be given for them.
    """

    title: str
    files: Mapping[str, str]
    steps: str
    built: str
    interrupt: bool = True
    pragma: bool = False
    example: str = field(default=_YOURS)


_NOT_BUILT = "Not built here: {} The files were checked for what they list, and the C was built with other compilers."

BUILD_SYSTEMS = {
    "cmake": BuildSystem(
        "CMake",
        {"CMakeLists.txt": "CMakeLists.txt", "cortex-m4.cmake": "cortex-m4.cmake"},
        "```sh\ncmake -S . -B build && cmake --build build && ctest --test-dir build\n"
        "cmake -S . -B m4 -DCMAKE_TOOLCHAIN_FILE=cortex-m4.cmake && cmake --build m4\n```",
        "Built by the project's tests for the host, where the self-test runs, and with arm-none-eabi-gcc "
        "for a Cortex-M4F.",
    ),
    "arduino": BuildSystem(
        "Arduino",
        {"library.properties": "library.properties", "examples/First/First.ino": "First.ino"},
        "Put the folder into your `libraries`, and open the example `First`.",
        "Compiled by the project's tests with avr-gcc and arm-none-eabi-gcc against a stub of the core; the Arduino "
        "IDE itself was not tried.",
        interrupt=False,
        pragma=True,
        example="`examples/First` tests itself and says what it found.",
    ),
    "zephyr": BuildSystem(
        "Zephyr",
        {
            "zephyr/module.yml": "module.yml",
            "zephyr/Kconfig": "Kconfig",
            "zephyr/CMakeLists.txt": "zephyr_CMakeLists.txt",
            "example/CMakeLists.txt": "sample_CMakeLists.txt",
            "example/prj.conf": "prj.conf",
        },
        "A module: add the folder to your manifest or to ZEPHYR_EXTRA_MODULES. The first program: "
        "`west build -b BOARD example`.",
        _NOT_BUILT.format("Zephyr's SDK is no package of Debian or PyPI."),
    ),
    "ccs": BuildSystem(
        "Code Composer Studio",
        {"{p}.projectspec": "projectspec"},
        "Project > Import CCS Projects, and choose the `.projectspec`. Add your linker command file with "
        "`.TI.ramfunc`, as pmsm-ickf's docs/ccs.md says.",
        _NOT_BUILT.format("TI's compiler is no package of Debian or PyPI."),
    ),
    "platformio": BuildSystem(
        "PlatformIO",
        {"library.json": "library.json", "platformio.ini": "platformio.ini"},
        "```sh\npio run -e host && .pio/build/host/program\n```\n\nAs a library: put the folder into `lib`.",
        _NOT_BUILT.format("PlatformIO loads its compilers from a registry of its own."),
    ),
}


@cache
def _templates() -> Environment:
    return Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates"),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        autoescape=False,
    )


def generated_sources(folder: GeneratedFolder, kind: str) -> dict[str, str]:
    """The generated C of a drive around one filter, by file name.

    Parameters
    ----------
    folder : GeneratedFolder
    kind : str
        Filter kind.
    """
    p = f"{folder.drive}_{kind}"
    ends = ("", "_foc", "_supervisor", "_drive", "_selftest", "_foc_selftest")
    names = [f"{p}{end}.{kind}" for end in ends for kind in "ch"]
    return {name: folder.text(name) for name in [*names, "pmsm_port.h"]}


def package_files(folder: GeneratedFolder, kind: str, system: str) -> dict[str, str]:
    """Every file of a package, by its path.

    Parameters
    ----------
    folder : GeneratedFolder
    kind : str
        Filter kind.
    system : str
        A name of :data:`BUILD_SYSTEMS`.

    Raises
    ------
    UserError
        Another name.
    """
    about = BUILD_SYSTEMS.get(system)
    if about is None:
        raise UserError(f"no package for '{system}'; there are: {', '.join(BUILD_SYSTEMS)}.")
    p, generated = f"{folder.drive}_{kind}", generated_sources(folder, kind)
    words: dict[str, Any] = {
        "p": p,
        "drive": folder.drive,
        "kind": kind.upper(),
        "version": __version__,
        "sha": folder.manifest["input_sha256"][:16],
        "period": f"{folder.module.SAMPLE_TIME * 1e6:g} us",
        "dc_link": f"{float(folder.manifest['parameters']['control']['dc_link'])!r}f",
        "sources": [name for name in generated if name.endswith(".c")],
        "every": list(generated),
        "title": about.title,
        "steps": about.steps,
        "built": about.built,
        "pragma": about.pragma,
        "example": about.example,
    }
    front = _UNFUSED if about.pragma else ""
    files = {f"src/{name}": (front if name.endswith(".c") else "") + text for name, text in generated.items()}
    wanted = {**about.files, **(_EXAMPLE if about.interrupt else {}), "README.md": "README.md"}
    for path, template in wanted.items():
        files[path.format(p=p)] = _templates().get_template(f"{template}.j2").render(words)
    if about.interrupt:
        files["example/drive_isr.c"] = example_for(folder, kind)
    return with_manifest(files, {"package": system, "of": folder.drive, "filter": kind})
