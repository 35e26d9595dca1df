"""Figures of a proof as SVG text: crisp, axes with units, one colour a filter throughout."""

from __future__ import annotations

import numpy as np

from runtime.drive.figures import SLICES, draw_band
from runtime.proof.link_ab import ALLOWED
from runtime.proof.link_cd import envelope
from runtime.proof.result import Proof
from runtime.proof.tables import COUNTS, stages_by_equation
from runtime.proof.verify import Evidence
from runtime.style.figures import pyplot, svg_text

#: Where a logarithmic axis shows no deviation at all.
NONE = 1e-17

COLOURS = {"ckf": "#3b6ea8", "ickf, cubature gain": "#c8553d", "ickf, jacobian gain": "#e0a030", "truth": "#444444"}


def stage_figure(proof: Proof) -> str:
    """Worst A-B deviation of every stage, by equation, against what is allowed.

    Parameters
    ----------
    proof : Proof
        All links of a drive.
    """
    stages = {key: cells for key, cells in stages_by_equation(proof.links).items() if key[1] not in COUNTS}
    figure, axes = pyplot().subplots(figsize=(7.5, 0.19 * len(stages) + 1.1))
    labels = [f"({equation})  {stage}" for equation, stage in stages]
    for variant in dict.fromkeys(variant for cells in stages.values() for variant in cells):
        points = [(max(cells[variant], NONE), k) for k, cells in enumerate(stages.values()) if variant in cells]
        worst, rows = zip(*points, strict=True)
        axes.plot(worst, rows, "o", ms=4.5, alpha=0.85, color=COLOURS.get(variant), label=variant)
    axes.axvline(ALLOWED, color="#444444", lw=1, ls="--")
    axes.text(ALLOWED, -0.9, "allowed ", ha="right", va="center", fontsize=8)
    axes.set(xscale="log", xlim=(NONE / 2, 1e-9), ylim=(len(stages) - 0.4, -1.4))
    axes.set_xlabel("worst deviation on the row's scale (leftmost: none at all)")
    axes.set_yticks(range(len(labels)), labels, fontsize=8)
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
    return svg_text(figure)


def drift_figure(evidence: Evidence, sample_time: float, units: dict[str, str]) -> str:
    """Float32 minus float64 over the long run: envelopes of each state, and of P.

    Parameters
    ----------
    evidence : Evidence
        What the links leave for figures.
    sample_time : float
        T, s.
    units : dict of str to str
    """
    panels = [*units, "P"]
    figure, axes = pyplot().subplots(len(panels), 1, figsize=(7.5, 1.25 * len(panels) + 0.6), sharex=True)
    for variant, drift in evidence.drift.items():
        for k, axis in enumerate(axes):
            ends, top = envelope(drift.x[:, k] if k < len(units) else drift.P, SLICES // 2)
            time = sample_time * drift.steps[ends - 1]
            axis.semilogy(time, np.maximum(top, 1e-12), lw=1, color=COLOURS.get(variant), label=variant)
    for name, axis in zip(panels, axes, strict=True):
        axis.set_ylabel(f"{name}\n{units.get(name, 'relative')}", fontsize=8)
        axis.minorticks_off()
    axes[0].legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
    axes[-1].set_xlabel("time, s")
    return svg_text(figure)


def effect_figure(evidence: Evidence) -> str:
    """ICKF minus CKF in sigmas along the trajectory.

    Parameters
    ----------
    evidence : Evidence
        What the links leave for figures.
    """
    figure, axes = pyplot().subplots(figsize=(7.5, 2.4))
    for gain, difference in evidence.effects.items():
        steps, top = envelope(difference)
        time = evidence.t[steps - 1]
        axes.semilogy(
            time, np.where(top > 0, top, np.nan), lw=1, color=COLOURS[f"ickf, {gain} gain"], label=f"{gain} gain"
        )
    axes.set(xlabel="time, s", ylabel="ICKF - CKF, sigmas")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    return svg_text(figure)


def trajectory_figure(evidence: Evidence) -> str:
    """The trajectory of the proof: speed, currents and voltages.

    Parameters
    ----------
    evidence : Evidence
        What the links leave for figures.
    """
    data = evidence.trajectory
    figure, axes = pyplot().subplots(3, 1, figsize=(7.5, 4.2), sharex=True)
    axes[0].plot(data.t, data.omega * 30 / np.pi, color=COLOURS["truth"], lw=1.2)
    axes[0].set_ylabel("speed, r/min")
    for axis, values, label in ((axes[1], data.y, "i, A"), (axes[2], data.u, "v, V")):
        for k, (name, colour) in enumerate((("alpha", "#3b6ea8"), ("beta", "#c8553d"))):
            draw_band(axis, data.t, values[:, k], name, {"lw": 0.7, "color": colour})
        axis.set_ylabel(label)
    axes[1].legend(loc="lower right", bbox_to_anchor=(1.0, 0.95), ncols=2, fontsize=8)
    axes[2].set_xlabel("time, s")
    return svg_text(figure)
