"""A fault ridden through: the processor restarts in the middle of a run.

The drive comes up with a rotor that turns. It reads the back-EMF twice, by short circuits of some samples, knows angle,
speed and direction from them, and takes the rotor over while it turns.
"""

from pathlib import Path

from runtime.estimator.folder import find_folder
from runtime.faults.catalogue import find_faults
from runtime.faults.loop import FaultyLoop
from runtime.faults.survey import judge, run_fault, task_of
from runtime.style.figures import pyplot, svg_text

folder = find_folder("spmsm_load_torque")
(fault,) = find_faults("power_cycle")
run = run_fault(FaultyLoop(folder, "ckf"), fault, task_of(folder), seed=1)
print(f"back after {1e3 * judge(run, run.t[1]).time:.0f} ms")

shown = slice(run.first - 200, run.first + 1500)
time = 1e3 * (run.t[shown] - run.t[run.first])
figure, axes = pyplot().subplots(3, 1, figsize=(7.0, 4.6), sharex=True, height_ratios=(2, 2, 1.4))
axes[0].plot(time, (run.omega * 9.5493)[shown], color="#444444", lw=1.0, label="true")
axes[0].plot(time, (run.x[:, 2] * 9.5493)[shown], color="#c8553d", ls="--", lw=0.9, label="estimate")
axes[1].plot(time, run.current[shown], color="#3b6ea8", lw=0.9)
axes[2].step(time, run.mode[shown], color="#444444", lw=1.0)
axes[0].legend(fontsize=8)
axes[0].set(ylabel="speed, r/min")
axes[1].set(ylabel="current, A")
names = ("RESTING", "PROBING", "WAITING", "CATCHING", "RUNNING")
axes[2].set(xlabel="time from the fault, ms", yticks=range(5), yticklabels=names)
Path("fault_ridden_through.svg").write_text(svg_text(figure))
