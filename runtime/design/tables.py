"""A trial in the terminal and as JSON."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from rich.table import Table

from runtime.design.facts import Facts
from runtime.design.questions import section_of, unit_of
from runtime.design.rules import Design
from runtime.design.trial import ENOUGH, MUST_HOLD, Point, Trial, blame
from runtime.drive.simulation import LOCKED_ANGLE
from runtime.recorded.units import RPM
from runtime.style.tables import columns_table

#: Facts by the keys that state them as they are kept.
IN_SI = {
    "R": ("motor", "stator_resistance"),
    "L_d": ("motor", "inductance_d"),
    "L_q": ("motor", "inductance_q"),
    "psi_m": ("motor", "magnet_flux"),
    "p": ("motor", "pole_pairs"),
    "J": ("motor", "inertia"),
    "D": ("motor", "friction"),
    "speed": ("rated", "speed"),
    "torque": ("rated", "torque"),
    "max_current": ("rated", "max_current"),
    "d_R": ("tolerance", "stator_resistance"),
    "d_L": ("tolerance", "inductance"),
    "d_psi": ("tolerance", "magnet_flux"),
    "d_J": ("tolerance", "inertia"),
    "dc_link": ("inverter", "dc_link"),
    "T": ("inverter", "sample_time"),
    "dead_time": ("inverter", "dead_time"),
    "range": ("sensor", "range"),
    "bits": ("sensor", "bits"),
    "noise": ("sensor", "noise"),
    "angle": ("start", "angle"),
    "step_every": ("load", "step_every"),
}


def facts_table(facts: Facts) -> Table:
    """The facts as they were understood, in SI; the angle in degrees.

    Parameters
    ----------
    facts : Facts
    """
    table = columns_table("fact", "value", "", left=(0, 2))
    for name, (section, key) in IN_SI.items():
        words, unit = section_of(section).model_fields[key].description or key, unit_of(section, key)
        value = getattr(facts, name)
        table.add_row(words, f"{math.degrees(value) if name == 'angle' else value:.6g}", unit)
    return table


def trial_table(trial: Trial) -> Table:
    """Where it holds and where not.

    Parameters
    ----------
    trial : Trial
    """
    heads = "speed", "r/min", "draws", "locked", "at speed", "angle, 95 %", "within 3 sigma", "speed error, 95 %", ""
    table = columns_table(*heads, left=(8,))
    for point in trial.points:
        verdict, style = verdict_of(point)
        speed_error = _high(point.speed_error) / (trial.facts.speed * RPM)
        table.add_row(
            f"{point.share:.0%}",
            f"{point.speed:.3g}",
            str(len(point.held)),
            f"{np.mean(point.locked):.1%}",
            f"{np.mean(point.reached):.1%}",
            f"{_high(point.angle):.1f}\u00b0",
            f"{np.mean(point.honest):.1%}",
            f"{speed_error:.1%} of rated",
            f"[{style}]{verdict}[/{style}]",
        )
    return table


def verdict_of(point: Point) -> tuple[str, str]:
    """In words what a speed's draws did, and the style to say it in.

    Parameters
    ----------
    point : Point
    """
    if point.holds:
        return "holds", "green"
    style = "red" if point.share >= MUST_HOLD else "yellow"
    if np.mean(point.locked) < ENOUGH:
        return f"loses the rotor (more than {LOCKED_ANGLE:.0f} degrees off)", style
    return "keeps the rotor, does not keep the speed", style


def trial_facts(trial: Trial, design: Design) -> dict[str, Any]:
    """Everything that was chosen and found, as plain data.

    Parameters
    ----------
    trial : Trial
    design : Design
    """
    return {
        "name": design.name,
        "holds": trial.holds,
        "success": trial.success,
        "points": [
            {
                "share_of_speed": point.share,
                "speed_rpm": point.speed,
                "draws": len(point.held),
                "held": float(np.mean(point.held)),
                "locked": float(np.mean(point.locked)),
                "reached": float(np.mean(point.reached)),
                "angle_95": _number(_high(point.angle)),
                "within_3_sigma": float(np.mean(point.honest)),
                "speed_error_95": _number(_high(point.speed_error)),
                "holds": point.holds,
                "hurts": trial.hurts.get(point.share, []),
            }
            for point in trial.points
        ],
        "blame": blame(trial),
        "remarks": design.remarks,
        "choices": {
            section: {key: {"value": choice.value, "reason": choice.reason} for key, choice in choices.items()}
            for section, choices in design.sections.items()
        },
    }


def _high(values: Any) -> float:
    """Below it are 95 % of the values; one that is reached, so that infinite ones do no harm."""
    return float(np.quantile(values, 0.95, method="higher"))


def _number(value: float) -> float | None:
    return value if np.isfinite(value) else None
