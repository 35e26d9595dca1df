"""The paper's figures 4-11 redrawn from runs: speed, speed error, position, position error; one colour a filter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from runtime.drive.experiment import SweepPoint
from runtime.drive.simulation import Run
from runtime.recorded.units import RPM
from runtime.style.figures import pyplot, svg_text

COLOURS = {"ckf": "#3b6ea8", "ickf": "#c8553d", "ekf": "#5a9e6f", "ukf": "#8a6bb1", "truth": "#444444"}
DASHES = {"ckf": "-", "ickf": "--", "ekf": "-.", "ukf": ":"}

#: The paper's numbering: speed, its error, position, its error.
NUMBERS = {"no_load": (4, 5, 6, 7), "load_step": (8, 9, 10, 11)}

_BELOW = ("data", "axes fraction")

#: Slices of time that a noisy quantity is drawn in: six points of a figure's width each.
SLICES = 80


def run_figure(runs: Sequence[Run], numbered: bool = False) -> str:
    """Four panels of one scenario, all filters together.

    Each filter closes its own loop, so each has a truth of its own: errors are against that; the position panel
    shows the first filter and its truth. ``numbered`` writes the paper's figure numbers.
    """
    scenario = runs[0].scenario
    figure, axes = pyplot().subplots(4, 1, figsize=(7.5, 8.0), sharex=False)
    for run in runs:
        style: dict[str, Any] = {"color": COLOURS[run.kind], "ls": DASHES[run.kind], "lw": 0.9}
        axes[0].plot(run.t, run.omega * RPM, label=f"{run.kind}, true", **style)
        draw_band(axes[1], run.t, run.speed_error, run.kind, style)
        draw_band(axes[3], run.t, run.angle_error, run.kind, style)
    first = runs[0]
    late = first.t >= first.t[-1] - 0.03
    axes[2].plot(first.t[late], first.x[late, 3], color=COLOURS[first.kind], lw=1.4, label=f"{first.kind}, estimate")
    wrapped = np.remainder(first.theta[late] + np.pi, 2 * np.pi) - np.pi
    axes[2].plot(first.t[late], wrapped, color=COLOURS["truth"], ls="--", lw=0.9, label="true")
    labels = ("speed, r/min", "speed error, r/min", "position,\nrad electrical", "position error,\ndeg electrical")
    numbers = NUMBERS.get(scenario.name, (0, 0, 0, 0)) if numbered else (0, 0, 0, 0)
    for axis, label, number in zip(axes, labels, numbers, strict=True):
        axis.set_ylabel(label, fontsize=8)
        axis.set_title(f"fig. {number}" if number else "", loc="left", fontsize=8)
        axis.legend(loc="lower right", ncols=len(runs), fontsize=7, bbox_to_anchor=(1.0, 0.97))
    axes[3].set_xlabel("time, s")
    return svg_text(figure)


def loop_figure(run: Run) -> str:
    """One run at a glance: the speed, true and estimated, and the errors of speed and angle.

    Parameters
    ----------
    run : Run
    """
    figure, axes = pyplot().subplots(3, 1, figsize=(6.2, 3.9), height_ratios=(1.6, 1, 1))
    thin = slice(None, None, max(1, len(run.t) // (4 * SLICES)))
    style: dict[str, Any] = {"color": COLOURS[run.kind], "ls": "-", "lw": 0.9}
    axes[0].plot(run.t[thin], run.x[thin, 2] * RPM, color=COLOURS[run.kind], lw=1.4, label=f"{run.kind}, estimate")
    axes[0].plot(run.t[thin], run.omega[thin] * RPM, color=COLOURS["truth"], ls="--", lw=0.9, label="true")
    if run.scenario.load:
        axes[0].axvline(run.scenario.load_at, color=COLOURS["truth"], lw=0.8, ls=":")
        axes[0].annotate(f" {run.scenario.load:.3g} N m", (run.scenario.load_at, 0.06), xycoords=_BELOW, fontsize=8)
    draw_band(axes[1], run.t, run.speed_error, run.kind, style)
    draw_band(axes[2], run.t, run.angle_error, run.kind, style)
    for axis, label in zip(axes, ("speed, r/min", "its error,\nr/min", "angle error,\ndeg el."), strict=True):
        axis.set_ylabel(label, fontsize=8)
    axes[0].legend(loc="lower right", ncols=2, fontsize=8, bbox_to_anchor=(1.0, 0.97))
    axes[2].set_xlabel("time, s", fontsize=8)
    return svg_text(figure)


def draw_band(axis: Any, t: Any, values: Any, label: str, style: dict[str, Any]) -> None:
    """A noisy quantity as the band between its extremes in each of some 80 slices of time."""
    from matplotlib.colors import to_rgba

    width = max(1, len(values) // SLICES)
    count = len(values) // width
    slices = values[: count * width].reshape(count, width)
    middle = t[: count * width].reshape(count, width).mean(axis=1)
    low, high = slices.min(axis=1), slices.max(axis=1)
    drawn = {"edgecolor": style["color"], "ls": style.get("ls", "-"), "lw": style["lw"], "label": label}
    axis.fill_between(middle, low, high, facecolor=to_rgba(style["color"], 0.12), **drawn)
    for edge in (low, high):  # for the values that the figure tells; the band's own outline is what is seen
        axis.plot(middle, edge, color=style["color"], ls=style.get("ls", "-"), label=f"_{label}", visible=False)


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
                    xycoords=_BELOW,
                    color=colour,
                    ha="right",
                )
                axes.axvline(p.sample_time * 1e6, color=colour, lw=0.8, ls=":")
    axes.set(xlabel="sample time, us", ylabel="largest speed error\nwhile starting, r/min", ylim=(0, None))
    axes.legend(loc="upper left")
    return svg_text(figure)
