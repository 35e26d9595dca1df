"""The figure of a soak: how far float32 and float64 are apart, decade by decade."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from runtime.endurance.soak import WITHIN, Soak
from runtime.style.figures import pyplot, svg_text
from runtime.system.files import make_folder, write_text


def write_soak_figure(soaks: Sequence[Soak], folder: Path) -> Path:
    """``soak.svg`` in a folder that is made if need be."""
    make_folder(folder)
    path = folder / "soak.svg"
    write_text(path, soak_figure(soaks))
    return path


def soak_figure(soaks: Sequence[Soak]) -> str:
    """Largest deviation of speed and angle in each decade of steps over the reference; both axes logarithmic."""
    figure, axes = pyplot().subplots(1, 2, figsize=(7.5, 2.8), sharey=True)
    for axis, name in zip(axes, ("omega", "theta"), strict=True):
        for result in soaks:
            k = result.names.index(name)
            ratios = [decade.deviation[k] / result.reference[k] for decade in result.decades]
            axis.loglog([decade.until for decade in result.decades], ratios, "o-", ms=3, lw=1, label=result.drive)
        axis.axhline(WITHIN, color="#c8553d", lw=0.8, ls="--")
        axis.set_xlabel("steps")
        axis.set_title(name, fontsize=9)
    axes[0].set_ylabel("largest |float32 - float64|\nover that of 100 000 steps", fontsize=8)
    figure.legend(*axis.get_legend_handles_labels(), fontsize=8, loc="outside upper center", ncols=3)
    return svg_text(figure)
