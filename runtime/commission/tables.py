"""What was found, in the terminal, as JSON, and for the files that are written."""

from __future__ import annotations

import math
from typing import Any

from rich.table import Table

from runtime.commission.commission import Commissioned, found_facts
from runtime.design.facts import Facts
from runtime.identify.intervals import Estimate
from runtime.identify.unknowns import DATA
from runtime.identify.write import Findings
from runtime.style.tables import columns_table


def guess(facts: Facts, word: str) -> float:
    """What the facts say of a datum, SI.

    Parameters
    ----------
    facts : Facts
    word : str
    """
    f = facts
    values = {"R": f.R, "L": (f.L_d + f.L_q) / 2, "L_d": f.L_d, "L_q": f.L_q, "psi_m": f.psi_m, "J": f.J}
    return {**values, "V_dead": f.dc_link * f.dead_time / f.T}[word]


def reason(found: Commissioned, word: str) -> str:
    """Why a datum is not told; empty if it is.

    Parameters
    ----------
    found : Commissioned
    word : str
    """
    told = found.told.get(word)
    if told is None:
        return found.why[word]
    if not told.surely:
        return f"too unsure: +- {100 * told.width:.2g} %"
    return "" if not found.ended else found.why.get(word, "")


def estimates_table(found: Commissioned) -> Table:
    """A line a datum: as stated, as found, its interval, or why it is not told.

    Parameters
    ----------
    found : Commissioned
    """
    table = columns_table("datum", "stated", "found", "95 % interval", "", left=(0, 4))
    for word in found.words:
        told, unit = found.told.get(word), DATA[word].unit
        why = reason(found, word)
        stated = f"{guess(found.facts, word):.5g}"
        if told is None:
            table.add_row(word, stated, "", "", f"[yellow]not told: {why}[/yellow]")
            continue
        said = f"[yellow]not told: {why}[/yellow]" if why else f"{unit} +- {100 * told.width:.2g} %"
        table.add_row(word, stated, f"{told.value:.5g}", f"{told.low:.5g} .. {told.high:.5g}", said)
    return table


def findings(found: Commissioned) -> Findings:
    """What is written into a facts or a drive file.

    Parameters
    ----------
    found : Commissioned
    """
    estimates = [
        Estimate(DATA[word], guess(found.facts, word), told.value, told.low, told.high, not reason(found, word))
        for word, told in found.told.items()
    ]
    return Findings(found.facts.name, found.facts, found_facts(found), estimates)


def commissioned_facts(found: Commissioned) -> dict[str, Any]:
    """Everything, for JSON: parameters by their names in files.

    Parameters
    ----------
    found : Commissioned
    """
    parameters: dict[str, Any] = {}
    for word in found.words:
        told, why = found.told.get(word), reason(found, word)
        value = (told.value, told.low, told.high) if told is not None else (math.nan,) * 3
        one: dict[str, Any] = dict(zip(("value", "low", "high"), (_number(v) for v in value), strict=True))
        one |= {"stated": guess(found.facts, word), "told": not why, "why": why or None}
        parameters |= dict.fromkeys(DATA[word].keys, one)
    runs = [
        {
            "name": ran.run.name,
            "seconds": ran.samples * ran.period,
            "rows": len(ran.rows),
            "lost": ran.lost,
            "whole": ran.whole,
        }
        for ran in found.runs
    ]
    limits = {"current": found.limits.current, "speed": found.limits.speed}
    return {"parameters": parameters, "limits": limits, "runs": runs, "ended": found.ended or None}


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
