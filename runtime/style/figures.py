"""Figures as SVG text: crisp, small, their values as titles, and the same bytes for the same data."""

from __future__ import annotations

import io
from typing import Any

from runtime.style.hover import with_values
from runtime.style.svg import compact_svg
from runtime.system.errors import UserError


def pyplot() -> Any:
    """matplotlib, set up for SVG; UserError where it is not installed."""
    try:
        import matplotlib as mpl
    except ImportError:
        raise UserError("figures need matplotlib: pip install 'pmsm-ickf[report]'.") from None
    mpl.use("svg")
    mpl.rcParams.update(
        {
            "svg.fonttype": "none",
            "path.simplify_threshold": 0.3,
            "svg.hashsalt": "pmsm-ickf",
            "font.size": 9,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.grid": True,
            "grid.alpha": 0.25,
            "xtick.bottom": False,  # the grid shows where a number belongs
            "ytick.left": False,
            "legend.frameon": False,
            "figure.constrained_layout.use": True,
        }
    )
    import matplotlib.pyplot as plt

    return plt


def svg_text(figure: Any) -> str:
    """A figure as the text of an <svg> element."""
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None})
    pyplot().close(figure)
    return with_values(figure, compact_svg(text.getvalue()))
