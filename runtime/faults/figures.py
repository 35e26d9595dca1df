"""Figures of faults: true speed and errors of the estimate over time, a row a fault, one colour a filter."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from runtime.drive.figures import COLOURS, DASHES
from runtime.faults.loop import FaultyRun
from runtime.faults.survey import ANGLE_BAND, Outcome
from runtime.recorded.units import RPM
from runtime.style.figures import pyplot, svg_text
from runtime.system.files import make_folder, write_text

#: The time shown, s from the fault's begin; and the largest errors drawn, in bands.
BEFORE, BEHIND, REACH = 0.01, 0.12, 4.0
#: r/min: half of the least range of a speed axis, so that noise looks like noise.
LEAST_RANGE = 20.0


def fault_figure(outcomes: Sequence[Outcome]) -> Any:
    """One drive: a row of three panels for every fault, seed 1 of each filter.

    Where the drive has no torque, because it waits or catches its rotor, there is no estimate to speak of: the lines
    of the errors are interrupted.
    """
    names = list(dict.fromkeys(outcome.fault.name for outcome in outcomes))
    height = 1.25 * len(names) + 0.9  # inches
    figure, axes = pyplot().subplots(len(names), 3, figsize=(9.0, height), sharex=True, squeeze=False, layout="none")
    for row, name in zip(axes, names, strict=True):
        shown = [outcome for outcome in outcomes if outcome.fault.name == name]
        for outcome in shown:
            _draw(row, outcome.example, outcome.kind)
        _finish(row, shown[0])
    figure.subplots_adjust(left=0.1, right=0.98, bottom=0.6 / height, top=1.0 - 0.3 / height, wspace=0.25, hspace=0.3)
    figure.align_ylabels(axes[:, 0])
    for axis, title in zip(axes[0], ("true speed, r/min", "speed error, r/min", "angle error, deg"), strict=True):
        axis.set_title(title, fontsize=8)
    for axis in axes[-1]:
        axis.set_xlabel("time from the fault, ms", fontsize=8)
    axes[0][0].legend(loc="lower right", fontsize=7)
    return figure


def _draw(row: Any, run: FaultyRun, kind: str) -> None:
    T = run.t[1] - run.t[0]
    part = slice(max(0, run.first - round(BEFORE / T)), run.first + round(BEHIND / T))
    time = (run.t[part] - run.t[run.first]) * 1e3
    style: dict[str, Any] = {"color": COLOURS.get(kind), "ls": DASHES.get(kind), "lw": 0.9, "label": kind}
    used = run.running[part] & run.powered[part]
    row[0].plot(time, run.omega[part] * RPM, **style)
    row[1].plot(time, np.where(used, run.speed_error[part], np.nan), **style)
    row[2].plot(time, np.where(used, run.angle_error[part], np.nan), **style)


def _finish(row: Any, outcome: Outcome) -> None:
    run = outcome.example
    T = run.t[1] - run.t[0]
    for axis, band in zip(row, (None, run.band, ANGLE_BAND), strict=True):
        axis.axvspan(0.0, max(run.after - run.first, 1) * T * 1e3, color="#bbbbbb", alpha=0.4, lw=0)
        axis.tick_params(labelsize=7)
        if band is not None:
            axis.axhspan(-band, band, color="#5a9e6f", alpha=0.12, lw=0)
            axis.set_ylim(-REACH * band, REACH * band)
    low, high = row[0].get_ylim()
    middle, half = 0.5 * (low + high), max(0.5 * (high - low), LEAST_RANGE)
    row[0].set_ylim(middle - half, middle + half)
    row[0].ticklabel_format(useOffset=False)
    row[0].set_ylabel(outcome.fault.name, fontsize=7)


def write_fault_figures(outcomes: Sequence[Outcome], folder: Path) -> list[Path]:
    """``faults_<drive>.svg`` for every drive."""
    make_folder(folder)
    paths = []
    for drive in dict.fromkeys(outcome.drive for outcome in outcomes):
        path = folder / f"faults_{drive}.svg"
        write_text(path, svg_text(fault_figure([outcome for outcome in outcomes if outcome.drive == drive])))
        paths.append(path)
    return paths
