"""What cffi is told of simulator.c, and of the filter and controller that are compiled with it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from runtime.estimator.c_backend import declarations
from runtime.estimator.compiler import open_library

SIMULATOR = Path(__file__).with_name("simulator.c")
POWERED_MOTOR = Path(__file__).with_name("powered_motor.h")


def controller_declarations(sources: Mapping[str, str], prefix: str, foc: str) -> str:
    """Filter and controller as cffi wants them.

    Parameters
    ----------
    sources : mapping of str to str
        Texts by file name.
    prefix : str
        Beginning of the names.
    foc : str
    """
    filter_part = declarations(sources[f"{prefix}.h"], prefix, "float32").partition("void runner_run")[0]
    foc_part = declarations(sources[f"{foc}.h"], foc, "float32").partition("void runner_run")[0]
    return filter_part + foc_part.split(";", 1)[1]


def drive_declarations(sources: Mapping[str, str], prefix: str) -> str:
    """Supervisor and drive as cffi wants them, after filter and controller.

    Parameters
    ----------
    sources : mapping of str to str
        Texts by file name.
    prefix : str
        Beginning of the names.
    """
    names = (f"{prefix}_supervisor", f"{prefix}_drive")
    parts = (declarations(sources[f"{name}.h"], name, "float32").partition("void runner_run")[0] for name in names)
    return "".join(part.split(";", 1)[1] for part in parts)


def simulator_sources(name: str = "simulator.c") -> dict[str, str]:
    """The simulator's texts by file name.

    Parameters
    ----------
    name : str
        Of the loop; as a header it is included instead of compiled.
    """
    return {name: SIMULATOR.read_text(encoding="utf-8"), POWERED_MOTOR.name: POWERED_MOTOR.read_text(encoding="utf-8")}


def simulator_struct() -> str:
    """The simulator's struct as cffi wants it, from its own source."""
    source = POWERED_MOTOR.read_text(encoding="utf-8")
    struct = source[source.index("typedef struct") : source.index("} simulator;") + len("} simulator;")]
    return "\n".join(line.partition("/*")[0] for line in struct.splitlines())


def open_simulator(library: Path, sources: dict[str, str], prefix: str, foc: str) -> tuple[Any, Any]:
    """cffi's view of controller, plant outputs and simulator.

    Parameters
    ----------
    library : Path
        Compiled.
    sources : dict of str to str
        Texts by file name.
    prefix, foc : str
        Beginning of the filter's and of the controller's names.
    """
    import cffi

    ffi = cffi.FFI()
    plant = foc.removesuffix("_foc")
    drive = plant.rpartition("_")[0]
    ffi.cdef(
        controller_declarations(sources, prefix, foc)
        + simulator_struct()
        + f"""
        void {drive}_plant_rest(const double motor[6], double theta, double s[6]);
        void {drive}_plant_outputs(const double s[6], const double motor[6], double i[2], double torque[1]);
        void {drive}_plant_advance(double s[6], const double motor[6], const double v[2], double load, double h, int n);
        void simulator_sense(const simulator *m, const double noise[2], float phase[2]);
        void simulator_actuate(simulator *m, const float duty[3], double load);
        void simulator_freewheel(simulator *m, double load);
        int simulator_drive_size(void);
        {foc}_t *simulator_switch_on(void *drive, int delay);
        void simulator_run(simulator *m, {foc}_t *c, void *drive, int steps, int n, const double *noise,
                           const double *speed, const double *load, double *out, float *x,
                           const float *covariance, int words, float *words_out, float *duty_out, int *status);
        """
    )
    return ffi, open_library(ffi, library)
