"""Many closed loops at once: the generated controller and motor in lanes, figures worked out inside C.

>>> from runtime.estimator.folder import find_folder
>>> from runtime.drive.scenario import Scenario
>>> fleet = Fleet(find_folder("spmsm_load_torque"), "ckf")
>>> outcomes = fleet.run(Scenario("short", speed=1000.0, duration=0.1), Cases(seed=np.arange(3), theta=0.1))
>>> outcomes.locked.shape
(3,)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.alignment import aligns
from model.rating import sensor_noise
from runtime.drive.interface import controller_declarations, drive_declarations
from runtime.drive.motor import FACTORS, inverter_of, longest_step, true_motor
from runtime.drive.scenario import LATE, Scenario
from runtime.drive.simulation import LOCKED_ANGLE, Conditions, Run, Simulator
from runtime.estimator.compiler import build_library
from runtime.estimator.folder import GeneratedFolder
from runtime.estimator.lanes import OPTIMISATION
from runtime.estimator.threads import thread_count
from runtime.folders.stated import stated_drive
from runtime.recorded.units import RPM
from runtime.system.errors import UserError

Array = NDArray[Any]
#: Called with the number of runs done and of all.
Progress = Callable[[int, int], None]

HERE = Path(__file__).parent
HANDWRITTEN = ("fleet.c", "fleet_figures.h", "sensor_noise.h", "powered_motor.h")

#: Share of the speed wanted at which a rotor counts as turning the wrong way.
WRONG_WAY = 0.01
#: The tuning fields of a filter's struct.
TUNABLE = ("Q", "R", "x_0", "P_0")


@dataclass(frozen=True)
class Cases:
    """Parameters that differ from run to run: numbers, or arrays of one entry a run (B,).

    ``seed`` of the sensor noise, a whole number from 0 to 2^64 - 1; ``noise`` A rms of each current sensor; ``theta``
    the rotor's electrical angle at the start, rad; ``R``, ``L_d``, ``L_q``, ``psi_m``, ``J`` factors on the motor
    that turns, while filter and controller keep the drive file's; ``load`` N m and ``speed`` r/min in place of the
    scenario's; ``tuning`` Q, R, x_0 or P_0 of the filter, (entries,) or (entries, B).
    """

    seed: ArrayLike = 1
    noise: ArrayLike | None = None
    theta: ArrayLike = 0.0
    R: ArrayLike = 1.0
    L_d: ArrayLike = 1.0
    L_q: ArrayLike = 1.0
    psi_m: ArrayLike = 1.0
    J: ArrayLike = 1.0
    load: ArrayLike | None = None
    speed: ArrayLike | None = None
    tuning: Mapping[str, ArrayLike] = field(default_factory=dict)

    def columns(self, scenario: Scenario, noise: float) -> dict[str, Array]:
        """Every number of every run, (B,); speed in r/min.

        Parameters
        ----------
        scenario : Scenario
            Speed reference and load over time.
        noise : float
            A rms, where the cases state none.

        Raises
        ------
        UserError
            Lengths that differ, or a number out of range.
        """
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "tuning"}
        values["noise"] = noise if self.noise is None else self.noise
        values["load"] = scenario.load if self.load is None else self.load
        values["speed"] = scenario.speed if self.speed is None else self.speed
        lengths = {np.size(value) for value in values.values()} | {np.shape(v)[1] for v in self._tuned()}
        runs = max(lengths)
        if not lengths <= {1, runs}:
            raise UserError(f"cases of different lengths: {', '.join(str(n) for n in sorted(lengths - {1}))}.")
        columns = {
            name: np.broadcast_to(np.ravel(np.asarray(v, dtype=np.uint64 if name == "seed" else float)), runs)
            for name, v in values.items()
        }
        for name, column in columns.items():
            if not np.all(np.isfinite(column)) or (name == "noise" and np.any(column < 0)):
                raise UserError(f"cases: {name} holds a value that is not a number{' >= 0' * (name == 'noise')}.")
        return columns

    def _tuned(self) -> list[Array]:
        return [np.asarray(value) for value in self.tuning.values() if np.ndim(value) == 2]


@dataclass(frozen=True)
class Outcomes:
    """Figures of B runs, arrays (B,).

    ``start``, ``load_step``: largest speed error before and from the load step on (without a load: of the last 50 ms),
    r/min; ``steady_rms``: of the last 50 ms, r/min; ``angle``: largest electrical angle error after the start, degrees;
    ``angle_end``: the last one; ``lock_time``: from when on the angle stays within 30 degrees and the rotor does not
    turn the wrong way, s, NaN for never; ``locked``, ``reached``: as :class:`runtime.drive.simulation.Run` has them;
    ``status``: bits of all steps together; ``finite``: every estimate was a number. Figures of a run that is not finite
    are NaN. ``mode``: the supervisor's at the end, by its place in the module's ``MODES``, -1 without one; ``reason``:
    why it last gave up its rotor, by its place in ``REASONS``.
    """

    start: Array
    load_step: Array
    steady_rms: Array
    angle: Array
    angle_end: Array
    lock_time: Array
    locked: Array
    reached: Array
    status: Array
    finite: Array
    mode: Array
    reason: Array

    @property
    def good(self) -> Array:
        """Locked, and where they were to go, (B,) of bool."""
        return np.asarray(self.locked & self.reached)

    def columns(self) -> dict[str, Array]:
        """Every figure by name, one entry a run."""
        return {f.name: getattr(self, f.name) for f in fields(self)}


def fleet_files(folder: GeneratedFolder, kind: str, supervised: bool = False) -> list[str]:
    """The generated C that a fleet is compiled from, by name in the folder.

    Parameters
    ----------
    folder : GeneratedFolder
        The generated folder.
    kind : str
        Filter kind, such as "ickf".
    supervised : bool, optional
        With the modes around the controller.
    """
    folder.require(kind)
    prefix, plant = f"{folder.drive}_{kind}", f"{folder.drive}_plant"
    stems = [prefix, f"{prefix}_foc", *(f"host/{stem}_lanes" for stem in (prefix, f"{prefix}_foc", plant))]
    if supervised:
        if aligns(stated_drive(folder)):
            raise UserError(f"{folder.drive} starts by an alignment, which fleets of whole drives do not have.")
        stems += [f"{prefix}_supervisor", f"{prefix}_drive", f"host/{prefix}_drive_lanes", f"host/{plant}"]
    return ["pmsm_port.h", *(f"{stem}{end}" for stem in stems for end in (".h", ".c"))]


class Fleet:
    """One drive's closed loop with one filter, compiled in lanes; make it once, run it often.

    The inverter is the averaged one, without delay, offset or quantisation. ``supervised``: the whole drive from
    power-up, which may start at any angle; else the controller alone, from the angle that the drive file says.
    """

    def __init__(self, folder: GeneratedFolder, kind: str, supervised: bool = False) -> None:
        self.folder, self.kind, self.supervised = folder, kind, supervised
        sources = {Path(name).name: folder.text(name) for name in fleet_files(folder, kind, supervised)}
        prefix, plant = f"{folder.drive}_{kind}", f"{folder.drive}_plant"
        foc = f"{prefix}_foc"
        texts = {name: (HERE / name).read_text(encoding="utf-8") for name in HANDWRITTEN}
        defines = {"FILTER": prefix, "FOC": foc, "PLANT": plant}
        defines |= {"HEADER_FOC_LANES": f'"{foc}_lanes.h"', "HEADER_PLANT_LANES": f'"{plant}_lanes.h"'}
        declared = controller_declarations(sources, prefix, foc)
        if supervised:
            whole = f"{prefix}_drive"
            defines |= {"WHOLE": whole, "HEADER_WHOLE_LANES": f'"{whole}_lanes.h"', "HEADER_PLANT": f'"{plant}.h"'}
            declared += drive_declarations(sources, prefix)
        self._place = ("control", "filter") if supervised else ("filter",)
        self._drive = f"{prefix}_drive_t" if supervised else f"{foc}_t"
        library = build_library({**sources, **texts}, defines, OPTIMISATION)
        self._ffi, self._library = _open(library, declared, texts["fleet.c"], self._drive)
        self._group = int(self._library.fleet_lanes())
        self._simulator: Simulator | None = None

    def run(
        self,
        scenario: Scenario,
        cases: Cases,
        threads: int | None = None,
        progress: Progress = lambda done, of: None,
    ) -> Outcomes:
        """Run every case from standstill to the scenario's end.

        A run's outcome depends on its own case alone: not on the others, the number of threads or the machine.

        Parameters
        ----------
        scenario : Scenario
        cases : Cases
        threads : int, optional
            By default as many as :func:`runtime.estimator.threads.thread_count` says.
        progress : callable
            Called with runs done and all runs.

        Raises
        ------
        UserError
            Cases that do not fit together or this drive.
        """
        columns = cases.columns(scenario, sensor_noise(self.folder.module.DEFAULTS["R"]))
        runs = len(columns["seed"])
        share = self._share_of_speed(scenario)
        task = self._task(scenario, share)
        drives = self._drives(runs, cases.tuning)
        arrays = {
            "motor": true_motor(self.folder, {name: columns[name] for name in FACTORS}),
            **{name: columns[name] for name in ("theta", "noise", "load", "seed")},
            "speed": columns["speed"] / RPM,
            "figures": np.zeros((7, runs)),
            "flags": np.zeros((5, runs), dtype=np.int32),
        }
        arrays = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
        batch = self._ffi.new("fleet_runs *", {"runs": runs, "drives": drives})
        for name, array in arrays.items():
            setattr(batch, name, self._ffi.cast(_POINTERS.get(name, "double *"), array.ctypes.data))
        self._share(task, batch, runs, threads or thread_count(), progress)
        band = scenario.band(columns["speed"])
        return _outcomes(arrays["figures"], arrays["flags"], band, task, self.folder.module.SAMPLE_TIME)

    def noise(self, seed: int, steps: int) -> Array:
        """Standard normals (steps, 2) float32 that a run of this seed gets from its two sensors.

        Parameters
        ----------
        seed : int
            Seed of what is random.
        steps : int
            Number of steps.
        """
        normal = np.empty((steps, 2), dtype=np.float32)
        seeds = self._ffi.new("uint64_t[1]", [seed])
        self._library.fleet_noise(seeds, 1, steps, self._ffi.cast("float *", normal.ctypes.data))
        return normal

    def trace(self, scenario: Scenario, cases: Cases, index: int) -> Run:
        """One of the cases again, every sample kept: the scalar simulator with the same motor, tuning and noise.

        Parameters
        ----------
        scenario : Scenario
            Speed reference and load over time.
        cases : Cases
            What differs from run to run.
        index : int
            Number of the node.
        """
        columns = cases.columns(scenario, sensor_noise(self.folder.module.DEFAULTS["R"]))
        case = {name: column[index] for name, column in columns.items()}
        self._simulator = self._simulator or Simulator(self.folder, self.kind)
        steps = round(scenario.duration / self.folder.module.SAMPLE_TIME)
        noise = float(case["noise"]) * self.noise(int(case["seed"]), steps).astype(float)
        tuned = {name: np.asarray(values, dtype=float) for name, values in cases.tuning.items()}
        tuning = {name: tuple(v[:, index] if v.ndim == 2 else v) for name, v in tuned.items()}
        factors = {name: float(case[name]) for name in FACTORS}
        conditions = Conditions(
            theta=float(case["theta"]), factors=factors, noise=float(case["noise"]), supervised=self.supervised
        )
        own = replace(scenario, speed=float(case["speed"]), load=float(case["load"]))
        return self._simulator.run(own, conditions, tuning=tuning, noise=noise)

    def _share_of_speed(self, scenario: Scenario) -> Array:
        """The speed reference at every sample over its end value, (steps,)."""
        T = self.folder.module.SAMPLE_TIME
        steps = round(scenario.duration / T)
        if steps < 1:
            raise UserError(f"a run of {scenario.duration:g} s is shorter than a sample of {T:g} s.")
        return np.ascontiguousarray(np.clip(T * np.arange(steps) / scenario.ramp, 0.0, 1.0))

    def _task(self, scenario: Scenario, share: Array) -> Any:
        """The data that all runs share; it points into ``share``."""
        T, steps = self.folder.module.SAMPLE_TIME, len(share)
        t = T * np.arange(steps)
        late = t >= t[-1] - LATE
        start = t < min(scenario.load_at, scenario.duration)
        substeps = int(np.ceil(T / longest_step(self.folder) - 1e-9))
        task = self._ffi.new("fleet_task *")
        task.steps, task.substeps, task.h = steps, substeps, T / substeps
        parameters = self.folder.manifest["parameters"]
        task.v_dc, task.T = parameters["control"]["dc_link"], T
        task.pole_pairs = parameters["motor"]["pole_pairs"]
        dead_time, drop = inverter_of(parameters)
        task.lost = dead_time / self.folder.module.SAMPLE_TIME + drop / task.v_dc
        task.share = self._ffi.cast("double *", share.ctypes.data)
        task.load_from = _first(t >= scenario.load_at - 1e-12)
        task.start_until = int(np.count_nonzero(start))
        task.after_from, task.late_from = _first(~start), _first(late)
        task.moving_from = _first(t >= min(scenario.started, t[-1]))
        task.locked_angle, task.wrong_way = np.radians(LOCKED_ANGLE), WRONG_WAY
        return task

    def _drives(self, runs: int, tuning: Mapping[str, ArrayLike]) -> Any:
        """A controller for each run, tuned, its filter at x_0 and P_0."""
        drives = self._ffi.new(f"{self._drive}[]", runs)
        self._library.fleet_init(drives, runs)
        raw = np.frombuffer(self._ffi.buffer(drives), dtype=np.uint8).reshape(runs, -1)
        defaults = self.folder.module.DEFAULTS
        for name, values in tuning.items():
            if name not in TUNABLE:
                raise UserError(f"no tuning '{name}'; there are: {', '.join(TUNABLE)}.")
            wanted = np.asarray(values, dtype=np.float32)
            wanted = wanted[:, None] if wanted.ndim == 1 else wanted
            entries = len(defaults[name])
            if wanted.ndim != 2 or wanted.shape[0] != entries or wanted.shape[1] not in (1, runs):
                raise UserError(
                    f"tuning {name} has shape {np.shape(values)}; ({entries},) or ({entries}, {runs}) is right."
                )
            start = self._ffi.offsetof(self._drive, *self._place, name)
            raw[:, start : start + 4 * entries].view(np.float32)[:] = wanted.T
        self._library.fleet_reset(drives, runs)
        return drives

    def _share(self, task: Any, batch: Any, runs: int, threads: int, progress: Progress) -> None:
        """Groups of lanes to threads, one after another: a call into C holds no lock of Python's."""
        pieces = [(first, min(self._group, runs - first)) for first in range(0, runs, self._group)]
        with ThreadPoolExecutor(threads) as pool:
            waiting = {pool.submit(self._library.fleet_run, task, batch, *piece): piece[1] for piece in pieces}
            done = 0
            try:
                for future in as_completed(waiting):
                    future.result()
                    done += waiting[future]
                    progress(done, runs)
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise


_POINTERS = {"seed": "uint64_t *", "flags": "int *"}


def _first(mask: Array) -> int:
    """Index of the first true entry; beyond the end if there is none."""
    return int(np.argmax(mask)) if mask.any() else len(mask)


def _outcomes(figures: Array, flags: Array, band: Array, task: Any, T: float) -> Outcomes:
    """From C's sums and maxima to figures in r/min and degrees; ``band`` r/min of each run."""
    start, after, square, angle, angle_end, late_angle, late_speed = figures
    status, locked_from, finite, mode, reason = flags
    good = finite.astype(bool)
    late = max(1, task.steps - task.late_from)
    blank = np.where(good, 1.0, np.nan)
    return Outcomes(
        start=start * RPM * blank,
        load_step=after * RPM * blank,
        steady_rms=np.sqrt(square / late) * RPM * blank,
        angle=np.degrees(angle) * blank,
        angle_end=np.degrees(angle_end) * blank,
        lock_time=np.where(good & (locked_from < task.steps), locked_from * T, np.nan),
        locked=good & (late_angle <= task.locked_angle),
        reached=good & (late_speed * RPM <= band),
        status=status.copy(),
        finite=good,
        mode=mode.copy(),
        reason=reason.copy(),
    )


def _open(library: Path, declared: str, source: str, drive: str) -> tuple[Any, Any]:
    """cffi's view of the fleet; its structs are read from its own source."""
    import cffi

    ffi = cffi.FFI()
    text = source[source.index("/* The data that all runs share") : source.index("enum {")]
    text = "\n".join(line.partition("/*")[0] for line in text.splitlines() if not line.startswith(" *"))
    ffi.cdef(
        declared
        + text.replace("DRIVE", drive)
        + f"""
        void fleet_run(const fleet_task *t, const fleet_runs *r, int first, int count);
        void fleet_noise(const uint64_t *seed, int count, int steps, float *normal);
        void fleet_philox(uint64_t key, uint32_t pair, uint32_t words[4]);
        void fleet_init({drive} *drives, int count);
        void fleet_reset({drive} *drives, int count);
        int fleet_lanes(void);
        """
    )
    return ffi, ffi.dlopen(str(library))
