"""Link D-E of the whole drive in lanes: the scalar C = the lane form, bit for bit, every field of every struct.

The supervisors are led about as those of link "supervisor" are, so that every transition is taken; each interrupt
begins from the same memory in both forms. The drives run on by themselves, all in one struct: each in its own mode,
half of them with a sample of delay.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.estimator.c_backend import declarations
from runtime.estimator.compiler import build_library, compiler_name, open_library
from runtime.estimator.folder import GeneratedFolder
from runtime.estimator.lanes import OPTIMISATION
from runtime.proof.drive_draws import inputs, set_drive
from runtime.proof.link_drive import Compiled, store_struct
from runtime.proof.mode_walk import Walk
from runtime.proof.modes import Modes
from runtime.proof.result import Link, Row

Array = NDArray[Any]

#: Groups of lanes and interrupts of the supervisors; interrupts of the drives; structs of arbitrary bits.
GROUPS, INTERRUPTS, SAMPLES, ANY_MEMORY = 5, 60, 90, 32


class CompiledLanes(Compiled):
    """The scalar forms and, beside them, all lane forms of a kind.

    Parameters
    ----------
    folder : GeneratedFolder
    kind : str
    """

    def __init__(self, folder: GeneratedFolder, kind: str) -> None:
        super().__init__(folder, kind)
        stems = [f"{self.stem}_{part}" for part in ("lanes", "foc_lanes", "drive_lanes")]
        texts = {f"{stem}{end}": folder.text(f"host/{stem}{end}") for stem in stems for end in (".h", ".c")}
        found = re.search(r"#define LANES (\d+)", texts[f"{stems[0]}.h"])
        assert found is not None
        self.lanes = int(found[1])
        for stem in stems:
            text = declarations(texts[f"{stem}.h"], stem, "float32").partition("void runner_run")[0].split(";", 1)[1]
            self.ffi.cdef(text.replace("[LANES]", f"[{self.lanes}]"))
        self.library = open_library(self.ffi, build_library({**self.sources, **texts}, {}, OPTIMISATION))

    def new(self) -> Any:
        """Return a group of drives in lanes."""
        return self.ffi.new(f"{self.stem}_drive_lanes_t *")

    def load(self, group: Any, drives: Any, first: int) -> None:
        """Fill a group's lanes from scalar drives ``first`` and on."""
        for lane in range(self.lanes):
            self.function("drive_lanes_load")(group, lane, drives + first + lane)

    def store(self, group: Any, drives: Any, first: int) -> None:
        """Read a group's lanes into scalar drives ``first`` and on."""
        for lane in range(self.lanes):
            self.function("drive_lanes_store")(group, lane, drives + first + lane)

    def supervise_lanes(self, group: Any, status: Array, given: Array) -> list[int]:
        """Transitions that one interrupt of a group's supervisors takes; phase currents and reference are rows."""
        columns, field = self.columns(given), self.ffi.addressof
        s, f = field(group, "supervisor"), field(group, "control", "filter")
        self.function("supervise_lanes")(s, f, status.tolist(), columns, columns + 2)
        return list(group.supervisor.taken)

    def supervise(self, drive: Any, status: int, given: Array) -> int:
        """The same of one scalar drive."""
        s, f = (self.ffi.addressof(drive, *place) for place in (("supervisor",), ("control", "filter")))
        return int(self.function("supervise")(s, f, status, given[:2].tolist(), float(given[2])))

    def drive_lanes(self, group: Any, given: Array) -> Array:
        """One sample of a group: duty cycles (3, lanes); phase currents and commands are rows."""
        columns, duty = self.columns(given), self.columns(np.zeros((3, self.lanes)))
        self.function("drive_lanes_step")(group, columns, columns + 2, duty)
        return np.frombuffer(self.ffi.buffer(duty), np.float32).reshape(3, self.lanes)

    def drive(self, drive: Any, given: Array) -> list[float]:
        """The same of one scalar drive."""
        duty = self.ffi.new("float[3]")
        self.function("drive_step")(drive, given[:2].tolist(), given[2:].tolist(), duty)
        return list(duty)

    def columns(self, values: Array) -> Any:
        """Numbers of all lanes, a row each, as C has them."""
        made = self.ffi.new("lanes[]", len(values))
        np.frombuffer(self.ffi.buffer(made), np.float32).reshape(values.shape)[:] = values
        return made


def link_drive_lanes(
    folder: GeneratedFolder,
    kind: str,
    gain: str,
    parameters: Mapping[str, Any],
    effort: tuple[int, int] = (INTERRUPTS, SAMPLES),
) -> Link:
    """Supervisor and drive in lanes against their scalar C.

    Parameters
    ----------
    folder : GeneratedFolder
        The generated folder.
    kind : str
        Filter kind, such as "ickf".
    gain : str
        "cubature" or "jacobian"; matters to the ICKF alone.
    parameters : mapping of str to Any
        Sections of the drive file, parsed.
    effort : tuple of int, optional
        Interrupts of the supervisors, and of the drives.
    """
    interrupts, samples = effort
    hand = Modes(parameters, flux=folder.manifest["states"][0]["unit"] == "Wb")
    compiled = CompiledLanes(folder, kind)
    rows = (
        _any_memory(compiled),
        *_supervisors(compiled, folder.module, hand, interrupts),
        *_drives(compiled, folder.module, hand, samples),
    )
    drives = GROUPS * compiled.lanes
    data = f"{drives * interrupts} interrupts, {compiled.lanes * samples} of the drive, {compiler_name()}"
    claim = "supervisor and drive: C = its lane form, bit for bit"
    return Link("D-E", claim, folder.drive, kind, gain, data, rows)


def differ(a: Array, b: Array) -> Array:
    """Which of two arrays of structs differ in any field; what is no number in both is the same.

    Parameters
    ----------
    a, b : ndarray
        Structured, of one type.
    """
    if a.dtype.names is None:
        other = (a != b) & ~((a != a) & (b != b))
        return np.asarray(other.reshape(len(a), -1).any(axis=-1))
    found = np.zeros(len(a), dtype=bool)
    for name in a.dtype.names:
        found |= differ(a[name], b[name])
    return found


def _any_memory(compiled: CompiledLanes) -> Row:
    """Memory of arbitrary bits, put into lanes and read again: nothing is forgotten and no lane is another's."""
    rng, count = np.random.default_rng(6), ANY_MEMORY
    (made, view), (again, seen) = compiled.structs("drive", count), compiled.structs("drive", count)
    compiled.ffi.buffer(made)[:] = rng.bytes(compiled.ffi.sizeof(made))
    group = compiled.new()
    for first in range(0, count, compiled.lanes):
        compiled.load(group, made, first)
        compiled.store(group, again, first)
    wrong = view.view(np.uint32) != seen.view(np.uint32)
    return Row("-", "lanes filled and read", "words that differ", float(wrong.sum()), 0.0, wrong.size)


def _supervisors(compiled: CompiledLanes, module: ModuleType, hand: Modes, interrupts: int) -> list[Row]:
    """A walk, each interrupt in both forms from the same memory."""
    count = GROUPS * compiled.lanes
    walk, group = Walk(module, hand, count, np.float32, 1), compiled.new()
    (made, view), (again, seen) = compiled.structs("drive", count), compiled.structs("drive", count)
    different, taken = 0, set[int]()
    for _ in range(interrupts):
        status, phase, reference = walk.draw()
        store_struct(view["supervisor"], walk.s)
        store_struct(view["control"]["filter"], walk.f)
        walk.step(status, phase, reference)
        seen[:] = view
        given, found = np.array([*phase, reference]), []
        for first in range(0, count, compiled.lanes):
            part = slice(first, first + compiled.lanes)
            compiled.load(group, made, first)
            found += compiled.supervise_lanes(group, status[part], given[:, part])
            compiled.store(group, again, first)
        codes = [compiled.supervise(made[lane], int(status[lane]), given[:, lane]) for lane in range(count)]
        different += int((np.array(codes) != found).sum() + differ(view, seen).sum())
        taken |= {code for code in codes if code}
    rows, never = count * interrupts, float(len(hand.events) - len(taken))
    return [
        Row("-", "supervisor in lanes, every field", "interrupts that differ", float(different), 0.0, rows),
        Row("-", "transitions, in lanes", "never taken", never, 0.0, len(taken)),
    ]


def _drives(compiled: CompiledLanes, module: ModuleType, hand: Modes, samples: int) -> list[Row]:
    """Drives that run on by themselves, side by side; now and then one is set as no run would leave it so soon."""
    lanes, rng, group = compiled.lanes, np.random.default_rng(7), compiled.new()
    (made, view), (again, seen) = compiled.structs("drive", lanes), compiled.structs("drive", lanes)
    different, modes = 0, set[int]()
    for lane in range(lanes):
        compiled.function("drive_init")(made + lane, lane % 2)
    compiled.load(group, made, 0)
    for _ in range(samples):
        for lane in range(lanes):
            one = fetch_struct(view[lane])
            if set_drive(one, module, hand, rng, np.float32):
                store_struct(view[lane : lane + 1], one)
                compiled.function("drive_lanes_load")(group, lane, made + lane)
        given = np.transpose([np.concatenate(inputs(hand, rng, np.float32)) for _ in range(lanes)])
        modes |= set(view["supervisor"]["mode"].tolist())
        seen[:] = view
        found = compiled.drive_lanes(group, given)
        compiled.store(group, again, 0)
        wanted = np.array([compiled.drive(made + lane, given[:, lane]) for lane in range(lanes)])
        different += int((differ(view, seen) | differ(found.T, wanted)).sum())
    missed = float(len(set(range(len(module.MODES))) - modes))
    return [
        Row("-", "drive in lanes, every field", "interrupts that differ", float(different), 0.0, lanes * samples),
        Row("-", "modes of the drive, in lanes", "not visited", missed, 0.0, len(modes)),
    ]


def fetch_struct(view: Any) -> SimpleNamespace:
    """C's memory as NumPy's module has it.

    Parameters
    ----------
    view : ndarray
        One struct.
    """
    found = SimpleNamespace()
    for name in view.dtype.names:
        value = view[name]
        if value.dtype.names:
            setattr(found, name, fetch_struct(value))
        else:
            setattr(found, name, tuple(value) if value.shape else value)
    return found
