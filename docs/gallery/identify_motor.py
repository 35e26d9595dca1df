"""Identify before and after: innovations with guessed motor data, and with those that were found.

The recording is a run of the salient drive; the guesses are 30 % off. Innovations of a filter that knows its motor lie
within the band and are white.
"""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from runtime.drive.experiment import simulate
from runtime.identify.figures import innovations_figure
from runtime.identify.identify import identify
from runtime.identify.subject import read_subject
from runtime.recorded.data import read_recorded

(run,) = simulate("ipmsm", "no_load", ("ckf",))
subject = read_subject("ipmsm", "R,L_d,L_q,psi_m")
facts = subject.facts
guesses = replace(facts, R=1.3 * facts.R, L_d=0.75 * facts.L_d, L_q=1.3 * facts.L_q, psi_m=0.8 * facts.psi_m)
with TemporaryDirectory() as folder:
    run.save(Path(folder) / "run.npz")
    found = identify(replace(subject, facts=guesses), [read_recorded(Path(folder) / "run.npz")])
for estimate in found.result.estimates:
    print(f"{estimate.datum.word}: {estimate.value:.4g} (+- {100 * estimate.width:.2g} %)")
Path("identify_motor.svg").write_text(innovations_figure(found))
