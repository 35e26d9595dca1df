"""How faulty runs are judged, and the command around it: planted evidence ends in exit 1."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import runtime.faults.survey
from runtime.faults.figures import fault_figure
from runtime.faults.survey import Outcome, column, judge, outcome_facts
from runtime.faults.tables import count_text, fault_table, recovery_text, said_text, told_text, worst_text
from tests.judges.made import (
    RPM,
    Kept,
    cells_of,
    command,
    curves,
    faulty_run,
    outcome,
    read_json,
    recovery,
)

T = 1e-3


def spoiled(name: str, values: dict[int, Any], **more: Any) -> Any:
    """A healthy run in which an array has other values at some samples."""
    run = faulty_run(**more)
    array = getattr(run, name).copy()
    for at, value in values.items():
        array[at] = value
    return replace(run, **{name: array})


# --- faults


def test_a_healthy_run_recovers_at_once() -> None:
    found = judge(faulty_run(), T)
    assert found.recovered
    assert (found.time, found.told, found.status, found.idle) == (0.0, -1, 0, 0.0)
    assert (found.speed_error, found.angle_error, found.deviation) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert found.current == 3.0


@pytest.mark.parametrize(
    ("name", "off", "bad"),
    [("x", 19.9 / RPM, False), ("x", 20.1 / RPM, True), ("x", -20.1 / RPM, True)],
)
def test_recovery_counts_from_the_faults_end_to_the_last_bad_sample(name: str, off: float, bad: bool) -> None:
    run = faulty_run()
    x = run.x.copy()
    x[150, 2] += off
    found = judge(replace(run, x=x), T)
    assert found.time == pytest.approx((151 - 110) * T if bad else 0.0)
    assert found.speed_error == pytest.approx(abs(off) * RPM)


@pytest.mark.parametrize(("degrees", "bad"), [(9.9, False), (10.1, True), (-10.1, True)])
def test_an_angle_out_of_its_band(degrees: float, bad: bool) -> None:
    run = faulty_run()
    x = run.x.copy()
    x[150, 3] += math.radians(degrees)
    found = judge(replace(run, x=x), T)
    assert found.time == pytest.approx(0.041 if bad else 0.0)
    assert found.angle_error == pytest.approx(abs(degrees))


def test_who_has_no_rest_or_no_torque_has_not_recovered() -> None:
    assert judge(spoiled("running", {349: False}), T).recovered
    assert judge(spoiled("running", {349: False}), T).time == pytest.approx(0.240)
    assert not judge(spoiled("running", {350: False}), T).recovered, "49 ms are left, 50 are wanted"
    late = judge(spoiled("running", {399: False}), T)
    assert math.isnan(late.time)
    assert late.idle == pytest.approx(0.001)
    assert judge(spoiled("running", {50: False, 120: False, 130: False}), T).idle == pytest.approx(0.002)
    assert judge(spoiled("running", {105: False}), T).time == 0.0, "it is over when the fault is"


def test_who_was_told_and_when() -> None:
    assert judge(spoiled("status", {107: 0x8}), T).told == 7
    assert judge(spoiled("status", {107: 0x8, 108: 0x1}), T).status == 0x9
    assert judge(spoiled("status", {107: 0x2}), T).told == -1, "not converged says nothing"
    assert judge(spoiled("status", {107: 0xA}), T).status == 0x8
    assert judge(spoiled("status", {99: 0x8}), T).told == -1
    assert judge(spoiled("status", {119: 0x8}), T).told == 19
    assert judge(spoiled("status", {120: 0x8}), T).told == -1, "10 ms behind the fault"
    assert judge(spoiled("running", {103: False}), T).told == 3


def test_errors_count_while_the_drive_has_torque_and_only_since_the_fault() -> None:
    run = spoiled("running", {101: False})
    x = run.x.copy()
    x[50, 2], x[101, 2], x[102, 2], x[103, 2] = 9e3, 8e3, run.x[102, 2] + 1.0, 7e3
    powered = run.powered.copy()
    powered[103] = False
    found = judge(replace(run, x=x, powered=powered), T)
    assert found.speed_error == pytest.approx(RPM)
    current = faulty_run().current.copy()
    current[[50, 100, 399]] = [99.0, 7.0, 8.0]
    assert judge(replace(run, current=current), T).current == 8.0
    omega = faulty_run().omega.copy()
    omega[[50, 200]] = [0.0, 97.0]
    assert judge(replace(faulty_run(), omega=omega, x=faulty_run().x), T).deviation == pytest.approx(3 * RPM)


RUNS = (
    recovery(time=0.010, told=3, status=0x8, speed_error=5.0, deviation=30.0, current=12.0),
    recovery(time=0.030, told=-1, status=0x1, speed_error=7.4, angle_error=9.0),
    recovery(time=0.014, told=5, status=0x0, deviation=44.0, current=11.0),
    recovery(time=float("nan"), told=9, status=0x8, current=13.0),
)


def test_figures_over_runs() -> None:
    assert count_text(RUNS) == "3/4"
    assert recovery_text(RUNS) == "14.0 (30.0)"
    assert recovery_text(RUNS[3:]) == "-"
    assert [worst_text(RUNS, name) for name in ("speed_error", "angle_error", "deviation", "current")] == [
        "7",
        "9",
        "44",
        "13",
    ]
    assert worst_text([*RUNS, recovery(current=float("nan"))], "current") == "no number"
    assert said_text(RUNS) == "0x9 3/4"
    assert said_text(RUNS[:1]) == "0x8"
    assert said_text([recovery(status=0, told=-1)]) == "-"
    assert said_text([recovery(status=0, told=2), recovery(status=0, told=-1)]) == "- 1/2"
    assert said_text([recovery(status=4, told=0), recovery(status=0, told=-1)]) == "0x4 1/2", "at once is said too"
    assert said_text([recovery(status=1, told=-1), recovery(status=2, told=-1)]) == "0x3"
    assert said_text([recovery(status=1, told=7), recovery(status=2, told=0)]) == "0x3"
    assert told_text([recovery(told=0), recovery(told=-1)]) == "0"
    assert (told_text(RUNS), told_text([recovery(told=-1)])) == ("9", "-")
    assert list(column(RUNS, "current")) == [12.0, 12.0, 11.0, 13.0]
    assert not outcome(*RUNS).recovered
    assert outcome(*RUNS[:3]).recovered


def test_json_of_an_outcome() -> None:
    facts = outcome_facts(outcome(*RUNS, alone=RUNS[:1]))
    assert (facts["fault"], facts["filter"], facts["recovered"]) == ("lost", "ckf", False)
    assert [run["current"] for run in facts["runs"]] == [12.0, 12.0, 11.0, 13.0]
    assert [run["deviation"] for run in facts["alone"]] == [30.0]
    first = {"time": 0.01, "told": 3, "status": 8, "speed_error": 5.0, "angle_error": 2.0, "deviation": 30.0}
    assert facts["runs"][0] == {**first, "current": 12.0, "idle": 0.004, "gave_up": "", "driven_off": False}


@pytest.mark.parametrize(
    ("lasting", "gave_up", "good"),
    [(0.0, "", False), (0.0, "SLIPPED", False), (6.0, "", False), (6.0, "SLIPPED", True)],
)
def test_where_a_fault_lasts_to_give_up_and_say_why_is_safe(lasting: float, gave_up: str, good: bool) -> None:
    """Never where it passes; and one run that does neither is one too many."""
    lost = recovery(time=float("nan"), gave_up=gave_up)
    found = outcome(recovery(), lost)
    assert replace(found, fault=replace(found.fault, lasting=lasting)).recovered is good
    assert lost.safe is bool(gave_up)
    assert judge(faulty_run(gave_up=gave_up), T).gave_up == gave_up


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    ("share", "gave_up", "good"), [(1.01, "CURRENT", True), (0.99, "CURRENT", False), (1.01, "", False)]
)
def test_a_rotor_that_its_load_drives_off_may_be_given_up(sign: int, share: float, gave_up: str, good: bool) -> None:
    """Only where its back-EMF is beyond the DC link in the end, and only with the reason said."""
    run = faulty_run(gave_up=gave_up, diodes=200.0, mode=np.zeros(len(faulty_run().t), int))
    found = judge(replace(run, omega=np.append(run.omega[:-1], sign * share * 200.0)), T)
    assert not found.recovered
    assert outcome(recovery(), found).recovered is good


def test_the_table_of_faults() -> None:
    alone = (recovery(time=0.5, deviation=99.0, current=77.0), recovery(time=float("nan")))
    (cells,) = cells_of(fault_table([outcome(*RUNS, alone=alone)]))
    assert cells == [
        "lost title",
        "3/4",
        "14.0 (30.0)",
        "7",
        "9",
        "44",
        "13",
        "0x9 3/4",
        "9",
        "1/2",
        "500.0 (500.0)",
        "99",
        "77",
    ]
    headers = [str(one.header) for one in fault_table([]).columns]
    assert headers == [
        "fault",
        "recovered",
        "recovery, ms",
        "r/min",
        "deg",
        "dip",
        "A",
        "said",
        "at",
        "alone",
        "ms",
        "dip",
        "A",
    ]
    table = fault_table([outcome(*RUNS), outcome(*RUNS[:3])])
    assert [cell.style for cell in table.columns[1].cells] == ["bold red", "green"]  # type: ignore[union-attr]


@pytest.mark.parametrize("bad", [None, 0, 1, 3])
def test_faults_ends_with_1_if_one_run_did_not_recover(
    bad: int | None, here: Path, monkeypatch: pytest.MonkeyPatch, kept: Kept
) -> None:
    asked: list[Any] = []
    runs = [recovery(time=float("nan") if k == bad else 0.01) for k in range(4)]
    made = [outcome(*runs[:2], kind="ckf"), outcome(*runs[2:], kind="ickf")]
    monkeypatch.setattr(runtime.faults.survey, "survey", lambda *rest: asked.append(rest) or made)
    code, said = command("faults", "paper_spmsm", "--json", "f.json", "--out", "p", "--seeds", "7", "--load", "3")
    ((folders, kinds, seeds, load, speed, *_),) = asked
    assert [folder.drive for folder in folders] == ["paper_spmsm"]
    assert (kinds, seeds, load, speed) == (None, 7, 3.0, None)
    assert Path("p/faults_d.svg").is_file()
    assert code == (bad is not None), said
    facts = read_json("f.json")
    assert [fact["recovered"] for fact in facts] == [bad not in (0, 1), bad not in (2, 3)]
    assert [run["time"] for fact in facts for run in fact["runs"]] == [None if k == bad else 0.01 for k in range(4)]
    assert said.count("1/2") == (2 if bad is not None else 0), "with the reaction and alone"
    assert (facts[0]["drive"], facts[0]["filter"], facts[0]["fault"]) == ("d", "ckf", "lost")


def test_a_real_loop_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    """The example interrupt's own run: a sensor that is lost for 10 ms is survived, and judged so."""
    from runtime.estimator.folder import find_folder
    from runtime.faults.catalogue import find_faults

    asked: list[Any] = []
    original = runtime.faults.survey.run_fault

    def kept_run(*rest: Any, **keys: Any) -> Any:
        asked.append((rest[3:], keys, original(*rest, **keys)))
        return asked[-1][-1]

    monkeypatch.setattr(runtime.faults.survey, "run_fault", kept_run)
    fault = find_faults(None)[0]
    (found,) = runtime.faults.survey.survey([find_folder("paper_spmsm")], ["ckf"], 2, faults=[fault])
    assert [rest for rest, _, _ in asked] == [(), (1, True), (2, True), (1, False), (2, False)]
    assert isinstance(found, Outcome)
    assert (found.drive, found.kind, found.fault, len(found.recoveries), len(found.alone)) == (
        "paper_spmsm",
        "ckf",
        fault,
        2,
        2,
    )
    facts = outcome_facts(found)
    for run, fact in zip((one for *_, one in asked[1:3]), facts["runs"], strict=True):
        assert 0.3 <= run.t[run.first] <= 0.3205
        speed = np.abs(run.x[:, 2].astype(float) - run.omega)[run.first :][run.running[run.first :]]
        assert fact["speed_error"] == pytest.approx(speed.max() * RPM)
        assert fact["current"] == run.current[run.first :].max()


def test_the_figure_of_faults(kept: Kept) -> None:
    run = faulty_run()
    x = run.x.copy()
    x[:, 2] += 3.0
    x[:, 3] -= 0.02
    run = replace(spoiled("running", {120: False}), x=x, omega=run.omega + np.arange(400) / 10)
    fault_figure([outcome(recovery(), example=run)])
    figure = fault_figure([outcome(recovery(), example=run)])
    speed, off, angle = figure.axes
    assert [axis.get_title() for axis in figure.axes] == ["true speed, r/min", "speed error, r/min", "angle error, deg"]
    time = np.asarray(curves(speed)["ckf"].x)
    np.testing.assert_allclose(time, np.arange(-10, 120), atol=1e-9)
    np.testing.assert_allclose(curves(speed)["ckf"].y, run.omega[90:220] * RPM)
    drawn = curves(off)["ckf"].y
    assert list(np.flatnonzero(np.isnan(drawn))) == [30]
    np.testing.assert_allclose(np.delete(drawn, 30), np.delete(run.speed_error[90:220], 30))
    np.testing.assert_allclose(np.delete(curves(angle)["ckf"].y, 30), np.delete(run.angle_error[90:220], 30))
    assert off.get_ylim() == (-80.0, 80.0)
    low, high = speed.get_ylim()
    drawn_speed = run.omega[90:220] * RPM
    assert low < drawn_speed.min() < drawn_speed.max() < high < low + 2 * np.ptp(drawn_speed)
    omega = 100.0 + np.where(np.arange(400) % 2, 1.0, -1.0) / RPM
    calm = fault_figure([outcome(recovery(), example=replace(faulty_run(), omega=omega))])
    assert calm.axes[0].get_ylim() == pytest.approx((100 * RPM - 20, 100 * RPM + 20)), "40 r/min at least are shown"
    assert angle.get_ylim() == (-40.0, 40.0)
    spans = [patch.get_extents().transformed(off.transData.inverted()) for patch in off.patches]
    assert any((span.x0, span.x1) == pytest.approx((0.0, 10.0)) for span in spans)
    assert any((span.y0, span.y1) == pytest.approx((-20.0, 20.0)) for span in spans)
