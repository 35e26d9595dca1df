"""Drives side by side, drawn: structure of F and H, costs, errors over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from runtime.compare.facts import costs, kinds
from runtime.compare.subject import CONSTANT, ONE, VARYING, ZERO, Subject
from runtime.drive.figures import draw_band
from runtime.style.figures import pyplot, svg_text

#: One colour a drive; more drives begin again.
COLOURS = ("#3b6ea8", "#c8553d", "#5a9e6f", "#e0a030", "#8a6bb1", "#666666", "#4aa5b5")

_SHADES = {ZERO: 0, CONSTANT: 1, ONE: 2, VARYING: 3}
_PALETTE = ("#f4f4f4", "#a9c4df", "#d8d8d8", "#3b6ea8")
_MEANINGS = {VARYING: "depends on state or input", CONSTANT: "constant", ONE: "one", ZERO: "zero"}

_SYMBOLS = {
    "alpha": r"\alpha", "beta": r"\beta", "psi": r"\psi", "omega": r"\omega", "theta": r"\theta",
}  # fmt: skip
_LETTERS = {"load_torque": "$T_L$", "magnet_flux": r"$\psi_m$", "stator_resistance": "$R$"}


def sparsity_figure(subjects: Sequence[Subject]) -> str:
    """F above H, one drive a column."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    n = max(len(subject.state_names) for subject in subjects)
    size = (max(7.5, 2.4 * len(subjects)), 0.27 * (n + 2) + 1.9)
    ratios = {"height_ratios": (n, 2.0)}
    figure, axes = pyplot().subplots(2, len(subjects), figsize=size, squeeze=False, gridspec_kw=ratios)
    for column, subject in enumerate(subjects):
        names = [_letter(name) for name in subject.state_names]
        for axis, which, left in zip(axes[:, column], "FH", (names, [r"$i_\alpha$", r"$i_\beta$"]), strict=True):
            shades = np.array([[_SHADES[mark] for mark in row] for row in subject.patterns[which]])
            axis.pcolormesh(shades, cmap=ListedColormap(_PALETTE), vmin=0, vmax=3, edgecolors="white", lw=1.5)
            axis.set_aspect("equal")
            axis.invert_yaxis()
            axis.grid(visible=False)
            axis.set_xticks(np.arange(shades.shape[1]) + 0.5, names, fontsize=8)
            axis.set_yticks(np.arange(shades.shape[0]) + 0.5, left, fontsize=8)
            axis.tick_params(length=0)
            for spine in axis.spines.values():
                spine.set_visible(False)
            filled = int(np.count_nonzero(shades))
            title = f"{which}, {filled} of {shades.size}"
            axis.set_title(f"{subject.label}\n{title}" if which == "F" else title, fontsize=8)
    patches = [Patch(color=_PALETTE[_SHADES[mark]], label=meaning) for mark, meaning in _MEANINGS.items()]
    figure.legend(handles=patches, loc="outside lower center", ncols=4, fontsize=8)
    return svg_text(figure)


def cost_figure(subjects: Sequence[Subject]) -> str:
    """Bars by filter: cycles, RAM, stack, code."""
    found = costs(subjects)
    panels = {
        "cycles a step, k = 2.5 (line: 5)": [cost.typical or 0 for cost in found],
        "RAM, 16-bit words": [cost.ram_words for cost in found],
        "stack, bytes (M4F)": [cost.stack or 0 for cost in found],
        "code, bytes (M4F)": [cost.text or 0 for cost in found],
    }
    figure, grid = pyplot().subplots(2, 2, figsize=(7.5, 0.6 + 2 * (0.5 + 0.2 * len(found))), sharey=True)
    labels = [subject.label for subject in subjects]
    colours = [COLOURS[labels.index(cost.label) % len(COLOURS)] for cost in found]
    groups = kinds(subjects)
    places = [k + 0.7 * groups.index(cost.kind) for k, cost in enumerate(found)]
    for axis, (title, values) in zip(grid.flat, panels.items(), strict=True):
        bars = axis.barh(places, values, 0.85, color=colours)
        if title.startswith("cycles"):
            bound = [cost.bound or 0 for cost in found]
            axis.hlines(places, values, bound, color=colours, lw=1.2)
        axis.bar_label(bars, fmt="{:,.0f}", fontsize=7, label_type="center", color="white")
        axis.set_xlabel(title, fontsize=8)
        axis.tick_params(labelsize=7)
        axis.set_yticks(places, [f"{cost.label}  {cost.kind}" for cost in found], fontsize=7)
    grid[0][0].invert_yaxis()
    return svg_text(figure)


def accuracy_figure(subjects: Sequence[Subject], kind: str) -> str:
    """Errors of speed and position over time, both scenarios, of the drives that ship a filter."""
    names = list(dict.fromkeys(run.scenario.name for subject in subjects for run in subject.runs))
    figure, axes = pyplot().subplots(2 * len(names), 1, figsize=(7.5, 3.6 * len(names)), squeeze=False, sharex=True)
    for row, name in enumerate(names):
        for k, subject in enumerate(subjects):
            for run in subject.runs:
                if (run.scenario.name, run.kind) == (name, kind):
                    style: dict[str, Any] = {"color": COLOURS[k % len(COLOURS)], "ls": "-", "lw": 0.9}
                    draw_band(axes[2 * row, 0], run.t, run.speed_error, subject.label, style)
                    draw_band(axes[2 * row + 1, 0], run.t, run.angle_error, subject.label, style)
        axes[2 * row, 0].set_title(f"{name}, {kind}", loc="left", fontsize=8)
        axes[2 * row, 0].set_ylabel("speed error, r/min", fontsize=8)
        axes[2 * row + 1, 0].set_ylabel("position error,\ndeg electrical", fontsize=8)
        axes[2 * row, 0].legend(loc="lower right", ncols=4, fontsize=7, bbox_to_anchor=(1.0, 0.97))
    axes[-1, 0].set_xlabel("time, s")
    return svg_text(figure)


def _letter(name: str) -> str:
    """A state's name as one writes it."""
    if name in _LETTERS:
        return _LETTERS[name]
    stem, _, index = name.partition("_")
    letter = _SYMBOLS.get(stem, stem)
    return f"${letter}_{{{_SYMBOLS.get(index, index)}}}$" if index else f"${letter}$"
