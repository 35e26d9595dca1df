"""Controller and motor in lanes: the bits of the scalar forms in every lane, faults included, and vector loops."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import cffi
import numpy as np
import pytest

from codegen.render.lanes import LANES
from model.schema import Drive
from runtime.drive.interface import controller_declarations
from runtime.drive.motor import true_motor
from runtime.estimator.c_backend import c_sources
from runtime.estimator.compiler import build_library
from runtime.estimator.folder import GENERATED, GeneratedFolder, find_folder
from runtime.estimator.lanes import OPTIMISATION
from tests.conftest import thoroughly

DRIVER = Path(__file__).with_name("lane_forms.c")
KINDS = ("ckf", "ickf")
STEPS = 60


def _build(folder: GeneratedFolder, kind: str, change: tuple[str, str] | None = None) -> tuple[Any, Any, str]:
    """The driver around both forms; ``change`` replaces a text of the lane forms, which no optimisation makes right."""
    prefix, sources = c_sources(folder, kind, "float32")
    foc, plant = f"{prefix}_foc", f"{folder.drive}_plant"
    sources |= {f"{foc}{end}": folder.text(f"{foc}{end}") for end in (".h", ".c")}
    lane_forms = (f"{prefix}_lanes", f"{foc}_lanes", f"{plant}_lanes")
    for name in (plant, *lane_forms):
        sources |= {f"{name}{end}": folder.text(f"host/{name}{end}") for end in (".h", ".c")}
    if change:
        names = [f"{name}.c" for name in lane_forms if change[0] in sources[f"{name}.c"]]
        assert names, f"no '{change[0]}' to change"
        sources |= {name: sources[name].replace(*change) for name in names}
    defines = {"FOC": foc, "PLANT": plant, "COVARIANCE": folder.module.COVARIANCE, "HEADER_PLANT": f'"{plant}.h"'}
    defines |= {"HEADER_FOC_LANES": f'"{foc}_lanes.h"', "HEADER_PLANT_LANES": f'"{plant}_lanes.h"'}
    ffi = cffi.FFI()
    ffi.cdef(
        controller_declarations(sources, prefix, foc)
        + f"""
        int lane_count(void);
        void init_drives({foc}_t *drives, int delay);
        int compare_controllers({foc}_t *drives, int steps, const float *phase, const float *command,
                                const float *sensed, int *seen);
        int compare_motors(const double *motor, const double *theta, const double *load, const double *v, int steps,
                           int n);
        """
    )
    optimisation = ("-O0",) if change else OPTIMISATION
    library = build_library({**sources, "driver.c": DRIVER.read_text()}, defines, optimisation)
    return ffi, ffi.dlopen(str(library)), foc


def _differences(folder: GeneratedFolder, kind: str, change: tuple[str, str] | None = None) -> tuple[int, int]:
    """Words that differ over inputs with faults in some lanes, and the statuses met."""
    ffi, library, foc = _build(folder, kind, change)
    rng = np.random.default_rng(3)
    phase = rng.normal(0, 2, (STEPS, 2, LANES))
    command = np.stack([rng.uniform(-100, 100, (STEPS, LANES)), rng.uniform(0, 400, (STEPS, LANES))], axis=1)
    sensed = np.stack([rng.uniform(-100, 100, (STEPS, LANES)), rng.uniform(-3, 3, (STEPS, LANES))], axis=1)
    for bad in (np.nan, np.inf, -np.inf, 1e9):
        for array in (phase, command, sensed):
            for _ in range(5):
                array[rng.integers(STEPS), rng.integers(2), rng.integers(LANES)] = bad
    inputs = [np.ascontiguousarray(array, dtype=np.float32) for array in (phase, command, sensed)]
    found, seen = 0, ffi.new("int *")
    for delay in (0, 1):
        drives = ffi.new(f"{foc}_t[]", LANES)
        library.init_drives(drives, delay)
        for lane in range(LANES):
            drives[lane].sensored = lane % 3 == 0
            drives[lane].gain[6] = 0.01 * (lane % 4)  # dead-time compensation
            drives[lane].filter.Q[2] = 1e-4 * (lane + 1)
        pointers = [ffi.cast("float *", array.ctypes.data) for array in inputs]
        found += library.compare_controllers(drives, STEPS, *pointers, seen)
    return found, seen[0]


@pytest.mark.parametrize("kind", KINDS)
def test_every_lane_of_the_controller_has_the_scalar_bits(drive: Drive, kind: str) -> None:
    found, seen = _differences(find_folder(drive.name), kind)
    assert found == 0
    assert seen & 0x5 == 0x5, "inputs and commands to reject are among them"


@pytest.mark.parametrize(
    "change",
    [
        ("(delayed != 0) ? queued : now", "now"),
        ("(good != 0) ? 0 : PMSM_COMMAND_REJECTED", "0"),
        ("#define L_D 0.000835f", "#define L_D 0.00083500007f"),  # its last bit
        *thoroughly(
            (("take(i, believed, rejected, 2);", ""),),
            (("(speed_good != 0) ? command[0].of[lane] : speed_held", "command[0].of[lane]"),),
            (("(sensed != 0) ? c->sensed[1].of[lane] : theta", "theta"),),
            (("c->integrator[k] = integrator[k];", ""),),
        ),
    ],
)
def test_a_wrong_lane_form_of_the_controller_is_caught(change: tuple[str, str]) -> None:
    assert _differences(find_folder("spmsm_load_torque"), "ckf", change)[0] > 0


def _motor_differences(drive: str, n: int, change: tuple[str, str] | None = None) -> int:
    folder = find_folder(drive)
    ffi, library, _ = _build(folder, "ckf", change)
    rng = np.random.default_rng(4)
    L = rng.uniform(0.8, 1.2, LANES)
    factors = {name: rng.uniform(0.8, 1.2, LANES) for name in ("R", "psi_m", "J")} | {"L_d": L, "L_q": L}
    arrays = [true_motor(folder, factors), rng.uniform(-3, 3, LANES), rng.uniform(0, 5, LANES)]
    arrays.append(rng.normal(0, 50, (200, 2, LANES)))
    pointers = [ffi.cast("double *", np.ascontiguousarray(array).ctypes.data) for array in arrays]
    return int(library.compare_motors(*pointers, 200, n))


@pytest.mark.parametrize("n", [1, 2, 7, 8])
def test_every_lane_of_the_motor_has_the_scalar_bits(drive: Drive, n: int) -> None:
    """An even and an odd number of Runge-Kutta steps a sample; motors, angles, loads and voltages that differ."""
    assert _motor_differences(drive.name, n) == 0


@pytest.mark.parametrize(
    "change",
    [
        ("slope4_theta = 4.0 * omega_at4", "slope4_theta = 4.0000000000000009 * omega_at4"),
        ("rotor_phasor(&s[3], &s[4]);", ""),
        ("s[k] = other[k];", ""),
    ],
)
def test_a_wrong_lane_form_of_the_motor_is_caught(change: tuple[str, str]) -> None:
    assert _motor_differences("spmsm_load_torque", 7, change) > 0


@pytest.mark.parametrize("part", ["ckf_foc", "ickf_foc", "plant"])
def test_every_lane_loop_becomes_vector_instructions(drive: Drive, part: str, tmp_path: Path) -> None:
    """GCC says which loops it vectorised; each outermost one is among them, or is a mere copy."""
    if "clang" in subprocess.run(["gcc", "--version"], capture_output=True, text=True).stdout:
        pytest.skip("not run: this gcc is clang, which reports otherwise")
    folder = GENERATED / drive.name
    source = folder / "host" / f"{drive.name}_{part}_lanes.c"
    flags = [
        *OPTIMISATION,
        "-ffp-contract=off",
        "-fopt-info-optimized",
        f"-I{folder}",
        "-c",
        "-o",
        str(tmp_path / "x.o"),
    ]
    done = subprocess.run(["gcc", *flags, str(source)], capture_output=True, text=True, check=True)
    good = [line for line in done.stderr.splitlines() if "loop vectorized" in line or "library calls" in line]
    vectorised = {int(line.split(":")[1]) for line in good}
    lines = source.read_text().splitlines()
    loops = {k for k, line in enumerate(lines, 1) if line == "    for (lane = 0; lane < LANES; lane++) {"}
    assert len(loops) >= 4
    assert loops <= vectorised, [lines[k] for k in loops - vectorised]
