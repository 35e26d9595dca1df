"""What the tests of exports share: a drive's folder, input for its filter, and the closed loop from its own sources."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

import runtime
from runtime.drive.interface import POWERED_MOTOR, simulator_struct
from runtime.drive.motor import inverter_of, longest_step, true_motor
from runtime.drive.simulation import RANGE_SHARE
from runtime.estimator.compiler import build_library, open_library
from runtime.estimator.folder import GENERATED, GeneratedFolder

HERE = Path(__file__).parent
STEPS = 10_000


def folder_of(name: str) -> GeneratedFolder:
    """The shipped folder of a drive."""
    return GeneratedFolder(GENERATED / name)


@lru_cache
def filter_run(name: str) -> tuple[Any, Any, Any]:
    """Inputs (N, 4) and what ``load(...).step`` in NumPy makes of them: estimates (N, n) and status (N,).

    Currents and voltages turn, with noise; some are no numbers, some beyond all limits.
    """
    f = runtime.load(name, dtype="float32")
    rng = np.random.default_rng(3)
    angle = np.cumsum(f.sample_time * np.linspace(0.0, 900.0, STEPS))
    turn = np.column_stack([np.cos(angle), np.sin(angle)])
    rows = np.hstack([0.3 * f.tuning["u_max"] * turn, 0.3 * f.tuning["y_max"] * turn])
    rows += rng.normal(0.0, 0.05, rows.shape) * np.abs(rows).max(axis=0)
    rows[5000:5003, 2] = np.nan
    rows[6000:6002, 0] = 1e30
    states, status = [], []
    for row in rows:
        states.append(np.array(f.step(row[:2], row[2:]), dtype=np.float32))
        status.append(int(f.status))
    return rows, np.array(states), np.array(status)


@lru_cache
def closed_loop(name: str, kind: str) -> tuple[Any, Any, Any]:
    """Speed reference and load torque (N,), and the rows of closed_loop.c."""
    import cffi

    folder = folder_of(name)
    prefix, plant = f"{name}_{kind}", f"{name}_plant"
    sources = {"pmsm_port.h": folder.text("pmsm_port.h"), POWERED_MOTOR.name: POWERED_MOTOR.read_text("utf-8")}
    for word, place in (*((f"{prefix}{end}", "") for end in ("", "_foc", "_supervisor", "_drive")), (plant, "host/")):
        sources |= {f"{word}{end}": folder.text(f"{place}{word}{end}") for end in (".h", ".c")}
    sources["closed_loop.c"] = (HERE / "closed_loop.c").read_text("utf-8")
    defines = {"DRIVE": f"{prefix}_drive", "HEADER_DRIVE": f'"{prefix}_drive.h"'}
    defines |= {"PLANT": plant, "HEADER_PLANT": f'"{plant}.h"'}
    ffi = cffi.FFI()
    ffi.cdef(
        simulator_struct()
        + f"void {plant}_rest(const double motor[6], double theta, double s[6]);"
        + "void closed_loop(simulator *, int, const double *, const double *, double, double *);"
    )
    library = open_library(ffi, build_library(sources, defines))
    stated = folder.manifest["parameters"]
    m = ffi.new("simulator *")
    m.motor[0:6] = true_motor(folder, {}).tolist()
    getattr(library, f"{plant}_rest")(m.motor, 0.0, m.s)
    m.duty_next[0:3] = [0.5, 0.5, 0.5]
    m.T, m.v_dc, m.h_max = folder.module.SAMPLE_TIME, stated["control"]["dc_link"], longest_step(folder)
    m.dead_time, m.drop = inverter_of(stated)
    m.range = RANGE_SHARE * stated["control"]["max_current"]
    m.pole_pairs = stated["motor"]["pole_pairs"]
    rated = stated["operating_box"]["speed"]
    t = folder.module.SAMPLE_TIME * np.arange(STEPS)
    speed = np.where(t > 0.5 * t[-1], -0.2, 0.3) * rated
    load = np.where(t > 0.3 * t[-1], 0.1, 0.0) * stated["control"]["max_current"] * stated["motor"]["magnet_flux"]
    out = np.zeros((STEPS, 11))
    numbers = [ffi.cast("double *", ffi.from_buffer(array)) for array in (speed, load, out)]
    library.closed_loop(m, STEPS, numbers[0], numbers[1], m.v_dc, numbers[2])
    return speed, load, out
