"""Verify a drive: every link of the chain that can be run here, over a trajectory and over the operating box."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from codegen.evidence.box import BoxSamples, sample_box
from codegen.evidence.certificate import SAMPLES
from codegen.generate import Package, build_steps, draft, generate_bare
from codegen.output.folder import write_folder
from codegen.targets.find import find_target
from model.alignment import aligns
from model.filters import FilterStep
from model.schema import Drive
from model.supervisor import supervisor
from runtime.estimator.compiler import find_compiler
from runtime.estimator.estimator import load_folder
from runtime.estimator.folder import GeneratedFolder
from runtime.folders.current import current_package
from runtime.folders.resolve import NamedDrive, find_drive
from runtime.proof.exhaust import link_exhaust
from runtime.proof.link_ab import free_run, link_ab, own_run, pieces_of, reference_run
from runtime.proof.link_bc import link_bc
from runtime.proof.link_cd import Envelope, link_cd
from runtime.proof.link_chip import link_chip
from runtime.proof.link_de import OPTIMISATIONS, Bits
from runtime.proof.link_drive import link_drive
from runtime.proof.link_drive_lanes import link_drive_lanes
from runtime.proof.link_foc import link_control
from runtime.proof.link_guard import link_data, link_guard
from runtime.proof.link_injection import link_injection
from runtime.proof.link_modes import link_modes
from runtime.proof.link_text import link_text
from runtime.proof.modes import Modes
from runtime.proof.motors import Plant
from runtime.proof.own_trajectory import trajectory_of
from runtime.proof.result import IterationEffect, Link, Proof
from runtime.proof.second import UNCHECKED, compare_statements, second_motor
from runtime.proof.trajectory import Trajectory

Array = NDArray[Any]
Progress = Callable[[str], None]

GAINS = ("cubature", "jacobian")

#: Steps that the reference goes on its own before it is set to where the generated filter is.
PIECE = 100

#: Largest difference between ICKF and CKF, in sigmas, that rounding explains (float64, as link A-B allows).
ROUNDING = 1e-9


@dataclass(frozen=True)
class Effort:
    """How much is compared. The defaults are what ``pmsm-ickf verify`` runs."""

    trajectory: float = 0.3  # s; the load step comes at 0.2 s
    box_draws: int = 300  # for link A-B; D-E takes all of them
    guard_draws: int = 4  # each with every fault
    bit_steps: int = 10_000
    drift_steps: int = 100_000
    chip_steps: int = 1000  # about 1.5 ms each: every operation is modelled
    optimisations: tuple[tuple[str, ...], ...] = OPTIMISATIONS


@dataclass(frozen=True)
class Evidence:
    """Arrays behind the tables, for plots: drift of the run at speed, and ICKF minus CKF in sigmas."""

    t: Array
    drift: dict[str, Envelope]
    effects: dict[str, Array]
    trajectory: Trajectory


def verify(
    drive: str | Path,
    effort: Effort | None = None,
    progress: Progress = lambda text: None,
    current: bool = False,
) -> tuple[Proof, Evidence]:
    """Prove a generated drive.

    Parameters
    ----------
    drive : str or Path
        A shipped name or a TOML file; or generated folder, see :func:`runtime.folders.resolve.find_drive`.
    effort : Effort, optional
    progress : callable, optional
        Called with a few words before each piece of work.
    current : bool
        The folder has just been generated: it is not generated again to see whether it is stale.

    Raises
    ------
    UserError
        No generated folder, a stale or hand-edited one, or no C compiler.
    """
    find_compiler()
    return prove(find_drive(drive), effort or Effort(), progress, current)


def prove(named: NamedDrive, effort: Effort, progress: Progress, current: bool = False) -> tuple[Proof, Evidence]:
    """All links for the gain the drive ships, and again for the other gain of the ICKF.

    Parameters
    ----------
    named : NamedDrive
        A drive and its generated folder.
    effort : Effort
    progress : callable
        Is told in words what is done next.
    current : bool, optional
        The folder is known to be what the drive generates: that is not tried again.

    Raises
    ------
    UserError
        The folder is missing, edited by hand or stale.
    """
    progress("generating")
    drive, path = named.drive, named.path
    package = Package(drive, *build_steps(drive), files={}) if current else current_package(named)
    proof = Proof(drive.name)
    equations = compare_statements(drive)
    if equations is not None:
        proof.links.append(equations)
    else:
        proof.unchecked.append(UNCHECKED)
    progress("every state of the supervisor")
    proof.links.append(_every_state(package))
    trajectory = trajectory_of(drive, PIECE * math.ceil(effort.trajectory / drive.model.sample_time / PIECE - 1e-9))
    evidence = Evidence(trajectory.t, {}, {}, trajectory)
    long = _long_run(drive, effort)
    for gain, variant, folder in _variants(package, path):
        prover = Prover(variant, literal_package(variant.drive), folder, trajectory, long, effort, progress)
        for kind in variant.steps:
            if kind == "ickf" or gain == drive.filter.gain:
                proof.links += prover.links(kind, evidence)
        if {"ckf", "ickf"} <= set(variant.steps):
            proof.effects.append(prover.effect(evidence))
    proof.notes += [step.iteration_proof for step in package.steps.values() if step.iteration_proof]
    return proof, evidence


def _every_state(package: Package) -> Link:
    """The declared machine alone; how long its modes may last is promised by the statement by hand."""
    drive, parameters = package.drive, package.drive.model_dump()
    hand = Modes(parameters, flux=package.model.states[0].unit == "Wb")
    machine = supervisor(drive, package.model)
    return link_exhaust(machine, drive.name, drive.model.sample_time, hand.longest)


def _with_gain(drive: Drive, gain: str) -> Drive:
    return drive.model_copy(update={"filter": drive.filter.model_copy(update={"gain": gain})})


def _variants(package: Package, path: Path) -> Iterator[tuple[str, Package, GeneratedFolder]]:
    """The shipped folder, then one generated with the other gain and thrown away."""
    drive = package.drive
    yield drive.filter.gain, package, GeneratedFolder(path)
    for gain in GAINS if "ickf" in drive.filter.kinds else ():
        if gain != drive.filter.gain:
            other = generate_bare(_with_gain(drive, gain))
            with tempfile.TemporaryDirectory() as scratch:
                write_folder(Path(scratch) / drive.name, other.files)
                yield gain, other, GeneratedFolder(Path(scratch) / drive.name)


def _long_run(drive: Drive, effort: Effort) -> tuple[Trajectory, int]:
    """The trajectory continued at speed, and the step from which its drift is judged."""
    settled = round(0.3 / drive.model.sample_time)
    steps = max(settled + effort.drift_steps, effort.bit_steps)
    return trajectory_of(drive, steps), settled


@dataclass(frozen=True)
class Literal:
    """The literal form of a drive: its symbolic steps and its Python module."""

    steps: dict[str, FilterStep]
    module: ModuleType


def literal_package(drive: Drive) -> Literal:
    """The paper's shape of a drive's filters, in Python alone.

    Parameters
    ----------
    drive : Drive
    """
    made = draft(drive, "literal")
    return Literal(made.steps, made.load(f"literal_{drive.name}"))


@dataclass
class Prover:
    """Runs the links of one generated folder."""

    package: Package
    literal: Literal
    folder: GeneratedFolder
    trajectory: Trajectory
    long: tuple[Trajectory, int]
    effort: Effort
    progress: Progress

    def links(self, kind: str, evidence: Evidence) -> list[Link]:
        """A-B, B-C, guard, data, text, D-E each way it is compiled, controller, modes; C-D and D-chip on the long run.

        Parameters
        ----------
        kind : str
            Filter kind, such as "ickf".
        evidence : Evidence
            What the links leave for figures.
        """
        step = self.package.steps[kind]
        label = f"{kind}, {step.gain} gain" if kind == "ickf" else kind
        self.progress(f"{label}: A-B-C, reference along the trajectory")
        found = self.along_trajectory(kind)
        self.progress(f"{label}: A-B-C, operating box")
        found += self._box(kind)
        self.progress(f"{label}: inputs to reject, and what is loaded")
        found += [*self._guards(kind), link_data(self.folder, kind, step.gain, self._parameters, self._motor)]
        self.progress(f"{label}: the C's expressions and NumPy's")
        found.append(link_text(self.folder, kind, step.gain))
        self.progress(f"{label}: D-E, compiling and comparing bits")
        bits = self._bits(kind)
        found += [*(bits.link(optimisation) for optimisation in self.effort.optimisations), bits.lane_link()]
        self.progress(f"{label}: the controller around it")
        found += link_control(self.folder, kind, step.gain, self._parameters, self._motor)
        if hasattr(self.folder.module, "inject"):
            dc_link = self._parameters["control"]["dc_link"]
            found.append(link_injection(self.folder.module, self.folder.drive, kind, step.gain, dc_link))
        self.progress(f"{label}: the modes, and the drive around them")
        found.append(replace(self._modes, kind=kind, gain=step.gain))
        found += link_drive(self.folder, kind, step.gain, self._parameters)
        if not aligns(self.package.drive):  # lanes of whole drives have no alignment
            found.append(link_drive_lanes(self.folder, kind, step.gain, self._parameters))
        self.progress(f"{label}: C-D, float32 at speed")
        long, settled = self.long
        drift_link, drift = link_cd(self.folder, kind, step.gain, long.u, long.y, settled)
        evidence.drift[label] = drift.envelope()
        found.append(drift_link)
        if find_target(self.package.drive.target_name).arithmetic is not None:
            self.progress(f"{label}: D-chip, the chip's arithmetic as modelled")
            steps = self.effort.chip_steps
            found.append(link_chip(self.folder, kind, step.gain, long.u[:steps], long.y[:steps]))
        return found

    def along_trajectory(self, kind: str) -> list[Link]:
        """A-B stage by stage along the trajectory, and B on its own; then B-C.

        Parameters
        ----------
        kind : str
            Filter kind, such as "ickf".
        """
        step, module, name = self.literal.steps[kind], self.literal.module, self.package.drive.name
        u, y = self.trajectory.u, self.trajectory.y
        first = self._start, np.diag(self.package.drive.filter.initial_covariance)
        own = own_run(module, kind, first, u, y)
        piece = math.gcd(len(u), PIECE)
        starts = pieces_of(own, first, piece)
        u_of, y_of = (np.swapaxes(signal.reshape(-1, piece, 2), 0, 1) for signal in (u, y))
        run = reference_run("trajectory", self._parameters, step, starts, u_of, y_of, self._motor)
        return [
            link_ab(module, step, name, run, self._R),
            free_run(step, name, run, own, module.ANGLE),
            link_bc(module, self.folder.module, step, name, run),
        ]

    def _box(self, kind: str) -> list[Link]:
        step, name = self.literal.steps[kind], self.package.drive.name
        box = sample_box(self.package.drive, self.package.model, self.effort.box_draws)
        starts, u, y = (box.x.T, _full(box)), box.u.T[None], box.y.T[None]
        situations = reference_run("operating box", self._parameters, step, starts, u, y, self._motor)
        return [
            link_ab(self.literal.module, step, name, situations, self._R),
            link_bc(self.literal.module, self.folder.module, step, name, situations),
        ]

    def _guards(self, kind: str) -> list[Link]:
        """The literal and the fast form on inputs to reject, from a few states of the box."""
        step, parameters, motor = self.literal.steps[kind], self._parameters, self._motor
        box = sample_box(self.package.drive, self.package.model, self.effort.guard_draws)
        draws = box.x.T, _full(box), box.u.T, box.y.T
        modules = {"literal": self.literal.module, "fast": self.folder.module}
        name = self.package.drive.name
        return [link_guard(m, step, name, form, parameters, motor, draws) for form, m in modules.items()]

    def _bits(self, kind: str) -> Bits:
        long, _ = self.long
        box = sample_box(self.package.drive, self.package.model, SAMPLES)
        steps = self.effort.bit_steps
        return Bits(self.folder, self.package.steps[kind], long.u[:steps], long.y[:steps], box)

    def effect(self, evidence: Evidence) -> IterationEffect:
        """ICKF against CKF, both generated float64, on the same trajectory.

        Parameters
        ----------
        evidence : Evidence
            What the links leave for figures.
        """
        gain, idle = self.package.drive.filter.gain, self.package.steps["ickf"].iteration_proof is not None
        ckf, ickf = (
            load_folder(self.folder, kind, "numpy", "float64").run(self.trajectory.u, self.trajectory.y)
            for kind in ("ckf", "ickf")
        )
        difference = np.abs(ickf.x - ckf.x)
        angle = self.package.model.angle
        difference[:, angle] = np.abs(np.remainder(ickf.x[:, angle] - ckf.x[:, angle] + np.pi, 2 * np.pi) - np.pi)
        in_sigma = difference / np.sqrt(np.einsum("kii->ki", ckf.P))
        evidence.effects[gain] = in_sigma.max(axis=1)
        worst = float(in_sigma.max())
        verdict = {(True, True): "rounding", (False, False): "real"}.get((idle, worst <= ROUNDING), "unexplained")
        by_state = {state.name: float(difference[:, k].max()) for k, state in enumerate(self.package.model.states)}
        return IterationEffect(self.package.drive.name, gain, worst, by_state, idle, verdict)

    @cached_property
    def _modes(self) -> Link:
        """The module's supervisor, which is the same for every kind."""
        return link_modes(self.folder, "", "", self._parameters, self._motor)

    @cached_property
    def _motor(self) -> Plant:
        return second_motor(self.package.drive)

    @property
    def _parameters(self) -> dict[str, Any]:
        return self.package.drive.model_dump()

    @property
    def _start(self) -> Array:
        return np.array(self.folder.module.DEFAULTS["x_0"], dtype=float)

    @property
    def _R(self) -> Array:
        return np.array(self.package.drive.filter.measurement_noise)


def _full(box: BoxSamples) -> Array:
    """Covariances (N, n, n) of the draws."""
    n, draws = box.x.shape
    P = np.empty((draws, n, n))
    rows, columns = np.tril_indices(n)
    P[:, rows, columns] = P[:, columns, rows] = box.P.T
    return P
