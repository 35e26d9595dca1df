"""The map of a drive as a table, a figure and a page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table
from rich.text import Text

from runtime.study.map import FLUXES, LOADS, RESISTANCES, SPEEDS, Map
from runtime.style.figures import pyplot, svg_text
from runtime.style.pages import page_template
from runtime.style.svg import themed
from runtime.style.tables import columns_table
from runtime.system.files import make_folder, write_text

#: Corners that a table shows.
LINES = 20
#: Runs that were lost are marked so.
LOST = "\u00d7"


def speed_table(found: Map) -> Table:
    """A row a speed: good runs and largest angle with exact data, with R a tenth off, and over all cells."""
    table = columns_table("r/min", "exact data", "R 10 % off", "R 20 %, psi_m 5 % off", left=())
    good, angle = found.grid("success"), found.grid("angle")
    exact = np.zeros(good.shape[:2], dtype=bool)
    exact[FLUXES.index(1.0), RESISTANCES.index(1.0)] = True
    tenth = np.zeros_like(exact)
    tenth[FLUXES.index(1.0)] = [0.9 <= R <= 1.1 for R in RESISTANCES]
    for k, share in enumerate(SPEEDS):
        cells = [
            _cell(float(np.mean(good[..., k][of])), float(np.max(angle[..., k][of])))
            for of in (exact, tenth, np.ones_like(exact))
        ]
        table.add_row(f"{share * found.scenario.speed:.4g}", *cells)
    table.caption = "good runs, %, over all loads up to the rated one (largest angle error, degrees electrical)"
    table.caption_justify = "left"
    return table


def _cell(good: float, angle: float) -> Text:
    style = "green" if good == 1 else "bold red" if good < 0.5 else ""
    return Text(f"{100 * good:.1f} ({angle:.1f})", style=style)


def map_figure(found: Map) -> str:
    """Heat maps of success, speed over load; a row an R, a column a psi_m; the largest angle error in each cell."""
    good, angle = found.grid("success"), found.grid("angle")
    shape = len(RESISTANCES), len(FLUXES)
    figure, axes = pyplot().subplots(*shape, figsize=(9.5, 8.0), sharex=True, sharey=True)
    image: Any = None
    for row, R in enumerate(RESISTANCES):
        for column, psi_m in enumerate(FLUXES):
            axis, cells = axes[row, column], 100 * good[column, row]
            image = axis.imshow(cells, origin="lower", aspect="auto", cmap="viridis", vmin=0, vmax=100)
            axis.grid(False)
            axis.set_title(f"R {R:g}, psi_m {psi_m:g}", fontsize=7, loc="left")
            axis.set_xticks(range(len(SPEEDS)), [f"{s * found.scenario.speed:.4g}" for s in SPEEDS], fontsize=6)
            axis.set_yticks(range(len(LOADS)), [f"{load * found.scenario.load:.3g}" for load in LOADS], fontsize=6)
            for (j, k), value in np.ndenumerate(angle[column, row]):
                text = LOST if value >= 180.0 else f"{value:.0f}"
                axis.text(
                    k, j, text, ha="center", va="center", fontsize=5, color="w" if cells[j, k] < 70 else "#111111"
                )
    figure.supxlabel("speed, r/min", fontsize=8)
    figure.supylabel("load, N m", fontsize=8)
    figure.colorbar(image, ax=axes, label="good runs, %")
    return svg_text(figure)


def write_map(found: Map, folder: Path) -> Path:
    """map.svg and index.html in a folder; the page's path."""
    figure = map_figure(found)
    make_folder(folder)
    write_text(folder / "map.svg", figure)
    text = page_template(Path(__file__).with_name("map.html.j2")).render(
        found=found, figure=themed(figure), lines=LINES
    )
    write_text(folder / "index.html", text)
    return folder / "index.html"
