"""Tables of simulated drives: figures of each filter, the paper's claims beside ours, the sample-time sweep."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from rich.table import Table
from rich.text import Text

from runtime.drive.experiment import SweepPoint
from runtime.drive.scenario import Scenario
from runtime.drive.simulation import Run
from runtime.recorded.units import RPM
from runtime.style.tables import columns_table


@dataclass(frozen=True)
class Claim:
    """A result the paper reports, and what we find: ``theirs`` as printed, ``ours`` measured, ``why`` they differ."""

    what: str
    theirs: str
    ours: str
    why: str


def claims(runs: Sequence[Run]) -> list[Claim]:
    """The paper's reported results (fig. 4-11) against CKF and ICKF runs of both scenarios."""
    found = {(run.scenario.name, run.kind): run.figures() for run in runs}
    needed = [(s, k) for s in ("no_load", "load_step") for k in ("ckf", "ickf")]
    if any(key not in found for key in needed):
        return []
    start = {kind: found["no_load", kind]["start"] for kind in ("ckf", "ickf")}
    step = {kind: found["load_step", kind]["load_step"] for kind in ("ckf", "ickf")}
    steady = {kind: found["no_load", kind]["steady_rms"] for kind in ("ckf", "ickf")}
    reached = start["ickf"] < 20.0
    start_why = (
        "agrees, with the corrected equations" if reached else "not reached with these conditions and this noise"
    )
    return [
        Claim("start, ICKF", "under 20 r/min", f"{start['ickf']:.1f} r/min", start_why),
        Claim("start, CKF", "over 1000 r/min", f"{start['ckf']:.1f} r/min", _why_alike(start)),
        Claim(
            "at speed, rms",
            "ICKF smaller",
            f"CKF {steady['ckf']:.2f}, ICKF {steady['ickf']:.2f} r/min",
            _why_alike(steady),
        ),
        Claim(
            "5 N m step, ICKF",
            "follows quickly",
            f"{step['ickf']:.1f} r/min",
            "largest error of the estimate after the step",
        ),
        Claim("5 N m step, CKF", "about 10 r/min, settles slowly", f"{step['ckf']:.1f} r/min", _why_alike(step)),
    ]


def _why_alike(figure: dict[str, float]) -> str:
    """CKF and ICKF side by side: one filter where the numbers say so, else only what can be said."""
    if abs(figure["ckf"] - figure["ickf"]) <= 0.01 * figure["ckf"]:
        return "currents are states, h is linear: (27)-(34) repeat the CKF's update, so both filters are one"
    return "one filter up to rounding (h is linear), but in this loop rounding has grown into two different runs"


def runs_table(runs: Sequence[Run]) -> Table:
    """Largest errors of each run, its verdict, and how often each bit of its status was set."""
    table = columns_table(
        "scenario", "filter", "start, r/min", "load step, r/min", "steady rms, r/min", "angle, deg", "", left=(0, 1)
    )
    for run in runs:
        f = run.figures()
        step = f"{f['load_step']:.2f}" if run.scenario.load else "-"
        cells = (f"{f['start']:.2f}", step, f"{f['steady_rms']:.3f}", f"{f['angle']:.3f}")
        state = Text(run.verdict, style="green" if run.good else "bold red")
        table.add_row(run.scenario.name, run.kind, *cells, state)
    return table


def remarks(runs: Sequence[Run]) -> list[str]:
    """A line for each run that did not reach its reference or whose status was set: what it says."""
    lines = []
    for run in runs:
        name = f"{run.scenario.name}, {run.kind}"
        if run.locked and not run.reached:
            ended = float(np.mean(run.omega[run.late])) * RPM
            lines.append(
                f"{name}: the estimate follows the rotor, but it turns at {ended:.0f} r/min where "
                f"{run.scenario.speed:.0f} were asked for: voltage, current or load do not let it."
            )
        if run.status_counts:
            told = ", ".join(f"{bit} {count:,}" for bit, count in run.status_counts.items())
            lines.append(f"{name}: status in {len(run.status):,} samples: {told}")
    return lines


def task_line(scenario: Scenario) -> str:
    """The task of a scenario in one line."""
    load = f", {scenario.load:.3g} N m from {scenario.load_at:.3g} s on" if scenario.load else ""
    return f"{scenario.name}: to {scenario.speed:.4g} r/min in {scenario.ramp:.3g} s{load}"


def claims_table(items: Sequence[Claim]) -> Table:
    """Make the table of the paper's claims beside what was measured."""
    table = columns_table("the paper's claim", "theirs", "ours", "why", left=(0, 1, 2, 3))
    for item in items:
        table.add_row(item.what, item.theirs, item.ours, item.why)
    return table


def sweep_table(points: Sequence[SweepPoint]) -> Table:
    """Largest speed error while starting, by sample time and discretisation."""
    table = columns_table("T", "Euler", "exact", left=(0, 1))
    for T in dict.fromkeys(point.sample_time for point in points):
        cells = {point.discretization: point for point in points if point.sample_time == T}
        table.add_row(f"{T * 1e6:g} us", *(sweep_cell(cells[name]) for name in ("euler", "exact")))
    return table


def sweep_cell(point: SweepPoint) -> str:
    """Spell one point of the sample-time sweep."""
    return f"{point.figures['start']:.1f} r/min" if point.locked else "loses lock"
