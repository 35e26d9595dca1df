"""What P says of the angle: from the words of a filter's state, and along a simulated run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from model.drives.load import load_drive
from runtime.drive.scenario import find_scenario
from runtime.drive.simulation import Simulator
from runtime.estimator.deviation import angle_deviation
from runtime.estimator.estimator import load
from runtime.estimator.folder import GENERATED, GeneratedFolder


@pytest.mark.parametrize("drive", ["paper_spmsm", "spmsm_load_torque", "ipmsm_adaptive", "traction_70kw"])
def test_it_is_the_root_of_the_angles_variance(drive: str) -> None:
    """In each place that the angle has in the root: L D L^T in full says the same."""
    module = GeneratedFolder(GENERATED / drive).module
    words = np.random.default_rng(3).uniform(0.1, 1.0, (50, module.WORDS)).astype(np.float32)
    P = np.stack([module.unpack(w)[module.ANGLE, module.ANGLE] for w in words])
    np.testing.assert_allclose(angle_deviation(module, words), np.sqrt(P), rtol=1e-14)


def test_a_run_has_the_filters_own_word_sample_by_sample() -> None:
    """That of the filter replayed over the run's voltages and currents; from both loops."""
    name = "ipmsm_adaptive"
    scenario = replace(find_scenario("no_load", load_drive(name)), duration=0.02)
    loop = Simulator(GeneratedFolder(GENERATED / name), "ckf")
    run, twin = loop.run(scenario), loop.run(scenario, controller="numpy")
    np.testing.assert_array_equal(run.angle_sigma, twin.angle_sigma)
    trace = load(name, "ckf", dtype="float32").run(run.u, run.i)
    replayed = np.degrees(np.sqrt(trace.P[:, 3, 3].astype(float)))
    # float32 numbers of the same filter, which the run has of its own currents before they were turned to alpha-beta
    np.testing.assert_allclose(run.angle_sigma, replayed, rtol=1e-3)
    assert np.ptp(run.angle_sigma) > 0.1
