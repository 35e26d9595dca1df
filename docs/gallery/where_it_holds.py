"""A map of where a drive holds: speed against a wrong resistance, 384 closed loops at once.

Each cell is a run of the generated controller on a motor of its own, side by side in vector registers: to a speed,
then a step of 3 N m. `pmsm-ickf study map` draws the whole, with loads and a wrong magnet, as a page.
"""

from pathlib import Path

import numpy as np

from model.drives.load import load_drive
from runtime.drive.fleet import Cases, Fleet
from runtime.drive.scenario import find_scenario
from runtime.estimator.folder import find_folder
from runtime.style.figures import pyplot, svg_text

speeds, factors = np.geomspace(20, 1000, 24), np.linspace(0.6, 1.4, 16)
speed, R = (axis.ravel() for axis in np.meshgrid(speeds, factors))
fleet = Fleet(find_folder("spmsm_load_torque"), "ckf")
scenario = find_scenario("load_step", load_drive("spmsm_load_torque"))
found = fleet.run(scenario, Cases(seed=np.arange(speed.size), speed=speed, R=R, load=3.0))
print(f"{np.count_nonzero(found.good)} of {found.good.size} hold")

figure, axis = pyplot().subplots(figsize=(7.0, 3.2))
angle = np.where(found.good, found.angle, np.nan).reshape(len(factors), len(speeds))
edges = np.geomspace(speeds[0], speeds[-1], len(speeds)), factors
drawn = axis.pcolormesh(*edges, angle, cmap="viridis_r", vmin=0, vmax=40, shading="nearest")
axis.set(xscale="log", xlabel="speed, r/min", ylabel="true R over the filter's", facecolor="#c8553d")
axis.set_title("largest angle error, degrees; red: does not hold", fontsize=9, loc="left")
axis.grid(False)
figure.colorbar(drawn)
Path("where_it_holds.svg").write_text(svg_text(figure))
