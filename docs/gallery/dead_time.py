"""Dead time, told and not told: a servo behind a switching inverter, at a tenth of its speed.

An inverter takes volts from every leg by the sign of its current. A filter that does not know takes them for back-EMF.
`servo_24v` states its inverter in the drive file; the other filter is the same but for that section.
"""

from contextlib import ExitStack
from pathlib import Path

from model.drives.load import load_drive
from runtime.drive.experiment import folder_with
from runtime.drive.scenario import find_scenario
from runtime.drive.simulation import Conditions, Simulator
from runtime.folders.resolve import NamedDrive, find_drive
from runtime.style.figures import pyplot, svg_text

told = find_drive("servo_24v")
bare = load_drive("servo_24v").model_copy(update={"inverter": None})
behind = Conditions(inverter="pwm", dead_time=2e-6, bits=12, delay=1)
figure, axes = pyplot().subplots(2, 1, figsize=(7.0, 4.2), sharex=True)
with ExitStack() as stack:
    for named, name, colour in (
        (told, "told of the dead time", "#3b6ea8"),
        (NamedDrive("bare", bare, Path("none")), "not told", "#c8553d"),
    ):
        scenario = find_scenario("load_step", named.drive, speed=300.0)
        run = Simulator(folder_with(named, "ckf", stack), "ckf").run(scenario, behind)
        axes[0].plot(run.t[::8], run.speed_error[::8], color=colour, lw=0.8, label=name)
        axes[1].plot(run.t[::8], run.angle_error[::8], color=colour, lw=0.8)
        print(f"{name}: {run.verdict}")
axes[0].set(ylabel="speed error, r/min")
axes[0].legend(fontsize=8)
axes[1].set(xlabel="time, s", ylabel="angle error, degrees")
Path("dead_time.svg").write_text(svg_text(figure))
