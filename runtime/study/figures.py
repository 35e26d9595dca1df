"""Figures of a study: how errors are distributed, where starts fail, and the front of a tuning."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from runtime.drive.figures import COLOURS
from runtime.study.analysis import FIGURES, success_over
from runtime.study.run import Group, Study
from runtime.study.statement import Range
from runtime.study.tune import OBJECTIVES, Tuned
from runtime.style.figures import pyplot, svg_text
from runtime.system.files import write_text

#: Cells along each side of a map, slices of an angle.
CELLS, SLICES = 10, 24


def write_figures(study: Study) -> list[Path]:
    """Every figure that the study's variables allow, as SVG in its folder."""
    varied = [item for item in study.statement.ranges if not item.fixed]
    figures = {}
    for drive in dict.fromkeys(group.drive for group in study.groups):
        groups = [group for group in study.groups if group.drive == drive]
        figures[f"{drive}_errors"] = violin_figure(groups)
        if any(item.name == "theta" for item in varied):
            figures[f"{drive}_success_over_theta"] = angle_figure(groups, next(i for i in varied if i.name == "theta"))
        if len(varied) >= 2:
            figures[f"{drive}_map"] = map_figure(groups, most_telling(groups, varied))
    return _write(study.folder, figures)


def write_front(tuned: Tuned, folder: Path) -> list[Path]:
    """The front of a tuning, as SVG."""
    return _write(folder, {"front": front_figure(tuned)})


def _write(folder: Path, figures: dict[str, str]) -> list[Path]:
    paths = []
    for name, text in figures.items():
        paths.append(folder / f"{name}.svg")
        write_text(paths[-1], text)
    return paths


def violin_figure(groups: Sequence[Group]) -> str:
    """Each figure's distribution over the runs that locked; ticks at 5, 50 and 95 %. Errors on a logarithmic axis."""
    figure, axes = pyplot().subplots(1, len(FIGURES), figsize=(7.5, 2.8))
    for axis, (name, unit) in zip(axes, FIGURES.items(), strict=True):
        for k, group in enumerate(groups):
            values = getattr(group.outcomes, name)[group.outcomes.good]
            if name != "lock_time":  # a start at the right angle takes no time
                values = np.log10(np.maximum(values, 1e-6))
            if values.size < 2 or np.ptp(values) == 0:
                continue
            colour = COLOURS[group.kind]
            parts = axis.violinplot(values, [k], widths=0.8, showextrema=False)
            parts["bodies"][0].set(facecolor=colour, alpha=0.35)
            low, middle, high = np.quantile(values, (0.05, 0.5, 0.95))
            axis.vlines(k, low, high, color=colour, lw=1.2)
            axis.plot([k] * 3, [low, middle, high], "_", color=colour, ms=9)
        axis.set_xticks(range(len(groups)), [group.kind for group in groups])
        if name != "lock_time":
            axis.set_yticks(round_ticks(*axis.get_ylim()))
            axis.yaxis.set_major_formatter(lambda value, position: f"{10**value:.3g}")
        axis.set_title(f"{name.replace('_', ' ')}, {unit}", fontsize=8)
    return svg_text(figure)


def round_ticks(low: float, high: float) -> list[float]:
    """Logarithms to base 10 of round numbers between two logarithms: decades, or steps of 1, 2, 5, or finer.

    Parameters
    ----------
    low, high : float
        Of an axis.
    """
    decades = range(int(np.floor(low)), int(np.ceil(high)))
    found: list[float] = []
    for digits in ((1,), (1, 2, 5), range(1, 10), np.arange(10, 100) / 10):
        found = [decade + float(np.log10(digit)) for decade in decades for digit in digits]
        found = [tick for tick in found if low <= tick <= high]
        if len(found) >= 4:
            break
    return found


def angle_figure(groups: Sequence[Group], angle: Range) -> str:
    """Success over the rotor's angle at the start, with Wilson's interval as a band."""
    edges = np.linspace(angle.low, angle.high, SLICES + 1)
    middle = (edges[1:] + edges[:-1]) / 2
    figure, axis = pyplot().subplots(figsize=(7.5, 2.6))
    for group in groups:
        rates = success_over(group, "theta", edges)
        known = np.array([rate.runs > 0 for rate in rates])
        low, share, high = (100 * np.array([getattr(r, n) for r in rates])[known] for n in ("low", "rate", "high"))
        colour = COLOURS[group.kind]
        axis.fill_between(middle[known], low, high, color=colour, alpha=0.15, lw=0)
        axis.plot(middle[known], share, "o-", ms=3, lw=1, color=colour, label=group.kind)
    axis.set(xlabel="electrical angle at the start, deg", ylabel="success, %", ylim=(-3, 103))
    axis.legend(loc="lower center", ncols=len(groups))
    return svg_text(figure)


def most_telling(groups: Sequence[Group], varied: Sequence[Range]) -> tuple[Range, Range]:
    """The two variables whose map differs most from cell to cell, by success and then by the error at speed."""

    def spread(pair: tuple[Range, Range]) -> tuple[float, float]:
        success, rms = (_cells(groups[0], pair, what, 4) for what in ("good", "steady_rms"))
        return _deviation(success), _deviation(rms)

    return max(combinations(varied, 2), key=spread)


def _deviation(cells: Any) -> float:
    """Standard deviation of what is known of a map, to three digits behind the point."""
    known = cells[np.isfinite(cells)]
    return round(float(np.std(known)), 3) if known.size else 0.0


def map_figure(groups: Sequence[Group], pair: tuple[Range, Range]) -> str:
    """Success and the median error at speed over two variables, one row a filter."""
    x, y = pair
    figure, axes = pyplot().subplots(len(groups), 2, figsize=(7.5, 2.7 * len(groups)), squeeze=False)
    for row, group in zip(axes, groups, strict=True):
        for axis, what, label in zip(row, ("good", "steady_rms"), ("success, %", "steady rms, r/min"), strict=True):
            cells = _cells(group, pair, what, CELLS) * (100 if what == "good" else 1)
            limits: dict[str, Any] = {"vmin": 0, "vmax": 100} if what == "good" else {}
            extent = (x.low, x.high, y.low, y.high)
            image = axis.imshow(cells.T, origin="lower", aspect="auto", extent=extent, cmap="viridis", **limits)
            figure.colorbar(image, ax=axis)
            axis.grid(False)
            axis.set(xlabel=f"{x.name}, {x.unit}", ylabel=f"{y.name}, {y.unit}")
            axis.set_title(f"{group.kind}: {label}", fontsize=8, loc="left")
    return svg_text(figure)


def _cells(group: Group, pair: tuple[Range, Range], what: str, cells: int) -> Any:
    """(cells, cells): share of runs that locked, or median of a figure over those; NaN where there are none."""
    slots = []
    for item in pair:
        values = group.drawn[item.name]
        share = np.log(values / item.low) / np.log(item.high / item.low) if item.log else None
        share = (values - item.low) / (item.high - item.low) if share is None else share
        slots.append(np.clip((share * cells).astype(int), 0, cells - 1))
    locked, figure = group.outcomes.good, getattr(group.outcomes, what)
    found = np.full((cells, cells), np.nan)
    for i in range(cells):
        for j in range(cells):
            here = (slots[0] == i) & (slots[1] == j) & (locked if what != "good" else True)
            if here.any():
                found[i, j] = figure[here].mean() if what == "good" else np.median(figure[here])
    return found


def front_figure(tuned: Tuned) -> str:
    """All trials in two planes of the three objectives, the front and the recommended point marked."""
    figure, axes = pyplot().subplots(1, 2, figsize=(7.5, 3.4))
    for axis, (a, b) in zip(axes, ((1, 2), (1, 0)), strict=True):
        tried = np.array([point.values for point in tuned.points])
        axis.loglog(tried[:, a], tried[:, b], ".", color="#bbbbbb", ms=4, label="trials")
        front = np.array([point.values for point in tuned.front])
        axis.loglog(front[:, a], front[:, b], "o", color=COLOURS["ckf"], ms=4, label="front")
        for point, mark, colour, label in (
            (tuned.own, "s", "#444444", "drive file"),
            (tuned.recommended, "*", COLOURS["ickf"], "recommended"),
        ):
            axis.loglog(point.values[a], point.values[b], mark, color=colour, ms=9, label=label)
        axis.set(xlabel=f"{OBJECTIVES[a]}, r/min", ylabel=f"{OBJECTIVES[b]}, r/min")
    axes[0].legend(fontsize=7)
    return svg_text(figure)
