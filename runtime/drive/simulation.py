"""Closed-loop simulation: the generated controller drives the generated motor through an inverter model."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.rating import sensor_noise
from runtime.drive.interface import open_simulator, simulator_sources
from runtime.drive.motor import inverter_of, longest_step, true_motor
from runtime.drive.scenario import LATE, Scenario
from runtime.estimator.c_backend import c_sources
from runtime.estimator.compiler import build_library
from runtime.estimator.deviation import angle_deviation
from runtime.estimator.folder import GeneratedFolder
from runtime.recorded.data import write_recorded
from runtime.recorded.truth import AgainstTruth
from runtime.recorded.units import RPM
from runtime.system.errors import UserError
from runtime.system.values import read_word

Array = NDArray[Any]
Progress = Callable[[float], None]

INVERTERS = ("averaged", "pwm")

#: Full scale of a current converter over the drive's largest current.
RANGE_SHARE = 2.5
#: Degrees electrical: an estimate further off lost the rotor.
LOCKED_ANGLE = 30.0
#: The verdict of a good run.
LOCKED = "locked"
#: Bits of the status, by their names in the generated module.
STATUS_BITS = (
    *("INPUT_REJECTED", "NOT_CONVERGED", "COMMAND_REJECTED", "COVARIANCE_REPAIRED", "DIVERGED", "RESTARTED"),
    "UNOBSERVABLE",
)


@dataclass(frozen=True)
class Conditions:
    """Inverter and sensors. Times in s, currents in A; ``theta`` is the rotor's electrical angle at the start, rad.

    ``supervised``: the drive with its supervisor, from power-up, which may start at any angle; None: where ``theta`` is
    not 0. Else the controller alone, which starts at once where the drive file says.

    ``noise`` and ``range``: None for what suits the drive (:func:`model.rating.sensor_noise`; 2.5 times its current).
    """

    inverter: str = "averaged"  # averaged | pwm
    dead_time: float | None = None  # None: as the drive file has it
    delay: int = 0
    noise: float | None = None  # rms of each of the two current sensors
    offset: tuple[float, float] = (0.0, 0.0)
    bits: int = 0  # 0: no quantisation
    range: float | None = None  # full scale of the converter
    compensate: bool = True  # the controller knows the dead time
    sensored: bool = False
    theta: float = 0.0
    seed: int = 1
    factors: Mapping[str, float] = field(default_factory=dict)  # on the true motor: R, L_d, L_q, psi_m, J
    switch_drop: float | None = None  # V; None: as the drive file has it
    min_pulse: float = 0.0  # s, pwm alone
    supervised: bool | None = None

    @property
    def from_power_up(self) -> bool:
        """The supervisor is in charge."""
        return (self.theta != 0.0 and not self.sensored) if self.supervised is None else self.supervised

    def __post_init__(self) -> None:
        for name in ("dead_time", "noise", "range", "theta"):
            value = getattr(self, name)
            if value is not None and not math.isfinite(value):
                raise UserError(f"--{name.replace('_', '-')} {value} is not a finite number.")
        if not all(math.isfinite(value) for value in self.offset):
            raise UserError(f"--offset {self.offset[0]} is not a finite number.")


@dataclass(frozen=True)
class Run(AgainstTruth):
    """A run in the recorded-data format, with the estimate beside the truth. Arrays of N samples.

    t s; u (N, 2) V; i (N, 2) A as measured; omega, theta, load_torque, torque: truth, theta unwrapped;
    x (N, n) the estimate; angle_sigma (N,) degrees, what its P says of the angle; duty (N, 3); status (N,).
    """

    scenario: Scenario
    kind: str
    state_names: tuple[str, ...]
    t: Array
    u: Array
    i: Array
    omega: Array
    theta: Array
    load_torque: Array
    torque: Array
    x: Array
    angle_sigma: Array
    duty: Array
    status: Array
    bits: Mapping[str, int] = field(default_factory=dict)

    @property
    def late(self) -> Array:
        """The samples at the end in which a run is judged, (N,) of bool."""
        return np.asarray(self.t >= self.t[-1] - LATE)

    @property
    def locked(self) -> bool:
        """Every estimate a number, and over the last 50 ms its angle within 30 degrees electrical of the rotor's."""
        finite = bool(np.all(np.isfinite(self.x)) and np.all(np.isfinite(self.omega)))
        return finite and bool(np.max(np.abs(self.angle_error[self.late])) <= LOCKED_ANGLE)

    @property
    def reached(self) -> bool:
        """Over the last 50 ms the rotor's speed is within its band of the reference: a tenth of it."""
        apart = np.abs(self.omega[self.late] * RPM - self.scenario.speed)
        return bool(np.max(apart) <= self.scenario.band())  # NaN is not

    @property
    def honest(self) -> float:
        """Share of the samples in which the angle is within three deviations of P; every sample counts."""
        return float(np.mean(np.abs(self.angle_error) <= 3 * self.angle_sigma))  # NaN is not

    @property
    def good(self) -> bool:
        """Locked, and where it was to go."""
        return self.locked and self.reached

    @property
    def verdict(self) -> str:
        """What became of the run, in a word or two; the filter is not blamed for what motor or voltage cannot do."""
        if not np.all(np.isfinite(self.omega)):
            return "SIMULATED MOTOR FAILED"
        if not self.locked:
            return "LOST LOCK"
        return LOCKED if self.reached else "REFERENCE NOT REACHED"

    @property
    def status_counts(self) -> dict[str, int]:
        """In how many samples each bit of the status was set; bits that never were are left out."""
        counts = {name: int(np.count_nonzero(self.status & bit)) for name, bit in self.bits.items()}
        return {name: count for name, count in counts.items() if count}

    def figures(self) -> dict[str, float]:
        """Return the run's figures.

        Largest speed error before and after the load step (r/min), rms over the last 50 ms, largest angle error
        after the start (degrees electrical).
        """
        start = self.t < min(self.scenario.load_at, self.scenario.duration)
        late, moving = self.late, self.t >= min(self.scenario.started, self.t[-1])
        error = self.speed_error
        after = ~start if self.scenario.load else late
        return {
            "start": float(np.max(np.abs(error[start]))),
            "load_step": float(np.max(np.abs(error[after]))),
            "steady_rms": float(np.sqrt(np.mean(error[late] ** 2))),
            "angle": float(np.max(np.abs(self.angle_error[moving]))),
        }

    def columns(self) -> dict[str, Array]:
        """The recorded-data format."""
        columns = {"t": self.t, "u_alpha": self.u[:, 0], "u_beta": self.u[:, 1]}
        columns |= {"i_alpha": self.i[:, 0], "i_beta": self.i[:, 1]}
        return columns | {"omega": self.omega, "theta": self.theta, "load_torque": self.load_torque}

    def save(self, path: Path) -> None:
        """Write .npz or .csv (with a header), by the path's suffix."""
        write_recorded(path, self.columns())


class Simulator:
    """One drive's compiled simulation; make it once, run it often."""

    def __init__(self, folder: GeneratedFolder, kind: str) -> None:
        folder.require(kind)
        self.folder, self.kind = folder, kind
        self.module = folder.module
        self._prefix, sources = c_sources(folder, kind, "float32")
        foc, plant = f"{self._prefix}_foc", f"{folder.drive}_plant"
        supervisor, drive = f"{self._prefix}_supervisor", f"{self._prefix}_drive"
        for name, place in ((foc, ""), (supervisor, ""), (drive, ""), (plant, "host/")):
            sources |= {f"{name}{end}": folder.text(f"{place}{name}{end}") for end in (".h", ".c")}
        parts = {"PLANT": plant, "FOC": foc, "DRIVE": drive}
        defines = parts | {f"HEADER_{part}": f'"{name}.h"' for part, name in parts.items()}
        library = build_library({**sources, **simulator_sources()}, defines, ("-O2",))
        self._foc = foc
        self._ffi, self._library = open_simulator(library, sources, self._prefix, foc)

    def run(
        self,
        scenario: Scenario,
        conditions: Conditions | None = None,
        controller: str = "c",
        tuning: dict[str, tuple[float, ...]] | None = None,
        progress: Progress = lambda share: None,
        noise: Array | None = None,
    ) -> Run:
        """Simulate a scenario.

        Parameters
        ----------
        scenario : Scenario
        conditions : Conditions, optional
        controller : {"c", "numpy"}
            The generated C, or its NumPy twin: the same bits.
        tuning : dict, optional
            Replaces Q, R, x_0 or P_0 of the drive file, as one would on the running firmware.
        progress : callable
            Called with the share done, 0 to 1.
        noise : (N, 2) array, optional
            Sensor noise in A in place of what ``conditions`` would draw: a fleet's run again, say.
        """
        conditions = conditions or Conditions()
        read_word(conditions.inverter, "inverter", INVERTERS)
        T = self.module.SAMPLE_TIME
        steps = round(scenario.duration / T)
        t = T * np.arange(steps)
        if noise is None:
            rng = np.random.default_rng(conditions.seed)
            sigma = sensor_noise(self.module.DEFAULTS["R"]) if conditions.noise is None else conditions.noise
            noise = rng.normal(0.0, sigma, (steps, 2)) if sigma else np.zeros((steps, 2))
        inputs = Inputs(
            noise=np.ascontiguousarray(noise, dtype=float),
            speed=scenario.speed_reference(t),
            load=scenario.load_torque(t),
        )
        machine = self._machine(conditions)
        loops = {"c": self._run_c, "numpy": self._run_numpy}
        loop = loops[read_word(controller, "controller", loops)]
        gain = self._gain(conditions)
        rows, x, words, duty, status = loop(machine, conditions, gain, tuning or {}, inputs, progress)
        i = np.column_stack([rows[:, 0], (rows[:, 0] + 2 * rows[:, 1]) / np.sqrt(3)])
        names = self.module.STATES
        truth = (rows[:, 4], rows[:, 5], inputs.load, rows[:, 6])
        bits = {name: getattr(self.module, name) for name in STATUS_BITS if hasattr(self.module, name)}
        found = (x, np.degrees(angle_deviation(self.module, words)), duty, status)
        return Run(scenario, self.kind, names, t, rows[:, 2:4], i, *truth, *found, bits=bits)

    def _machine(self, conditions: Conditions) -> Any:
        """A fresh simulator struct: the motor at rest."""
        m = self._ffi.new("simulator *")
        parameters = self.folder.manifest["parameters"]
        m.motor[0:6] = true_motor(self.folder, conditions.factors).tolist()
        getattr(self._library, f"{self.folder.drive}_plant_rest")(m.motor, conditions.theta, m.s)
        m.duty_next[0:3] = [0.5, 0.5, 0.5]
        m.T = self.module.SAMPLE_TIME
        m.v_dc = parameters["control"]["dc_link"]
        m.dead_time, m.drop = inverter_of(parameters, conditions.dead_time, conditions.switch_drop)
        m.min_pulse = conditions.min_pulse
        m.offset[0:2] = list(conditions.offset)
        m.range = conditions.range or RANGE_SHARE * parameters["control"]["max_current"]
        m.step = 2 * m.range / 2**conditions.bits if conditions.bits else 0.0
        m.h_max = longest_step(self.folder)
        m.delay = conditions.delay
        m.switching = INVERTERS.index(conditions.inverter)
        m.pole_pairs, m.open = parameters["motor"]["pole_pairs"], int(conditions.from_power_up)
        return m

    def _gain(self, conditions: Conditions) -> tuple[float, ...]:
        """The controller's data for these conditions."""
        names = self.module.GAIN_NAMES
        gain = dict(zip(names, self.module.GAIN, strict=True))
        if conditions.delay:
            gain["advance"] = self.module.ADVANCE_DELAYED
        if "compensation" in gain:  # the model has what the inverter takes
            gain["compensation"] *= conditions.compensate
        elif conditions.compensate:
            gain["dead_share"] = (conditions.dead_time or 0.0) / self.module.SAMPLE_TIME
        return tuple(gain[name] for name in names)

    def _run_c(
        self,
        machine: Any,
        conditions: Conditions,
        gain: tuple[float, ...],
        tuning: dict[str, tuple[float, ...]],
        inputs: Inputs,
        progress: Progress,
    ) -> tuple[Array, ...]:
        """Software in the loop: the generated C, a tenth of a second of drive time at a call."""
        drive = self._ffi.new("char[]", self._library.simulator_drive_size())
        controller = self._library.simulator_switch_on(drive, conditions.delay)
        supervised = drive if conditions.from_power_up else self._ffi.NULL
        controller.sensored = int(conditions.sensored)
        controller.gain[0 : len(gain)] = list(gain)
        for name, values in tuning.items():
            getattr(controller.filter, name)[0 : len(values)] = list(values)
        getattr(self._library, f"{self._prefix}_reset")(self._ffi.addressof(controller, "filter"))
        covariance = getattr(controller.filter, self.module.COVARIANCE)
        steps, n = len(inputs.speed), len(self.module.STATES)
        rows, x, words, duty, status = _columns(steps, self.module)
        chunk = max(1, round(0.1 / machine.T))
        for first in range(0, steps, chunk):
            part = slice(first, min(first + chunk, steps))
            arrays = [
                inputs.noise[part],
                inputs.speed[part],
                inputs.load[part],
                rows[part],
                x[part],
                words[part],
                duty[part],
                status[part],
            ]
            types = ["double *"] * 4 + ["float *"] * 3 + ["int *"]
            pointers = [self._ffi.cast(c, a.ctypes.data) for c, a in zip(types, arrays, strict=True)]
            given, found = pointers[:5], pointers[5:]
            self._library.simulator_run(
                machine, controller, supervised, part.stop - first, n, *given, covariance, words.shape[1], *found
            )
            progress(part.stop / steps)
        return rows, x, words, duty, status

    def _run_numpy(
        self,
        machine: Any,
        conditions: Conditions,
        gain: tuple[float, ...],
        tuning: dict[str, tuple[float, ...]],
        inputs: Inputs,
        progress: Progress,
    ) -> tuple[Array, ...]:
        """The NumPy twin in the same loop, around the same motor, inverter and sensors."""
        module, ffi, library = self.module, self._ffi, self._library
        math = module.MATH["float32"]
        drive = module.new_drive(np.float32, conditions.delay)
        controller = drive.control = numpy_controller(module, tuning, gain, conditions)
        steps = len(inputs.speed)
        rows, x, words, duty, status = _columns(steps, module)
        phase, i, torque = ffi.new("float[2]"), ffi.new("double[2]"), ffi.new("double[1]")
        outputs = getattr(library, f"{self.folder.drive}_plant_outputs")
        for k in range(steps):
            library.simulator_sense(machine, [float(v) for v in inputs.noise[k]], phase)
            outputs(machine.s, machine.motor, i, torque)
            rows[k] = (phase[0], phase[1], *controller.v_acting, machine.s[2], machine.s[3], torque[0])
            turned = float(np.remainder(machine.s[3] + np.pi, 2 * np.pi) - np.pi)
            controller.sensed = (np.float32(machine.s[2]), np.float32(turned))
            measured = (np.float32(phase[0]), np.float32(phase[1]))
            command = (np.float32(inputs.speed[k]), np.float32(machine.v_dc))
            gates = 1
            if conditions.from_power_up:
                duties, gates = module.drive_step(drive, module.STEPS[self.kind], measured, command, math)
                status[k] = drive.status
            else:
                duties, status[k] = module.foc_step(controller, module.STEPS[self.kind], measured, command, math)
            x[k], words[k], duty[k] = controller.filter.x, getattr(controller.filter, module.COVARIANCE), duties
            if gates:
                machine.open = 0
                library.simulator_actuate(machine, [float(d) for d in duties], inputs.load[k])
            else:
                machine.duty_next[0:3] = [float(d) for d in duties]
                library.simulator_freewheel(machine, inputs.load[k])
            if k % 1000 == 999:
                progress((k + 1) / steps)
        return rows, x, words, duty, status


def _columns(steps: int, module: Any) -> tuple[Array, ...]:
    """Room for what a loop writes a sample: true motor, estimate, covariance words, duty cycles, status."""
    rows, status = np.empty((steps, 7)), np.empty(steps, dtype=np.int32)
    sizes = (len(module.STATES), module.WORDS, 3)
    x, words, duty = (np.empty((steps, size), dtype=np.float32) for size in sizes)
    return rows, x, words, duty, status


@dataclass(frozen=True)
class Inputs:
    """Inputs of a run, one row a sample: sensor noise (N, 2) A, speed reference rad/s, load N m."""

    noise: Array
    speed: Array
    load: Array


def numpy_controller(module: Any, tuned: dict[str, Any], gain: tuple[float, ...], conditions: Conditions) -> Any:
    """The controller's state for the NumPy twin, as ``_foc_init`` leaves it, some of the tuning replaced."""
    return module.new_controller(np.float32, gain, conditions.sensored, conditions.delay, **tuned)
