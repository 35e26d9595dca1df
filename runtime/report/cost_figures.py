"""The gain of each pass, drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from runtime.style.figures import pyplot, svg_text

_COLOURS = ("#3b6ea8", "#c8553d", "#e0a030")


def passes_figure(labels: Sequence[str], panels: Mapping[str, Mapping[str, Sequence[float]]]) -> str:
    """Bars from the literal form down to the shipped one.

    Parameters
    ----------
    labels : sequence of str
        The forms, in order.
    panels : mapping
        What is counted -> drive -> one figure a form.
    """
    series = max(len(curves) for curves in panels.values())
    size = (7.5, 0.5 + 0.22 * len(labels) * max(series, 1.4))
    figure, axes = pyplot().subplots(1, len(panels), figsize=size, sharey=True, squeeze=False)
    for axis, (title, curves) in zip(axes[0], panels.items(), strict=True):
        height = 0.8 / len(curves)
        for k, (name, values) in enumerate(curves.items()):
            rows = [row + (k - (len(curves) - 1) / 2) * height for row in range(len(values))]
            bars = axis.barh(rows, values, 0.9 * height, color=_COLOURS[k % len(_COLOURS)], label=name)
            axis.bar_label(bars, fmt="{:,.0f}", fontsize=7, padding=2)
        axis.set_xlabel(title)
        axis.margins(x=0.12)
    axes[0][0].set_yticks(range(len(labels)), labels, fontsize=8)
    axes[0][0].invert_yaxis()
    if series > 1:
        figure.legend(*axes[0][0].get_legend_handles_labels(), fontsize=8, loc="outside upper center", ncols=series)
    return svg_text(figure)
