"""Figures of runs in the closed loop, and the recorded-data side: recomputed from the arrays by other code."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from runtime.drive.experiment import HARD, changed, run_facts, simulate
from runtime.drive.figures import SLICES, loop_figure, run_figure, sweep_figure
from runtime.drive.simulation import Conditions, Run
from runtime.drive.tables import claims, claims_table, remarks, runs_table, sweep_cell, sweep_table
from runtime.estimator.folder import KINDS
from runtime.recorded.truth import angle_error, errors, speed_error
from runtime.system.errors import UserError
from tests.conftest import TASKS
from tests.judges.made import POINTS, Kept, cells_of, curves, run

T = 1e-3
TIME = T * np.arange(1, 401)


def _wild(scenario: str = "load_step", kind: str = "ckf") -> Run:
    """Errors that are large at chosen times: 7 r/min at 50 ms, -20 at 199, 11 at 250, -5 and 4 at the end."""
    speed, angle = np.zeros(400), np.zeros(400)
    for at, value in ((50, 7.0), (199, -20.0), (250, 11.0), (380, -5.0), (390, 4.0)):
        speed[at - 1] = value
    for at, value in ((100, 170.0), (149, -90.0), (200, -9.0), (399, 6.0)):
        angle[at - 1] = value
    return run(scenario, kind, speed, angle)


# --- figures of a run


def test_figures_against_a_loop_over_samples() -> None:
    """Before the load step, from it on, the last 50 ms, after the start: told from the samples' own times."""
    one = _wild()
    late = [k for k, t in enumerate(TIME) if t > 0.3495]
    off = [(float(one.x[k, 2]) - float(one.omega[k])) * 60 / (2 * math.pi) for k in range(400)]
    found = one.figures()
    assert (
        found["start"] == pytest.approx(max(abs(off[k]) for k, t in enumerate(TIME) if t < 0.1995)) == pytest.approx(20)
    )
    assert (
        found["load_step"]
        == pytest.approx(max(abs(off[k]) for k, t in enumerate(TIME) if t > 0.1995))
        == pytest.approx(11)
    )
    assert found["steady_rms"] == pytest.approx(math.sqrt(sum(off[k] ** 2 for k in late) / len(late)))
    assert found["steady_rms"] == pytest.approx(math.sqrt((25 + 16) / 51))
    assert found["angle"] == pytest.approx(9.0), "170 degrees at 100 ms belong to the start"
    assert run("load_step", angle_error=np.where(np.arange(400) == 149, 40.0, 0)).figures()["angle"] == pytest.approx(
        40
    )


def test_without_a_load_the_last_50_ms_stand_in() -> None:
    assert _wild("no_load").figures()["load_step"] == pytest.approx(5.0)
    assert _wild("no_load").figures()["start"] == pytest.approx(20.0)


def test_a_saved_run_gives_the_same_figures(tmp_path: Path) -> None:
    """From the npz alone, the estimate beside it: replay's code, which is not simulate's."""
    one = _wild()
    one.save(tmp_path / "r.npz")
    with np.load(tmp_path / "r.npz") as file:
        saved = {name: file[name] for name in file.files}
    assert sorted(saved) == ["i_alpha", "i_beta", "load_torque", "omega", "t", "theta", "u_alpha", "u_beta"]
    for name, array in (
        ("u_alpha", one.u[:, 0]),
        ("u_beta", one.u[:, 1]),
        ("i_alpha", one.i[:, 0]),
        ("i_beta", one.i[:, 1]),
    ):
        np.testing.assert_array_equal(saved[name], array)
    truth = {name: saved[name] for name in ("omega", "theta", "load_torque")}
    again = errors(saved["t"], one.x, one.state_names, truth)
    figures = one.figures()
    assert again is not None
    assert again.load_step_at == pytest.approx(0.2)
    assert (again.speed_start, again.speed_load_step) == pytest.approx((figures["start"], figures["load_step"]))
    assert again.speed_steady_rms == pytest.approx(figures["steady_rms"])
    assert again.position_max == pytest.approx(170.0)


@pytest.mark.parametrize(
    ("changes", "locked"),
    [
        ({}, True),
        ({"angle_error": 29.9}, True),
        ({"angle_error": -30.1}, False),
        ({"angle_error": 30.1}, False),
        ({"angle_error": np.where(TIME > 0.36, 31.0, 0.0)}, False),
        ({"angle_error": np.where(TIME < 0.34, 179.0, 0.0)}, True),
        ({"angle_error": np.where(np.arange(400) == 349, 31.0, 0.0)}, False),
        ({"speed_error": np.where(np.arange(400) == 3, np.nan, 0.0)}, False),
        ({"speed_error": 500.0}, True),
    ],
)
def test_lock(changes: dict[str, Any], locked: bool) -> None:
    """The angle at the end within 30 degrees electrical, all of it numbers."""
    one = run(**changes)
    assert (one.locked, one.good, one.reached) == (locked, locked, True)
    assert one.verdict == ("locked" if locked else "LOST LOCK")


@pytest.mark.parametrize(
    ("speed", "reached"), [(1099.0, True), (1101.0, False), (901.0, True), (899.0, False), (-1000.0, False)]
)
def test_a_reference_that_is_not_reached_is_no_lost_lock(speed: float, reached: bool) -> None:
    """The true speed within a tenth of the reference; the estimate follows it all the while."""
    one = run(speed=speed)
    assert (one.locked, one.reached, one.good) == (True, reached, reached)
    assert one.verdict == ("locked" if reached else "REFERENCE NOT REACHED")
    assert [f"{speed:.0f} r/min where 1000" in line for line in remarks([one])] == ([] if reached else [True])


@pytest.mark.parametrize(("speed", "reached"), [(19.9, True), (-19.9, True), (20.1, False)])
def test_standstill_is_reached_within_a_share_of_rated_speed(speed: float, reached: bool) -> None:
    one = run(replace(TASKS["no_load"], speed=0.0), speed=speed)
    assert one.reached is reached


def test_remarks_count_the_status() -> None:
    one = replace(run(), bits={"INPUT_REJECTED": 1, "COMMAND_REJECTED": 4, "DIVERGED": 16})
    assert remarks([one]) == []
    status = np.zeros(400, int)
    status[10:22] = 4
    status[20:25] |= 1
    spoiled = replace(one, status=status)
    assert spoiled.status_counts == {"INPUT_REJECTED": 5, "COMMAND_REJECTED": 12}
    assert remarks([spoiled]) == [
        "load_step, ckf: status in 400 samples: INPUT_REJECTED 5, COMMAND_REJECTED 12",
    ]


def test_lock_needs_a_true_speed_that_is_a_number() -> None:
    one = run()
    omega = one.omega.copy()
    omega[0] = np.nan
    failed = replace(one, omega=omega)
    assert (failed.locked, failed.good, failed.verdict) == (False, False, "SIMULATED MOTOR FAILED")


def test_errors_have_a_sign_and_a_unit() -> None:
    one = run(speed_error=3.0, angle_error=-7.0)
    np.testing.assert_allclose(one.speed_error, 3.0)
    np.testing.assert_allclose(one.angle_error, -7.0, atol=1e-9)
    x = np.array([[0, 0, 2.0, 3.0]])
    assert speed_error(x, np.array([1.0]))[0] == pytest.approx(60 / (2 * math.pi))
    assert angle_error(x, np.array([-3.0]))[0] == pytest.approx(math.degrees(6 - 2 * math.pi))
    assert angle_error(np.array([[0, 0, 0, math.pi]]), np.array([0.0]))[0] == -180.0


# --- tables of runs


def test_the_table_of_runs_is_the_figures() -> None:
    runs = [_wild("no_load"), _wild("load_step", "ickf"), run("load_step", "ekf", angle_error=90.0)]
    cells = cells_of(runs_table(runs))
    rms = math.sqrt(41 / 51)
    assert cells[0] == ["no_load", "ckf", "20.00", "-", f"{rms:.3f}", "9.000", "locked"]
    assert cells[1] == ["load_step", "ickf", "20.00", "11.00", f"{rms:.3f}", "9.000", "locked"]
    assert cells[2] == ["load_step", "ekf", "0.00", "0.00", "0.000", "90.000", "LOST LOCK"]
    headers = [str(column.header) for column in runs_table(runs).columns]
    assert headers == ["scenario", "filter", "start, r/min", "load step, r/min", "steady rms, r/min", "angle, deg", ""]
    assert [cell.style for cell in runs_table(runs).columns[-1].cells] == ["green", "green", "bold red"]  # type: ignore[union-attr]


def _four(start: float = 15.0, ckf: float = 1.0) -> list[Run]:
    runs = []
    for scenario in ("no_load", "load_step"):
        for kind, scale in (("ckf", ckf), ("ickf", 1.0)):
            error = np.zeros(400)
            error[20], error[220], error[360:] = scale * start, scale * 6.0, scale * 2.0
            runs.append(run(scenario, kind, error))
    return runs


def test_the_papers_claims_are_told_by_the_numbers() -> None:
    start, start_ckf, steady, step, step_ckf = claims(_four())
    rms = 2 * math.sqrt(40 / 51)
    assert [one.what for one in (start, start_ckf, steady, step, step_ckf)] == [
        "start, ICKF", "start, CKF", "at speed, rms", "5 N m step, ICKF", "5 N m step, CKF"
    ]  # fmt: skip
    assert (start.theirs, start.ours, start.why) == (
        "under 20 r/min",
        "15.0 r/min",
        "agrees, with the corrected equations",
    )
    assert (start_ckf.ours, step.ours, step_ckf.ours) == ("15.0 r/min", "6.0 r/min", "6.0 r/min")
    assert steady.ours == f"CKF {rms:.2f}, ICKF {rms:.2f} r/min"
    assert all("repeat the CKF's update" in one.why for one in (start_ckf, steady, step_ckf))
    assert cells_of(claims_table([start])) == [[start.what, start.theirs, start.ours, start.why]]
    assert claims(_four(20.5))[0].why.startswith("not reached")
    assert claims(_four(19.9))[0].why.startswith("agrees")
    figures = {"start": 20.0, "load_step": 6.0, "steady_rms": 1.0}
    met: list[Any] = [
        SimpleNamespace(scenario=SimpleNamespace(name=s), kind=k, figures=lambda: figures)
        for s in ("no_load", "load_step")
        for k in ("ckf", "ickf")
    ]
    assert claims(met)[0].why.startswith("not reached"), "20 r/min are not under 20 r/min"
    apart = claims(_four(ckf=1.1))
    assert apart[0].ours == "15.0 r/min"
    assert apart[1].ours == "16.5 r/min"
    assert apart[2].ours == f"CKF {1.1 * rms:.2f}, ICKF {rms:.2f} r/min"
    assert apart[4].ours == "6.6 r/min"
    assert all("grown into two different runs" in apart[k].why for k in (1, 2, 4))
    assert all("repeat the CKF's update" in claims(_four(ckf=1.0098))[k].why for k in (1, 2, 4))
    assert all("grown into two different runs" in claims(_four(ckf=0.9))[k].why for k in (1, 2, 4))
    assert all("repeat the CKF's update" in claims(_four(ckf=0.992))[k].why for k in (1, 2, 4))
    still = claims([run(scenario, kind) for scenario in ("no_load", "load_step") for kind in ("ckf", "ickf")])
    assert all("repeat the CKF's update" in still[k].why for k in (1, 2, 4)), "no error is like no error"
    for k in range(4):
        assert claims([one for j, one in enumerate(_four()) if j != k]) == []


def test_the_sweeps_table_and_figure(kept: Kept) -> None:
    assert cells_of(sweep_table(POINTS)) == [
        ["100 us", "loses lock", "12.3 r/min"],
        ["20 us", "30.1 r/min", "11.0 r/min"],
    ]
    assert [str(column.header) for column in sweep_table(POINTS).columns] == ["T", "Euler", "exact"]
    assert sweep_cell(POINTS[0]) == "loses lock"
    sweep_figure(POINTS)
    (axis,) = kept.axes
    found = curves(axis)
    assert (list(found["euler"].x), list(found["euler"].y)) == ([20.0], [30.06])
    assert (list(found["exact"].x), list(found["exact"].y)) == (pytest.approx([100.0, 20.0]), [12.34, 11.0])
    assert [one.get_text() for one in axis.texts] == ["euler loses lock"]
    assert axis.texts[0].xy[0] == pytest.approx(100.0)
    assert axis.get_xlabel() == "sample time, us"
    assert axis.get_ylabel() == "largest speed error\nwhile starting, r/min"


def test_the_figure_of_a_run_is_its_arrays(kept: Kept) -> None:
    one, other = _wild(), run("load_step", "ickf", 2.0, 3.0)
    run_figure([one, other], numbered=True)
    speed, off, position, angle = kept.axes
    assert [axis.get_title("left") for axis in kept.axes] == ["fig. 8", "fig. 9", "fig. 10", "fig. 11"]
    labels = ["speed, r/min", "speed error, r/min", "position,\nrad electrical", "position error,\ndeg electrical"]
    assert [axis.get_ylabel() for axis in kept.axes] == labels
    np.testing.assert_allclose(curves(speed)["ckf, true"].y, 1000.0)
    np.testing.assert_array_equal(curves(speed)["ckf, true"].x, one.t)
    for axis, values in ((off, one.speed_error), (angle, one.angle_error)):
        slices = values.reshape(SLICES, -1)
        low, high = (line.get_ydata() for line in axis.lines[:2])
        np.testing.assert_array_equal(low, slices.min(axis=1))
        np.testing.assert_array_equal(high, slices.max(axis=1))
        drawn = axis.collections[0].get_paths()[0].vertices[:, 1]
        assert (drawn.min(), drawn.max()) == (values.min(), values.max()), "what is seen is the band"
    drawn = curves(position)
    late = one.t >= 0.3695
    np.testing.assert_array_equal(drawn["ckf, estimate"].y, one.x[late, 3])
    np.testing.assert_array_equal(drawn["ckf, estimate"].x, one.t[late])
    true = [math.remainder(value, 2 * math.pi) for value in one.theta[late]]
    np.testing.assert_allclose(drawn["true"].y, true, atol=1e-9)
    run_figure([_wild("no_load")], numbered=True)
    assert [axis.get_title("left") for axis in kept.axes] == ["fig. 4", "fig. 5", "fig. 6", "fig. 7"]
    run_figure([one])
    assert [axis.get_title("left") for axis in kept.axes] == [""] * 4


def test_a_band_holds_its_extremes(kept: Kept) -> None:
    values = np.zeros(4000)
    values[1234], values[1235] = 5.0, -3.0
    run_figure([replace(run(T=1e-4), x=run(T=1e-4, speed_error=values).x)])
    low, high = (np.asarray(line.get_ydata()) for line in kept.axes[1].lines)
    assert (low.min(), high.max()) == pytest.approx((-3.0, 5.0))
    assert len(low) == SLICES
    assert kept.axes[1].lines[0].get_xdata()[np.argmin(low)] == pytest.approx(0.1235, abs=4e-3)


def test_facts_of_a_run() -> None:
    facts = run_facts(_wild())
    words = {"filter": "ckf", "scenario": "load_step", "locked": True, "reached": True, "status": {}}
    assert {key: value for key, value in facts.items() if key != "task"} == {**words, **_wild().figures()}
    assert (facts["task"]["speed"], facts["task"]["load"]) == (1000.0, 5.0)
    lost = replace(_wild(), x=np.full((400, 4), np.nan))
    assert run_facts(lost)["start"] is None, "JSON knows no NaN"
    assert run_facts(run(angle_error=90.0))["locked"] is False
    assert run_facts(run(speed=500.0))["reached"] is False


def test_conditions_that_the_page_names() -> None:
    assert (HARD.inverter, HARD.dead_time, HARD.bits, HARD.delay) == ("pwm", 2e-6, 12, 1)
    assert (Conditions().noise, Conditions().range, Conditions().seed) == (None, None, 1)
    with pytest.raises(UserError, match="no filter"):
        simulate("paper_spmsm", kinds=["ckf", "abc"])
    assert KINDS == ("ckf", "ickf", "ekf", "ukf")


def test_changed_changes_one_key() -> None:
    from model.drives.load import load_drive

    drive = load_drive("paper_spmsm")
    other = changed(drive, model={"sample_time": 1e-4}, filter={"kinds": ["ekf"]})
    assert (other.model.sample_time, other.filter.kinds) == (1e-4, ["ekf"])
    assert other.model.discretization == drive.model.discretization
    assert drive.model.sample_time == 2e-5


def test_the_loop_at_a_glance(kept: Kept) -> None:
    """Estimate and truth by their labels, errors in their units, where the load steps."""
    one = _wild()
    loop_figure(one)
    speed, off, angle = kept.axes
    found = curves(speed)
    np.testing.assert_allclose(found["ckf, estimate"].y, one.x[:, 2] * 30 / np.pi)
    np.testing.assert_allclose(found["true"].y, 1000.0)
    assert [axis.get_ylabel() for axis in kept.axes] == ["speed, r/min", "its error,\nr/min", "angle error,\ndeg el."]
    assert [text.get_text() for text in speed.texts] == [" 5 N m"]
    assert speed.texts[0].xy[0] == pytest.approx(one.scenario.load_at)
    for axis, values in ((off, one.speed_error), (angle, one.angle_error)):
        drawn = axis.collections[0].get_paths()[0].vertices[:, 1]
        assert (drawn.min(), drawn.max()) == (values.min(), values.max())
