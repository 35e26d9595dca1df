"""The paper's figures 8 to 11: a step of 5 N m at 1000 r/min.

The paper's filters know no load torque: a step shows as noise of the speed. A drive that has the load as a state,
`spmsm_load_torque`, is a line of the drive file away.
"""

from pathlib import Path

from runtime.drive.experiment import simulate
from runtime.drive.figures import run_figure

runs = simulate("paper_spmsm", "load_step", ("ckf", "ickf"))
for run in runs:
    print(f"{run.kind}: {run.verdict}, largest speed error in the load step {run.figures()['load_step']:.1f} r/min")
Path("paper_load_step.svg").write_text(run_figure(runs, numbered=True))
