"""What is kept of each measured subject, and its table in docs/results.md."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

Facts = Any


def markdown(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A Markdown table; numbers with three digits that count.

    >>> print(markdown(["a", "b"], [["x", 0.01234]]))
    | a | b |
    |---|---|
    | x | 0.0123 |
    """
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(
        "|" + "|".join(cell if cell == "---" else f" {spelled(cell)} " for cell in row) + "|" for row in lines
    )


def spelled(cell: object) -> str:
    """A cell in words: floats to three digits.

    >>> spelled(1234.5), spelled(0.5), spelled(None), spelled(7)
    ('1230', '0.5', 'not measured', '7')
    """
    if cell is None:
        return "not measured"
    if isinstance(cell, float):
        return f"{cell:.3g}" if abs(cell) < 1000 or abs(cell) >= 1e7 else f"{float(f'{cell:.3g}'):.0f}"
    return str(cell)


# --- what is kept of each subject, and its table


def condense_proof(found: Mapping[str, Facts]) -> Facts:
    """Of every link of every drive: share of what is allowed, numbers compared, passed."""
    kept: dict[str, dict[str, Any]] = {}
    for drive in found["verify"]["drives"]:
        links: dict[str, Any] = {}
        for link in drive["links"]:
            one = links.setdefault(link["name"], {"used": 0.0, "compared": 0, "passed": True})
            for row in link["rows"]:
                share = row["worst"] / row["allowed"] if row["allowed"] else float(bool(row["worst"]))
                one["used"] = max(one["used"], share)
                one["compared"] += row["compared"]
            one["passed"] = one["passed"] and link["passed"]
        kept[drive["drive"]] = {"passed": drive["passed"], "links": links}
    return kept


def proof_table(kept: Facts) -> str:
    """Links down, drives across: the largest share of what is allowed."""
    names = list(dict.fromkeys(name for drive in kept.values() for name in drive["links"]))

    def cell(drive: Facts, name: str) -> str:
        link = drive["links"].get(name)
        if link is None:
            return "-"
        if not link["passed"]:
            return "**NOT proved**"
        return "identical" if link["used"] == 0 else f"{100 * link['used']:.2g} %"

    rows = [[name, *(cell(drive, name) for drive in kept.values())] for name in names]
    rows.append(["numbers compared", *(sum(x["compared"] for x in d["links"].values()) for d in kept.values())])
    rows.append(["verdict", *("proved" if d["passed"] else "**NOT proved**" for d in kept.values())])
    return markdown(["link", *(f"`{name}`" for name in kept)], rows)


def condense_firmware(found: Mapping[str, Facts]) -> Facts:
    """Every check's name, state and words, by drive."""
    return {drive["drive"]: drive["checks"] for drive in found["firmware"]["drives"]}


def firmware_table(kept: Facts) -> str:
    """Checks of each drive."""
    rows = []
    for drive, checks in kept.items():
        for check in checks:
            words = " ".join(str(check[key]) for key in check if key not in {"name", "state", "seconds"} and check[key])
            rows.append([f"`{drive}`", check["name"], check["state"], words.replace("|", "/").replace("\n", " ")])
    return markdown(["drive", "check", "state", "figures"], rows)


def condense_loop(found: Mapping[str, Facts]) -> Facts:
    """The runs of each drive."""
    every = [run | {"drive": facts["drive"]} for facts in found.values() for run in facts["runs"]]
    return [{key: value for key, value in run.items() if key not in ("task", "status")} for run in every]


def loop_table(kept: Facts) -> str:
    """A row a drive and filter; equal filters share one."""
    rows, seen = [], {}
    for run in kept:
        key = run["drive"], run["scenario"], *(run[name] for name in ("start", "load_step", "steady_rms", "angle"))
        if key in seen:
            seen[key][1] += f" = {run['filter']}"
            continue
        load = run["load_step"] if run["scenario"] == "load_step" else "-"
        row = [f"`{run['drive']}`", run["filter"], run["scenario"], run["start"], load, run["steady_rms"], run["angle"]]
        seen[key] = [*row, "yes" if run["locked"] else "**no**"]
        rows.append(seen[key])
    head = ["drive", "filter", "scenario", "start", "load step", "steady rms", "angle, deg", "locked"]
    return markdown(head, rows)


def condense_study(found: Mapping[str, Facts]) -> Facts:
    """Groups of each study, and what was drawn."""
    return [
        {"name": name, **{key: facts[key] for key in ("vary", "seed", "runs", "groups")}}
        for name, facts in found.items()
    ]


def study_table(kept: Facts) -> str:
    """Success with its 95 % interval, medians and 95 % quantiles."""
    rows = []
    for study in kept:
        for group in study["groups"]:
            share, quick = group["success"], group["locked_within_0.2_s"]
            quantiles = group["quantiles"]
            spread = [f"{spelled(quantiles[q]['0.5'])} ({spelled(quantiles[q]['0.95'])})" for q in _QUANTITIES]
            who = [f"`{group['drive']}`", group["filter"], study["runs"]]
            rows.append([*who, _interval(share), _interval(quick), *spread])
    return markdown(["drive", "filter", "runs", "success, % (95 %)", "within 0.2 s", *_QUANTITIES.values()], rows)


_QUANTITIES = {"start": "start, median (95 %)", "load_step": "load step", "steady_rms": "steady rms", "angle": "angle"}


def _interval(share: Mapping[str, float]) -> str:
    return f"{100 * share['rate']:.1f} ({100 * share['low']:.1f} .. {100 * share['high']:.1f})"


def condense_map(found: Mapping[str, Facts]) -> Facts:
    """Of each drive good runs and largest angle by speed: exact data, R a tenth off, everything; the worst corner."""
    kept = []
    for facts in found.values():
        cells, rows = facts["cells"], []
        for speed in sorted({cell["speed"] for cell in cells}):
            here = [cell for cell in cells if cell["speed"] == speed]
            exact = [cell for cell in here if cell["R"] == cell["psi_m"] == 1.0]
            tenth = [cell for cell in here if 0.9 <= cell["R"] <= 1.1 and cell["psi_m"] == 1.0]
            row = [
                [statistics.fmean(cell["success"] for cell in some), max(cell["angle"] for cell in some)]
                for some in (exact, tenth, here)
            ]
            rows.append([speed, *row])
        who = {key: facts[key] for key in ("drive", "filter", "runs", "rated")}
        kept.append({**who, "speeds": rows, "worst": cells[0]})
    return kept


def map_table(kept: Facts) -> str:
    """A row a drive and speed."""
    rows = []
    for facts in kept:
        for speed, *groups in facts["speeds"]:
            cells = [f"{100 * good:.1f} ({angle:.1f})" for good, angle in groups]
            rows.append([f"`{facts['drive']}`", facts["filter"], speed, *cells])
    return markdown(["drive", "filter", "r/min", "exact data", "R 10 % off", "R 20 %, psi_m 5 % off"], rows)


def condense_faults(found: Mapping[str, Facts]) -> Facts:
    """Of each fault, drive and filter: runs that recover, median and worst time; the same where nobody reacts."""
    kept = []
    for case in found["faults"]:
        times = [run["time"] for run in case["runs"] if run["time"] is not None]
        kept.append(
            {
                **{key: case[key] for key in ("drive", "filter", "fault")},
                "runs": len(case["runs"]),
                "recovered": len(times),
                "median_s": median(times) if times else None,
                "worst_s": max(times) if times else None,
                "alone": sum(run["time"] is not None for run in case["alone"]),
                "alone_runs": len(case["alone"]),
            }
        )
    return kept


def faults_table(kept: Facts) -> str:
    """Milliseconds."""
    rows = []
    for case in kept:
        times = "-" if case["median_s"] is None else f"{1e3 * case['median_s']:.1f} ({1e3 * case['worst_s']:.1f})"
        shares = [
            f"{case['recovered']} of {case['runs']}",
            f"{case['alone']} of {case.get('alone_runs', case['runs'])}",
        ]
        who = [f"`{case['drive']}`", case["filter"], case["fault"].replace("_", " ")]
        rows.append([*who, shares[0], times, shares[1]])
    return markdown(["drive", "filter", "fault", "recovered", "ms, median (worst)", "nobody reacts"], rows)


def condense_as_it_is(found: Mapping[str, Facts]) -> Facts:
    """All of it."""
    return dict(found)


def tables_of(kept: Facts) -> str:
    """Tables that come as rows of named cells."""
    parts = []
    for facts in kept.values():
        for table in (part for part in facts.values() if "rows" in part):
            columns = list(dict.fromkeys(key for row in table["rows"] for key in row if key != "note"))
            rows = [[_cell(row.get(column, "")) for column in columns] for row in table["rows"]]
            notes = " ".join(table.get("notes", []))
            parts.append(f"**{table['title']}**\n\n{markdown(columns, rows)}\n\n{notes}".strip())
    return "\n\n".join(parts)


def _cell(cell: Any) -> object:
    return f"not measured: {cell['not_measured']}" if isinstance(cell, dict) else cell
