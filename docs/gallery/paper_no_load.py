"""The paper's figures 4 to 7: from standstill to 1000 r/min without load.

The paper reports a largest speed error of under 20 r/min for its ICKF and of over 1000 for its CKF. With its misprints
corrected both are the same filter here, since currents are states and measured: the lines lie on each other.
"""

from pathlib import Path

from runtime.drive.experiment import simulate
from runtime.drive.figures import run_figure

runs = simulate("paper_spmsm", "no_load", ("ckf", "ickf"))
for run in runs:
    print(f"{run.kind}: {run.verdict}, largest speed error while starting {run.figures()['start']:.1f} r/min")
Path("paper_no_load.svg").write_text(run_figure(runs, numbered=True))
