"""S-functions and C-Scripts: compiled and stepped against stubs, with the bits of the estimator and of the drive."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime.drive.simulation import Conditions, Simulator
from runtime.estimator.compiler import build_library, open_library
from runtime.exports.blocks import plecs_text, sections, sfunction_text
from runtime.exports.variables import FIXED, INPUT, OUTPUT, PARTS, TUNABLE, by_port, variables
from runtime.system.errors import UserError
from tests.conftest import ALL_DRIVES
from tests.exports.drives import HERE, STEPS, closed_loop, filter_run, folder_of

SOME = [pytest.param(d, marks=() if d == "servo_24v" else pytest.mark.thorough) for d in ALL_DRIVES]

#: A sample, a parameter, an element of it, and its value from then on.
Change = tuple[int, str, int, float]

_STRUCTS = """
typedef struct { size_t count; double *values; int complex, other; } mxArray;
typedef struct {
    int expected, given, inputs, outputs, pwork_count, sample_times, options;
    int tunable[32], input_width[32], output_width[32], contiguous[32], feedthrough[32];
    double period, shift;
    const mxArray *parameter[32];
    const double *input[32];
    double *output[32];
    void *pwork[32];
    const char *error;
} SimStruct;
int sizes(SimStruct *S);
int run(SimStruct *S, int steps, const double *in, double *out, int again, int change_at, double *changed, double to);
"""


class SFunction:
    """An S-function behind the stub."""

    def __init__(self, drive: str, part: str) -> None:
        import cffi

        folder = folder_of(drive)
        self.table = variables(folder, part)
        self.ports = by_port(self.table, TUNABLE, FIXED)
        sources = {"block_sf.c": sfunction_text(folder, folder.chosen(None), part, "block_sf")}
        sources |= {name: (HERE / name).read_text("utf-8") for name in ("simstruc.h", "cg_sfun.h")}
        self.ffi = cffi.FFI()
        self.ffi.cdef(_STRUCTS)
        self.library = open_library(self.ffi, build_library(sources, {}, ("-O2", "-Wall", "-Wextra", "-Werror")))

    def opened(self, **parameters: list[float]) -> tuple[Any, list[Any]]:
        """A block with these parameters; the others are []."""
        S = self.ffi.new("SimStruct *")
        S.given = len(self.ports)
        kept: list[Any] = []
        for k, port in enumerate(self.ports):
            values = parameters.get(port, [])
            numbers = self.ffi.new("double[]", values or 1)
            array = self.ffi.new("mxArray *", {"count": len(values), "values": numbers})
            kept += [numbers, array]
            S.parameter[k] = array
        return S, kept

    def run(self, rows: Any, again: int = 1, change: Change | None = None, **parameters: Any) -> Any:
        """Outputs (N, m) for inputs (N, n); ``change``: at a sample, an element of a parameter to a value."""
        S, kept = self.opened(**parameters)
        assert self.library.sizes(S) == 0, self.ffi.string(S.error)
        rows = np.ascontiguousarray(rows, dtype=float)
        widths = [sum(list(w)[:count]) for w, count in ((S.input_width, S.inputs), (S.output_width, S.outputs))]
        assert rows.shape[1] == widths[0]
        out = np.zeros((len(rows), widths[1]))
        at, changed, to = -1, self.ffi.NULL, 0.0
        if change:
            at, port, element, to = change
            changed = kept[2 * list(self.ports).index(port)] + element
        pointers = [self.ffi.cast("double *", self.ffi.from_buffer(array)) for array in (rows, out)]
        assert self.library.run(S, len(rows), pointers[0], pointers[1], again, at, changed, to) == 0
        return out

    def columns(self, out: Any) -> dict[str, Any]:
        """Outputs by name."""
        names = [variable.name for found in by_port(self.table, OUTPUT).values() for variable in found]
        return dict(zip(names, out.T, strict=True))


sfunction = lru_cache(SFunction)


class CScript:
    """A C-Script behind the stub: the sections' texts as they are told to the user."""

    def __init__(self, drive: str, part: str) -> None:
        import cffi

        folder = folder_of(drive)
        self.table = variables(folder, part)
        text = plecs_text(folder, folder.chosen(None), part, "block.h")
        head = text.partition(" */\n")[0]
        sources = {"block.h": text, "cscript.c": (HERE / "cscript.c").read_text("utf-8")}
        for section, name in (("Start", "start"), ("Output", "output"), ("Update", "update")):
            told = head.partition(f" * {section}:\n")[2].splitlines()
            taken = []
            for line in told:
                if not line.startswith(" *     "):
                    break
                taken.append(line[7:])
            assert taken, section
            sources[f"{name}.inc"] = "\n".join(taken) + "\n"
            assert "".join(taken).split("//")[0].split()[0] == sections(part)[section].split()[0]
        self.ffi = cffi.FFI()
        self.ffi.cdef("int run(int steps, const double *in, double *out, const char *name, double value);")
        self.library = open_library(
            self.ffi, build_library(sources, {"EXPORTED": '"block.h"'}, ("-O2", "-Wall", "-Werror"))
        )

    def run(self, rows: Any, name: str = "", value: float = 0.0) -> Any:
        """Outputs (N, m) for inputs (N, n), a value changed by its name."""
        rows = np.ascontiguousarray(rows, dtype=float)
        out = np.zeros((len(rows), sum(len(found) for found in by_port(self.table, OUTPUT).values())))
        pointers = [self.ffi.cast("double *", self.ffi.from_buffer(array)) for array in (rows, out)]
        assert self.library.run(len(rows), pointers[0], pointers[1], name.encode(), value) == 0
        return out


cscript = lru_cache(CScript)


@pytest.mark.parametrize("drive", SOME)
def test_filter_has_the_bits_of_the_estimator(drive: str) -> None:
    rows, states, status = filter_run(drive)
    for again in (1, 3):  # taken again in a sample, as in an algebraic loop, it is the same sample
        out = sfunction(drive, "filter").run(rows, again)
        assert np.array_equal(out[:, : states.shape[1]].astype(np.float32), states, equal_nan=True)
        assert np.array_equal(out[:, states.shape[1]], status)
    assert np.array_equal(cscript(drive, "filter").run(rows), out, equal_nan=True)


def inputs_of_the_loop(drive: str) -> tuple[Any, Any]:
    """What the drive's block sees in the loop of closed_loop.c, and what it answers."""
    folder = folder_of(drive)
    speed, _, rows = closed_loop(drive, folder.chosen(None))
    phase = np.vstack([np.zeros((1, 2)), rows[:-1, :2]])
    link = np.full(STEPS, folder.manifest["parameters"]["control"]["dc_link"])
    return np.column_stack([phase, speed, link, np.zeros(STEPS)]), rows


@pytest.mark.parametrize("drive", SOME)
def test_drive_and_motor_have_the_bits_of_the_loop(drive: str) -> None:
    rows, expected = inputs_of_the_loop(drive)
    block = sfunction(drive, "drive")
    out = block.run(rows, 2)
    found = block.columns(out)
    names = ["duty_a", "duty_b", "duty_c", "gates", "mode", "status"]
    assert np.array_equal(np.column_stack([found[name] for name in names]), expected[:, 5:])
    assert np.array_equal(cscript(drive, "drive").run(rows), out)
    # The motor: a sample after the drive, by its own delay.
    _, load, _ = closed_loop(drive, folder_of(drive).chosen(None))
    link = rows[:, 3]
    held = np.vstack([[0.5, 0.5, 0.5, 0.0], expected[:-1, 5:9]])
    moved = np.column_stack([held, link, load])
    motor = sfunction(drive, "motor")
    out = motor.run(moved, 2, delay=[0.0])
    seen = motor.columns(out)
    names = ["i_a", "i_b", "omega", "theta", "torque"]
    assert np.array_equal(np.column_stack([seen[name] for name in names])[1:], expected[:-1, :5])
    assert np.array_equal(cscript(drive, "motor").run(moved, "inverter_delay", 0.0), out)


def test_parameters_change_what_they_say() -> None:
    rows, _ = inputs_of_the_loop("servo_24v")
    rows = rows[:3000]
    block = sfunction("servo_24v", "drive")
    as_it_is = block.run(rows)
    gain = np.array(folder_of("servo_24v").module.GAIN)
    gain[folder_of("servo_24v").module.GAIN_NAMES.index("advance")] *= 3  # of a delay of one sample
    same = block.run(rows, gain=gain.tolist())
    assert np.array_equal(same, as_it_is)
    changed = block.run(rows, change=(2500, "gain", 0, 2 * gain[0]), gain=gain.tolist())
    assert np.array_equal(changed[:2500], as_it_is[:2500])
    assert not np.array_equal(changed[2500:], as_it_is[2500:])
    fixed = block.run(rows, change=(2500, "delay", 0, 0.0), delay=[1.0])
    assert np.array_equal(fixed, as_it_is)
    assert not np.array_equal(block.run(rows, delay=[0.0]), as_it_is)


def test_a_fault_is_acknowledged_once() -> None:
    """From 0 to 1 it leaves FAULT; held at 1 it does not leave the next one."""
    rows = np.zeros((40_000, 5))
    rows[:, 3] = 24.0
    rows[:, 0] = np.where(np.arange(len(rows)) % 40 < 2, 1000.0, 0.0)  # it trips as often as it tries
    rows[20_000:, 4] = 1.0
    block = sfunction("servo_24v", "drive")
    mode = block.columns(block.run(rows))["mode"]
    assert mode[19_999] == 5
    assert mode[20_001] != 5
    assert mode[-1] == 5


def test_wrong_parameters_are_refused() -> None:
    block = sfunction("servo_24v", "filter")
    S, _ = block.opened(Q=[1.0, 2.0])
    assert block.library.sizes(S) == 1
    assert block.ffi.string(S.error) == b"parameter 1, Q, is [] or 6 real numbers"
    S, kept = block.opened(Q=[1.0] * 6)
    kept[1].complex = 1
    assert block.library.sizes(S) == 1
    S, _ = block.opened()
    assert block.library.sizes(S) == 0
    assert (S.period, S.shift, S.feedthrough[0], S.pwork_count) == (1e-4, 0.0, 1, 1)


@pytest.mark.parametrize("part", PARTS)
def test_variables_of_a_port_lie_together(part: str) -> None:
    for drive in ALL_DRIVES:
        table = variables(folder_of(drive), part)
        place = {variable.name: k for k, variable in enumerate(table)}
        assert len(place) == len(table)
        for roles in ((INPUT,), (OUTPUT,), (TUNABLE, FIXED)):
            for found in by_port(table, *roles).values():
                first = place[found[0].name]
                assert [place[variable.name] for variable in found] == list(range(first, first + len(found)))
                assert len({variable.role for variable in found}) == 1


def test_a_name_that_c_does_not_take() -> None:
    with pytest.raises(UserError, match="letters, digits"):
        sfunction_text(folder_of("servo_24v"), "ckf", "filter", "my-block")


def test_gains_start_as_the_simulator_has_them() -> None:
    """The delay's ``advance``: by the simulator's own way, from the module."""
    simulator = Simulator(folder_of("servo_24v"), "ckf")
    names = folder_of("servo_24v").module.GAIN_NAMES
    delayed = dict(zip(names, simulator._gain(Conditions(delay=1)), strict=True))["advance"]
    assert delayed == pytest.approx(3 * dict(zip(names, simulator._gain(Conditions()), strict=True))["advance"])


def test_no_file_outside_is_needed() -> None:
    """A file of one's own: of headers it asks the compiler's and the simulator's alone."""
    for part in PARTS:
        text = sfunction_text(folder_of("ipmsm"), "ickf", part, "block") + plecs_text(
            folder_of("ipmsm"), "ickf", part, "b.h"
        )
        asked = {line.split('"')[1] for line in text.splitlines() if line.startswith('#include "')}
        assert asked == {"simstruc.h", "simulink.c", "cg_sfun.h"}
        assert str(Path.home()) not in text
