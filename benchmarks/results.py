"""Measured results: runs the commands that measure, keeps what their JSON says, and writes docs/results.md of it.

Run: python benchmarks/results.py                      writes docs/results.md from docs/results/*.json
     python benchmarks/results.py --measure loop proof measures these subjects anew first ("all": every one; an hour)

No figure of the page is typed by hand. A subject is its commands, what is kept of their JSON, and a table.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from result_tables import (
    condense_as_it_is,
    condense_faults,
    condense_firmware,
    condense_loop,
    condense_map,
    condense_proof,
    condense_study,
    faults_table,
    firmware_table,
    loop_table,
    map_table,
    proof_table,
    study_table,
    tables_of,
)

ROOT = Path(__file__).resolve().parents[1]
KEPT, PAGE = ROOT / "docs" / "results", ROOT / "docs" / "results.md"
#: The two programs a command line begins with.
PROGRAMS = {"pmsm-ickf": [sys.executable, "-m", "runtime"], "python": [sys.executable]}
#: Said where nothing is kept.
UNMEASURED = "Not measured on the text as it is."
DRIVES = (
    "paper_spmsm",
    "spmsm_load_torque",
    "ipmsm",
    "ipmsm_flux",
    "spmsm_adaptive",
    "ipmsm_adaptive",
    "servo_24v",
    "hub_36v",
    "traction_70kw",
)

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
        "PWM, 2 us dead time that the controller makes up for and the filter does not know, 12 bits, voltages acting a "
        "sample later.",
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
    "cycles": Subject(
        "Cycles on the chip, as computed",
        "From published cycles, not measured: an estimate of the worst step, counted in the generated C "
        "([regenerate.md](regenerate.md#a-budget) says what is in the sum), and its share of the sample time T, in "
        "bold where it is longer. An interrupt is filter, controller and supervisor in a mode of the drive; in "
        "STARTING two filters run.",
        {"cycles": "python benchmarks/cycles.py --json {json}"},
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
