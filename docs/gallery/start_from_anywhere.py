"""A start from anywhere: twelve rotors at rest, at angles nobody knows.

From power-up, with the supervisor: it reads no back-EMF, so the rotor stands; two filters half a turn apart run until
the rotor has turned, and the one that expected the currents better is followed.
"""

from pathlib import Path

import numpy as np

from runtime.drive.experiment import simulate
from runtime.drive.simulation import Conditions
from runtime.style.figures import pyplot, svg_text

plt = pyplot()
figure, axes = plt.subplots(2, 1, figsize=(7.0, 4.2), sharex=True)
for theta in np.linspace(-np.pi, np.pi, 12, endpoint=False):
    start = Conditions(theta=theta, supervised=True)
    (run,) = simulate("spmsm_load_torque", "no_load", ("ckf",), start)
    shown, colour = run.t < 0.12, plt.cm.twilight((theta + np.pi) / (2 * np.pi))
    axes[0].plot(1e3 * run.t[shown], (run.omega * 60 / (2 * np.pi))[shown], color=colour, lw=0.9)
    axes[1].plot(1e3 * run.t[shown], np.abs(run.angle_error[shown]), color=colour, lw=0.9)
    print(f"{np.degrees(theta):5.0f} degrees: {run.verdict}")
axes[0].set(ylabel="true speed, r/min")
axes[1].set(xlabel="time from power-up, ms", ylabel="angle off, degrees", yticks=(0, 60, 120, 180))
Path("start_from_anywhere.svg").write_text(svg_text(figure))
