"""How starts are judged, shown and written, and the command around them: planted evidence ends in exit 1."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import runtime.faults.starts
from runtime.drive.scenario import Scenario
from runtime.faults.loop import FaultyRun, FoundMotor
from runtime.faults.standstill import STANDSTILL, Hold, injected_current, judge_standstill
from runtime.faults.starts import FROM_REST, REVERSAL, TURNING, Attempt, Start, Starts, judge_start, starts_facts, times
from runtime.faults.tables import starts_table
from tests.judges.made import RPM, cells_of, command, read_json

T, N = 1e-3, 400
RUNNING, RESTING, FAULT = 4, 0, 5


def made_run(**changes: Any) -> FaultyRun:
    """It runs well from 0.1 s on, backwards at 100 rad/s as it is wanted to."""
    omega = np.full(N, -100.0)
    theta = np.cumsum(4 * omega * T)
    x = np.zeros((N, 4))
    x[:, 2], x[:, 3] = omega, np.remainder(theta + np.pi, 2 * np.pi) - np.pi
    mode = np.where(np.arange(N) < 100, RESTING, RUNNING)
    usual: dict[str, Any] = {
        **dict.fromkeys(("torque", "told"), np.zeros(N)),
        **dict.fromkeys(("status", "reason"), np.zeros(N, int)),
        "kind": "ckf",
        "first": 0,
        "after": 0,
        "t": T * np.arange(N),
        "reference": np.full(N, -100.0),
        "omega": omega,
        "theta": theta,
        "x": x,
        "mode": mode,
        "current": np.full(N, 3.0),
        "phase": np.zeros((N, 2)),
        "duty": np.full((N, 3), 0.5),
        "powered": np.ones(N, bool),
        "band": 20.0,
    }
    usual |= changes
    return FaultyRun(**({"running": usual["mode"] == RUNNING} | usual))


def attempt(least: float = 0.0, since: float = 0.0) -> Attempt:
    return Attempt(Scenario("start", -100.0 * RPM), FoundMotor(), least, since)


def judged(name: str = "mode", values: dict[int, Any] | None = None, least: float = 0.0, since: float = 0.0) -> Start:
    """The made run with other values of an array at some samples; errors of the angle in degrees."""
    run = made_run()
    array = (run.x if name == "angle" else getattr(run, name)).copy()
    for at, value in (values or {}).items():
        if name == "angle":
            array[at, 3] += math.radians(value)
        else:
            array[at] = value
    changed = made_run(**{"x" if name == "angle" else name: array})
    return judge_start(changed, attempt(least, since), max_current=4.0)


def test_a_good_start() -> None:
    found = judged()
    assert (found.locked, found.kept, found.wrong_way) == (True, True, 0.0)
    assert (found.time, found.current) == pytest.approx((0.1, 0.75))
    assert found.angle == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("degrees", "good"), [(9.9, True), (-9.9, True), (10.1, False), (-10.1, False)])
def test_the_angle_in_the_last_50_ms(degrees: float, good: bool) -> None:
    for at in (350, 399):
        found = judged("angle", {at: degrees})
        assert found.locked == good
        assert math.isnan(found.time) != good
        assert found.angle == pytest.approx(abs(degrees))
    early = judged("angle", {349: degrees})
    assert early.locked
    assert early.time == pytest.approx(0.1 if good else 0.35)


def test_who_does_not_run_at_the_end_is_not_locked() -> None:
    assert not judged("mode", {399: RESTING}).locked
    assert not judged("mode", {350: RESTING}).locked
    late = judged("mode", {349: RESTING})
    assert (late.locked, late.kept) == (True, False)
    assert late.time == pytest.approx(0.35)
    assert not judged("mode", dict.fromkeys(range(N), RESTING)).kept


def test_an_angle_counts_as_wrong_while_running_alone() -> None:
    assert judged("angle", {50: 170.0}).angle == pytest.approx(0.0, abs=1e-9)
    assert judged("angle", {150: 170.0}).angle == pytest.approx(170.0)


@pytest.mark.parametrize(("least", "good"), [(0.0, False), (-math.inf, True)])
def test_a_start_must_turn_the_right_way_all_the_time_and_a_catch_need_not(least: float, good: bool) -> None:
    found = judged("omega", {370: 2.0}, least)
    assert found.locked == good
    assert found.wrong_way == pytest.approx(2.0 * RPM)
    assert judged("omega", {200: 7.0}, least).locked
    assert judged("omega", {200: 7.0}, least).wrong_way == pytest.approx(7.0 * RPM)


def test_a_reversal_must_reach_its_speed_and_its_time_counts_from_its_end() -> None:
    assert judged(least=99.9).locked
    assert not judged(least=100.1).locked
    assert judged(since=0.3).time == 0.0
    assert judged("mode", {320: RESTING}, since=0.3).time == pytest.approx(0.021)


def stood(
    shown: bool = True,
    rival: bool = True,
    mode: dict[int, int] | None = None,
    omega: dict[int, float] | None = None,
    degrees: float = 0.0,
) -> Start:
    """The made run, judged as one that was to stand from 0.1 to 0.2 s, then to turn."""
    run = made_run()
    changed = {"mode": run.mode.copy(), "omega": np.where(run.t < 0.2, 0.0, run.omega), "x": run.x.copy()}
    changed["x"][150, 3] += math.radians(degrees)
    for name, values in (("mode", mode or {}), ("omega", omega or {})):
        for at, value in values.items():
            changed[name][at] = value
    reference = np.where(run.t < 0.2, 0.0, -100.0)
    gave_up = "SLIPPED" if changed["mode"][-1] == FAULT else ""
    asked = Hold(attempt().scenario, FoundMotor(), 90.0, 0.2, (0.1, 0.2), 100.0, 2.0, shown, rival)
    return judge_standstill(made_run(**changed, reference=reference, gave_up=gave_up), asked, max_current=4.0)


def test_a_salient_rotor_is_held_and_then_turns() -> None:
    good = stood(degrees=9.9)
    assert (good.locked, good.kept, good.wrong_way) == (True, True, 0.0)
    assert good.angle == pytest.approx(9.9)
    for bad in (
        stood(degrees=10.1),
        stood(mode={100: RESTING}),
        stood(mode={199: RESTING}),
        stood(mode={399: RESTING}),
    ):
        assert not bad.locked
        assert math.isnan(bad.time)
    assert not stood(mode={150: RESTING}).kept
    assert stood(mode={99: RESTING, 200: RESTING}).locked, "before and after it may"
    assert not stood(omega={399: -89.0}).locked, "it turns as wanted in the end"
    assert stood(omega={150: 3.0}).wrong_way == pytest.approx(3.0 * RPM)


def test_a_round_rotor_may_slip_but_neither_turn_fast_nor_stay_away() -> None:
    slipped = stood(shown=False, degrees=170.0, mode={150: RESTING}, omega={120: 99.9})
    assert (slipped.locked, slipped.kept) == (True, False)
    assert math.isnan(slipped.angle)
    assert math.isnan(slipped.ripple)
    assert stood(shown=False, mode={199: RESTING, 210: RESTING}).time == pytest.approx(0.011)
    assert not stood(shown=False, omega={120: 100.1}).locked
    assert not stood(shown=False, omega={120: -100.1}).locked
    assert not stood(shown=False, mode={399: RESTING}).locked


def test_only_a_drive_without_a_rival_may_end_in_fault_at_rest() -> None:
    ended = dict.fromkeys(range(150, N), FAULT)
    assert not stood(shown=False, mode=ended).locked
    alone = stood(shown=False, rival=False, mode=ended, omega={160: 300.0, 140: 40.0})
    assert (alone.locked, alone.gave_up) == (True, "SLIPPED")
    assert alone.wrong_way == pytest.approx(40.0 * RPM), "with its gates off nobody holds it"
    assert not stood(shown=False, rival=False, mode=ended, omega={140: 110.0}).locked
    assert not stood(shown=False, rival=False, mode={399: RESTING}).locked
    assert not stood(rival=False, mode=ended).locked


def test_the_injected_current_is_what_changes_its_sign() -> None:
    k, angle = np.arange(1000), 0.7
    slow, ripple = 5.0 * np.exp(1e-3j * k), 0.3 * (-1.0) ** k * np.exp(1j * angle)
    i = slow + ripple
    phase = np.stack([i.real, -0.5 * i.real + np.sqrt(0.75) * i.imag], axis=1)
    for window in (200, 201):
        assert injected_current(phase, window) == pytest.approx(0.3, rel=1e-2)


def start(**changes: Any) -> Start:
    return replace(Start(True, 0.03, True, 20.0, 4.0, 0.8), **changes)


RUNS = (
    start(),
    start(locked=False, time=float("nan"), current=1.2),
    start(time=0.05, kept=False, wrong_way=44.0),
    start(time=0.034, angle=7.0),
)


def test_figures_over_runs() -> None:
    assert times(RUNS) == pytest.approx((0.034, 0.05))
    assert times(RUNS[1:2]) is None
    assert not Starts("d", "ckf", FROM_REST, RUNS).locked
    assert Starts("d", "ckf", FROM_REST, RUNS[2:]).locked
    assert not Starts("d", "ckf", FROM_REST, ()).locked, "nothing is shown by nothing"


def test_the_table_of_starts() -> None:
    items = [Starts("d", "ckf", FROM_REST, RUNS), Starts("e", "ickf", TURNING, RUNS[1:2])]
    slipped = start(time=float("nan"), angle=float("nan"), gave_up="SLIPPED")
    items += [Starts("f", "ckf", STANDSTILL, (slipped,)), Starts("g", "ckf", STANDSTILL, (start(ripple=0.0519),))]
    assert cells_of(starts_table(items)) == [
        ["d", "ckf", "from rest", "4", "3", "0", "34 (50)", "3", "7", "44", "1.20", "-"],
        ["e", "ickf", "turning", "1", "0", "0", "-", "1", "4", "-", "1.20", "-"],
        ["f", "ckf", "standstill", "1", "1", "1", "-", "1", "-", "20", "0.80", "-"],
        ["g", "ckf", "standstill", "1", "1", "0", "30 (30)", "1", "4", "20", "0.80", "5.2"],
    ]
    good = starts_table([Starts("d", "ckf", FROM_REST, RUNS[2:]), *items])
    assert [cell.style for cell in good.columns[4].cells] == ["green", *["bold red"] * 2, *["green"] * 2]  # type: ignore[union-attr]


def test_json_of_starts() -> None:
    items = [Starts("d", kind, task, RUNS) for kind in ("ckf", "ickf") for task in (FROM_REST, REVERSAL)]
    facts = starts_facts([*items, Starts("e", "ckf", FROM_REST, RUNS[1:2])])["drives"]
    assert set(facts) == {"d", "e"}
    assert set(facts["d"]) == {"ckf", "ickf"}
    own = facts["d"]["ckf"]
    assert (own["runs"], own["locked"], own["lost"], own["kept"]) == (4, 3, [2], 3)
    assert own["time"] == pytest.approx({"median": 0.034, "worst": 0.05})
    assert (own["wrong_way"], own["angle"], own["current"]) == (44.0, 7.0, 1.2)
    assert own["reverse"]["locked"] == 3
    assert "wrong_way" not in own["reverse"]
    assert facts["e"]["ckf"]["time"] is None
    assert (own["gave_up"], own["ripple"]) == ([], None)
    slipped = start(angle=float("nan"), ripple=0.05, gave_up="SLIPPED")
    still = starts_facts([Starts("d", "ckf", STANDSTILL, (start(), slipped))])["drives"]["d"]["ckf"]["still"]
    assert (still["angle"], still["wrong_way"], still["gave_up"]) == (None, 20.0, [2])


@pytest.mark.parametrize("bad", [None, 0, 1, 3])
def test_starts_ends_with_1_if_one_run_did_not_lock(
    bad: int | None, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []
    runs = [start(locked=k != bad) for k in range(4)]
    made = [Starts("d", "ckf", FROM_REST, tuple(runs[:2])), Starts("d", "ckf", TURNING, tuple(runs[2:]))]
    monkeypatch.setattr(runtime.faults.starts, "survey_starts", lambda *rest: asked.append(rest) or made)
    code, said = command(
        "starts", "paper_spmsm", "--runs", "7", "--turning", "--still", "--json", "s.json", "--filters", "ckf"
    )
    ((folders, kinds, tasks, count, _),) = asked
    assert [folder.drive for folder in folders] == ["paper_spmsm"]
    assert (kinds, tasks, count) == (["ckf"], [FROM_REST, TURNING, STANDSTILL], 7)
    assert code == (bad is not None), said
    facts = read_json("s.json")["drives"]["d"]["ckf"]
    assert (facts["locked"], facts["turning"]["locked"]) == (2 - (bad in (0, 1)), 2 - (bad == 3))


def test_no_start_is_no_good_start(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runtime.faults.starts, "survey_starts", lambda *rest: [])
    assert command("starts", "paper_spmsm")[0] == 1
