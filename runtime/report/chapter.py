"""The chapter of one drive on the page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from codegen.fast.ablation import Earned
from model.schema import Drive
from runtime.drive.experiment import SweepPoint
from runtime.drive.simulation import Run
from runtime.firmware.gates import Gated
from runtime.proof.result import Proof
from runtime.proof.verify import Evidence


@dataclass(frozen=True)
class Chapter:
    """Proof and simulations of a drive generated into ``folder``; in the second floor all that follows ``runs``.

    ``hard``: the load step under a cheap inverter's conditions. ``earned``: what each pass saves of the first kind.
    """

    drive: Drive
    folder: Path
    proof: Proof
    evidence: Evidence
    runs: list[Run]
    hard: Sequence[Run] = ()
    sweep: Sequence[SweepPoint] = ()
    firmware: Gated | None = None
    earned: Sequence[Earned] = ()

    @property
    def good(self) -> bool:
        """Proved, no firmware check failed, and locked in every scenario with an ideal inverter."""
        return not list(self.failures())

    def failures(self) -> Iterator[str]:
        """The failures, a line each; nothing that was not run."""
        if not self.proof.passed:
            yield f"{self.drive.name}: {self.proof.verdict}"
        for check in self.firmware.checks if self.firmware else ():
            if check.state == "failed":
                yield f"{self.drive.name}: {check.name} of {check.subject} failed"
        for run in self.runs:
            if not run.locked:
                yield f"{self.drive.name}: {run.kind} lost the rotor in {run.scenario.name}"
            elif not run.reached:
                yield f"{self.drive.name}: {run.kind} did not reach the speed of {run.scenario.name}"
        if not self.runs:
            yield f"{self.drive.name}: not simulated"
