"""A machine of one's own: magnets that are not sinusoidal.

`docs/own_machine` has the equations of a motor whose magnets link a fifth and a seventh harmonic. Its filter knows
them; a filter that thinks the magnets sinusoidal, on the same data, takes them for speed.
"""

from contextlib import ExitStack
from pathlib import Path

import numpy as np

from model.drives.load import load_drive
from runtime.drive.experiment import changed, folder_with, simulate
from runtime.estimator.estimator import load_folder
from runtime.folders.resolve import NamedDrive
from runtime.style.figures import pyplot, svg_text

drive = Path(__file__).parents[1] / "own_machine" / "my_motor.toml"
(run,) = simulate(str(drive), "load_step", ("ckf",))
plain = changed(load_drive(drive), model={"machine": "salient_flux"})
with ExitStack() as stack:
    other = load_folder(folder_with(NamedDrive("plain", plain, Path("none")), "ckf", stack), "ckf", "numpy", "float64")
    x = other.run(run.u, run.i).x
off = np.degrees(np.angle(np.exp(1j * (x[:, 3] - run.theta))))
errors = {
    "knows the harmonics": (run.speed_error, run.angle_error, "#3b6ea8"),
    "thinks them away": ((x[:, 2] - run.omega) * 60 / (2 * np.pi), off, "#c8553d"),
}
figure, axes = pyplot().subplots(2, 1, figsize=(7.0, 4.2), sharex=True)
for name, (speed, angle, colour) in errors.items():
    axes[0].plot(run.t[::4], speed[::4], color=colour, lw=0.7, label=name)
    axes[1].plot(run.t[::4], angle[::4], color=colour, lw=0.7)
axes[0].set(ylabel="speed error, r/min")
axes[0].legend(fontsize=8)
axes[1].set(xlabel="time, s", ylabel="angle error, degrees")
Path("own_machine.svg").write_text(svg_text(figure))
