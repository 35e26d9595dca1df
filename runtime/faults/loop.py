"""The generated example interrupt in the closed loop: compiled, given a fault, and run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.rating import sensor_noise
from runtime.drive.interface import controller_declarations, simulator_sources, simulator_struct
from runtime.drive.motor import inverter_of, longest_step, true_motor
from runtime.drive.scenario import Scenario
from runtime.estimator.c_backend import c_sources
from runtime.estimator.compiler import build_library, open_library
from runtime.estimator.folder import GeneratedFolder
from runtime.recorded.truth import AgainstTruth
from runtime.system.errors import UserError

Array = NDArray[Any]

LOOP = Path(__file__).with_name("loop.c")

#: Bits of a fault's ``what``, as in loop.c.
REPLACE_A, REPLACE_B, HOLD_A, HOLD_B, CLIP, POWER_OFF, SWAP, OPEN_A, STALL = 1, 2, 4, 8, 16, 32, 64, 128, 256

#: One sample of a fault, as loop.c reads it.
FAULT = np.dtype(
    [
        ("what", np.int32),
        ("reserved", np.int32),
        ("phase", np.float32, 2),
        ("gain", float, 2),
        ("offset", float, 2),
        ("range", float),
        ("link", float),
        ("told", float),
        ("load", float),
    ]
)


@dataclass(frozen=True)
class FaultyRun(AgainstTruth):
    """A run with a fault; arrays of N samples.

    t s; omega rad/s, theta rad unwrapped, torque N m, current A (amplitude): the motor's; phase (N, 2) A as read;
    told V; x (N, n) the estimate; duty (N, 3); status, mode, reason (N,): the interrupt's; ``running`` (N,): mode
    RUNNING. Samples ``first`` <= k < ``after`` are the fault's; ``powered`` (N,) whether the processor was on;
    ``band`` r/min: an estimate of the speed no further off is right. ``gave_up``: the reason, where it ended in FAULT.
    ``diodes`` rad/s: from this speed on the back-EMF between two phases is more than the DC link, and current flows
    through the diodes of an inverter that is off.
    """

    kind: str
    first: int
    after: int
    t: Array
    reference: Array
    omega: Array
    theta: Array
    torque: Array
    current: Array
    told: Array
    phase: Array
    x: Array
    duty: Array
    status: Array
    mode: Array
    reason: Array
    running: Array
    powered: Array
    band: float
    gave_up: str = ""
    diodes: float = math.inf


@dataclass(frozen=True)
class FoundMotor:
    """The true motor at power-up: electrical ``angle`` rad, ``speed`` rad/s, and its data as factors on the drive's."""

    angle: float = 0.0
    speed: float = 0.0
    factors: Mapping[str, float] = field(default_factory=dict)


#: At rest, at angle 0, and as the drive file says.
AS_STATED = FoundMotor()


class FaultyLoop:
    """One drive's compiled loop; make it once, run it often. It has one board: runs follow one another."""

    def __init__(self, folder: GeneratedFolder, kind: str) -> None:
        folder.require(kind)
        self.folder, self.kind, self.module = folder, kind, folder.module
        prefix, sources = c_sources(folder, kind, "float32")
        foc, plant = f"{prefix}_foc", f"{folder.drive}_plant"
        own = [f"{prefix}_{end}" for end in ("foc", "supervisor", "drive", "selftest", "foc_selftest")]
        for name, place in (*((name, "") for name in own), (plant, "host/")):
            sources |= {f"{name}{end}": folder.text(f"{place}{name}{end}") for end in (".h", ".c")}
        defines = {"PLANT": plant, "FOC": foc, "HEADER_PLANT": f'"{plant}.h"', "HEADER_FOC": f'"{foc}.h"'}
        handwritten = {"loop.c": LOOP.read_text(encoding="utf-8"), **simulator_sources("simulator.h")}
        handwritten |= {"example_isr.h": example_for(folder, kind)}
        library = build_library({**sources, **handwritten}, defines, ("-O2",))
        self._ffi, self._library = _open(library, controller_declarations(sources, prefix, foc), folder.drive)

    def run(
        self,
        scenario: Scenario,
        faults: Array,
        fault_at: float,
        noise: float | None = None,
        seed: int = 1,
        reacting: bool = True,
        motor: FoundMotor = AS_STATED,
    ) -> FaultyRun:
        """A scenario from power-up, with a fault.

        Parameters
        ----------
        scenario : Scenario
        faults : array of FAULT
            One row a sample, from ``fault_at`` (s) on; empty: none.
        noise : float
            A rms of each current sensor; None: what suits the drive.
        seed : int
            Of the noise.
        reacting : bool
            Whether there is an application that reacts to the status; else the generated controller is alone.
        motor : FoundMotor, optional
            How it stands or turns at power-up, and its data.
        """
        T, n = self.module.SAMPLE_TIME, len(self.module.STATES)
        steps = round(scenario.duration / T)
        t = T * np.arange(steps)
        first = round(fault_at / T)
        sigma = sensor_noise(self.module.DEFAULTS["R"]) if noise is None else noise
        rows: Array = np.ascontiguousarray(faults[: steps - first], dtype=FAULT)
        given: dict[str, Array] = {
            "noise": np.random.default_rng(seed).normal(0.0, sigma, (steps, 2)),
            "speed": scenario.speed_reference(t),
            "load": scenario.load_torque(t),
            "faults": rows,
        }
        found = {"out": np.empty((steps, 5)), "phase": np.empty((steps, 2), np.float32)}
        found |= {"x": np.empty((steps, n), np.float32), "duty": np.empty((steps, 3), np.float32)}
        found |= {name: np.empty(steps, np.int32) for name in ("status", "mode", "reason")}
        self._play(motor, given, found, first, reacting)
        truth = dict(zip(("omega", "theta", "torque", "current", "told"), found.pop("out").T, strict=True))
        after = first + len(rows)
        gave_up = found["mode"][-1] == self.module.FAULT
        return FaultyRun(
            self.kind,
            first,
            after,
            t,
            given["speed"],
            **truth,
            **found,
            running=found["mode"] == self.module.RUNNING,
            powered=_powered(steps, first, rows),
            band=scenario.least_band,
            gave_up=self.module.REASONS[found["reason"][-1]] if gave_up else "",
            diodes=_diode_speed(self.folder.manifest["parameters"]),
        )

    def _play(
        self, motor: FoundMotor, given: dict[str, Array], found: dict[str, Array], first: int, reacting: bool
    ) -> None:
        """Run the loop: arrays of what is ``given`` and what is ``found``, by their names in loop.c."""
        task = self._ffi.new("faulty_run *")
        task.reacting = int(reacting)
        task.steps, task.states = found["x"].shape
        task.fault_from, task.fault_count = first, len(given["faults"])
        for name, array in (given | found).items():
            setattr(task, name, self._ffi.cast("void *", array.ctypes.data))
        failed = self._library.faulty_loop(self._motor(motor), task)
        if failed:
            raise UserError(f"drive '{self.folder.drive}': the self-test says {failed}; regenerate, or see its header.")

    def _motor(self, found: FoundMotor) -> Any:
        """The motor without current, an averaged inverter, a sample of delay as the example interrupt has it."""
        m = self._ffi.new("simulator *")
        m.motor[0:6] = true_motor(self.folder, found.factors).tolist()
        getattr(self._library, f"{self.folder.drive}_plant_rest")(m.motor, found.angle, m.s)
        m.s[2] = found.speed
        m.duty_next[0:3] = [0.5, 0.5, 0.5]
        m.T = self.module.SAMPLE_TIME
        parameters = self.folder.manifest["parameters"]
        m.v_dc = parameters["control"]["dc_link"]
        m.dead_time, m.drop = inverter_of(parameters)
        m.h_max = longest_step(self.folder)
        m.delay, m.open = 1, 1
        m.pole_pairs = parameters["motor"]["pole_pairs"]
        return m


def example_for(folder: GeneratedFolder, kind: str) -> str:
    """The example interrupt around any of the folder's filters: it names the one it has by its prefix alone.

    Parameters
    ----------
    folder : GeneratedFolder
        The generated folder.
    kind : str
        Filter kind, such as "ickf".
    """
    text = folder.text("example_isr.c")
    own = next(name for name in folder.kinds if f'"{folder.drive}_{name}_selftest.h"' in text)
    old, new = f"{folder.drive}_{own}", f"{folder.drive}_{kind}"
    return text.replace(old, new).replace(old.upper(), new.upper())


def _open(library: Path, controller: str, drive: str) -> tuple[Any, Any]:
    """cffi's view of the loop; its structs are read from its own source."""
    import cffi

    ffi = cffi.FFI()
    text = LOOP.read_text(encoding="utf-8")
    text = text[text.index("/* The faults of one sample") : text.index("/* The board.")]
    structs = "\n".join(line.partition("/*")[0] for line in text.splitlines() if not line.startswith((" *", "/*")))
    ffi.cdef(
        controller
        + simulator_struct()
        + structs
        + f"""
        void {drive}_plant_rest(const double motor[6], double theta, double s[6]);
        int faulty_loop(simulator *m, const faulty_run *r);
        """
    )
    return ffi, open_library(ffi, library)


def _powered(steps: int, first: int, rows: Array) -> Array:
    """Whether the processor is on, sample by sample."""
    powered = np.ones(steps, dtype=bool)
    powered[first : first + len(rows)] = (rows["what"] & POWER_OFF) == 0
    return powered


def _diode_speed(parameters: Mapping[str, Any]) -> float:
    """The speed (rad/s) at which sqrt(3) p omega psi_m is the DC link."""
    motor = parameters["motor"]
    return float(parameters["control"]["dc_link"] / (math.sqrt(3.0) * motor["pole_pairs"] * motor["magnet_flux"]))
