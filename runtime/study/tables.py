"""Tables of a study: success and errors by filter, and the filters against each other."""

from __future__ import annotations

import math

import numpy as np
from rich.table import Table
from rich.text import Text

from runtime.study.analysis import (
    FIGURES,
    QUANTILES,
    QUICK,
    Difference,
    Rate,
    comparisons,
    ended,
    quantiles,
    quick,
    success,
)
from runtime.study.run import Study
from runtime.study.tune import Point, Tuned
from runtime.style.tables import columns_table

#: Rows of a front that are shown.
LINES = 20

#: The aims of tuning, in the order of the objectives.
ERRORS = ("start, r/min", "steady rms, r/min", "load step, r/min")


def groups_table(study: Study) -> Table:
    """One row a drive and filter: success with its interval, then median, 95 % and worst of each figure."""
    names = [f"{name.replace('_', ' ')}, {unit}" for name, unit in FIGURES.items()]
    supervised = ("in FAULT", "gave up once") if study.statement.supervised else ()
    heads = ("drive", "filter", "runs", "success, % (95 %)", f"within {QUICK:g} s", *supervised, *names)
    table = columns_table(*heads, left=(0, 1))
    for group in study.groups:
        rate = success(group)
        found = quantiles(group)
        cells = [_cell(dict(zip(QUANTILES, found[name], strict=True))) for name in FIGURES]
        modes, reasons = ended(group) if supervised else ({}, {})
        faults = [str(modes.get("FAULT", 0)), str(sum(reasons.values()))] if supervised else []
        table.add_row(group.drive, group.kind, str(rate.runs), _share(rate), _share(quick(group)), *faults, *cells)
    table.caption = "median / 95 % / worst, of the runs that locked"
    table.caption_justify = "left"
    return table


def _share(rate: Rate) -> Text:
    style = "green" if rate.rate == 1 else "bold red" if rate.rate < 0.5 else ""
    return Text(f"{100 * rate.rate:.1f} ({100 * rate.low:.1f} .. {100 * rate.high:.1f})", style=style)


def _cell(values: dict[float, float]) -> str:
    if math.isnan(values[0.5]):
        return "-"
    return " / ".join(f"{values[q]:.3g}" for q in (0.5, 0.95, 1.0))


def paired_table(study: Study) -> Table | None:
    """Each filter against the drive's first, run by run; None where there is nothing to compare."""
    items = comparisons(study)
    if not items:
        return None
    table = columns_table("drive", "difference", "of", "runs", "mean", "95 % interval", "", left=(0, 1))
    for item in items:
        scale, unit = (100.0, "%") if item.figure == "success" else (1.0, FIGURES[item.figure])
        interval = f"{scale * item.low:+.3g} .. {scale * item.high:+.3g}"
        table.add_row(
            item.drive,
            f"{item.second} - {item.first}",
            item.figure.replace("_", " "),
            str(item.runs),
            f"{scale * item.mean:+.3g} {unit}",
            interval,
            verdict(item),
        )
    return table


def verdict(item: Difference) -> str:
    """The verdict of an interval."""
    if item.low == item.high == 0:
        return "identical"
    if item.low <= 0 <= item.high:
        return "no difference shown"
    better = (item.mean > 0) == (item.figure == "success")
    return f"{item.second} better" if better else f"{item.first} better"


def front_table(tuned: Tuned) -> Table:
    """The Pareto front and the drive file's own tuning, on the runs of the trials."""
    table = columns_table(
        "trial", "", "start, r/min", "steady rms, r/min", "load step, r/min", *tuned.axes, left=(0, 1)
    )
    special = {tuned.recommended.number: Text("recommended", style="bold green")}
    special[tuned.own.number] = Text("drive file")  # which may be the one to take
    others = [point for point in tuned.front if point.number not in special]
    shown = [others[k] for k in np.unique(np.linspace(0, len(others) - 1, min(len(others), LINES)).astype(int))]
    rows = sorted({point.number: point for point in (tuned.own, tuned.recommended, *shown)}.values(), key=_by_start)
    for point in rows:
        factors = [f"{point.factors[name]:.3g}" for name in tuned.axes]
        table.add_row(
            str(point.number), special.get(point.number, ""), *(f"{value:.3g}" for value in point.values), *factors
        )
    table.caption = (
        "means over the runs of a trial, a lost run counting as the speed wanted; factors on the drive file's"
    )
    table.caption_justify = "left"
    return table


def _by_start(point: Point) -> tuple[float, ...]:
    return point.values


def proof_table(tuned: Tuned) -> Table:
    """Both tunings on runs that no trial has seen."""
    table = columns_table(
        "on fresh runs", "start, r/min", "steady rms, r/min", "load step, r/min", "success, % (95 %)", left=(0, 1)
    )
    for label, check in (("drive file", tuned.check_own), ("recommended", tuned.check_recommended)):
        rate = check.rate
        share = f"{100 * rate.rate:.1f} ({100 * rate.low:.1f} .. {100 * rate.high:.1f})"
        table.add_row(label, *(f"{value:.3g}" for value in check.values), share)
    return table
