"""What a figure says where a pointer rests on it: an unseen area over each stretch, point or bar, with its values."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any
from xml.sax.saxutils import escape

import numpy as np

#: Stretches that an axis is cut into where its curves have more points; of a figure with more than four axes, fewer.
STRETCHES, FEWER = 14, 8
#: Points of one curve that are told one by one.
SINGLE = 40
#: Half the side of the area over a point, in points of 1/72 inch.
REACH = 4.0


@dataclass(frozen=True)
class Spot:
    """An area in the figure, from its upper left corner, in points of 1/72 inch, and its words."""

    x: float
    y: float
    width: float
    height: float
    words: str


def with_values(figure: Any, svg: str) -> str:
    """A figure's SVG with its values as titles.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        It was drawn, so that its axes have their places.
    svg : str
    """
    areas = "".join(
        f'<path d="M{s.x:.0f} {s.y:.0f}h{max(s.width, 1.0):.0f}v{max(s.height, 1.0):.0f}h-{max(s.width, 1.0):.0f}z">'
        f"<title>{escape(s.words)}</title></path>"
        for axis in figure.axes
        for s in spots(axis)
    )
    end = svg.rindex("</svg>")
    return f'{svg[:end]}<g fill="none" pointer-events="all">{areas}</g>{svg[end:]}' if areas else svg


def spots(axis: Any) -> Iterator[Spot]:
    """The areas of one axis: of bars, cells and single points, else of stretches of its curves.

    Parameters
    ----------
    axis : matplotlib.axes.Axes
    """
    yield from _bars(axis)
    yield from _cells(axis)
    lines = [line for line in axis.lines if _is_curve(axis, line)]
    if lines and all(len(line.get_xdata()) <= SINGLE and line.get_marker() not in ("None", "", None) for line in lines):
        yield from _points(axis, lines)
    elif lines:
        yield from _stretches(axis, lines)


def _is_curve(axis: Any, line: Any) -> bool:
    """Not a line across the whole axis."""
    return line.get_transform() == axis.transData and len(line.get_xdata()) > 1


def _to_points(axis: Any, x: Any, y: Any) -> Any:
    """Where data lie in the figure, in points from its upper left corner."""
    width, height = (72.0 * size for size in axis.figure.get_size_inches())
    box = axis.get_position()
    at = (axis.transScale + axis.transLimits).transform(np.column_stack([x, y]))
    return np.column_stack([width * (box.x0 + box.width * at[:, 0]), height * (1 - box.y0 - box.height * at[:, 1])])


def _stretches(axis: Any, lines: list[Any]) -> Iterator[Spot]:
    """Over each stretch the values of all curves; where a curve has several, the least and the largest."""
    low, high = sorted(axis.get_xlim())
    count = STRETCHES if len(axis.figure.axes) <= 4 else FEWER
    edges = (np.geomspace if axis.get_xscale() == "log" else np.linspace)(low, high, count + 1)
    groups: dict[Any, list[Any]] = {}
    for line in lines:
        groups.setdefault((line.get_color(), line.get_linestyle()), []).append(line)
    top, bottom = _to_points(axis, edges[[0, 0]], axis.get_ylim())[:, 1][::-1]
    places = _to_points(axis, edges, np.full(len(edges), axis.get_ylim()[0]))[:, 0]
    name, unit = _named(_x_label(axis))
    for k in range(count):
        said = [f"{name} {_number((edges[k] + edges[k + 1]) / 2)} {unit}".strip()]
        for group in groups.values():
            values = np.concatenate([_between(line, edges[k], edges[k + 1]) for line in group])
            label = next(filter(None, map(_label, group)), "")
            if len(values):
                said.append(f"{label + ': ' if label else ''}{_range(values)} {_named(axis.get_ylabel())[1]}".strip())
        if len(said) > 1:
            yield Spot(places[k], top, places[k + 1] - places[k], bottom - top, "\n".join(said))


def _label(artist: Any) -> str:
    """Its label, also where the legend does not show it; not one that matplotlib made up."""
    label = str(artist.get_label())
    return "" if label.startswith(("_child", "_nolegend")) else label.removeprefix("_")


def _between(line: Any, low: float, high: float) -> Any:
    x, y = np.asarray(line.get_xdata(), dtype=float), np.asarray(line.get_ydata(), dtype=float)
    found = y[(x >= low) & (x < high)]
    return found[np.isfinite(found)]


def _points(axis: Any, lines: list[Any]) -> Iterator[Spot]:
    x_unit = _named(_x_label(axis))[1]
    y_unit = _named(axis.get_ylabel())[1]
    names = [label.get_text() for label in axis.get_yticklabels()] if _is_list(axis.yaxis) else []
    found: dict[tuple[float, float], list[str]] = {}
    for line in lines:
        for a, b in zip(*(np.asarray(data, dtype=float).tolist() for data in line.get_data()), strict=True):
            found.setdefault((a, b), []).append(_label(line))
    for (a, b), labels in found.items():
        ((left, down),) = _to_points(axis, [a], [b])
        row = names[int(b)] if names and 0 <= b < len(names) else f"{_number(b)} {y_unit}".strip()
        words = f"{'; '.join(labels)}\n{row}\n{_number(a)} {x_unit}".strip()
        yield Spot(left - REACH, down - REACH, 2 * REACH, 2 * REACH, words)


def _is_list(axis: Any) -> bool:
    return type(axis.get_major_formatter()).__name__ == "FixedFormatter"


def _bars(axis: Any) -> Iterator[Spot]:
    for container in axis.containers:
        for bar in getattr(container, "patches", ()):
            (x0, y0), (x1, y1) = bar.get_xy(), (bar.get_x() + bar.get_width(), bar.get_y() + bar.get_height())
            corners = _to_points(axis, [x0, x1], [y0, y1])
            left, top = corners.min(axis=0)
            width, height = np.abs(corners[1] - corners[0])
            along = bar.get_width() if getattr(container, "orientation", "") == "horizontal" else bar.get_height()
            label = _label(container)
            words = f"{label + ': ' if label and not label.startswith('container') else ''}{_number(along)}"
            yield Spot(left, top, width, height, words)


def _cells(axis: Any) -> Iterator[Spot]:
    for image in axis.images:
        values = np.asarray(image.get_array())
        if values.ndim != 2 or values.size > 400:
            continue
        x_names, y_names = (
            [label.get_text() for label in ticks] for ticks in (axis.get_xticklabels(), axis.get_yticklabels())
        )
        for (row, column), value in np.ndenumerate(values):
            corners = _to_points(axis, [column - 0.5, column + 0.5], [row - 0.5, row + 0.5])
            left, top = corners.min(axis=0)
            width, height = np.abs(corners[1] - corners[0])
            place = [names[at] for names, at in ((x_names, column), (y_names, row)) if at < len(names)]
            yield Spot(left, top, width, height, f"{', '.join(place)}: {_number(float(value))}")


def _x_label(axis: Any) -> str:
    """Its own, or that of the nearest axis below it which has one."""
    place = axis.get_position()
    below = [
        (other.get_position().y0, str(other.get_xlabel()))
        for other in axis.figure.axes
        if other.get_xlabel() and _is_below(other.get_position(), place)
    ]
    return str(axis.get_xlabel()) or max(below, default=(0.0, ""))[1]


def _is_below(box: Any, place: Any) -> bool:
    """Whether an axis lies under another, not beside it."""
    return bool(box.y0 <= place.y0 and box.x0 < place.x1 and place.x0 < box.x1)


def _named(label: str) -> tuple[str, str]:
    """'time, s' -> 'time' and 's'."""
    words = re.sub(r"\s+", " ", label)
    name, comma, unit = words.rpartition(", ")
    return (name, unit) if comma else (words, "")


def _range(values: Any) -> str:
    low, high = _number(float(values.min())), _number(float(values.max()))
    return low if low == high else f"{low} .. {high}"


def _number(value: float) -> str:
    return f"{value:.3g}"
