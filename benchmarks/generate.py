"""What generating costs: processor seconds of the whole command with its workers, user and system, median of three.

Run: python benchmarks/generate.py [DRIVE ...]
Without DRIVE: every shipped drive alone, then all of them in one command.
again: `generate --check`, stack and code size as the folder has them; new: `generate --out` into an empty folder,
with what the stand-in's compiler takes to measure them. The figures are of a cold command: no process before it leaves
anything but Python's bytecode of modules and templates. The first run of each, which may write that, is not counted.
asked: what it is meant to take. Other work on the machine makes processor seconds more; interleave runs to compare.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from model.drives.load import load_drive, shipped_drives
from model.machines.state_space import build

ROOT = Path(__file__).parents[1]
RUNS = 3

#: Processor seconds that it is meant to take at most, by states of one drive; and for all that are shipped.
ASKED, ASKED_OF_ALL = {4: 1.5, 7: 5.0}, 15.0


def processor_seconds(*arguments: str) -> float:
    """Of one command and all processes it has waited for: user and system."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    words = [sys.executable, "-m", "runtime", "generate", "--quiet", *arguments]
    process = subprocess.Popen(words, env=environment, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0, f"generate {' '.join(arguments)} ended with {process.returncode}"
    return usage.ru_utime + usage.ru_stime


def again(drives: Sequence[str]) -> float:
    return processor_seconds(*drives, "--check")


def new(drives: Sequence[str]) -> float:
    with tempfile.TemporaryDirectory() as empty:
        return processor_seconds(*drives, "--out", empty)


def show(label: str, states: str, drives: Sequence[str], asked: float | None) -> None:
    """One row: both ways in turn."""
    again(drives)
    rounds = [(again(drives), new(drives)) for _ in range(RUNS)]
    figures = "".join(f"{statistics.median(times):>10.2f}" for times in zip(*rounds, strict=True))
    print(f"{label:<20}{states:>8}{figures}{f'{asked:.1f}' if asked else '':>10}", flush=True)


def main(drives: Sequence[str]) -> None:
    print(f"Processor seconds of pmsm-ickf generate, median of {RUNS}.\n")
    print(f"{'':<20}{'states':>8}{'again':>10}{'new':>10}{'asked':>10}")
    for name in drives or shipped_drives():
        states = len(build(load_drive(name)).states)
        show(name, str(states), [name], ASKED.get(states))
    if not drives:
        show("all of them", "", list(shipped_drives()), ASKED_OF_ALL)


if __name__ == "__main__":
    main(sys.argv[1:])
