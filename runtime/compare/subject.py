"""One drive of a comparison: what its generated folder, its model and its runs say."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca

from codegen.render.equations import Readable, readable
from model.machines.state_space import StateSpaceModel, build
from model.schema import Drive
from runtime.drive.scenario import scenarios
from runtime.drive.simulation import Run, Simulator
from runtime.estimator.compiler import find_compiler
from runtime.estimator.folder import GeneratedFolder
from runtime.folders.resolve import drive_folder
from runtime.folders.stated import stated_drive
from runtime.system.errors import UserError

Progress = Callable[[str], None]

#: How an entry of F or H is drawn: structurally zero, one, another constant, a function of state or input.
ZERO, ONE, CONSTANT, VARYING = ".", "1", "c", "x"


@dataclass(frozen=True)
class Subject:
    """``label`` names it in tables: the drive's name, or what was asked for where two share a name."""

    label: str
    folder: GeneratedFolder
    runs: tuple[Run, ...] = ()

    @property
    def manifest(self) -> dict[str, Any]:
        """The folder's manifest."""
        return self.folder.manifest

    @cached_property
    def drive(self) -> Drive:
        """As the folder was generated, whatever became of its file."""
        return stated_drive(self.folder)

    @cached_property
    def model(self) -> StateSpaceModel:
        """The symbolic model of the drive."""
        return build(self.drive)

    @cached_property
    def equations(self) -> Readable:
        """The equations as a reader sees them."""
        return readable(self.drive)

    @property
    def state_names(self) -> tuple[str, ...]:
        """The states' names, in order."""
        return tuple(state["name"] for state in self.manifest["states"])

    @cached_property
    def patterns(self) -> dict[str, tuple[str, ...]]:
        """F (n, n) and H (2, n), a character an entry."""
        point = ca.vertcat(self.model.x, self.model.u)
        return {name: _pattern(matrix, point) for name, matrix in (("F", self.model.F), ("H", self.model.H))}


def _pattern(matrix: Any, point: Any) -> tuple[str, ...]:
    def mark(entry: Any) -> str:
        if entry.nnz() == 0 or entry.is_zero():
            return ZERO
        if entry.is_one():
            return ONE
        return VARYING if ca.depends_on(entry, point) else CONSTANT

    rows, columns = matrix.shape
    return tuple("".join(mark(matrix[i, j]) for j in range(columns)) for i in range(rows))


def collect(drives: Sequence[str], progress: Progress = lambda text: None) -> list[Subject]:
    """Find the drives' folders and run both scenarios of each with every filter it ships.

    Raises
    ------
    UserError
        Fewer than two drives, one named twice, one not generated, or no C compiler.
    """
    if len(drives) < 2:
        raise UserError("compare needs two drives or more, such as: pmsm-ickf compare paper_spmsm spmsm_load_torque")
    find_compiler()
    folders = [drive_folder(name) for name in drives]
    places = [folder.path.resolve() for folder in folders]
    for k, place in enumerate(places):
        if place in places[:k]:
            raise UserError(f"'{drives[k]}' is there twice: {place}.")
    names = [folder.drive for folder in folders]
    labels = [name if names.count(name) == 1 else asked for name, asked in zip(names, drives, strict=True)]
    return [
        Subject(label, folder, _runs(label, folder, progress)) for label, folder in zip(labels, folders, strict=True)
    ]


def _runs(label: str, folder: GeneratedFolder, progress: Progress) -> tuple[Run, ...]:
    runs = []
    tasks = scenarios(stated_drive(folder))
    for kind in folder.kinds:
        simulator = Simulator(folder, kind)
        for scenario in tasks.values():
            progress(f"{label}: {scenario.name}, {kind}")
            runs.append(simulator.run(scenario))
    return tuple(runs)
