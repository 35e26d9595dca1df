"""The files that pages speak of as their reader's own: drive files, facts, answers, recordings."""

from __future__ import annotations

import atexit
import re
import shutil
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.other_motor import MOTORS, recordings
from runtime.design.facts import EXAMPLE
from runtime.design.write import facts_text
from runtime.drive.scenario import find_scenario
from runtime.drive.simulation import Simulator
from runtime.estimator.folder import find_folder
from runtime.folders.stated import stated_drive
from runtime.recorded.data import read_recorded, write_recorded
from tests.pages.read import ROOT, make_desk, run

#: What a label and a cheap meter say of the motor whose recordings :func:`on_a_bench` lays down.
ROUGH = """\
name = "my_motor"
[motor]
line_resistance = 8.0    # a cheap meter
line_inductance = 12e-3
ke_v_per_krpm = 110.0    # the label
pole_pairs = 4
inertia = 0.006
[rated]
speed = 104.7
torque = 5.0
max_current = 20.0
[inverter]
dc_link = 311.0
sample_time = 100e-6
[sensor]
range = 50.0
bits = 16
noise = 0.05
"""
#: What a reader answers to `new`, in its order, of the motor of docs/design.md; empty: the default.
ANSWERS = (
    *("2", "0.6", "2", "0.5 mH", "2", "3.6", "1", "4", "1e-5", ""),
    *("1", "3000", "1", "0.15", "10"),
    *("", "", "", ""),
    *("24", "1", "100 us", "0.5 us"),
    *("20", "12", "0.02", "", ""),
)
#: What is typed, a line an answer.
TYPED = "".join(f"{answer}\n" for answer in ANSWERS)


def facts(desk: Path) -> None:
    """The facts file that docs/design.md shows."""
    text = (ROOT / "docs" / "design.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"^```toml\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    (desk / "my_motor_facts.toml").write_text(shown, encoding="utf-8")


def answers(desk: Path) -> None:
    """The same facts as a script gives them to `new`."""
    (desk / "answers.txt").write_text(TYPED, encoding="utf-8")


def no_motor(desk: Path) -> None:
    """Take away what the line before made: the next one is another way to the same two files."""
    for name in ("my_motor.toml", "my_motor_facts.toml"):
        (desk / name).unlink()


def motor(desk: Path) -> None:
    """A drive file of one's own, generated."""
    made = _generated()
    shutil.copy(made / "my_motor.toml", desk)
    shutil.copytree(made / "generated" / "my_motor", desk / "generated" / "my_motor")


@cache
def _generated() -> Path:
    """A desk in which my_motor is generated; made once a process, and read alone."""
    desk = Path(tempfile.mkdtemp(prefix="pmsm-ickf-my-motor-"))
    atexit.register(shutil.rmtree, desk, ignore_errors=True)
    make_desk(desk)
    text = (ROOT / "model" / "drives" / "servo_24v.toml").read_text(encoding="utf-8")
    (desk / "my_motor.toml").write_text(text.replace('"servo_24v"', '"my_motor"', 1), encoding="utf-8")
    done = run("pmsm-ickf generate my_motor.toml", desk)
    assert done.returncode == 0, done.stderr
    return desk


def recording(drive: str, name: str) -> Callable[[Path], None]:
    """A run of a shipped drive from rest through a step of its load, with the truth."""

    def laid(desk: Path) -> None:
        folder = find_folder(drive)
        Simulator(folder, "ckf").run(find_scenario("load_step", stated_drive(folder))).save(desk / name)

    return laid


def scope_with_their_names(desk: Path) -> None:
    """What a scope saved of my_motor: two phase currents, one in mA, and two line voltages, under names of its own."""
    recording("servo_24v", "made.npz")(desk)
    made = read_recorded(desk / "made.npz")
    turns = np.exp(-2j * np.pi / 3 * np.arange(3))
    u, i = (np.real((x[:, 0] + 1j * x[:, 1])[:, None] * turns) for x in (made.u, made.y))
    table = np.column_stack([made.t, 1e3 * i[:, 0], i[:, 1], u[:, 0] - u[:, 1], u[:, 1] - u[:, 2]])
    np.savetxt(desk / "scope.csv", table, "%.9g", ",", header="Time,Ia,Ib,Uab,Ubc", comments="")


def scope_with_our_names(desk: Path) -> None:
    """A recording of the paper's drive, which README's my_motor is, with the columns that need no word."""
    recording("paper_spmsm", "made.npz")(desk)
    made = read_recorded(desk / "made.npz")
    names = ("t", "u_alpha", "u_beta", "i_alpha", "i_beta")
    write_recorded(desk / "scope.csv", dict(zip(names, (made.t, *made.u.T, *made.y.T), strict=True)))


def on_a_bench(desk: Path) -> None:
    """Rough facts of a motor and three recordings of it, by another simulator than the project's."""
    (desk / "my_motor_facts.toml").write_text(ROUGH, encoding="utf-8")
    for name, made in zip(("run.csv", "a.npz", "b.npz"), recordings(MOTORS["bench"], 3, 0.2), strict=True):
        names = ("t", "u_alpha", "u_beta", "i_alpha", "i_beta")
        write_recorded(desk / name, dict(zip(names, (made.t, *made.u.T, *made.y.T), strict=True)))


def to_commission(desk: Path) -> None:
    """A motor as it is, and the facts that are known of it: off by up to a half."""
    guess = {**EXAMPLE, "motor": {**EXAMPLE["motor"], "stator_resistance": 0.42, "inertia": 6e-6}}
    true = {**EXAMPLE, "inverter": {**EXAMPLE["inverter"], "dead_time": 1e-6}}
    (desk / "true.toml").write_text(facts_text(true), encoding="utf-8")
    for name in ("guess.toml", "my_motor_facts.toml"):
        (desk / name).write_text(facts_text(guess), encoding="utf-8")
