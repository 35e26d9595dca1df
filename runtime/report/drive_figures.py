"""The paper's figures 4-11 redrawn from runs: speed, speed error, position, position error; one colour a filter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from runtime.drive.experiment import SweepPoint
from runtime.drive.scenario import RPM
from runtime.drive.simulation import Run
from runtime.report.figures import pyplot, svg_text

COLOURS = {"ckf": "#3b6ea8", "ickf": "#c8553d", "ekf": "#5a9e6f", "ukf": "#8a6bb1", "truth": "#444444"}
DASHES = {"ckf": "-", "ickf": "--", "ekf": "-.", "ukf": ":"}

#: The paper's numbering: speed, its error, position, its error.
NUMBERS = {"no_load": (4, 5, 6, 7), "load_step": (8, 9, 10, 11)}


def run_figure(runs: Sequence[Run]) -> str:
    """Four panels of one scenario, all filters together."""
    scenario = runs[0].scenario
    figure, axes = pyplot().subplots(4, 1, figsize=(7.5, 8.0), sharex=False)
    for run in runs:
        style: dict[str, Any] = {"color": COLOURS[run.kind], "ls": DASHES[run.kind], "lw": 1.1, "label": run.kind}
        axes[0].plot(run.t, run.x[:, 2] * RPM, **style)
        axes[1].plot(run.t, run.speed_error, **style)
        late = run.t >= run.t[-1] - 0.03
        axes[2].plot(run.t[late], run.x[late, 3], **style)
        axes[3].plot(run.t, run.angle_error, **style)
    truth = runs[0]
    late = truth.t >= truth.t[-1] - 0.03
    axes[0].plot(truth.t, truth.omega * RPM, color=COLOURS["truth"], lw=0.8, label="true")
    wrapped = np.remainder(truth.theta[late] + np.pi, 2 * np.pi) - np.pi
    axes[2].plot(truth.t[late], wrapped, color=COLOURS["truth"], lw=0.8, label="true")
    labels = ("speed, r/min", "speed error, r/min", "position, rad electrical", "position error, deg electrical")
    numbers = NUMBERS.get(scenario.name, (0, 0, 0, 0))
    for axis, label, number in zip(axes, labels, numbers, strict=True):
        axis.set_ylabel(label, fontsize=8)
        axis.set_title(f"fig. {number}" if number else "", loc="left", fontsize=8)
    axes[0].legend(loc="lower right", ncols=len(runs) + 1)
    axes[3].set_xlabel("time, s")
    return svg_text(figure)


def sweep_figure(points: Sequence[SweepPoint]) -> str:
    """Largest speed error while starting over the sample time; a lost lock is marked at the top."""
    figure, axes = pyplot().subplots(figsize=(7.5, 2.8))
    for name, colour in (("euler", "#c8553d"), ("exact", "#3b6ea8")):
        chosen = [p for p in points if p.discretization == name]
        good = [p for p in chosen if p.locked]
        axes.plot(
            [p.sample_time * 1e6 for p in good], [p.figures["start"] for p in good], "o-", color=colour, label=name
        )
        for p in chosen:
            if not p.locked:
                axes.annotate(
                    f"{name} loses lock",
                    (p.sample_time * 1e6, 0.92),
                    xycoords=("data", "axes fraction"),
                    color=colour,
                    ha="right",
                )
                axes.axvline(p.sample_time * 1e6, color=colour, lw=0.8, ls=":")
    axes.set(xlabel="sample time, us", ylabel="largest speed error\nwhile starting, r/min", ylim=(0, None))
    axes.legend(loc="upper left")
    return svg_text(figure)
