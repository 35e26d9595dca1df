"""What was found, in the terminal and as JSON."""

from __future__ import annotations

import math
from typing import Any

from rich.table import Table

from runtime.identify.identify import Identified
from runtime.identify.intervals import Estimate
from runtime.identify.redesign import Compared
from runtime.identify.search import STARTS
from runtime.replay.replay import Replay
from runtime.style.tables import columns_table


def estimates_table(found: Identified) -> Table:
    """A line a datum: guess, value, interval, whether it is told.

    Parameters
    ----------
    found : Identified
    """
    table = columns_table("datum", "guess", "found", "95 % interval", "unit, half-width", "", left=(0, 4, 5))
    for e in found.result.estimates:
        half = f"+- {100 * e.width:.2g} %" if e.datum.positive else ""
        said = "" if e.told else "[yellow]not shown[/yellow]"
        interval = f"{e.low:.5g} .. {e.high:.5g}"
        table.add_row(
            e.datum.word, f"{e.guess:.5g}", f"{e.value:.5g}", interval, f"{e.datum.unit} {half}".strip(), said
        )
    return table


#: Said of a search that Ctrl-C ended.
INTERRUPTED = "interrupted: these are the best so far, and the search had not ended."


def notes_words(found: Identified) -> list[str]:
    """What reading the recordings had to say, a line each.

    Parameters
    ----------
    found : Identified
    """
    recordings = found.problem.recordings
    return [f"note: {rows.recorded.path.name}: {note}" for rows in recordings for note in rows.notes]


def steps_words(found: Identified) -> list[str]:
    """When the load was taken to step, a line a recording that has steps.

    Parameters
    ----------
    found : Identified
    """
    told = [(rows.recorded.path.name, rows.load_steps) for rows in found.problem.recordings if rows.load_steps]
    return [f"{name}: the load steps at {', '.join(f'{t:.3g} s' for t in sorted(steps))}" for name, steps in told]


def summary(found: Identified) -> str:
    """How the search ended, in a line.

    Parameters
    ----------
    found : Identified
    """
    data, rank = len(found.result.estimates), found.result.rank
    ends = len(found.found.ends)
    alike = f"{found.found.agreeing} of {ends} starts ended here" if ends > 1 else f"one of {STARTS} starts ended"
    steps = sum(rows.steps for rows in found.problem.recordings)
    return f"{steps:,} samples; {alike}; the recordings tell {rank} of {data} combinations of the data"


def filters_table(compared: Compared) -> Table:
    """The filter before and after, a line a recording and figure.

    Parameters
    ----------
    compared : Compared
    """
    table = columns_table("the filter on", "figure", "as it was", "redesigned", "", left=(0, 1, 4))
    for before, after in zip(compared.before, compared.after, strict=True):
        name = before.recorded.path.name
        for (what, unit, one), (_, _, other) in zip(_figures(before), _figures(after), strict=True):
            if one is not None or other is not None:
                table.add_row(name, what, _number(one), _number(other), unit)
    return table


def _figures(run: Replay) -> list[tuple[str, str, float | None]]:
    """Figures of a run: of its innovations, and against the truth where that is known."""
    errors, found = run.errors, run.consistency
    return [
        ("normalised innovation squared, mean", "2 is right", found.nis_mean if found else None),
        ("innovations beyond white noise", "of 1", found.outside if found else None),
        ("speed, largest before the load step", "r/min", errors.speed_start if errors else None),
        ("speed, rms at the end", "r/min", errors.speed_steady_rms if errors else None),
        ("speed, largest after the load step", "r/min", errors.speed_load_step if errors else None),
        ("position, rms at the end", "deg electrical", errors.position_steady_rms if errors else None),
    ]


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"


def identified_facts(found: Identified, compared: Compared | None) -> dict[str, Any]:
    """Everything that was found, as plain data; a number that is none is None.

    Parameters
    ----------
    found : Identified
    compared : Compared or None
    """
    parameters = {key: _entry(e) for e in found.result.estimates for key in e.datum.keys}
    facts: dict[str, Any] = {
        "name": found.problem.subject.name,
        "parameters": parameters,
        "rank": found.result.rank,
        "correlation": {
            "of": [e.datum.word for e in found.result.estimates],
            "matrix": [[_finite(v) for v in row] for row in found.result.correlation.tolist()],
        },
        "words": list(found.result.words),
        "starts": [_finite(-end) for end in found.found.ends],
        "log_likelihood": _finite(-found.found.slope.value),
        "interrupted": found.found.interrupted,
        "recordings": [
            {
                "path": rows.recorded.path.name,
                "samples": rows.steps,
                "notes": list(rows.notes),
                "load_steps": list(rows.load_steps),
            }
            for rows in found.problem.recordings
        ],
    }
    if compared is not None:
        facts["filters"] = [
            {"recording": b.recorded.path.name, "before": _plain(b), "after": _plain(a)}
            for b, a in zip(compared.before, compared.after, strict=True)
        ]
    return facts


def _entry(e: Estimate) -> dict[str, Any]:
    numbers = {"value": e.value, "low": e.low, "high": e.high, "guess": e.guess}
    return {**{name: _finite(number) for name, number in numbers.items()}, "unit": e.datum.unit, "told": e.told}


def _plain(run: Replay) -> dict[str, float | None]:
    return {what: None if value is None else _finite(value) for what, _, value in _figures(run)}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
