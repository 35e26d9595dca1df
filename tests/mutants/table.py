"""The score as a table: for the terminal, as JSON, and as the page that is published."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from tests.mutants.mutant import Outcome

#: The description of a kind's mutants, in the order of the table.
KINDS = {
    "data": "drive data: the generator is given wrong ones, the reference keeps the true ones",
    "model": "equations: machines, mechanics, slow states, discretisation",
    "inverter": "what the inverter takes: its numbers, its term, what the controller makes up for",
    "filter": "stages of the filters, the paper's shape",
    "fast form": "even and odd parts, L D L^T, turning frame",
    "tolerance": "noise of motor data that may be wrong, in both forms",
    "passes": "rewriting of the graph",
    "sine and cosine": "polynomials and reductions",
    "filter, C": "the emitted filter",
    "lanes, C": "its lane form",
    "controller, C": "the emitted interrupt body",
    "Python": "the emitted module",
    "flow": "guards, branches, masks, status bits and restarts of all texts of the step, by rule",
    "controller": "the controller's equations and gains",
    "supervisor": "the drive's modes: table, actions, numbers, blocks, and their C and Python",
    "plant": "the motor that is simulated",
    "example interrupt": "the example's text: what enables and stops the inverter, and what is sent",
    "self-test": "the self-tests' text, tables and allowances",
    "printed figures": "costs, sizes, bounds and units in headers, report and manifest",
    "evidence": "what counts, measures and certifies",
    "gates": "what judges the C without running it",
    "example interrupt, drawn": "the emitted example, by rule",
    "self-test, drawn": "the emitted self-tests, by rule",
    "design": "drive files from facts: conversions, rules, what is written, the trial's verdicts, questions",
    "judges": "verdicts, exit codes, tables, figures, conversions: listed",
    "judges, by rule": "the same modules: comparisons, aggregates, truth, numbers, drawn by a seed",
}


def killers(outcomes: Iterable[Outcome]) -> Counter[str]:
    """Links by name, tests by file."""
    names = (o.killer.removeprefix("test ").partition("::")[0] for o in outcomes if o.fate == "killed")
    return Counter(names)


def rows(outcomes: Sequence[Outcome]) -> list[tuple[str, int, int, str]]:
    """Kind, mutants that count, killed, by what."""
    found = []
    for kind in KINDS:
        some = [o for o in outcomes if o.mutant.kind == kind and o.fate != "equivalent"]
        by = ", ".join(f"{name} {count}" for name, count in killers(some).most_common())
        if some:
            found.append((kind, len(some), sum(o.fate == "killed" for o in some), by))
    return found


def to_json(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Everything, one entry a mutant."""
    return {
        "mutants": [
            {
                "kind": o.mutant.kind,
                "name": o.mutant.name,
                "digest": o.mutant.digest,
                "fate": o.fate,
                "killer": o.killer,
                "said": o.said,
                "crash": o.crash,
                "equivalent": o.mutant.equivalent,
                "seconds": round(o.seconds, 2),
            }
            for o in outcomes
        ]
    }


def page(outcomes: Sequence[Outcome], made: Mapping[str, int], command: str) -> str:
    """docs/mutants.md. ``made``: by kind, how many there are to draw from."""
    table = rows(outcomes)
    total, killed = sum(row[1] for row in table), sum(row[2] for row in table)
    lines = [
        "# Mutants: can the proof fail?",
        "",
        f"Written by `{command}`; do not edit. A mutant is one small error: in a drive's data, an",
        "equation, a filter's stage, the rewriting, the emitted text. It is killed when a link of `verify` does not",
        "pass or a test's assertion fails. A crash or a hang is no kill. The unmutated tree passes every check first.",
        "Links are those of `pmsm-ickf verify` on less data (60 steps and 20 draws for A-B and B-C; 420 steps and 200",
        'draws for D-E); "in full" means that it took 10 000 steps and 2000 draws, as `verify` takes them. Mutants of',
        "the emitted text are made by rule, one of each sort of error a file, at a place drawn with a fixed seed;",
        "so are those of the data, one of each sort a drive. Of these, some of each sort are drawn and run.",
        "",
        f"**{killed} of {total} killed.**",
        "",
        "| kind | what | made | run | killed | by |",
        "|---|---|---|---|---|---|",
        *(f"| {kind} | {KINDS[kind]} | {made[kind]} | {count} | {dead} | {by} |" for kind, count, dead, by in table),
        "",
    ]
    alive = [o for o in outcomes if o.fate in {"survived", "crashed"}]
    if alive:
        lines += [
            "## Not killed",
            "",
            *(f"- {o.mutant.kind}: `{o.mutant.name}`: {o.fate} {o.crash}" for o in alive),
            "",
        ]
    same = [o for o in outcomes if o.fate == "equivalent"]
    if same:
        lines += ["## Equivalent", "", "They count neither way.", ""]
        lines += [*(f"- {o.mutant.kind}: `{o.mutant.name}`: {o.mutant.equivalent}" for o in same), ""]
    lines += ["## Each", ""]
    for kind in KINDS:
        some = sorted(
            (o for o in outcomes if o.mutant.kind == kind and o.fate != "equivalent"), key=lambda o: o.mutant.name
        )
        if some:
            lines += [f"### {kind}", "", "| mutant | killed by |", "|---|---|"]
            lines += [f"| {_cell(o.mutant.name)} | {_cell(o.killer or o.fate)} |" for o in some]
            lines += [""]
    return "\n".join(lines)


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("*", "\\*").replace("<", "&lt;")
