"""``python -m tests.mutants [WORD ...]``: run all mutants, or those whose kind and name hold words; print a table."""

from __future__ import annotations

import argparse
import json
import os
import random
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from tests.mutants.around import around_mutants
from tests.mutants.catalogue import SOURCES, data_mutants
from tests.mutants.emitted import SEED, emitted_mutants
from tests.mutants.flow import flow_mutants
from tests.mutants.judged import judged_mutants
from tests.mutants.mutant import ROOT, Mutant, Outcome, StaleMutantError
from tests.mutants.run import run
from tests.mutants.table import page, rows, to_json

#: A few quick ones, for the test suite: words that kind and name hold.
SAMPLE = (
    ("data", "paper_spmsm: Q of theta"),
    ("cubature.py", "n for sqrt(n)"),
    ("reuse.py", "constant of a product lost"),
    ("controller.py", "decoupling's sign"),
    ("supervisor", "good at once"),
    ("filter, C", "paper_spmsm_ckf", "status"),
)


def everything(each: int | None = None) -> list[Mutant]:
    """All of the catalogue's; of those made by rule ``each`` of a sort, or all."""
    return [
        *SOURCES,
        *drawn([*data_mutants(), *emitted_mutants(), *flow_mutants(), *around_mutants(), *judged_mutants()], each),
    ]


def drawn(mutants: Sequence[Mutant], each: int | None) -> list[Mutant]:
    """``each`` of every kind and sort, by a fixed seed; fewer are a part of more."""
    rng, taken = random.Random(SEED), Counter[tuple[str, str]]()
    order, kept = rng.sample(range(len(mutants)), len(mutants)), set()
    for number in order:
        key = mutants[number].kind, mutants[number].sort
        taken[key] += 1
        if each is None or taken[key] <= each:
            kept.add(number)
    return [mutant for number, mutant in enumerate(mutants) if number in kept]


def holds(mutant: Mutant, words: Sequence[str]) -> bool:
    return all(word in f"{mutant.kind} {mutant.name}" for word in words)


def zeroth(mutants: Sequence[Mutant]) -> list[Mutant]:
    """The tree as it is, under every check that source mutants meet: none may fail."""
    checks = sorted({check for mutant in mutants if mutant.old for check in mutant.checks})
    return [Mutant("none", check, (check,), group="unmutated") for check in checks]


def follow(title: str, mutants: list[Mutant], jobs: int, console: Console) -> Iterator[Outcome]:
    """Run with a bar, naming what lives."""
    columns = TextColumn(title), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()
    with Progress(*columns, console=console) as bar:
        task = bar.add_task(title, total=len(mutants))
        for count, outcome in enumerate(run(mutants, jobs), start=1):
            bar.advance(task)
            if not console.is_terminal and count % 25 == 0:
                console.print(f"{title}: {count} of {len(mutants)}")
            if outcome.fate in {"survived", "crashed"} and outcome.mutant.kind != "none":
                line = f"{outcome.fate}: {outcome.mutant.kind}: {outcome.mutant.name} {outcome.crash}"
                bar.console.print(line, markup=False)
            yield outcome


def known(mutants: Sequence[Mutant], file: Path) -> list[Outcome]:
    """The mutants of these that earlier runs killed."""
    entries = json.loads(file.read_text(encoding="utf-8"))["mutants"] if file.is_file() else []
    kills = {entry["digest"]: entry for entry in entries if entry["fate"] == "killed"}
    found = [(m, kills[m.digest]) for m in mutants if m.digest in kills]
    return [Outcome(m, entry["killer"], entry["said"], seconds=entry["seconds"]) for m, entry in found]


def main() -> int:
    """0 if every mutant is killed."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__)
    parser.add_argument("words", nargs="*", help="only mutants whose kind and name hold these words")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--json", type=Path, default=ROOT / "build" / "mutants.json")
    parser.add_argument("--again", action="store_true", help="keep what the last runs killed: for one in pieces")
    parser.add_argument("--each", type=int, default=None, help="of those made by rule so many of each sort")
    parser.add_argument(
        "--places", type=int, help="others than are published: of emitted text and judges, so many of each sort"
    )
    parser.add_argument("--seed", type=int, default=SEED, help="where --places draws them")
    parser.add_argument("--sample", action="store_true", help="only the few that the test suite runs")
    options, console, start = parser.parse_args(), Console(), time.monotonic()
    made = (emitted_mutants, flow_mutants, around_mutants, judged_mutants)
    every = (
        [m for make in made for m in make(options.places, options.seed)] if options.places else everything(options.each)
    )
    outcomes = known(every, options.json) if options.again else []
    done = {outcome.mutant.digest for outcome in outcomes}
    choices = SAMPLE if options.sample else (options.words,)
    mutants = [m for m in every if m.digest not in done and any(holds(m, words) for words in choices)]
    options.json.parent.mkdir(exist_ok=True)
    alive = 0
    try:
        for outcome in follow("unmutated", zeroth(mutants), options.jobs, console):
            if outcome.killer or outcome.crash:
                console.print(f"the unmutated tree does not pass '{outcome.mutant.name}':", outcome.said, outcome.crash)
                return 1
        for outcome in follow("mutants", mutants, options.jobs, console):
            outcomes.append(outcome)
            alive += outcome.fate in {"survived", "crashed"}
            options.json.write_text(json.dumps(to_json(outcomes), indent=1), encoding="utf-8")
    except StaleMutantError as error:
        console.print(str(error), markup=False)
        return 1
    table = Table("kind", "mutants", "killed", "by")
    for kind, count, dead, by in rows(outcomes):
        table.add_row(kind, str(count), str(dead), by)
    console.print(table)
    if len(outcomes) == len(every) and not options.places:
        made = Counter(m.kind for m in everything() if not m.equivalent)
        command = f"python -m tests.mutants{f' --each {options.each}' if options.each else ''}"
        (ROOT / "docs" / "mutants.md").write_text(page(outcomes, made, command), encoding="utf-8")
    console.print(f"{alive} of {len(mutants)} not killed, {time.monotonic() - start:.0f} s")
    return int(alive > 0)


if __name__ == "__main__":
    raise SystemExit(main())
