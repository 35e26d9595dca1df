"""How long a replay of a million rows takes, and how much memory one of ten million.

Run: python benchmarks/replay.py [ROWS] [DRIVE]
The recording is the drive's own simulation. Every figure is of the whole command, from its start to its exit, the best
of several rounds taken in turn, because other programs only ever slow a run down; the median stands beside it.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from model.drives.load import load_drive
from runtime.drive.scenario import find_scenario
from runtime.drive.simulation import Simulator
from runtime.estimator.folder import find_folder

ROUNDS = 5
#: Rows that are simulated; a longer recording repeats them, and jumps where it does.
SIMULATED = 1_000_000
#: By what is said of them.
FILES = {"csv": "d.csv", "npz": "d.npz", "npz with truth": "truth.npz"}
INPUTS = ("u_alpha", "u_beta", "i_alpha", "i_beta")


@dataclass(frozen=True)
class Cost:
    """Of one command: wall clock and processor time, s, and the most memory it held, bytes."""

    wall: float
    processor: float
    memory: int


def simulated(drive: str, rows: int) -> dict[str, Any]:
    """Columns of a recording: inputs, and the truth."""
    folder = find_folder(drive)
    T = folder.module.SAMPLE_TIME
    steps = min(rows, SIMULATED)
    scenario = replace(find_scenario("load_step", load_drive(drive)), duration=steps * T)
    run = Simulator(folder, folder.chosen(None)).run(scenario)
    made = dict(zip(INPUTS, np.hstack([run.u, run.i]).T, strict=True))
    made |= {"omega": run.omega, "theta": run.theta, "load_torque": run.load_torque}
    times = -(-rows // len(run.t))
    return {"t": T * np.arange(1, rows + 1)} | {name: np.tile(values, times)[:rows] for name, values in made.items()}


def write(columns: dict[str, Any], folder: Path) -> None:
    """The recording as FILES."""
    plain = {name: columns[name] for name in ("t", *INPUTS)}
    np.savez(folder / FILES["npz"], **plain)
    np.savez(folder / FILES["npz with truth"], **columns)
    with (folder / FILES["csv"]).open("w", encoding="ascii") as file:
        file.write(",".join(plain) + "\n")
        for first in range(0, len(columns["t"]), 100_000):
            rows = np.column_stack([column[first : first + 100_000] for column in plain.values()])
            np.savetxt(file, rows, delimiter=",", fmt="%.9g")


def cost(command: list[str]) -> Cost:
    """Run a command to its end."""
    begin = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)} ended with {process.returncode}")
    return Cost(time.perf_counter() - begin, used.ru_utime + used.ru_stime, used.ru_maxrss * 1024)


def main(rows: int, drive: str) -> None:
    with tempfile.TemporaryDirectory() as place:
        # In a process of its own: a child's memory counts from that of the process it is forked from.
        subprocess.run([sys.executable, __file__, str(rows), drive, place], check=True)
        files = {name: Path(place) / file for name, file in FILES.items()}
        command = [sys.executable, "-m", "runtime", "replay", drive]
        commands = {name: [*command, str(path)] for name, path in files.items()}
        commands["npz, estimates written"] = [*commands["npz"], "--out", str(Path(place) / "est.npz")]
        cost(commands["npz"])  # compiles what is compiled once
        found: dict[str, list[Cost]] = {name: [] for name in commands}
        for _ in range(ROUNDS if rows <= SIMULATED else 1):
            for name, words in commands.items():
                found[name].append(cost(words))
    print(f"{rows:,} rows through {drive}, whole command")
    print(f"{'':24} {'best, s':>9} {'median, s':>10} {'processor, s':>13} {'memory, MB':>11}")
    for name, costs in found.items():
        walls = [one.wall for one in costs]
        processor, memory = min(one.processor for one in costs), max(one.memory for one in costs) / 1e6
        print(f"{name:24} {min(walls):9.2f} {statistics.median(walls):10.2f} {processor:13.2f} {memory:11.0f}")


if __name__ == "__main__":
    rows, drive, place = (*sys.argv[1:], *("1e6", "spmsm_load_torque", "")[len(sys.argv) - 1 :])
    if place:
        write(simulated(drive, int(rows)), Path(place))
    else:
        main(int(float(rows)), drive)
