"""A batch of 1000 filters over one recording, each with a tuning of its own.

The process noise of the speed goes over six decades. Too little of it, and the filter does not follow the load step;
too much, and it follows the sensors' noise. All 1000 run side by side, sixteen in a vector register.
"""

from pathlib import Path

import numpy as np

from runtime import load
from runtime.drive.experiment import simulate
from runtime.style.figures import pyplot, svg_text

(run,) = simulate("paper_spmsm", "load_step", ("ckf",))
around = slice(9000, 14000)  # 0.18 s to 0.28 s: the load steps at 0.2 s
B = 1000
Q = np.geomspace(1e-4, 1e2, B)
f = load("paper_spmsm", filter="ckf", backend="c", dtype="float32")
f.reset(np.repeat(run.x[around.start - 1][:, None], B, axis=1))
for lane, q in enumerate(Q):
    f.backend.filters[lane].Q[2] = q
u, i = (np.repeat(values[around, :, None], B, axis=2) for values in (run.u, run.i))
speed = f.run(u, i).x[:, 2]

error = (speed - run.omega[around, None]) * 9.5493
figure, axis = pyplot().subplots(figsize=(7.0, 3.0))
axis.loglog(Q, np.abs(error[1000:]).max(axis=0), color="#c8553d", lw=1.0, label="largest in the load step")
axis.loglog(Q, np.sqrt((error[-2000:] ** 2).mean(axis=0)), color="#3b6ea8", lw=1.0, label="rms at the end")
axis.axvline(f.tuning["Q"][2], color="#444444", ls=":", label="the paper's")
axis.set(xlabel="Q of omega, (rad/s)^2 a step", ylabel="speed error, r/min")
axis.legend(fontsize=8)
Path("batch_of_1000.svg").write_text(svg_text(figure))
