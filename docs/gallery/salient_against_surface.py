"""Salient against surface: one rotor shows its angle at rest, the other does not.

Both drives run up, come back to rest, and are loaded there for most of a second, with motor data as far off as they may
be. A salient machine gets a small square wave of voltage and sees its angle by its inductances. A round rotor has
nothing to show: it slips, as the drive is told to expect, and is caught when it is to turn again.
"""

from pathlib import Path

import numpy as np

from runtime.estimator.folder import find_folder
from runtime.faults.loop import FaultyLoop
from runtime.faults.standstill import STANDSTILL
from runtime.faults.starts import run_attempt
from runtime.style.figures import pyplot, svg_text

figure, axes = pyplot().subplots(2, 2, figsize=(7.5, 4.2), sharex="col")
for column, (name, colour) in enumerate((("ipmsm", "#c8553d"), ("spmsm_adaptive", "#3b6ea8"))):
    attempt, run = run_attempt(FaultyLoop(find_folder(name), "ckf"), STANDSTILL, number=3)
    angle = np.where(run.running, run.angle_error, np.nan)
    print(f"{name}: in charge {100 * np.mean(run.running):.1f} % of the time")
    axes[0, column].plot(run.t[::20], 9.5493 * run.omega[::20], color=colour, lw=0.9)
    axes[1, column].plot(run.t[::20], angle[::20], color=colour, lw=0.9)
    for axis in axes[:, column]:
        axis.axvspan(*attempt.held, color="#bbbbbb", alpha=0.3, lw=0)
    axes[0, column].set(title=f"{name}; shaded: loaded at rest")
    axes[1, column].set(xlabel="time, s", ylim=(-180, 180), yticks=(-180, -90, 0, 90, 180))
axes[0, 0].set(ylabel="true speed, r/min")
axes[1, 0].set(ylabel="angle error, degrees")
Path("salient_against_surface.svg").write_text(svg_text(figure))
