"""Shipped drives with ``[inverter]`` on recordings of another simulator's switching inverter (motulator, tests/data):
2 us of dead time in 100 us that nobody makes up for, the voltage as commanded, currents of 12 bits with 0.05 A of noise.

``python -m tests.runtime.test_recordings_pwm`` prints the table of docs/inverter.md.
"""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from codegen.generate import generate_bare
from codegen.output.folder import write_folder
from model.drives.load import load_drive
from model.inverter import lost_voltage
from model.machines.lost_voltage import LostVoltage
from model.schema import Drive, Inverter, Tolerance
from runtime import load
from runtime.estimator.estimator import Estimator
from runtime.recorded.truth import Errors, errors
from tests.conftest import variant
from tests.runtime.test_recordings import recording

KNOWN, LEARNT, WITHOUT, HALF = "known", "learnt", "without", "half of it"
DEAD_TIME = {KNOWN: 2e-6, LEARNT: 2e-6, HALF: 1e-6}
NOISE, BITS, FULL_SCALE = 0.05, 12, 2.5  # A rms on phases a and b; the converter's range by max_current
DRAWS = range(1, 17)
FIGURES = ("speed_start", "speed_steady_rms", "speed_load_step", "position_max")


def behind(name: str, case: str) -> Drive:
    """A shipped drive, told of the inverter as ``case`` says; what is learnt of the motor within a tolerance."""
    drive = load_drive(name)
    drive = variant(drive, filter={"kinds": ["ckf"]})
    if case in DEAD_TIME:
        drive = drive.model_copy(update={"inverter": Inverter(dead_time=DEAD_TIME[case])})
    if drive.model.adaptive:
        drive = drive.model_copy(update={"tolerance": Tolerance(stator_resistance=0.2, magnet_flux=0.1)})
    if case != LEARNT:
        return drive
    f, slow = drive.filter, "dead_time_voltage"
    tuning = {"initial_covariance": [*f.initial_covariance, 1.0], "process_noise": [*f.process_noise, 1e-6]}
    tuning |= {"root_order": [*f.root_order, slow]} if f.root_order else {}
    return variant(drive, model={"adaptive": [*drive.model.adaptive, slow]}, filter=tuning)


def made(drive: Drive) -> Estimator:
    """The drive's float32 C, generated and compiled."""
    with tempfile.TemporaryDirectory() as folder:
        write_folder(Path(folder) / drive.name, generate_bare(drive).files)
        return load(Path(folder) / drive.name, filter="ckf", backend="c", dtype="float32")


@cache
def estimator(name: str, case: str) -> Estimator:
    return made(behind(name, case))


def sensed(data: dict[str, np.ndarray], largest: float, seed: int) -> np.ndarray:
    """What two current sensors and a converter of 12 bits over +-2.5 ``largest`` A make of a recording, (N, 2) A."""
    alpha, beta = data["i_alpha"].astype(float), data["i_beta"].astype(float)
    phases = np.column_stack([alpha, (np.sqrt(3) * beta - alpha) / 2])
    phases += NOISE * np.random.default_rng(seed).normal(size=phases.shape)
    step = 2 * FULL_SCALE * largest / 2**BITS
    a, b = (np.round(phases / step) * step).T
    return np.column_stack([a, (a + 2 * b) / np.sqrt(3)])


def replayed(f: Estimator, drive: Drive, seed: int) -> Errors:
    """Errors over a recording of the drive's motor, by the rules of ``replay``."""
    data = recording(f"{drive.name.partition('_')[0].removeprefix('paper_')}_pwm.npz")
    f.reset()
    y = sensed(data, drive.control.max_current, seed)
    x = f.run(np.column_stack([data["u_alpha"], data["u_beta"]]), y).x
    found = errors(data["t"], x, f.state_names, {c: data[c].astype(float) for c in ("omega", "theta", "load_torque")})
    assert found is not None
    return found


def worst(f: Estimator, drive: Drive, draws: Any = DRAWS) -> tuple[dict[str, float], int]:
    """The largest of each figure over draws of the sensors' noise, and in how many the rotor was lost."""
    runs = [replayed(f, drive, seed) for seed in draws]
    return {name: max(getattr(run, name) for run in runs) for name in FIGURES}, sum(run.lost for run in runs)


def table() -> str:
    """Every drive told and not told, Markdown."""
    lines = ["| drive | V_d | start | steady | load | angle | lost |", "|---|---|---|---|---|---|---|"]
    for name, case in [(name, case) for name in CASES for case in CASES[name]]:
        found, lost = worst(estimator(name, case), behind(name, case))
        figures = " | ".join(f"{found[figure]:.3g}" for figure in FIGURES)
        lines.append(f"| `{name}` | {case} | {figures} | {lost} of {len(DRAWS)} |")
    return "\n".join(lines)


CASES = {
    "spmsm_load_torque": (KNOWN, LEARNT, HALF, WITHOUT),
    "spmsm_adaptive": (KNOWN, LEARNT, WITHOUT),
    "ipmsm": (KNOWN, WITHOUT),
    "ipmsm_flux": (KNOWN, WITHOUT),
    "ipmsm_adaptive": (KNOWN, WITHOUT),
}

if __name__ == "__main__":
    print(table())
