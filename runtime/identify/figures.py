"""Figures: innovations with the guesses and with what was found, and the likelihood along each datum."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.identify.identify import Identified
from runtime.identify.intervals import Z_95
from runtime.identify.likelihood import values
from runtime.identify.problem import Stage
from runtime.style.figures import pyplot, svg_text
from runtime.system.files import make_folder, write_text

Array = NDArray[Any]

BEFORE, AFTER = "#c8553d", "#3b6ea8"
#: Points of a curve, and how far it goes in half-widths of the interval.
POINTS, REACH = 33, 2.5
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
        for k, (colour, label) in enumerate(((BEFORE, "guesses"), (AFTER, "found"))):
            white = np.clip(told[:, 0, k] / sigma, -1e3, 1e3)
            axis.plot(t[thin], white[thin], color=colour, lw=0.6, alpha=0.85, label=label)
        axis.set_yscale("symlog", linthresh=5)
        axis.set_yticks([-1000, -100, -10, 0, 10, 100, 1000])
        axis.set(ylabel="innovation, sigma", title=problem.recordings[recording].recorded.path.name)
        axis.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, fontsize=7)
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
    from matplotlib.ticker import MaxNLocator

    problem, estimates = found.problem, found.result.estimates
    columns = 3
    rows = -(-len(estimates) // columns)
    figure, axes = pyplot().subplots(rows, columns, figsize=(7.5, 2.1 * rows), squeeze=False)
    for axis in axes.flat[len(estimates) :]:
        axis.axis("off")
    for axis, place, estimate in zip(axes.flat, problem.data, estimates, strict=False):
        x, height = along(found, place)
        axis.plot(x, height, color=AFTER)
        axis.axvspan(estimate.low, estimate.high, color=AFTER, alpha=0.12, lw=0)
        axis.axhline(-(Z_95**2) / 2, color="grey", lw=0.6, ls=":")
        if x[0] <= estimate.guess <= x[-1]:
            axis.axvline(estimate.guess, color=BEFORE, lw=0.8, ls="--")
        axis.set_ylim(-12, 1)
        axis.set_title(
            f"{estimate.datum.word}, {estimate.datum.unit}" + ("" if estimate.told else " (not shown)"), fontsize=8
        )
        axis.tick_params(labelsize=6)
        axis.xaxis.get_offset_text().set_fontsize(6)
        axis.xaxis.set_major_locator(MaxNLocator(4))
    for axis in axes[:, 0]:
        axis.set_ylabel("log likelihood", fontsize=7)
    return svg_text(figure)


def along(found: Identified, place: int) -> tuple[Array, Array]:
    """Values of a datum and the log likelihood there, relative to the best, (33,) each.

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
    ends = (
        np.log([estimate.low, estimate.high])
        if unknown.positive
        else np.array([estimate.low, estimate.high]) / unknown.size
    )
    half = (ends[1] - ends[0]) / 2
    steps = np.linspace(-REACH, REACH, POINTS) * half
    found_at = values(problem, q[:, None] + direction[:, None] * steps, Stage())
    return np.asarray(unknown.value(q[place] + steps)), found.found.slope.value - found_at
