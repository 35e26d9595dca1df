"""Tables of ``fuzz`` and ``soak``, and their figures for machines."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from rich.table import Table
from rich.text import Text

from runtime.endurance.fuzz import Campaign, Finding
from runtime.endurance.soak import Soak
from runtime.style.tables import columns_table
from runtime.system.verdicts import all_hold


def campaigns_table(campaigns: Iterable[Campaign]) -> Table:
    """One row a filter or controller.

    Parameters
    ----------
    campaigns : iterable of Campaign
        Finished campaigns.
    """
    table = columns_table("target", "executions", "a second", "inputs kept", "features", "findings")
    for one in campaigns:
        pace = one.executions / one.seconds if one.seconds else 0.0
        found = Text(str(len(one.findings)), style="bold red" if one.findings else "green")
        table.add_row(one.target, f"{one.executions:,}", f"{pace:,.0f}", str(one.kept), str(one.features), found)
    return table


def finding_lines(campaigns: Iterable[Campaign]) -> list[str]:
    """A line for each kind of finding of a target: the operations that bring it about, and the input itself.

    Parameters
    ----------
    campaigns : iterable of Campaign
        Finished campaigns.
    """
    lines = []
    for one in campaigns:
        kinds: dict[str, list[Finding]] = {}
        for finding in one.findings:
            kinds.setdefault(finding.what.partition(":")[0], []).append(finding)
        for alike in kinds.values():
            first = min(alike, key=lambda finding: len(finding.data))
            more = f" (and {len(alike) - 1} more words)" if alike[1:] else ""
            lines.append(f"{one.target}: {first.what}{more} -- {first.words} [input {first.data.hex()}]")
    return lines


def campaign_facts(campaigns: Sequence[Campaign]) -> dict[str, Any]:
    """Every figure of a campaign, for machines.

    Parameters
    ----------
    campaigns : sequence of Campaign
        Finished campaigns.
    """
    rows = []
    for one in campaigns:
        found = [{"what": f.what, "words": f.words, "input": f.data.hex()} for f in one.findings]
        rows.append({**vars(one), "findings": found})
    return {"passed": all_hold(one.good for one in campaigns), "targets": rows}


def soak_table(result: Soak) -> Table:
    """Largest deviations and errors of each decade of steps."""
    table = Table(header_style="", show_edge=False, pad_edge=False, title_justify="left", title_style="bold")
    hours = result.steps * result.sample_time / 3600
    table.title = f"{result.drive}/{result.kind}: {hours:.2g} h of drive time in {result.seconds:.0f} s"
    theta = result.names.index("theta")
    names = [f"{name}, {unit}" for name, unit in zip(result.names, result.units, strict=True)]
    for column in (
        "up to step",
        *names,
        "theta, slow",
        "of sigma",
        "P",
        "theta off, deg",
        "omega off, rad/s",
        "lost",
        "status",
    ):
        table.add_column(column, justify="right", overflow="fold")
    for one in result.decades:
        status = Text(str(one.unexpected), style="bold red" if one.unexpected else "green")
        cells = [f"{value:.1e}" for value in (*one.deviation, one.slow[theta])]
        cells += [
            f"{max(one.share):.0e}",
            f"{one.covariance:.0e}",
            f"{math.degrees(one.angle):.1f}",
            f"{one.speed:.2f}",
        ]
        table.add_row(f"{one.until:.0e}", *cells, str(one.rejected), status)
    *states, covariance = result.reference
    table.add_row("reference", *(f"{value:.1e}" for value in states), "", "", f"{covariance:.0e}", style="dim")
    table.caption = (
        "float32 against float64, largest of each decade, at speed and slow; lost: steps without currents; "
        "status: unexpected ones; reference: 100 000 steps at the proof's speed and at the slow end"
    )
    table.caption_justify = "left"
    return table


def soaks_verdict(soaks: Iterable[Soak]) -> list[tuple[str, str]]:
    """Lines and their style: what is wrong, or that all held."""
    lines: list[tuple[str, str]] = []
    for result in soaks:
        wrong = result.failures()
        lines += [(line, "red") for line in wrong]
        if not wrong:
            lines.append((f"{result.drive}/{result.kind}: held over {result.steps:,} steps", "green"))
    return lines


def soak_facts(soaks: Sequence[Soak]) -> dict[str, Any]:
    """Every figure of all runs, for machines."""
    passed = all_hold(not result.failures() for result in soaks)
    return {"passed": passed, "runs": [result.to_json() for result in soaks]}
