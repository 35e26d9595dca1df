"""The program run on a processor: one generated step function, its struct as a row of 32-bit words, and its files.

Nothing here knows a field by its meaning: every word of the struct is compared, whatever the generator put there.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from runtime.estimator.folder import GeneratedFolder

#: The port header's names, as far as structs may use them; only float or not matters here.
_TYPES = "typedef float float32; typedef int int16, int32; typedef unsigned Uint16, Uint32;"

#: u and y of a filter; phase currents and commands of a controller.
INPUTS = 4


@dataclass(frozen=True)
class Field:
    """``count`` neighbouring words of the struct; ``name`` as C spells it (``filter.x``)."""

    name: str
    count: int
    is_int: bool


@dataclass(frozen=True)
class Subject:
    """One generated step function.

    ``name`` is its prefix (``paper_spmsm_ickf``, ``paper_spmsm_ickf_foc``), ``sources`` the generated files it is
    compiled from, unchanged, ``outputs`` the number of floats it writes beside its struct (duty cycles).
    """

    name: str
    controller: bool
    sources: Mapping[str, str]

    @property
    def filter_name(self) -> str:
        """C name of the filter, or of the filter within the controller."""
        return self.name.removesuffix("_foc")

    @property
    def outputs(self) -> int:
        """Number of words a step hands out beside the struct."""
        return 3 if self.controller else 0

    @cached_property
    def fields(self) -> tuple[Field, ...]:
        """The struct's fields in order, those of a struct inside it included."""
        import cffi

        ffi = cffi.FFI()
        names = [self.filter_name, self.name] if self.controller else [self.name]
        ffi.cdef(_TYPES + "".join(_struct(self.sources[f"{name}.h"], name) for name in names))
        return tuple(_fields(ffi.typeof(f"{self.name}_t"), ""))

    @cached_property
    def words(self) -> tuple[str, ...]:
        """A name for every word compared after a step: status, outputs, then the struct."""
        outputs = [f"duty[{k}]" for k in range(self.outputs)]
        return ("status", *outputs, *self.struct_words)

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
    """Every filter of a folder, then the controllers it has."""
    port = {"pmsm_port.h": folder.text("pmsm_port.h")}
    filters, controllers = [], []
    for kind in folder.kinds:
        name = f"{folder.drive}_{kind}"
        files = {f"{name}{end}": folder.text(f"{name}{end}") for end in (".h", ".c")}
        filters.append(Subject(name, False, {**port, **files}))
        if f"{name}_foc.c" in folder.manifest["files"]:
            foc = {f"{name}_foc{end}": folder.text(f"{name}_foc{end}") for end in (".h", ".c")}
            controllers.append(Subject(f"{name}_foc", True, {**port, **files, **foc}))
    return (*filters, *controllers)


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
