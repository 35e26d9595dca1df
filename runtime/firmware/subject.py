"""The program run on a processor: one generated step function, its struct as a row of 32-bit words, and its files.

A filter alone, the controller around it, or the whole drive with its supervisor.

Nothing here knows a field by its meaning: every word of the struct is compared, whatever the generator put there.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

from runtime.estimator.folder import GeneratedFolder

#: The port header's names, as far as structs may use them; only float or not matters here.
_TYPES = "typedef float float32; typedef int int16, int32; typedef unsigned Uint16, Uint32;"

#: u and y of a filter; phase currents and commands of a controller or a drive.
INPUTS = 4

#: The end of a subject's name: a filter's, a controller's, a drive's.
Part = Literal["", "foc", "drive"]
#: What a part's struct is made of beside the filter's, in the order in which C declares it.
_PIECES: Mapping[Part, tuple[str, ...]] = {"": (), "foc": ("foc",), "drive": ("foc", "supervisor", "drive")}
#: Where the filter is in a part's struct.
_FILTER: Mapping[Part, str] = {"": "", "foc": "filter.", "drive": "control.filter."}


@dataclass(frozen=True)
class Field:
    """``count`` neighbouring words of the struct; ``name`` as C spells it (``filter.x``)."""

    name: str
    count: int
    is_int: bool


@dataclass(frozen=True)
class Subject:
    """One generated step function.

    ``name`` is its prefix (``paper_spmsm_ickf``, ``paper_spmsm_ickf_foc``), ``part`` that prefix's end, ``sources`` the
    generated files it is compiled from, unchanged, ``outputs`` the number of floats it writes beside its struct (duty
    cycles).
    """

    name: str
    part: Part
    sources: Mapping[str, str]

    @property
    def controller(self) -> bool:
        """Whether it takes phase currents and commands, and hands out duty cycles."""
        return self.part != ""

    @property
    def filter_name(self) -> str:
        """C name of the filter, or of the filter within."""
        return self.name.removesuffix(f"_{self.part}") if self.part else self.name

    @property
    def filter_place(self) -> str:
        """Where the filter is in the struct, as C spells what comes before a field of it."""
        return _FILTER[self.part]

    @property
    def outputs(self) -> int:
        """Number of words a step hands out beside the struct."""
        return 3 if self.controller else 0

    @cached_property
    def fields(self) -> tuple[Field, ...]:
        """The struct's fields in order, those of a struct inside it included."""
        import cffi

        ffi = cffi.FFI()
        names = [self.filter_name, *(f"{self.filter_name}_{piece}" for piece in _PIECES[self.part])]
        ffi.cdef(_TYPES + "".join(_struct(self.sources[f"{name}.h"], name) for name in names))
        return tuple(_fields(ffi.typeof(f"{self.name}_t"), ""))

    @cached_property
    def words(self) -> tuple[str, ...]:
        """A name for every word compared after a step: what it returns, outputs, then the struct."""
        outputs = [f"duty[{k}]" for k in range(self.outputs)]
        return ("inverter" if self.part == "drive" else "status", *outputs, *self.struct_words)

    @cached_property
    def struct_words(self) -> tuple[str, ...]:
        """A name for each word of the struct."""
        return tuple(
            field.name if field.count == 1 else f"{field.name}[{k}]"
            for field in self.fields
            for k in range(field.count)
        )

    @cached_property
    def integers(self) -> tuple[bool, ...]:
        """Of each of :attr:`words`, whether it is an integer."""
        struct = [field.is_int for field in self.fields for _ in range(field.count)]
        return (True, *[False] * self.outputs, *struct)


def subjects(folder: GeneratedFolder) -> tuple[Subject, ...]:
    """Every filter of a folder, then the controllers and the drives it has."""
    return tuple(
        Subject("_".join(filter(None, (folder.drive, kind, part))), part, _sources(folder, kind, part))
        for part in _PIECES
        for kind in folder.kinds
        if not part or f"{folder.drive}_{kind}_{part}.c" in folder.manifest["files"]
    )


def _sources(folder: GeneratedFolder, kind: str, part: Part) -> dict[str, str]:
    names = ["_".join(filter(None, (folder.drive, kind, piece))) for piece in ("", *_PIECES[part])]
    files = ["pmsm_port.h", *(f"{name}{end}" for name in names for end in (".h", ".c"))]
    return {name: folder.text(name) for name in files}


def _struct(header: str, name: str) -> str:
    """The header's ``typedef struct { ... } <name>_t;`` without its comments."""
    text = re.sub(r"/\*.*?\*/", "", header, flags=re.DOTALL)
    end = text.index(f"}} {name}_t;")
    return text[text.rindex("typedef struct", 0, end) : end] + f"}} {name}_t;"


def _fields(struct: Any, prefix: str) -> list[Field]:
    found = []
    for name, field in struct.fields:
        kind, count = field.type, 1
        if kind.kind == "array":
            kind, count = kind.item, kind.length
        if kind.kind == "struct":
            found += _fields(kind, f"{prefix}{name}.")
        else:
            found.append(Field(f"{prefix}{name}", count, kind.cname != "float"))
    return found
