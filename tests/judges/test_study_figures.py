"""Intervals, quantiles, pairs and drawings of studies: each figure again from the arrays, by another way."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

import runtime.study.figures
import runtime.study.run
import runtime.study.tune
from runtime.study.analysis import (
    FIGURES,
    Difference,
    Rate,
    comparisons,
    paired,
    quantiles,
    quick,
    study_facts,
    success,
    success_over,
    wilson,
)
from runtime.study.figures import _cells, angle_figure, front_figure, map_figure, most_telling, violin_figure
from runtime.study.run import Study
from runtime.study.statement import Range
from runtime.study.tables import front_table, groups_table, paired_table, proof_table, verdict
from runtime.study.tune import Check, Point, Tuned, tuned_facts
from tests.judges.made import Kept, cells_of, command, curves, group, read_json

# --- intervals, quantiles, pairs


@pytest.mark.parametrize(("successes", "runs"), [(0, 7), (7, 7), (3, 7), (98, 100), (1, 1000)])
def test_wilsons_interval_solves_its_equation(successes: int, runs: int) -> None:
    """Its ends are the p at which the observed share lies 1.96 standard errors away."""
    rate = wilson(successes, runs)
    z, share = stats.norm.ppf(0.975), successes / runs
    assert (rate.successes, rate.runs, rate.rate) == (successes, runs, share)
    assert rate.low <= share <= rate.high
    for end, trivial in ((rate.low, successes == 0), (rate.high, successes == runs)):
        if trivial:
            assert end in (0.0, 1.0)
        else:
            assert abs(share - end) / math.sqrt(end * (1 - end) / runs) == pytest.approx(z)
    empty = wilson(0, 0)
    assert (empty.runs, empty.low, empty.high, math.isnan(empty.rate)) == (0, 0.0, 1.0, True)


def _study(*groups: Any, **more: Any) -> Study:
    ranges, supervised = more.pop("ranges", ()), more.pop("supervised", False)
    statement: Any = SimpleNamespace(facts=lambda: {"seed": 1}, ranges=ranges, supervised=supervised)
    return Study(
        statement, more.pop("runs", 40), tuple(groups), more.pop("folder", Path(".")), more.pop("interrupted", False)
    )


LOCKED = np.array([1] * 36 + [0] * 4)


def test_success_quickness_and_quantiles() -> None:
    times = np.r_[np.full(30, 0.2), np.full(6, 0.2001), np.full(4, 0.01)]
    one = group("ckf", LOCKED, lock_time=times, start=np.r_[np.arange(36.0), 1e9, 1e9, 1e9, 1e9])
    assert (success(one).successes, success(one).runs) == (36, 40)
    assert (quick(one).successes, quick(one).runs) == (30, 40), "in time and locked to the end"
    five, median, ninety_five, worst = quantiles(one)["start"]
    assert (worst, median) == (35.0, 17.5)
    assert (five, ninety_five) == pytest.approx((0.05 * 35, 0.95 * 35))
    assert set(quantiles(one)) == set(FIGURES) == {"start", "load_step", "steady_rms", "angle", "lock_time"}
    assert FIGURES == {"start": "r/min", "load_step": "r/min", "steady_rms": "r/min", "angle": "deg", "lock_time": "s"}
    named = group("ckf", [1], start=[1.0], load_step=[2.0], steady_rms=[3.0], angle=[4.0], lock_time=[5.0])
    assert [quantiles(named)[name][1] for name in FIGURES] == [1, 2, 3, 4, 5]
    assert all(math.isnan(v) for values in quantiles(group("ckf", [0, 0])).values() for v in values)


def test_pairs_are_second_minus_first_of_the_same_run() -> None:
    a = group("ckf", [1, 1, 0, 1], [0, 1, 2, 9], start=[1.0, 2.0, 3.0, 50.0], angle=[4.0, 4.0, 4.0, 4.0])
    b = group("ickf", [1, 1, 1], [2, 1, 0], start=[5.0, 7.0, 4.0], angle=[1.0, 1.0, 1.0])
    found = {one.figure: one for one in paired(a, b)}
    assert (found["start"].mean, found["start"].runs) == (pytest.approx(((4 - 1) + (7 - 2)) / 2), 2)
    assert (found["success"].mean, found["success"].runs) == (pytest.approx(1 / 3), 3)
    assert (found["start"].first, found["start"].second, found["start"].drive) == ("ckf", "ickf", "d")
    assert (found["angle"].mean, found["angle"].low, found["angle"].high) == (-3.0, -3.0, -3.0)
    assert found["start"].low < found["start"].mean < found["start"].high
    assert paired(group("ckf", [1], [0]), group("ickf", [1], [1])) == []
    other = group("ukf", [1, 1, 1], [2, 1, 0])
    pairs = [(one.first, one.second) for one in comparisons(_study(a, b, other)) if one.figure == "success"]
    assert pairs == [("ckf", "ickf"), ("ckf", "ukf")]
    assert comparisons(_study(a, replace(b, drive="e"))) == []


def test_a_resampled_interval_is_the_means_own() -> None:
    values = np.random.default_rng(8).normal(2.0, 3.0, 400)
    zero = np.zeros(400)
    found = {one.figure: one for one in paired(group("a", zero + 1, start=zero), group("b", zero + 1, start=values))}[
        "start"
    ]
    half = stats.norm.ppf(0.975) * values.std(ddof=1) / 20
    assert found.mean == pytest.approx(values.mean())
    assert (found.low, found.high) == pytest.approx((values.mean() - half, values.mean() + half), abs=0.025)


def _difference(figure: str, low: float, mean: float, high: float) -> Difference:
    return Difference("d", "ckf", "ickf", figure, 10, mean, low, high)


@pytest.mark.parametrize(
    ("item", "words"),
    [
        (_difference("start", 0.0, 0.0, 0.0), "identical"),
        (_difference("start", -1.0, 1.0, 3.0), "no difference shown"),
        (_difference("start", 0.0, 1.0, 3.0), "no difference shown"),
        (_difference("start", -3.0, -1.0, 0.0), "no difference shown"),
        (_difference("start", 1.0, 2.0, 3.0), "ckf better"),
        (_difference("start", -3.0, -2.0, -1.0), "ickf better"),
        (_difference("success", 0.1, 0.2, 0.3), "ickf better"),
        (_difference("success", -0.3, -0.2, -0.1), "ckf better"),
    ],
)
def test_words_of_a_difference(item: Difference, words: str) -> None:
    assert verdict(item) == words


def test_tables_of_a_study() -> None:
    one = group("ckf", LOCKED, start=np.arange(40.0), lock_time=np.full(40, 0.1))
    other = group("ickf", np.ones(40), start=np.arange(40.0) + 2, lock_time=np.full(40, 0.3))
    rows = cells_of(groups_table(_study(one, other)))
    low, high = stats.binomtest(36, 40).proportion_ci(method="wilson")
    share = f"90.0 ({100 * low:.1f} .. {100 * high:.1f})"
    assert rows[0][:5] == ["d", "ckf", "40", share, share]
    assert rows[0][5] == "17.5 / 33.2 / 35"
    assert rows[1][2] == "40"
    assert rows[1][3].startswith("100.0 (")
    assert rows[1][4].startswith("0.0 (0.0 ..")
    headers = [str(column.header) for column in groups_table(_study(one)).columns]
    assert headers[3:6] == ["success, % (95 %)", "within 0.2 s", "start, r/min"]
    assert groups_table(_study(one)).caption == "median / 95 % / worst, of the runs that locked"
    styles = [str(cell.style) for cell in groups_table(_study(one, other, group("x", [0, 0, 1]))).columns[3].cells]  # type: ignore[union-attr]
    assert styles == ["", "green", "bold red"]
    table = paired_table(_study(one, other))
    assert table is not None
    pairs = {row[2]: row for row in cells_of(table)}
    assert pairs["success"][:2] == ["d", "ickf - ckf"]
    assert pairs["success"][3:5] == ["40", "+10 %"]
    assert pairs["success"][5].startswith("+2.5 .. +")
    assert pairs["start"][3:] == ["36", "+2 r/min", "+2 .. +2", "ckf better"]
    assert pairs["lock time"][4] == "+0.2 s"
    assert paired_table(_study(one)) is None
    assert cells_of(groups_table(_study(group("ckf", [0, 0]))))[0][5] == "-"


def test_json_of_a_study() -> None:
    one = group(
        "ckf", LOCKED, start=np.arange(40.0), lock_time=np.full(40, 0.1), finite=np.r_[np.zeros(3), np.ones(37)]
    )
    facts = study_facts(_study(one, group("ickf", np.ones(40)), interrupted=True))
    assert (facts["runs"], facts["interrupted"], facts["seed"]) == (40, True, 1)
    first = facts["groups"][0]
    assert (first["drive"], first["filter"], first["not_finite"]) == ("d", "ckf", 3)
    assert (first["success"]["successes"], first["success"]["rate"]) == (36, 0.9)
    assert first["locked_within_0.2_s"]["successes"] == 36
    assert first["quantiles"]["start"] == pytest.approx({"0.05": 1.75, "0.5": 17.5, "0.95": 33.25, "1": 35.0})
    assert study_facts(_study(group("ckf", [0])))["groups"][0]["quantiles"]["start"]["0.5"] is None
    assert len(facts["paired"]) == 6


def test_a_study_of_whole_drives_says_how_they_ended() -> None:
    """Of forty runs two end in FAULT and one is being caught; five gave a rotor up."""
    mode, reason = np.full(40, 4), np.zeros(40, int)
    mode[:3], reason[:5] = (5, 5, 3), (9, 9, 1, 4, 4)
    study = _study(group("ckf", LOCKED, mode=mode, reason=reason), supervised=True)
    table = groups_table(study)
    assert [str(column.header) for column in table.columns][5:7] == ["in FAULT", "gave up once"]
    assert cells_of(table)[0][5:7] == ["2", "5"]
    facts = study_facts(study)["groups"][0]
    assert facts["modes"] == {"CATCHING": 1, "RUNNING": 37, "FAULT": 2}
    assert facts["reasons"] == {"CURRENT": 1, "RESTARTED": 2, "NOT_STARTED": 2}
    assert not {"modes", "reasons"} & set(study_facts(_study(group("ckf", LOCKED)))["groups"][0])


def test_success_over_slices_of_an_angle() -> None:
    theta = np.array([-90.0, -31.0, -29.0, 0.0, 29.0, 31.0, 90.0])
    rates = success_over(
        group("c", [1, 0, 1, 1, 0, 1, 1], drawn={"theta": theta}), "theta", np.array([-90, -30, 30, 90])
    )
    assert [(rate.successes, rate.runs) for rate in rates] == [(1, 2), (2, 3), (2, 2)]


# --- a study drawn


def test_drawings_of_a_study(kept: Kept) -> None:
    one = group("ckf", LOCKED, start=np.arange(1.0, 41.0), lock_time=np.arange(40) / 100)
    violin_figure([one, group("ickf", np.ones(40))])
    axes = kept.axes
    assert [axis.get_title() for axis in axes] == [
        "start, r/min",
        "load step, r/min",
        "steady rms, r/min",
        "angle, deg",
        "lock time, s",
    ]
    ticks = np.asarray(axes[0].lines[0].get_ydata())
    np.testing.assert_allclose(ticks, np.quantile(np.log10(np.arange(1.0, 37.0)), [0.05, 0.5, 0.95]))
    np.testing.assert_allclose(
        np.asarray(axes[4].lines[0].get_ydata()), np.quantile(np.arange(36) / 100, [0.05, 0.5, 0.95])
    )
    assert axes[0].yaxis.get_major_formatter()(2, 0) == "100"
    theta = np.linspace(-179, 179, 240)
    angle_figure([group("ckf", np.abs(theta) < 90, drawn={"theta": theta})], Range("theta", -180.0, 180.0))
    (axis,) = kept.axes
    found = curves(axis)["ckf"]
    np.testing.assert_allclose(found.x, np.arange(-172.5, 180, 15))
    np.testing.assert_allclose(found.y, np.where(np.abs(found.x) < 90, 100.0, 0.0))
    band = axis.collections[0].get_paths()[0].vertices[:, 1]
    low, _ = stats.binomtest(10, 10).proportion_ci(method="wilson")
    assert band.max() == 100.0
    assert any(np.isclose(band, 100 * low))
    assert axis.get_ylabel() == "success, %"


def test_maps_are_shares_and_medians() -> None:
    drawn = {"R": np.array([0.5, 0.5, 0.5, 1.5, 1.5, 2.0]), "load": np.array([1.0, 1.0, 1.0, 1.0, 100.0, 100.0])}
    one = group("ckf", [1, 0, 1, 0, 1, 1], drawn=drawn, steady_rms=[1.0, 99.0, 5.0, 9.0, 7.0, 20.0])
    pair = Range("R", 0.5, 2.0), Range("load", 1.0, 100.0, log=True)
    shares, medians = (_cells(one, pair, what, 2) for what in ("good", "steady_rms"))
    np.testing.assert_allclose(shares, [[2 / 3, np.nan], [0.0, 1.0]])
    np.testing.assert_allclose(medians, [[3.0, np.nan], [np.nan, 13.5]])


def test_the_map_is_drawn_in_per_cent_over_the_most_telling_pair(kept: Kept) -> None:
    rng = np.random.default_rng(1)
    drawn = {name: rng.uniform(0, 1, 3000) for name in ("R", "J", "psi_m")}
    locked = (drawn["R"] < 0.5) == (drawn["psi_m"] < 0.5)
    one = group("ckf", locked, drawn=drawn, steady_rms=np.ones(3000))
    ranges = [Range(name, 0.0, 1.0) for name in drawn]
    pair = most_telling([one], ranges)
    assert [item.name for item in pair] == ["R", "psi_m"]
    map_figure([one], pair)
    images = [axis.images[0] for axis in kept.axes if axis.images]
    cells = np.asarray(images[0].get_array())
    assert (np.nanmin(cells), np.nanmax(cells)) == (0.0, 100.0)
    assert cells[0, 0] == cells[-1, -1] == 100.0
    assert images[0].get_clim() == (0, 100)
    assert images[0].get_extent() == [0.0, 1.0, 0.0, 1.0]
    assert [axis.get_title("left") for axis in kept.axes if axis.images] == [
        "ckf: success, %",
        "ckf: steady rms, r/min",
    ]


def _tuned() -> Tuned:
    points = [Point(k, {"Q omega": 1.0 + k}, (10.0 - k, 1.0 + k, 5.0 * (k + 1))) for k in range(4)]
    check_ = Check((9.0, 1.0, 4.0), Rate(8, 10, 0.8, 0.5, 0.9))
    better = Check((8.0, 0.5, 3.0), Rate(10, 10, 1.0, 0.7, 1.0))
    return Tuned(
        "d",
        "ckf",
        ("Q omega",),
        tuple(points),
        tuple(points[1:]),
        points[0],
        points[2],
        check_,
        better,
        "",
        Path("."),
        4,
        False,
    )


def test_a_tunings_tables_and_figure(kept: Kept) -> None:
    rows = cells_of(front_table(_tuned()))
    assert rows == [
        ["3", "", "7", "4", "20", "4"],
        ["2", "recommended", "8", "3", "15", "3"],
        ["1", "", "9", "2", "10", "2"],
        ["0", "drive file", "10", "1", "5", "1"],
    ]
    assert cells_of(proof_table(_tuned())) == [
        ["drive file", "9", "1", "4", "80.0 (50.0 .. 90.0)"],
        ["recommended", "8", "0.5", "3", "100.0 (70.0 .. 100.0)"],
    ]
    front_figure(_tuned())
    left = curves(kept.axes[0])
    assert (list(left["trials"].x), list(left["trials"].y)) == ([1, 2, 3, 4], [5, 10, 15, 20])
    assert (list(left["front"].x), list(left["recommended"].x), list(left["drive file"].x)) == ([2, 3, 4], [3], [1])
    right = curves(kept.axes[1])
    assert (list(right["trials"].x), list(right["trials"].y)) == ([1, 2, 3, 4], [10, 9, 8, 7])
    assert [(a.get_xlabel(), a.get_ylabel()) for a in kept.axes] == [
        ("steady rms, r/min", "load step, r/min"),
        ("steady rms, r/min", "start, r/min"),
    ]


def test_json_of_a_tuning() -> None:
    facts = tuned_facts(replace(_tuned(), lines="Q = 1\nR = 2"))
    assert (facts["drive"], facts["filter"], facts["trials"], facts["interrupted"]) == ("d", "ckf", 4, False)
    names = ("start", "steady rms", "load step")
    for said, number in ((facts["drive_file"], 0), (facts["recommended"], 2), (facts["front"][0], 1)):
        assert said["trial"] == number
        assert said["factors"] == {"Q omega": 1.0 + number}
        assert said["objectives"] == dict(zip(names, (10.0 - number, 1.0 + number, 5.0 * (number + 1)), strict=True))
    assert [one["trial"] for one in facts["front"]] == [1, 2, 3]
    assert facts["recommended"]["lines"] == ["Q = 1", "R = 2"]
    own, better = facts["fresh_runs"]["drive_file"], facts["fresh_runs"]["recommended"]
    assert own["objectives"] == dict(zip(names, (9.0, 1.0, 4.0), strict=True))
    assert better["objectives"] == dict(zip(names, (8.0, 0.5, 3.0), strict=True))
    assert own["success"] == {"successes": 8, "runs": 10, "rate": 0.8, "low": 0.5, "high": 0.9}
    assert better["success"]["successes"] == 10


@pytest.mark.parametrize("interrupted", [False, True])
def test_a_study_that_was_interrupted_ends_with_130(
    interrupted: bool, here: Path, monkeypatch: pytest.MonkeyPatch, kept: Kept
) -> None:
    asked: list[Any] = []
    made = _study(group("ckf", LOCKED), group("ickf", np.ones(40)), interrupted=interrupted)
    monkeypatch.setattr(runtime.study.run, "state_study", lambda *rest: asked.append(rest) or (made.statement, [1, 2]))
    monkeypatch.setattr(runtime.study.run, "run_study", lambda *rest: asked.append(rest) or made)
    monkeypatch.setattr(runtime.study.figures, "write_figures", lambda study: [])
    arguments = "study run ipmsm --runs 40 --seed 5 --filters ckf,ickf --out o --json s.json"
    code, said = command(*arguments.split(), *["--supervised"] * interrupted)
    assert code == (130 if interrupted else 0), said
    assert ("80 of 80 runs are kept" in said) is interrupted
    assert read_json("s.json")["interrupted"] is interrupted
    (names, kinds, _, _, seed, supervised), (_, packages, runs, out, *_) = asked
    assert (list(names), list(kinds), seed, supervised) == (["ipmsm"], ["ckf", "ickf"], 5, interrupted)
    assert (packages, runs, out) == ([1, 2], 40, Path("o"))


@pytest.mark.parametrize("interrupted", [False, True])
def test_a_tuning_that_was_interrupted_ends_with_130(
    interrupted: bool, here: Path, monkeypatch: pytest.MonkeyPatch, kept: Kept
) -> None:
    made = replace(_tuned(), interrupted=interrupted)
    monkeypatch.setattr(runtime.study.tune, "tune", lambda *rest: made)
    monkeypatch.setattr(runtime.study.figures, "write_front", lambda tuned, folder: [Path("front.svg")])
    code, said = command("study", "tune", "ipmsm", "--trials", "9", "--json", "t.json")
    assert code == (130 if interrupted else 0), said
    assert ("interrupted after 4 of 9 trials" in said) is interrupted
    assert read_json("t.json")["interrupted"] is interrupted
