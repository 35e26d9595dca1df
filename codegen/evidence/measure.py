"""Stack and code size of emitted C, measured with the compiler of the target's stand-in, which is at hand.

A measurement is keyed by the code it was made from (comments left out, flags included) and kept in manifest.json:
the same code gives the same report on any machine, with or without the compiler.
"""

from __future__ import annotations

import hashlib
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pycparser import c_ast

from codegen.evidence.emitted import code_of
from codegen.evidence.ledger import Program
from codegen.evidence.programs import ProgramError, run_program
from codegen.evidence.units import Unit
from codegen.output.folder import FolderError, read_manifest
from codegen.targets.description import StandIn

#: Its keys in manifest.json: source_sha256, and either compiler, stack_bytes and text_bytes, or not_measured.
Record = dict[str, Any]


class RefusedError(Exception):
    """A compiler that takes no part in it, for want of its C library say."""


def kept_records(folder: Path) -> dict[str, Record]:
    """Measurements a generated folder holds, by name of the function; none if there is no such folder.

    Parameters
    ----------
    folder : Path
        A generated folder.
    """
    try:
        records: dict[str, Record] = read_manifest(folder).get("measured", {})
    except FolderError:
        return {}
    return records


@dataclass
class Measurer:
    """Takes what was kept for the same code, else measures.

    ``compile`` off: what was not kept is reported as not measured, whatever is installed. ``retry``: code that was
    kept as not measured is measured once there is a compiler.
    """

    kept: Mapping[str, Record] = field(default_factory=dict)
    compile: bool = False
    retry: bool = False
    _objects: dict[str, tuple[dict[str, int], int]] = field(default_factory=dict)

    def __call__(self, files: Mapping[str, str], program: Program, function: str) -> Record:
        """Record of ``function``, with everything it calls; ``files`` are the folder's texts.

        A compiler that refuses them, for want of its C library say, leaves them unmeasured; one that crashes or hangs
        has said nothing of them, and that is a ProgramError.
        """
        stand_in = program.target.stand_in
        units = _reached(program, *program.find(function))
        key = _digest(stand_in.flags, {name: files[name] for unit in units for name in unit.files})
        kept = self.kept.get(function, {})
        usable = kept.get("source_sha256") == key
        if usable and not ("not_measured" in kept and self.retry and shutil.which(stand_in.compiler)):
            return dict(kept)
        if not self.compile:
            return {"source_sha256": key, "not_measured": "not asked for"}
        if shutil.which(stand_in.compiler) is None:
            return {"source_sha256": key, "not_measured": not_found(stand_in)}
        try:
            objects = {unit.name: self._object(files, unit, stand_in) for unit in units}
            version = compiler_version(stand_in)
        except RefusedError:
            return {"source_sha256": key, "not_measured": f"{stand_in.compiler} failed on it"}
        return {
            "source_sha256": key,
            "compiler": f"{stand_in.compiler} {version}",
            "stack_bytes": _deepest(program, objects, function),
            "text_bytes": sum(text for _, text in objects.values()),
        }

    def _object(self, files: Mapping[str, str], unit: Unit, stand_in: StandIn) -> tuple[dict[str, int], int]:
        if unit.name not in self._objects:
            self._objects[unit.name] = compile_object({name: files[name] for name in unit.files}, unit.name, stand_in)
        return self._objects[unit.name]


def not_found(stand_in: StandIn) -> str:
    """What is said where a stand-in's compiler is missing.

    Parameters
    ----------
    stand_in : StandIn
    """
    return f"{stand_in.compiler} not found (Debian: {stand_in.package})"


def compiler_version(stand_in: StandIn) -> str:
    """Return the first line of what the cross compiler says of its version.

    Parameters
    ----------
    stand_in : StandIn
    """
    command = [stand_in.compiler, "-dumpfullversion"]
    with _read_from(command):
        return _answer(command).split()[0]


def compile_object(files: Mapping[str, str], source: str, stand_in: StandIn) -> tuple[dict[str, int], int]:
    """Compile one file: the frame of each function that was not inlined, and the bytes of code and constants.

    Parameters
    ----------
    files : mapping of str to str
        Texts by path relative to the folder.
    source : str
        The file's path.
    stand_in : StandIn
    """
    with tempfile.TemporaryDirectory() as scratch:
        for name, text in files.items():
            (Path(scratch) / name).write_text(text, encoding="utf-8")
        command = [stand_in.compiler, *stand_in.flags, "-fstack-usage", "-c", source, "-o", "measured.o"]
        _answer(command, source, Path(scratch))
        with _read_from(command, source):
            frames = _frames((Path(scratch) / "measured.su").read_text(encoding="utf-8"))
        command = [stand_in.compiler.replace("gcc", "size"), "measured.o"]
        size = _answer(command, source, Path(scratch))
        with _read_from(command, source):
            return frames, int(size.splitlines()[1].split()[0])


def _answer(command: Sequence[str], source: str = "", folder: Path | None = None) -> str:
    ended = run_program(command, folder=folder, on=source, temporary=folder)
    if ended.crash:
        raise ProgramError(f"{command[0]} crashed{f' on {source}' if source else ''}: {ended.crash}")
    if ended.code:
        raise RefusedError
    return ended.out


@contextmanager
def _read_from(command: Sequence[str], source: str = "") -> Iterator[None]:
    """What is no answer of a program is a ProgramError."""
    try:
        yield
    except (OSError, ValueError, IndexError):
        on = f" on {source}" if source else ""
        raise ProgramError(f"{command[0]} ended well{on}, but what it made cannot be read.") from None


def _frames(usage: str) -> dict[str, int]:
    """Bytes by function from GCC's .su file; clones (``name.constprop.0``) count as the function, the largest wins."""
    frames: dict[str, int] = {}
    for line in usage.splitlines():
        place, size, _ = line.split("\t")
        name = place.rpartition(":")[2].partition(".")[0]
        frames[name] = max(frames.get(name, 0), int(size))
    return frames


def _reached(program: Program, unit: Unit, definition: c_ast.FuncDef) -> list[Unit]:
    """The files a function needs, its own first."""
    units = [unit]
    for callee in program.callees(unit, definition):
        units += [other for other in _reached(program, *callee) if other not in units]
    return units


def _deepest(program: Program, objects: Mapping[str, tuple[dict[str, int], int]], function: str) -> int:
    """Largest sum of frames along any chain of calls; an inlined function lies in its caller's frame.

    A bound: what is inlined here and called there counts twice.
    """

    def depth(unit: Unit, definition: c_ast.FuncDef) -> int:
        own = objects[unit.name][0].get(definition.decl.name, 0)
        return own + max((depth(*callee) for callee in program.callees(unit, definition)), default=0)

    return depth(*program.find(function))


def _digest(flags: Sequence[str], files: Mapping[str, str]) -> str:
    text = "\n".join([" ".join(flags), *(f"{name}\n{code_of(text)}" for name, text in sorted(files.items()))])
    return hashlib.sha256(text.encode()).hexdigest()
