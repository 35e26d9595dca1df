"""Where a drive holds: success and angle error over speed, load, wrong R and wrong psi_m; the worst corner first."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.drive.experiment import folder_with
from runtime.drive.fleet import Cases, Fleet
from runtime.drive.scenario import Scenario, find_scenario
from runtime.estimator.compiler import find_compiler
from runtime.estimator.folder import KINDS
from runtime.folders.resolve import find_drive
from runtime.system.values import read_word

Array = NDArray[Any]
#: Called with runs done, of all, and what is being run.
Progress = Callable[[int, int, str], None]

#: The axes: speed and load as shares of the rated ones, R and psi_m of the true motor over the filter's.
SPEEDS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
LOADS = (0.0, 0.25, 0.5, 0.75, 1.0)
RESISTANCES = (0.8, 0.9, 1.0, 1.1, 1.2)
FLUXES = (0.95, 1.0, 1.05)
#: Seeds of the sensors' noise in each cell.
RUNS = 8


@dataclass(frozen=True)
class Cell:
    """The runs at one speed (r/min), load (N m) and motor; shares that were locked, and locked at the reference.

    ``angle``: largest error of any of the runs after its start, degrees electrical, 180 where one is lost.
    """

    speed: float
    load: float
    R: float
    psi_m: float
    locked: float
    success: float
    angle: float


@dataclass(frozen=True)
class Map:
    """All cells of a drive with one filter, in the order of the axes: psi_m, R, load, speed (which runs quickest)."""

    drive: str
    kind: str
    scenario: Scenario
    runs: int
    cells: tuple[Cell, ...]

    def grid(self, name: str) -> Array:
        """One figure of every cell, (psi_m, R, load, speed).

        Parameters
        ----------
        name : str
            A field of :class:`Cell`.
        """
        shape = (len(FLUXES), len(RESISTANCES), len(LOADS), len(SPEEDS))
        return np.array([getattr(cell, name) for cell in self.cells]).reshape(shape)

    @property
    def corners(self) -> list[Cell]:
        """The cells, the worst first: least success, then the largest angle error, then the higher speed."""
        return sorted(self.cells, key=lambda cell: (cell.success, -cell.angle, -cell.speed))


def draw_map(
    drive: str,
    kind: str | None = None,
    runs: int = RUNS,
    seed: int = 1,
    supervised: bool = False,
    progress: Progress = lambda done, of, what: None,
) -> Map:
    """Run a drive's load step in every cell, from angle 0.

    Parameters
    ----------
    drive : str
        A shipped name, a TOML file or a generated folder.
    kind : str, optional
        Filter kind; None: the drive file's first.
    runs : int, optional
        Of each cell.
    seed : int, optional
        Of the first run's noise; the others follow.
    supervised : bool, optional
        From power-up, with the supervisor, to which the angle is unknown; else the controller alone.
    progress : callable
        Told runs done, of how many, of what.
    """
    find_compiler()
    named = find_drive(drive)
    kind = kind or named.drive.filter.kinds[0]
    read_word(kind, "filter", KINDS)
    scenario = find_scenario("load_step", named.drive)
    axes = np.meshgrid(FLUXES, RESISTANCES, LOADS, SPEEDS, np.arange(runs), indexing="ij")
    flux, resistance, load, speed, run = (axis.ravel() for axis in axes)
    cases = Cases(
        seed=seed + run.astype(int),
        R=resistance,
        psi_m=flux,
        load=load * scenario.load,
        speed=speed * scenario.speed,
    )
    with ExitStack() as stack:
        fleet = Fleet(folder_with(named, kind, stack), kind, supervised)
        found = fleet.run(scenario, cases, progress=lambda done, of: progress(done, of, f"{named.drive.name}, {kind}"))
    angle = np.where(found.locked, found.angle, 180.0)

    def cell(k: int) -> Cell:
        part = slice(k * runs, (k + 1) * runs)
        at = k * runs
        return Cell(
            speed=float(speed[at] * scenario.speed),
            load=float(load[at] * scenario.load),
            R=float(resistance[at]),
            psi_m=float(flux[at]),
            locked=float(np.mean(found.locked[part])),
            success=float(np.mean(found.good[part])),
            angle=float(np.max(angle[part])),
        )

    cells = tuple(cell(k) for k in range(speed.size // runs))
    return Map(named.drive.name, kind, scenario, runs, cells)


def map_facts(found: Map) -> dict[str, Any]:
    """Everything that is drawn as plain data, the worst cell first; a figure that is no number becomes None."""
    cells = [
        {name: value if math.isfinite(value) else None for name, value in vars(cell).items()} for cell in found.corners
    ]
    rated = {"speed": found.scenario.speed, "load": found.scenario.load}
    return {"drive": found.drive, "filter": found.kind, "runs": found.runs, "rated": rated, "cells": cells}
