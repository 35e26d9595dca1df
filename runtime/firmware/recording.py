"""The inputs of the processors: recorded inputs in segments, each with the words its struct starts from.

A filter gets the start and the load step of the proof's trajectory, draws from the operating box, and inputs it must
reject. A controller gets the phase currents of the simulated drive, with and without a sample of delay, sensorless
and sensored, and phase currents that are out of range or no numbers. A drive's are in ``drive_recording.py``.

A segment sets only tuning (x_0, P_0, gains) and lets the generated ``_reset`` make the state from it, so nothing here
depends on how a filter keeps its covariance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from codegen.evidence.box import sample_box
from codegen.ir.covariance import place
from model.machines import MACHINES
from model.machines.state_space import build
from model.schema import Drive
from runtime.drive.scenario import Scenario
from runtime.drive.simulation import Conditions, Run, Simulator
from runtime.estimator.folder import GeneratedFolder
from runtime.firmware.subject import INPUTS
from runtime.folders.stated import stated_drive
from runtime.proof.own_trajectory import motion_of, trajectory_of
from runtime.proof.trajectory import Trajectory
from runtime.recorded.units import RPM

Array = NDArray[Any]

LOAD_AT = 0.2  # s, in the trajectory and in the simulated run
#: The value of a measurement or a voltage where it must be rejected.
BAD = (np.nan, np.inf, -np.inf, 1e6, -1e6, 3e38)


@dataclass(frozen=True)
class Segment:
    """Consecutive steps.

    ``inputs`` (N, 4); ``fields`` sets words of the struct by C name (``x_0[2]``) before the
    filter's reset; ``option`` is the second argument of a controller's or a drive's init (delay).
    """

    inputs: Array
    fields: Mapping[str, float] = field(default_factory=dict)
    option: int = 0


@dataclass(frozen=True)
class Recording:
    """All segments of a run."""

    segments: tuple[Segment, ...]

    @property
    def steps(self) -> int:
        """Number of steps."""
        return sum(len(segment.inputs) for segment in self.segments)


def filter_recording(folder: GeneratedFolder, steps: int) -> Recording:
    """60 % start, 20 % load step at speed, 10 % with inputs to reject, the rest draws from the box, two steps each."""
    drive = stated_drive(folder)
    names = folder.module.STATES
    T = drive.model.sample_time
    shares = [round(share * steps) for share in (0.6, 0.2, 0.1)]
    at = round(LOAD_AT / T) - shares[1] // 4
    trajectory = trajectory_of(drive, at + shares[1] + shares[2] + 1)
    rows = np.column_stack([trajectory.u, trajectory.y])
    loaded = slice(at + 1, at + 1 + shares[1])
    after = slice(loaded.stop, loaded.stop + shares[2])
    left = steps - sum(shares)
    segments = [
        Segment(rows[: shares[0]]),
        Segment(rows[loaded], _start(names, "", _truth(drive, names, trajectory, at))),
        Segment(spoil(rows[after]), _start(names, "", _truth(drive, names, trajectory, loaded.stop - 1))),
        *_box_segments(drive, names, left),
    ]
    return checked(segments, steps)


def controller_recording(folder: GeneratedFolder, steps: int) -> Recording:
    """40 % start, 35 % load step with delay and dead-time compensation, 15 % sensored, 10 % with spoilt currents."""
    run = _simulated(folder, steps)
    names = run.state_names
    shares = [round(share * steps) for share in (0.4, 0.35, 0.15)]
    shares.append(steps - sum(shares))
    rows = phases_and_commands(folder, run)
    at = round(LOAD_AT / folder.module.SAMPLE_TIME) - shares[1] // 4
    loaded, sensored = slice(at, at + shares[1]), slice(at + shares[1], at + shares[1] + shares[2])
    spoilt = slice(sensored.stop, sensored.stop + shares[3])
    compensated = {_gain(folder, "dead_share"): 0.02} if "dead_share" in folder.module.GAIN_NAMES else {}
    turned = float(np.remainder(run.theta[sensored.start] + np.pi, 2 * np.pi) - np.pi)
    sensors = {"sensored": 1, "sensed[0]": float(run.omega[sensored.start]), "sensed[1]": turned}
    segments = [
        Segment(rows[: shares[0]]),
        Segment(rows[loaded], {**_estimate(names, run, loaded.start), **compensated}, option=1),
        Segment(rows[sensored], {**_estimate(names, run, sensored.start), **sensors}),
        *_spoilt_segments(rows[spoilt], _estimate(names, run, spoilt.start)),
    ]
    return checked(segments, steps)


def spoil(rows: Array) -> Array:
    """Every fourth step bad in one entry: each kind of bad value in each of the four entries, by turns."""
    spoilt = rows.copy()
    for k, row in enumerate(range(2, len(rows), 4)):
        spoilt[row, k % INPUTS] = BAD[(k // INPUTS) % len(BAD)]
    return spoilt


def _spoilt_segments(rows: Array, fields: Mapping[str, float]) -> list[Segment]:
    """One bad phase current in a piece of ten steps: what the controller makes of it, then a fresh start."""
    pieces = []
    for k, first in enumerate(range(0, len(rows), 10)):
        piece = rows[first : first + 10].copy()
        if len(piece) > 3:
            piece[3, k % 2] = BAD[k % len(BAD)]
        pieces.append(Segment(piece, fields))
    return pieces


def _box_segments(drive: Drive, names: Sequence[str], steps: int) -> list[Segment]:
    """Draws from the operating box: x and the variances of P become x_0 and P_0; correlation comes with the steps."""
    count = (steps + 1) // 2
    if not count:
        return []
    box = sample_box(drive, build(drive), count)
    diagonal = [place(i, i) for i in range(len(names))]
    segments = []
    for k in range(count):
        row = np.concatenate([box.u[:, k], box.y[:, k]])
        fields = {f"x_0[{i}]": float(box.x[i, k]) for i in range(len(names))}
        fields |= {f"P_0[{i}]": float(box.P[d, k]) for i, d in enumerate(diagonal)}
        segments.append(Segment(np.tile(row, (min(2, steps - 2 * k), 1)), fields))
    return segments


def _truth(drive: Drive, states: Sequence[str], trajectory: Trajectory, at: int) -> dict[str, float]:
    """True states of the trajectory by name, at a step; the currents as measured."""
    electrical = ("psi_alpha", "psi_beta") if drive.model.machine in MACHINES else states[:2]
    turned = float(np.remainder(trajectory.theta[at] + np.pi, 2 * np.pi) - np.pi)
    values = [*trajectory.y[at], *trajectory.psi[at], trajectory.omega[at], turned]
    names = ("i_alpha", "i_beta", *electrical, "omega", "theta")
    return dict(zip(names, map(float, values), strict=True))


def _start(names: Sequence[str], owner: str, truth: Mapping[str, float]) -> dict[str, float]:
    """x_0 of the states whose truth is known; the others keep the drive's."""
    return {f"{owner}x_0[{i}]": truth[name] for i, name in enumerate(names) if name in truth}


def _simulated(folder: GeneratedFolder, steps: int) -> Run:
    """The drive in the loop past its load step."""
    kind, motion = "ickf" if "ickf" in folder.kinds else folder.kinds[0], motion_of(stated_drive(folder))
    duration = LOAD_AT + max(steps, 100) * folder.module.SAMPLE_TIME
    task = Scenario("recorded", motion.speed * RPM, motion.ramp, motion.load, LOAD_AT, duration)
    return Simulator(folder, kind).run(task, Conditions())


def phases_and_commands(folder: GeneratedFolder, run: Run) -> Array:
    """Rows i_a, i_b in A, speed reference in rad/s, DC link in V, of a simulated run.

    Parameters
    ----------
    folder : GeneratedFolder
        Tells the DC link.
    run : Run
    """
    i_b = 0.5 * (np.sqrt(3) * run.i[:, 1] - run.i[:, 0])
    v_dc = np.full(len(run.t), folder.manifest["parameters"]["control"]["dc_link"])
    return np.column_stack([run.i[:, 0], i_b, run.scenario.speed_reference(run.t), v_dc])


def _estimate(names: Sequence[str], run: Run, at: int) -> dict[str, float]:
    return _start(names, "filter.", dict(zip(names, map(float, run.x[at - 1]), strict=True)))


def _gain(folder: GeneratedFolder, name: str) -> str:
    return f"gain[{folder.module.GAIN_NAMES.index(name)}]"


def checked(segments: Sequence[Segment], steps: int) -> Recording:
    """A recording of the segments that are not empty.

    Raises
    ------
    ValueError
        It has not the steps asked for.
    """
    recording = Recording(tuple(segment for segment in segments if len(segment.inputs)))
    if recording.steps != steps:
        raise ValueError(f"recording has {recording.steps} steps, wanted {steps}")
    return recording
