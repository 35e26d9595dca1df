"""What the page says of one drive."""

from __future__ import annotations

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
    """Proof and simulations of a drive generated into ``folder``.

    ``hard``: the load step under a cheap inverter's conditions. ``earned``: what each pass saves of the first kind.
    """

    drive: Drive
    folder: Path
    proof: Proof
    evidence: Evidence
    runs: list[Run]
    hard: list[Run]
    sweep: list[SweepPoint]
    firmware: Gated
    earned: list[Earned]

    @property
    def good(self) -> bool:
        """Proved, no firmware check failed, and locked in every scenario with an ideal inverter."""
        return self.proof.passed and not self.firmware.failed and all(run.locked for run in self.runs)
