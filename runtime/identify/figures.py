"""Figures: innovations with the guesses and with what was found, and the likelihood along each datum.

A datum's axis is its deviation from what was found, in per cent: what an engineer asks of an interval. A datum that the
recordings do not show has a logarithmic axis of its values, over all that its guess may be off.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.identify.identify import Identified
from runtime.identify.intervals import Z_95, Estimate
from runtime.identify.likelihood import values
from runtime.identify.problem import Stage
from runtime.style.figures import pyplot, svg_text
from runtime.system.files import make_folder, write_text

Array = NDArray[Any]

BEFORE, AFTER = "#c8553d", "#3b6ea8"
#: Points of a curve, and how far it goes in half-widths of the interval.
POINTS, REACH = 33, 2.0
#: Points that a recording's innovations are thinned to.
DRAWN = 2000


def write_figures(found: Identified, folder: Path) -> list[Path]:
    """Write innovations.svg and likelihood.svg to a folder, which is made if it is missing.

    Parameters
    ----------
    found : Identified
    folder : Path
    """
    texts = {"innovations.svg": innovations_figure(found), "likelihood.svg": likelihood_figure(found)}
    make_folder(folder)
    for name, text in texts.items():
        write_text(folder / name, text)
    return [folder / name for name in texts]


def innovations_figure(found: Identified) -> str:
    """Innovations in sigmas of the filter that was found, alpha: with the guesses of the data, and with what was found.

    Shaded: where 95 % of them lie if the model is right. Where the load steps is marked.

    Parameters
    ----------
    found : Identified

    Returns
    -------
    str
        SVG.
    """
    problem, q = found.problem, found.found.q
    guessed = q.copy()
    guessed[problem.data] = problem.guess[problem.data]
    figure, axes = pyplot().subplots(
        len(problem.recordings), 1, figsize=(7.5, 2.2 * len(problem.recordings)), squeeze=False
    )
    for recording, axis in enumerate(axes[:, 0]):
        blocks = list(problem.innovations(np.column_stack([guessed, q]), recording, Stage()))
        told = np.concatenate([block for _, block in blocks])
        sigma = np.sqrt(told[:, 2, 1])
        t = problem.subject.facts.T * np.arange(1, len(told) + 1)
        thin = slice(None, None, max(1, len(t) // DRAWN))
        axis.axhspan(-Z_95, Z_95, color="grey", alpha=0.15, lw=0)
        for k, (colour, label) in enumerate(((BEFORE, "with the guesses"), (AFTER, "with what was found"))):
            white = np.clip(told[:, 0, k] / sigma, -1e3, 1e3)
            axis.plot(t[thin], white[thin], color=colour, lw=0.6, alpha=0.85, label=label)
        for k, at in enumerate(problem.recordings[recording].load_steps):
            axis.axvline(at, color="black", lw=0.8, ls="--", label=None if k else "the load steps")
        axis.set_yscale("symlog", linthresh=5)
        axis.set_yticks([-1000, -100, -10, 0, 10, 100, 1000])
        axis.yaxis.set_major_formatter("{x:g}")
        axis.set_ylabel("innovation, sigma")
        axis.set_title(f"{problem.recordings[recording].recorded.path.name}, i_alpha", loc="left")
        axis.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, fontsize=7)
    axes[-1, 0].set_xlabel("time, s")
    return svg_text(figure)


def likelihood_figure(found: Identified) -> str:
    """Log likelihood along each datum, the other unknowns moved along with it; its 95 % interval and the guess.

    Parameters
    ----------
    found : Identified

    Returns
    -------
    str
        SVG.
    """
    problem, estimates = found.problem, found.result.estimates
    columns = min(3, len(estimates))
    rows = -(-len(estimates) // columns)
    figure, axes = pyplot().subplots(rows, columns, figsize=(2.5 * columns, 2.3 * rows + 0.4), squeeze=False)
    for axis in axes.flat[len(estimates) :]:
        axis.axis("off")
    for axis, place, estimate in zip(axes.flat, problem.data, estimates, strict=False):
        _draw_datum(axis, estimate, *along(found, place))
    for axis in axes[:, 0]:
        axis.set_ylabel("log likelihood", fontsize=7)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=7)
    return svg_text(figure)


def _draw_datum(axis: Any, estimate: Estimate, x: Array, height: Array) -> None:
    """One curve, in per cent off what was found; of signed data and those that are not shown in their unit."""
    datum = estimate.datum
    percent = datum.positive and estimate.told
    name = f"{datum.word}, {datum.unit}"
    if percent:
        x = 100 * (x / estimate.value - 1)
        low, high, guess = (100 * (v / estimate.value - 1) for v in (estimate.low, estimate.high, estimate.guess))
        name = "off what was found, %"
    else:
        low, high, guess = estimate.low, estimate.high, estimate.guess
    if datum.positive and not estimate.told:
        axis.set_xscale("log")
        axis.set_xticks([low, estimate.value, high], [f"{v:.2g}" for v in (low, estimate.value, high)])
        axis.set_xticks([], minor=True)
    axis.plot(x, height, color=AFTER, label="likelihood")
    axis.axvspan(low, high, color=AFTER, alpha=0.12, lw=0, label="95 % interval")
    axis.axhline(-(Z_95**2) / 2, color="grey", lw=1.0, ls=":", label="where a right model would end it")
    axis.plot([], [], color=BEFORE, lw=0.8, ls="--", label="guess")
    if x[0] <= guess <= x[-1]:
        axis.axvline(guess, color=BEFORE, lw=0.8, ls="--")
    axis.set_ylim(-12, 1)
    axis.set_xlim(x[0], x[-1])
    if axis.get_xscale() == "linear":
        axis.locator_params(axis="x", nbins=4)
    said = f"{datum.word} = {estimate.value:.4g} {datum.unit}" if estimate.told else f"{datum.word} (not shown)"
    axis.set_title(f"{said}\nguess {estimate.guess:.4g}", fontsize=8)
    axis.set_xlabel(name, fontsize=7)
    axis.tick_params(labelsize=6)


def along(found: Identified, place: int) -> tuple[Array, Array]:
    """Values of a datum and the log likelihood there, relative to the best, (33,) each.

    Two half-widths of the interval either way; what is not told, over its interval.

    Parameters
    ----------
    found : Identified
    place : int
        Of the datum in the search vector.
    """
    problem, q = found.problem, found.found.q
    inverse = np.linalg.inv(found.found.slope.information)
    direction = inverse[:, place] / inverse[place, place]
    estimate = found.result.estimates[problem.data.index(place)]
    unknown = problem.unknowns[place]
    ends = np.array([estimate.low, estimate.high])
    ends = np.log(ends) if unknown.positive else ends / unknown.size
    half = REACH * (ends[1] - ends[0]) / 2
    first, last = (-half, half) if estimate.told else (ends[0] - q[place], ends[1] - q[place])
    steps = np.linspace(float(first), float(last), POINTS)
    found_at = values(problem, q[:, None] + direction[:, None] * steps, Stage())
    return np.asarray(unknown.value(q[place] + steps)), found.found.slope.value - found_at
