"""Four filters on one drive: EKF, UKF, CKF and ICKF.

The load step of a salient machine with flux linkages as states, where the measurement is curved and the four are not
the same. What decides is the tuning, not the letter before KF.
"""

from pathlib import Path

from runtime.drive.experiment import simulate
from runtime.drive.figures import COLOURS, DASHES
from runtime.style.figures import pyplot, svg_text

figure, axes = pyplot().subplots(2, 1, figsize=(7.0, 4.2), sharex=True)
for run in simulate("ipmsm_flux", "load_step", ("ekf", "ukf", "ckf", "ickf")):
    style = {"color": COLOURS[run.kind], "ls": DASHES[run.kind], "lw": 0.9, "label": run.kind}
    axes[0].plot(run.t[::8], run.speed_error[::8], **style)
    axes[1].plot(run.t[::8], run.angle_error[::8], **style)
    print(run.kind, {name: round(value, 2) for name, value in run.figures().items()})
axes[0].set(ylabel="speed error, r/min")
axes[1].set(xlabel="time, s", ylabel="angle error, degrees")
axes[0].legend(ncols=4, fontsize=8)
Path("four_filters.svg").write_text(svg_text(figure))
