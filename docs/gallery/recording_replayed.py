"""A recording replayed: errors of the estimate, and two sigmas of P about them.

Data of another simulator, whose motor obeys no equation of this project, without noise. Where there is no truth one can
still ask whether what was measured is what the filter expected: the normalised innovation squared, which is 2 on the
mean for sensors as noisy as R says, and less here.
"""

from pathlib import Path

import numpy as np

from runtime.estimator.folder import find_folder
from runtime.recorded.data import read_recorded
from runtime.replay.replay import Settings, replay
from runtime.style.figures import pyplot, svg_text

recorded = read_recorded(Path(__file__).parents[2] / "tests" / "data" / "spmsm_step.npz")
found = replay(find_folder("spmsm_load_torque"), recorded, Settings(kind="ckf"))
print(f"normalised innovation squared: {found.consistency.nis_mean:.3g}")
P = found.P(slice(0, None))
off = np.angle(np.exp(1j * (found.x[:, 3] - recorded.truth["theta"])))
figure, axes = pyplot().subplots(3, 1, figsize=(7.0, 5.0), sharex=True)
for axis, error, state, unit, name in (
    (axes[0], found.x[:, 2] - recorded.truth["omega"], 2, 9.5493, "speed error, r/min"),
    (axes[1], off, 3, 57.296, "angle error, degrees"),
    (axes[2], found.x[:, 4] - recorded.truth["load_torque"], 4, 1.0, "torque error, N m"),
):
    band = 2 * unit * np.sqrt(P[:, state, state])[20::20]
    axis.fill_between(recorded.t[20::20], -band, band, color="#3b6ea8", alpha=0.15, lw=0)
    axis.plot(recorded.t[20::20], unit * error[20::20], color="#3b6ea8", lw=0.9)
    axis.set(ylabel=name)
axes[2].set(xlabel="time, s")
Path("recording_replayed.svg").write_text(svg_text(figure))
