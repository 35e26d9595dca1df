"""Faults in operation: the generated example interrupt turns the generated motor at speed under load, and recovers."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from runtime.cli import app
from runtime.drive.scenario import Scenario
from runtime.drive.simulation import Conditions, numpy_controller
from runtime.estimator.folder import find_folder
from runtime.faults.catalogue import FAULTS
from runtime.faults.loop import FAULT, FaultyLoop
from runtime.faults.survey import circumstances, judge, run_fault
from runtime.system.errors import UserError
from tests.conftest import DRIVES

TASK = Scenario("faults", speed=1000.0, load=5.0, duration=0.5, least_band=20.0)
FAULT_BY_NAME = {fault.name: fault for fault in FAULTS}

#: Of spmsm_load_torque: status bits that must be among those said, by which sample, and the longest recovery in s. A
#: restart is 2 ms of rest, the probe, and 3 ms in which the filter must be content; what needs none passes as soon as
#: the filter has forgotten the fault.
EXPECTED = {
    "lost_sample": (0x1, 0, 0.0),
    "lost_burst": (0x1, 0, 0.0),
    "stuck_5ms": (0, None, 0.02),  # near its crest a current hardly moves in 5 ms: the filter absorbs that
    "stuck_50ms": (0x10, 100, 0.02),
    "saturated": (0x10, 300, 0.02),
    "sag_known": (0, None, 0.02),
    "sag_unknown": (0x10, 50, 0.02),
    "garbage": (0x1, 5, 0.01),
    "power_cycle": (0, 50, 0.01),
    "gain_jump": (0x10, 100, 0.02),
    "offset_jump": (0x10, 100, 0.02),
    "offset_drift": (0x10, 1500, 0.02),
    "stalled": (0x10, 50, 0.02),
    "overload": (0, None, 0.02),
}
#: Those that stay: status bits, by which sample, and the reasons that may be given for giving up.
STAYING = {
    "phase_lost": (0x10, 50, {"PHASE", "NOT_STARTED"}),  # or the load has driven the rotor off before it is told
    "swapped": (0x10, 0, {"CURRENT"}),
}


@pytest.fixture(scope="module")
def loop() -> FaultyLoop:
    return FaultyLoop(find_folder("spmsm_load_torque"), "ickf")


def test_every_fault_is_expected_of() -> None:
    assert [*EXPECTED, *STAYING] == list(FAULT_BY_NAME)


@pytest.mark.parametrize("name", EXPECTED)
def test_recovers_and_says_so(name: str, loop: FaultyLoop) -> None:
    bits, by_sample, longest = EXPECTED[name]
    task = replace(TASK, duration=0.7) if name == "offset_drift" else TASK  # it takes 0.2 s
    for seed in range(1, 4):
        recovery = judge(run_fault(loop, FAULT_BY_NAME[name], task, seed), loop.module.SAMPLE_TIME)
        assert recovery.time <= longest  # NaN fails
        assert recovery.status & bits == bits
        if by_sample is not None:
            assert 0 <= recovery.told <= by_sample


@pytest.mark.parametrize("name", STAYING)
def test_what_stays_ends_in_fault_and_says_why(name: str, loop: FaultyLoop) -> None:
    bits, by_sample, reasons = STAYING[name]
    run = run_fault(loop, FAULT_BY_NAME[name], TASK, 1)
    found = judge(run, loop.module.SAMPLE_TIME)
    assert not found.recovered
    assert found.gave_up in reasons
    assert found.status & bits == bits
    assert 0 <= found.told <= by_sample
    assert run.mode[-1] == loop.module.FAULT
    gave_up = int(np.argmax(run.mode == loop.module.FAULT))
    assert set(run.mode[gave_up:]) == {loop.module.FAULT}, "for good"
    assert np.max(run.current[gave_up + 100 :]) == 0.0


@pytest.mark.parametrize(
    ("name", "speed"),
    [*product(DRIVES, (1000.0, -1000.0, 300.0)), ("ipmsm_adaptive", 1000.0), ("spmsm_adaptive", 1000.0)],
)
def test_a_rotor_that_turns_is_caught_at_any_angle(name: str, speed: float) -> None:
    """The load drives one direction and brakes the other."""
    loop = FaultyLoop(find_folder(name), "ickf")
    task = Scenario("turning", speed=speed, load=5.0, duration=0.45, least_band=20.0)
    for seed in range(1, 4):
        recovery = judge(run_fault(loop, FAULT_BY_NAME["power_cycle"], task, seed), loop.module.SAMPLE_TIME)
        assert recovery.time <= 0.05  # NaN fails


def test_without_the_reaction_the_papers_filter_believes_in_the_opposite_speed() -> None:
    """It is content half a turn off, as it allows its speed any change: what the reaction is for; judge() sees it."""
    loop = FaultyLoop(find_folder("paper_spmsm"), "ickf")
    runs = [run_fault(loop, FAULT_BY_NAME["power_cycle"], TASK, seed, reacting=False) for seed in range(1, 4)]
    assert not all(judge(run, loop.module.SAMPLE_TIME).recovered for run in runs)


def test_no_fault_no_reaction(loop: FaultyLoop) -> None:
    """From power-up: rest, a probe that finds no back-EMF, a start, and then torque for good."""
    run = loop.run(TASK, np.empty(0, FAULT), 0.0)
    changes, m = np.flatnonzero(np.diff(run.mode)), loop.module
    assert list(run.mode[[0, *(changes + 1)]]) == [m.RESTING, m.PROBING, m.STARTING, m.RUNNING]
    assert not run.reason.any()
    assert not (run.status & ~m.UNOBSERVABLE).any()  # that bit: a round rotor at rest shows nothing
    assert not run.status[len(run.status) // 2 :].any()
    assert np.max(np.abs(run.speed_error[changes[-1] + 1 :])) < run.band


def test_a_seed_makes_a_run(loop: FaultyLoop) -> None:
    first, again, other = (run_fault(loop, FAULT_BY_NAME["garbage"], TASK, seed) for seed in (5, 5, 6))
    assert first.x.tobytes() == again.x.tobytes()
    assert first.phase.tobytes() == again.phase.tobytes()
    assert first.x.tobytes() != other.x.tobytes()


def test_a_sensor_that_does_not_read_zero_keeps_the_inverter_off(loop: FaultyLoop) -> None:
    """Stuck at what it last read, for long: no torque until it is well again."""
    module = loop.module
    fault = FAULT_BY_NAME["garbage"].rows(circumstances(loop.folder, TASK), np.random.default_rng(1))
    stuck = np.repeat(fault[-1:], 1000)
    stuck["phase"] = 4.0
    run = loop.run(TASK, np.concatenate([fault, stuck]), 0.2)
    assert not np.any(run.running[run.first + len(fault) : run.after])
    assert set(run.mode[run.first + len(fault) + 10 : run.after]) == {module.RESTING}
    assert np.max(run.current[run.first + len(fault) + 10 : run.after]) == 0.0
    assert judge(run, module.SAMPLE_TIME).recovered


@pytest.mark.parametrize("name", ["garbage", "stuck_5ms", "sag_known", "gain_jump"])
@pytest.mark.parametrize("drive", ["spmsm_load_torque", "ipmsm_flux"])
def test_c_and_numpy_keep_the_same_bits(drive: str, name: str) -> None:
    """The generated controller alone, whatever comes in; its NumPy twin gets what the C got."""
    loop = FaultyLoop(find_folder(drive), "ickf")
    module = loop.module
    rows = FAULT_BY_NAME[name].rows(circumstances(loop.folder, TASK), np.random.default_rng(3))[:60]
    short = Scenario("short", speed=1000.0, ramp=0.01, load=2.0, load_at=0.01, duration=0.03, least_band=20.0)
    run = loop.run(short, rows, 0.015, reacting=False)
    gain = dict(zip(module.GAIN_NAMES, module.GAIN, strict=True)) | {"advance": module.ADVANCE_DELAYED}
    twin = numpy_controller(module, {}, tuple(gain.values()), Conditions(delay=1))
    single: Any = np.float32
    step = module.STEPS["ickf"]
    for k in range(len(run.t)):
        command = (single(run.reference[k]), single(run.told[k]))
        phase = (run.phase[k, 0], run.phase[k, 1])
        with np.errstate(all="ignore"):
            duty, status = module.foc_step(twin, step, phase, command, module.MATH["float32"])
        assert np.array(twin.filter.x, single).tobytes() == run.x[k].tobytes(), k
        assert np.array(duty, single).tobytes() == run.duty[k].tobytes(), k
        assert status == run.status[k], k


def test_command(tmp_path: Path) -> None:
    arguments = ["faults", "spmsm_load_torque", "--filters", "ckf", "--seeds", "1", "--only", "lost_sample,garbage"]
    done = CliRunner().invoke(app, [*arguments, "--json", str(tmp_path / "f.json"), "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert all(FAULT_BY_NAME[name].title in done.output for name in ("lost_sample", "garbage"))
    assert (tmp_path / "faults_spmsm_load_torque.svg").read_text().startswith("<svg")
    outcomes = json.loads((tmp_path / "f.json").read_text())
    assert [(outcome["fault"], outcome["recovered"]) for outcome in outcomes] == [
        ("lost_sample", True),
        ("garbage", True),
    ]


def test_what_does_not_recover_fails_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    """No estimate is within nothing of the truth."""
    monkeypatch.setattr("runtime.drive.scenario.REACHED_OF_RATED", 0.0)
    arguments = ["faults", "spmsm_load_torque", "--filters", "ckf", "--seeds", "1", "--only", "lost_sample"]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 1
    assert "0/1" in done.output


@pytest.mark.parametrize(
    ("arguments", "words"), [(["--filters", "ukf"], "no filter 'ukf'"), (["--only", "fire"], "no fault 'fire'")]
)
def test_what_is_not_there_is_one_line(arguments: list[str], words: str) -> None:
    done = CliRunner().invoke(app, ["faults", "spmsm_load_torque", "--seeds", "1", *arguments])
    assert isinstance(done.exception, UserError)
    assert words in str(done.exception)
