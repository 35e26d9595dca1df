"""Measured results: runs the commands that measure, keeps what their JSON says, and writes docs/results.md of it.

Run: python benchmarks/results.py                      writes docs/results.md from docs/results/*.json
     python benchmarks/results.py --measure loop proof measures these subjects anew first ("all": every one; an hour)

No figure of the page is typed by hand. A subject is its commands, what is kept of their JSON, and a table.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
KEPT, PAGE = ROOT / "docs" / "results", ROOT / "docs" / "results.md"
#: The two programs a command line begins with.
PROGRAMS = {"pmsm-ickf": [sys.executable, "-m", "runtime"], "python": [sys.executable]}
#: Said where nothing is kept.
UNMEASURED = "Not measured on the text as it is."
DRIVES = ("paper_spmsm", "spmsm_load_torque", "ipmsm", "ipmsm_flux", "spmsm_adaptive", "ipmsm_adaptive")

Facts = Any


@dataclass(frozen=True)
class Subject:
    """One chapter of the page.

    Parameters
    ----------
    title : str
        Heading.
    about : str
        How it was measured and what the columns are; no figures.
    commands : mapping of str to str
        Command lines by a name of their own; ``{json}`` stands for the file that the command writes, ``{out}`` for a
        folder it may use.
    condense : callable
        From the JSON of each command, by name, to what is kept in docs/results.
    table : callable
        From what is kept to Markdown.
    """

    title: str
    about: str
    commands: Mapping[str, str]
    condense: Callable[[Mapping[str, Facts]], Facts]
    table: Callable[[Facts], str]


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
            }
        )
    return kept


def faults_table(kept: Facts) -> str:
    """Milliseconds."""
    rows = []
    for case in kept:
        times = "-" if case["median_s"] is None else f"{1e3 * case['median_s']:.1f} ({1e3 * case['worst_s']:.1f})"
        shares = [f"{case[key]} of {case['runs']}" for key in ("recovered", "alone")]
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


# --- the subjects


def of_each_drive(command: str) -> dict[str, str]:
    """A command line a shipped drive, whose name replaces DRIVE."""
    return {name: command.replace("DRIVE", name) for name in DRIVES}


SUBJECTS: dict[str, Subject] = {
    "proof": Subject(
        "The chain of proof",
        "The largest share of what each link allows, over all filters and gains of a drive; `identical`: bits or "
        "expressions, nothing allowed. The links are told in ARCHITECTURE.md.",
        {"verify": "pmsm-ickf verify --json {json}"},
        condense_proof,
        proof_table,
    ),
    "firmware": Subject(
        "The C on emulated processors, and read by other tools",
        "Emulated processors are stand-ins, not the chip: an ATmega1284P shares the 16-bit int and the 32-bit double "
        "with it, a Cortex-M4F the single-precision unit. 'Not proved' is neither a failure nor a proof.",
        {"firmware": "pmsm-ickf firmware --allow-missing --json {json}"},
        condense_firmware,
        firmware_table,
    ),
    "loop": Subject(
        "The sensorless loop",
        "To 1000 r/min, then a step of 5 N m; noise 0.05 A, averaged inverter. Speed errors in r/min (largest while "
        "starting and after the step, rms at steady speed), angle in electrical degrees.",
        of_each_drive("pmsm-ickf simulate DRIVE --scenario all --noise 0.05 --json {json}"),
        condense_loop,
        loop_table,
    ),
    "inverter": Subject(
        "The same with a switching inverter",
        "PWM, 2 us dead time that nobody compensates, 12 bits, voltages acting a sample later.",
        of_each_drive(
            "pmsm-ickf simulate DRIVE --scenario all --inverter pwm --dead-time 2e-6 --bits 12 --delay 1 --noise 0.05 "
            "--json {json}"
        ),
        condense_loop,
        loop_table,
    ),
    "study": Subject(
        "Motors that differ from their drive file",
        "Noise 0.02 to 0.1 A, angle within 30 degrees, R 20 %, L 10 %, psi_m 5 %, J 20 % off, load 0 to 5 N m, evenly "
        "drawn. Success: the right way round and locked at the end. Errors in r/min, angle in degrees.",
        of_each_drive("pmsm-ickf study run DRIVE --runs 1000 --seed 1 --out {out} --json {json}"),
        condense_study,
        study_table,
    ),
    "map": Subject(
        "Where a drive holds",
        "Load step at no load to rated load, from a known angle, averaged inverter, 8 runs a cell; the true motor's R "
        "and psi_m off the filter's. Good runs in %, over all loads (largest angle error, degrees electrical; 180: "
        "lost). `pmsm-ickf study map DRIVE` draws each cell.",
        of_each_drive("pmsm-ickf study map DRIVE --out {out} --json {json}"),
        condense_map,
        map_table,
    ),
    "angles": Subject(
        "The angle unknown at the start",
        "Uniform over the circle, 0.05 A noise, no load, motor data exact.",
        of_each_drive(
            "pmsm-ickf study run DRIVE --runs 200 --vary theta=-180:180 --vary noise=0.05 --scenario no_load --seed 1 "
            "--out {out} --json {json}"
        ),
        condense_study,
        study_table,
    ),
    "faults": Subject(
        "Faults in operation",
        "At 1000 r/min with 5 N m, 20 runs a fault, the generated example interrupt around the generated motor: time "
        "from the fault's end until torque is back and the estimate stays within 20 r/min and 10 degrees; and in how "
        "many runs it comes back if nobody reacts. The converter, the diodes and the sensors are models.",
        {"faults": "pmsm-ickf faults --json {json}"},
        condense_faults,
        faults_table,
    ),
    "recordings": Subject(
        "On recordings of another simulator",
        "motulator's motor and controller (tests/data), float32 C. Speed errors in r/min, angle in degrees; `wrong`: "
        "the filter starts with R 20 % high and psi_m 10 % low, 0.05 A noise, 100 draws of it: median (worst).",
        {"recordings": "python -m tests.runtime.test_recordings {json}"},
        condense_as_it_is,
        tables_of,
    ),
    "cost": Subject(
        "What a step costs",
        "x86 by callgrind, -O2; M4 by an emulated Cortex-M4F: instructions, not cycles of the chip. Peers compute the "
        "same filter to float32 rounding, which the command checks. CasADi keeps its constants and library calls in "
        "double.",
        {"cost": "python benchmarks/cost.py --json {json}"},
        condense_as_it_is,
        tables_of,
    ),
}


def measure(name: str) -> None:
    """Run a subject's commands and keep what their JSON says."""
    subject, found = SUBJECTS[name], {}
    with tempfile.TemporaryDirectory() as folder:
        for label, words in subject.commands.items():
            print(f"{name}: {label}", flush=True)
            file, out = Path(folder) / f"{label}.json", Path(folder) / label
            program, *line = [word.format(json=file, out=out) for word in words.split()]
            result = subprocess.run([*PROGRAMS[program], *line], cwd=ROOT, stdout=subprocess.DEVNULL, check=False)
            if not file.is_file():
                raise SystemExit(f"{name}: '{words}' wrote no JSON (exit {result.returncode})")
            found[label] = json.loads(file.read_text(encoding="utf-8"))
    KEPT.mkdir(parents=True, exist_ok=True)
    text = json.dumps(subject.condense(found), indent=1) + "\n"
    (KEPT / f"{name}.json").write_text(text, encoding="utf-8")


def page() -> str:
    """docs/results.md, of what is kept."""
    parts = [
        "# Measured results",
        "Written by `python benchmarks/results.py` from docs/results; `--measure NAME` runs the commands again. "
        "Figures of the simulations are the same on every machine, those of time are not here. Nothing was run on the "
        "chip.",
    ]
    for name, subject in SUBJECTS.items():
        file = KEPT / f"{name}.json"
        line, *others = (words.format(json="F.json", out="DIR") for words in subject.commands.values())
        shown = f"`{line}`" + (f" and the same for the other {len(others)}" if others else "")
        table = subject.table(json.loads(file.read_text(encoding="utf-8"))) if file.is_file() else UNMEASURED
        parts += [f"## {subject.title}", f"{subject.about}\n\nCommand (`{name}`): {shown}", table]
    return "\n\n".join(parts) + "\n"


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--measure", nargs="+", choices=[*SUBJECTS, "all"], default=[], metavar="NAME")
    chosen = parser.parse_args().measure
    for name in SUBJECTS if "all" in chosen else chosen:
        measure(name)
    PAGE.write_text(page(), encoding="utf-8")
    print(f"{PAGE.relative_to(ROOT)}: {sum((KEPT / f'{name}.json').is_file() for name in SUBJECTS)} subjects")


if __name__ == "__main__":
    main()
