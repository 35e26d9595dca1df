"""Salient drives hold standstill under load, motor data off, by the square wave on the estimated d axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from runtime.drive.scenario import Scenario, find_scenario
from runtime.estimator.folder import GENERATED, GeneratedFolder
from runtime.faults.loop import FAULT, FaultyLoop, FoundMotor
from runtime.folders.stated import stated_drive
from tests.conftest import thoroughly

#: Degrees electrical, and the share of runs that may be beyond. Of 250 runs each traction_70kw was at most 9 degrees
#: off, ipmsm_flux, whose R is not learnt, 12; ipmsm_adaptive, which learns it at rest, lost the rotor in two.
WORST = {"traction_70kw": (10.0, 0.0), "ipmsm_adaptive": (10.0, 0.1), "ipmsm_flux": (13.0, 0.0)}


@dataclass(frozen=True)
class Held(Scenario):
    """To a fifth of the rated speed and back to rest; then a load from 0.4 s on."""

    def speed_reference(self, t: Any) -> Any:
        up_and_down = np.clip(np.minimum(t / 0.05, (0.35 - t) / 0.1), 0.0, 1.0)
        return self.speed * np.pi / 30 * 0.2 * up_and_down

    def load_torque(self, t: Any) -> Any:
        return self.load * np.clip((t - 0.4) / 0.05, 0.0, 1.0)


@pytest.mark.parametrize("runs", [6, *thoroughly(60)])
@pytest.mark.parametrize("name", sorted(WORST))
def test_a_salient_drive_holds_standstill(name: str, runs: int) -> None:
    """Load 0 .. rated of either sign, R off by a fifth, each inductance by a tenth."""
    folder = GeneratedFolder(GENERATED / name, checked=False)
    loop, rated = FaultyLoop(folder, folder.chosen(None)), find_scenario("load_step", stated_drive(folder))
    rng = np.random.default_rng(3)
    beyond = []
    for k in range(runs):
        off = {"R": rng.uniform(0.8, 1.2), "L_d": rng.uniform(0.9, 1.1), "L_q": rng.uniform(0.9, 1.1)}
        given = {**rated.__dict__, "load": (-1) ** k * rng.uniform(0, 1) * rated.load, "duration": 1.2}
        run = loop.run(Held(**given), np.empty(0, FAULT), 0.0, seed=k, motor=FoundMotor(factors=off))
        held = run.t > 0.45
        if not (np.all(run.running[held]) and np.max(np.abs(run.angle_error[held])) < WORST[name][0]):
            beyond.append((k, off))
    assert len(beyond) <= WORST[name][1] * runs, (name, beyond)
