"""A part as an FMU: its C, compiled for this machine, its source for others, and its model description."""

from __future__ import annotations

import ctypes
import hashlib
import io
import platform
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from runtime.estimator.compiler import build_library
from runtime.estimator.folder import GeneratedFolder
from runtime.exports.blocks import block_name
from runtime.exports.description import description, written
from runtime.exports.single_file import part_text
from runtime.exports.variables import DOUBLE, INTEGER, SINGLE, Variable, variables
from runtime.system.errors import UserError

_OWN = Path(__file__).parent
VERSIONS = {2: "2.0", 3: "3.0"}

#: Names of systems in FMI, by Python's: FMI 2 has one for each it knows, FMI 3 one for a processor and a system.
_SYSTEMS = {"Linux": ("linux", "so"), "Darwin": ("darwin", "dylib"), "Windows": ("win", "dll")}
_PROCESSORS = {"x86_64": "x86_64", "AMD64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}

_PLAIN: dict[str, Any] = {SINGLE: ctypes.c_float, DOUBLE: ctypes.c_double, INTEGER: ctypes.c_int}

_WORDS = {
    "filter": "{kind} of the drive {drive}: currents and voltages in, speed and angle out, every {T:g} s",
    "drive": "sensorless drive {drive} around its {kind}: currents in, duty cycles and gates out, every {T:g} s",
    "motor": "motor of the drive {drive} behind its inverter and current sensors, every {T:g} s",
}


def binary_place(version: int) -> tuple[str, str]:
    """The binary's folder in an FMU, and its ending, on this machine.

    Parameters
    ----------
    version : {2, 3}

    Raises
    ------
    UserError
        A machine that this version of FMI has no name for.
    """
    system, ending = _SYSTEMS.get(platform.system(), ("", ""))
    processor = _PROCESSORS.get(platform.machine(), "")
    if version == 2 and system and processor == "x86_64":
        return f"{system}64", ending
    if version == 3 and system and processor:
        return f"{processor}-{'windows' if system == 'win' else system}", ending
    more = " FMI 3 may have one: --fmi 3." if version == 2 and system and processor else ""
    raise UserError(f"FMI {version} has no name for {platform.machine()} under {platform.system()}.{more}")


def write_fmu(folder: GeneratedFolder, kind: str, part: str, version: int) -> bytes:
    """The FMU's bytes: the same for the same folder and compiler.

    Parameters
    ----------
    folder : GeneratedFolder
    kind : str
        Filter kind.
    part : {"filter", "drive", "motor"}
    version : {2, 3}
        Of FMI.

    Raises
    ------
    UserError
        No compiler, or a machine that FMI has no name for.
    """
    place, ending = binary_place(version)
    table = variables(folder, part)
    name = block_name(folder, kind, part)
    body = part_text(folder, kind, part, table)
    token = "{" + hashlib.sha256(body.encode()).hexdigest()[:32] + "}"
    shared = (_OWN / "fmi.h").read_text(encoding="utf-8") + (_OWN / f"fmi{version}.c").read_text(encoding="utf-8")
    source = f'{body}#define TOKEN "{token}"\n\n{shared}'
    library = build_library({f"{name}.c": source}, {}, ("-O2", "-fvisibility=hidden"))
    words = _WORDS[part].format(kind=kind.upper(), drive=folder.drive, T=folder.module.SAMPLE_TIME)
    starts = _starts(folder, kind, part, table)
    about = description(VERSIONS[version], name, token, words, folder.module.SAMPLE_TIME, table, starts)
    files = {
        "modelDescription.xml": about,
        f"binaries/{place}/{name}.{ending}": library.read_bytes(),
        f"sources/{name}.c": source.encode(),
    }
    if version == 3:
        files["sources/buildDescription.xml"] = _build_description(name)
    return _zipped(files)


#: Appended to a part: the text of its values after power-up.
_READER = """
const void *value_of(unsigned reference)
{
    static part_t part;
    part_init(&part);
    return (const char *)&part + VARIABLES[reference].offset;
}
"""


def _starts(folder: GeneratedFolder, kind: str, part: str, table: Sequence[Variable]) -> list[str]:
    """Values after power-up, asked of the compiled part: the description cannot differ from the C."""
    library = build_library({"part.c": part_text(folder, kind, part, table) + _READER}, {}, ("-O1",))
    value_of = ctypes.CDLL(str(library)).value_of
    value_of.restype, value_of.argtypes = ctypes.c_void_p, [ctypes.c_uint]
    found = []
    for reference, variable in enumerate(table):
        value = _PLAIN[variable.type].from_address(value_of(reference)).value
        found.append(str(value) if variable.type == INTEGER else repr(float(value)))
    return found


def _build_description(name: str) -> bytes:
    root = ElementTree.Element("fmiBuildDescription", fmiVersion="3.0")
    files = ElementTree.SubElement(
        ElementTree.SubElement(root, "BuildConfiguration", modelIdentifier=name), "SourceFileSet"
    )
    files.set("language", "C99")
    files.set("compilerOptions", "-ffp-contract=off")
    ElementTree.SubElement(files, "SourceFile", name=f"{name}.c")
    return written(root)


def _zipped(files: dict[str, bytes]) -> bytes:
    """A ZIP archive without the time of day."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name)
            entry.external_attr = 0o644 << 16
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, content)
    return packed.getvalue()
