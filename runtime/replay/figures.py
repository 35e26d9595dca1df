"""A replay drawn: estimate against truth, and the innovations."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from runtime.drive.figures import COLOURS
from runtime.recorded.truth import angle_error, speed_error
from runtime.recorded.units import RPM
from runtime.replay.replay import Array, Replay
from runtime.replay.statistics import LAGS, NIS_BAND, mean_band
from runtime.style.figures import pyplot, svg_text
from runtime.system.files import make_folder, write_text

ESTIMATE, TRUTH, BAND = "#3b6ea8", COLOURS["truth"], "#c8553d"

#: Points a noisy curve is thinned to: pairs of extremes.
SLICES = 400


@np.errstate(all="ignore")  # a diverged filter is drawn as far as it goes
def write_figures(replay: Replay, folder: Path) -> list[Path]:
    """Write estimate.svg and innovations.svg to a folder.

    Parameters
    ----------
    replay : Replay
    folder : Path
        Made if it is missing.

    Returns
    -------
    list of Path
        The files written.
    """
    texts = {"estimate.svg": estimate_figure(replay), "innovations.svg": innovation_figure(replay)}
    make_folder(folder)
    for name, text in texts.items():
        write_text(folder / name, text)
    return [folder / name for name in texts]


def estimate_figure(replay: Replay) -> str:
    """Speed, position and the slow states, estimate against truth; their errors within two sigma of the filter's.

    Parameters
    ----------
    replay : Replay

    Returns
    -------
    str
        SVG: time in s, speed in r/min, angle in electrical degrees, other states in their own units.
    """
    rows = _estimate_rows(replay)
    figure, axes = pyplot().subplots(len(rows), 1, figsize=(7.5, 1.75 * len(rows)), squeeze=False)
    for axis, draw in zip(axes[:, 0], rows, strict=True):
        draw(axis)
        _legend(axis)
    axes[-1, 0].set_xlabel("time, s")
    return svg_text(figure)


def _estimate_rows(replay: Replay) -> list[Any]:
    """One drawing function a panel."""
    t, x, truth = replay.recorded.t, replay.x, replay.recorded.truth
    thin = _thinned(len(t))
    variances = np.diagonal(replay.P(thin), axis1=1, axis2=2)

    def sigma(state: int) -> Array:
        return np.asarray(np.sqrt(variances[:, state]))

    def compared(axis: Any, state: int, label: str, scale: float, true: Array | None) -> None:
        _band(axis, t, x[:, state] * scale, ESTIMATE, "estimate")
        if true is not None:
            axis.plot(t[thin], true[thin] * scale, color=TRUTH, ls="--", lw=0.9, label="true")
        axis.set_ylabel(label, fontsize=8)

    def error(axis: Any, e: Array, two_sigma: Array, label: str) -> None:
        _band(axis, t, e, ESTIMATE, "error")
        axis.plot(t[thin], two_sigma, color=BAND, lw=0.8, ls="--", label="2 sigma of the filter")
        axis.plot(t[thin], -two_sigma, color=BAND, lw=0.8, ls="--")
        axis.set_ylabel(label, fontsize=8)
        _limits(axis, e, two_sigma)

    rows: list[Any] = [lambda axis: compared(axis, 2, "speed, r/min", RPM, truth.get("omega"))]
    if "omega" in truth:
        e_speed = speed_error(x, truth["omega"])
        rows.append(lambda axis: error(axis, e_speed, 2 * sigma(2) * RPM, "speed error,\nr/min"))
    rows.append(lambda axis: _position(axis, replay))
    if "theta" in truth:
        e_angle = angle_error(x, truth["theta"])
        rows.append(lambda axis: error(axis, e_angle, 2 * np.degrees(sigma(3)), "position error,\ndeg electrical"))
    for k, (name, unit) in enumerate(zip(replay.state_names, replay.state_units, strict=True)):
        if k > 3:
            label = f"{name.replace('_', ' ')}, {unit}"
            rows.append(lambda axis, k=k, name=name, label=label: compared(axis, k, label, 1.0, truth.get(name)))
    return rows


def _position(axis: Any, replay: Replay) -> None:
    """The last stretch, some turns long at most."""
    t, theta = replay.recorded.t, replay.x[:, 3]
    turns = np.abs(np.diff(theta, prepend=theta[:1])) > np.pi
    back = np.flatnonzero(turns)
    first = max(int(back[-5]) if len(back) >= 5 else 0, len(t) - 100_000)
    late = slice(first, None)
    axis.plot(t[late], np.where(turns, np.nan, theta)[late], color=ESTIMATE, lw=1.4, label="estimate")
    if "theta" in replay.recorded.truth:
        true = np.remainder(replay.recorded.truth["theta"][late] + np.pi, 2 * np.pi) - np.pi
        jumps = np.abs(np.diff(true, prepend=true[:1])) > np.pi
        axis.plot(t[late], np.where(jumps, np.nan, true), color=TRUTH, ls="--", lw=0.9, label="true")
    axis.set_ylabel("position,\nrad electrical", fontsize=8)


def innovation_figure(replay: Replay) -> str:
    """Innovations within two sigma, the normalised innovation squared with its band, the autocorrelation.

    Parameters
    ----------
    replay : Replay

    Returns
    -------
    str
        SVG: innovations in A over time in s.
    """
    found, consistency, t = replay.innovations, replay.consistency, replay.recorded.t
    figure, axes = pyplot().subplots(4, 1, figsize=(7.5, 8.0))
    thin = _thinned(len(t))
    for axis, k, element, name in zip(axes, (0, 1), (0, 2), ("alpha", "beta"), strict=False):
        two_sigma = 2 * np.sqrt(found.S[thin, element])
        _band(axis, t, found.nu[:, k], ESTIMATE, "innovation")
        axis.plot(t[thin], two_sigma, color=BAND, lw=0.9, ls="--", label="2 sigma expected")
        axis.plot(t[thin], -two_sigma, color=BAND, lw=0.9, ls="--")
        axis.set_ylabel(f"innovation {name}, A", fontsize=8)
    nis = found.squared()
    width = max(1, len(t) // SLICES)
    axes[2].plot(*_slice_means(t, nis, width), color=ESTIMATE, lw=1.0, label=f"mean over {width} steps")
    axes[2].axhline(2.0, color=TRUTH, lw=0.8, label="expected: 2")
    band = mean_band(width) if width > 1 else NIS_BAND
    for edge, label in zip(band, ("95 % of such means", None), strict=True):
        axes[2].axhline(edge, color=BAND, lw=0.9, ls="--", label=label)
    axes[2].set(yscale="log", xlabel="time, s")
    axes[2].set_ylabel("normalised innovation\nsquared", fontsize=8)
    if consistency is not None:
        for k, (row, name) in enumerate(zip(consistency.correlation, ("alpha", "beta"), strict=True)):
            lags = np.arange(1, LAGS + 1) + 0.2 * (2 * k - 1)
            axes[3].bar(lags, row, 0.35, color=(ESTIMATE, "#e0a030")[k], label=name)
        edge = consistency.correlation_band
        axes[3].axhspan(-edge, edge, color=BAND, alpha=0.15, lw=0, label="95 % of white noise")
        axes[3].axhline(0.0, color=TRUTH, lw=0.6)
    axes[3].set(xlabel="lag, samples", xticks=range(1, LAGS + 1))
    axes[3].set_ylabel("autocorrelation", fontsize=8)
    for axis in axes:
        _legend(axis)
    return svg_text(figure)


def _legend(axis: Any) -> None:
    if axis.get_legend_handles_labels()[0]:
        axis.legend(loc="lower right", ncols=4, fontsize=7, bbox_to_anchor=(1.0, 0.97))


def _thinned(length: int) -> Array:
    """Some 800 rows, evenly spread, first and last among them."""
    return np.unique(np.linspace(0, length - 1, min(length, 2 * SLICES)).astype(int))


def _band(axis: Any, t: Array, values: Array, colour: str, label: str) -> None:
    """A curve; of more points than a picture has columns, the band between its extremes."""
    if len(t) <= 4 * SLICES:
        axis.plot(t, values, color=colour, lw=0.8, label=label)
        return
    width = len(t) // SLICES
    low, high = (_by_slices(values, width, extreme) for extreme in (np.min, np.max))
    axis.fill_between(t[: len(low) * width : width], low, high, color=colour, lw=0.8, alpha=0.85, label=label)


def _slice_means(t: Array, values: Array, width: int) -> tuple[Array, Array]:
    means = _by_slices(values, width, np.mean)
    return t[: len(means) * width : width], means


def _by_slices(values: Array, width: int, figure: Callable[[Array], Any]) -> Array:
    """A figure of each whole slice of so many values, of those that are numbers; a long record is never copied."""
    found = np.full(len(values) // width, np.nan)
    for k in range(len(found)):
        piece = values[k * width : (k + 1) * width].astype(float)
        piece = piece[np.isfinite(piece)]
        if len(piece):
            found[k] = figure(piece)
    return found


def _limits(axis: Any, e: Array, two_sigma: Array) -> None:
    """An axis that shows the error, not the width of P_0 at the start."""
    shown = e[np.isfinite(e)]
    if len(shown) and len(two_sigma):
        edge = 1.15 * max(float(np.max(np.abs(shown))), 1.3 * float(np.nanmedian(two_sigma)), 1e-12)
        axis.set_ylim(-edge, edge)
