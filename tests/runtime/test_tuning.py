"""Tuning a filter by study: trials kept, fronts that nothing beats, lines that mean what the table says."""

from __future__ import annotations

import json
import sys
import tomllib
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime.estimator.folder import find_folder
from runtime.study.run import state_study
from runtime.system.errors import UserError

DRIVE = "spmsm_load_torque"


@pytest.fixture(scope="module")
def optuna() -> Any:
    return pytest.importorskip("optuna")


@pytest.mark.thorough
def test_tuning_goes_on_and_never_recommends_what_is_worse(optuna: Any, tmp_path: Path) -> None:
    from runtime.study.figures import write_front
    from runtime.study.tables import front_table, proof_table
    from runtime.study.tune import tune, tuned_facts

    first = tune("ipmsm_flux", "ckf", 10, tmp_path, ["noise=0.05"], 1)
    assert first.own.number == 0
    second = tune("ipmsm_flux", "ckf", 30, tmp_path, ["noise=0.05"], 1)
    assert [point.number for point in second.points] == list(range(30))
    assert second.points[:10] == first.points, "kept, not made again"
    for point in second.front:
        worse = [o for o in second.points if all(np.less_equal(o.values, point.values)) and o.values != point.values]
        assert not worse
    for point in second.points:
        beaten = any(all(np.less_equal(f.values, point.values)) for f in second.front)
        assert beaten, "every trial is on the front or beaten by it"
    assert all(np.less_equal(second.recommended.values, second.own.values))
    filter_part = tomllib.loads(second.lines)
    assert len(filter_part["process_noise"]) == 4
    assert filter_part["process_noise"][0] == filter_part["process_noise"][1]
    factor = filter_part["measurement_noise"][0] / find_folder("ipmsm_flux").module.DEFAULTS["R"][0]
    assert factor == pytest.approx(second.recommended.factors["R"], rel=1e-4)
    assert ET.parse(write_front(second, tmp_path)[0]).getroot().tag.endswith("svg")
    json.dumps(tuned_facts(second), allow_nan=False)
    assert front_table(second).row_count >= 2
    assert proof_table(second).row_count == 2
    with pytest.raises(UserError, match=r"holds another tuning \(seed there: 1, now: 2\)"):
        tune("ipmsm_flux", "ckf", 30, tmp_path, ["noise=0.05"], 2)


def test_a_tunings_figures_are_those_of_a_fleet_with_it(optuna: Any, tmp_path: Path) -> None:
    """The recommended lines, put into a fleet by hand, give the figures of the table on fresh runs."""
    from runtime.drive.fleet import Cases, Fleet
    from runtime.study.tune import CHECK_RUNS, FRESH, tune

    tuned = tune("ipmsm_flux", "ckf", 10, tmp_path, ["noise=0.05"], 3)
    statement, _ = state_study(["ipmsm_flux"], ["ckf"], "load_step", ["noise=0.05"], 3)
    lines = tomllib.loads(tuned.lines)
    tuning = {"Q": lines["process_noise"], "R": lines["measurement_noise"]}
    cases = Cases(seed=statement.draw(FRESH, CHECK_RUNS)["seed"], noise=0.05, tuning=tuning)
    outcomes = Fleet(find_folder("ipmsm_flux"), "ckf").run(statement.scenarios[0], cases)
    means = [float(getattr(outcomes, name).mean()) for name in ("start", "steady_rms", "load_step")]
    assert means == pytest.approx(tuned.check_recommended.values, rel=1e-3)  # the lines have five digits


def test_an_interrupted_tuning_keeps_its_trials(optuna: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from runtime.study import tune as tuning

    rounds = []
    original = tuning.Trials.run

    def interrupted(self: Any, factors: Any, *rest: Any) -> Any:
        rounds.append(len(factors))
        if len(rounds) == 2:
            raise KeyboardInterrupt
        return original(self, factors, *rest)

    monkeypatch.setattr(tuning.Trials, "run", interrupted)
    first = tuning.tune(DRIVE, None, 40, tmp_path, ["noise=0.05"], 1)
    assert first.interrupted
    assert len(first.points) == 10
    second = tuning.tune(DRIVE, None, 20, tmp_path, ["noise=0.05"], 1)
    assert not second.interrupted
    assert len(second.points) == 20
    assert second.points[:10] == first.points


def test_an_interruption_before_the_first_result_starts_over(
    optuna: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from runtime.study import tune as tuning

    def interrupted(*args: Any) -> Any:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(tuning.Trials, "run", interrupted)
        with pytest.raises(KeyboardInterrupt):
            tuning.tune(DRIVE, None, 10, tmp_path, ["noise=0.05"], 1)
    tuned = tuning.tune(DRIVE, None, 10, tmp_path, ["noise=0.05"], 1)
    assert set(tuned.own.factors.values()) == {1.0}


def test_what_tuning_needs_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from runtime.study.tune import tune

    monkeypatch.setitem(sys.modules, "optuna", None)
    with pytest.raises(UserError, match=r"study tune needs Optuna: pip install 'pmsm-ickf\[study\]'"):
        tune(DRIVE, None, 10, tmp_path, ["noise=0.05"], 1)
