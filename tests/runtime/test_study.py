"""Studies: draws belong to their index, what is done stays done, intervals are statisticians', workers agree."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from runtime.drive.fleet import Fleet, Outcomes
from runtime.estimator.folder import find_folder
from runtime.study import run as running
from runtime.study import store as storing
from runtime.study.analysis import comparisons, paired, quantiles, study_facts, success, success_over, wilson
from runtime.study.figures import write_figures
from runtime.study.run import Group, run_study, state_study
from runtime.study.statement import ANYWHERE, VARIABLES, Statement, parse_range, parse_ranges
from runtime.study.store import Store
from runtime.system.errors import UserError
from tests import forked
from tests.runtime.processes import ROOT, finish, start
from tests.runtime.studies import DRIVE, VARY, same_study, stated


@pytest.fixture
def small_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(storing, "CHUNK", 24)


# --- the statement


def test_draws_depend_on_seed_and_index_alone() -> None:
    whole = stated()[0].draw(0, 1000)
    for first, count in ((0, 1), (1, 2), (7, 500), (996, 4), (513, 30)):
        part = stated()[0].draw(first, count)
        for name, column in part.items():
            np.testing.assert_array_equal(column, whole[name][first : first + count])
    fewer = stated(vary=("R=0.8:1.2",))[0].draw(0, 1000)
    for name in ("R", "seed"):
        np.testing.assert_array_equal(fewer[name], whole[name])
    other = stated(seed=2)[0].draw(0, 1000)
    assert not np.any(other["R"] == whole["R"])
    assert len(np.unique(whole["seed"])) == 1000


def test_draws_are_even_and_independent() -> None:
    drawn = stated()[0].draw(0, 20_000)
    assert stats.kstest(drawn["R"], "uniform", (0.8, 0.4)).pvalue > 1e-3
    assert stats.kstest(drawn["theta"], "uniform", (-90, 180)).pvalue > 1e-3
    assert stats.kstest(np.log(drawn["noise"]), "uniform", (np.log(0.02), np.log(5))).pvalue > 1e-3
    correlation = np.corrcoef([drawn[name] for name in ("R", "theta", "noise", "load")]) - np.eye(4)
    assert np.max(np.abs(correlation)) < 4 / np.sqrt(20_000)


def test_both_inductances_vary_together_and_angles_turn_into_radians() -> None:
    cases = stated(vary=("L=0.9:1.1", "theta=180"))[0].cases(0, 0, 5)
    np.testing.assert_array_equal(cases.L_d, cases.L_q)
    np.testing.assert_allclose(cases.theta, np.pi)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("R", "is not NAME=LOW:HIGH"),
        ("psi=0.9:1.1", "nothing called 'psi' varies. Did you mean 'psi_m'?"),
        ("banana=1", "nothing called 'banana' varies. There are: noise"),
        ("R=a:b", "'a' is not a number"),
        ("R=1:2:3", "is not R=LOW:HIGH"),
        ("R=", "'' is not a number"),
        ("R=nan", "nan is not a finite number"),
        ("R=1.2:0.8", "write R=0.8:1.2"),
        ("R=-1:1", "cannot be below 0.001"),
        ("noise=-0.1:0.1", "cannot be below 0"),
        ("R=1:rated", "no rated R is known; there are those of noise, load, speed"),
        ("noise=0:0.1:log", "a logarithmic range begins above 0"),
    ],
)
def test_ranges_that_are_none(text: str, message: str) -> None:
    with pytest.raises(UserError) as error:
        parse_range(text)
    assert message in str(error.value)


def test_ranges_that_contradict_each_other() -> None:
    with pytest.raises(UserError, match="--vary R is given twice"):
        parse_ranges(["R=1", "R=0.8:1.2"])
    with pytest.raises(UserError, match="varies both inductances"):
        parse_ranges(["L=1", "L_q=0.8:1.2"])
    for name in VARIABLES:
        assert parse_range(f"{name}=0.5:1") == parse_range(str(parse_range(f"{name}=0.5:1")))
    for text in ("load=0:1:rated", "noise=0.4:2:log:rated", "speed=1:rated"):
        assert str(parse_range(text)) == text
        assert parse_range(text).rated
        assert parse_range(text).unit == "of rated"


def test_shares_of_the_rated_belong_to_each_drive() -> None:
    """One draw of shares; noise, load and speed are those of the drive that runs."""
    statement, _ = stated(vary=("load=0:1:rated", "speed=0.5:1:rated", "noise=2:rated", "R=1.1"))
    own = replace(statement, rated=(statement.rated[0], {"noise": 0.001, "load": 0.2, "speed": 9000.0}))
    usual, small = own.cases(0, 0, 50), own.cases(1, 0, 50)
    share = own.draw(0, 50)["load"]
    np.testing.assert_allclose(usual.load, 5.0 * share)
    np.testing.assert_allclose(small.load, 0.2 * share)
    np.testing.assert_allclose(np.asarray(small.speed) / 9000.0, np.asarray(usual.speed) / 1000.0)
    assert np.all(np.asarray(usual.noise) == 0.1)
    assert np.all(np.asarray(small.noise) == 0.002)
    assert own.digest != statement.digest


def test_unknown_words_of_a_study() -> None:
    with pytest.raises(UserError, match="no filter 'pf'; there are: ckf"):
        state_study([DRIVE], ["pf"], "load_step", VARY, 1)
    with pytest.raises(UserError, match="no scenario 'dance'"):
        state_study([DRIVE], ["ckf"], "dance", VARY, 1)
    statement, packages = state_study([DRIVE], ["ckf"], "load_step", ["L_q=1.1"], 1)
    cases = statement.cases(0, 0, 1)
    with pytest.raises(UserError, match="has one inductance"):
        running.run_package(packages[0], statement.scenarios[0], cases)


def test_a_study_of_whole_drives_is_the_fleets_and_another_study(tmp_path: Path) -> None:
    """Supervised, from anywhere: what the packages run is the supervised fleet; the two kinds of study keep apart."""
    statement, packages = state_study([DRIVE], ["ckf"], "load_step", ANYWHERE, 1, supervised=True)
    alone, _ = state_study([DRIVE], ["ckf"], "load_step", ANYWHERE, 1)
    assert statement.digest != alone.digest
    study = run_study(statement, packages, 20, tmp_path / "whole")
    fleet = Fleet(find_folder(DRIVE), "ckf", supervised=True)
    expected = fleet.run(statement.scenarios[0], statement.cases(0, 0, 20))
    for name, column in study.groups[0].outcomes.columns().items():
        np.testing.assert_array_equal(column, getattr(expected, name), name)
    assert np.ptp(study.groups[0].drawn["theta"]) > 270
    assert sum(study_facts(study)["groups"][0]["modes"].values()) == 20
    with pytest.raises(UserError, match="holds another study"):
        Store(tmp_path / "whole", alone)


# --- what is done stays done


def test_an_interrupted_study_goes_on(small_chunks: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C in the fourth chunk: three are kept, only the others are run, and all is as if nothing had happened."""
    statement, packages = stated()
    whole = run_study(statement, packages, 60, tmp_path / "whole")
    assert [len(group.index) for group in whole.groups] == [60, 60]
    calls = []
    original = running.run_package

    def counting(*args: Any, **keywords: Any) -> Outcomes:
        calls.append(1)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return original(*args, **keywords)

    monkeypatch.setattr(running, "run_package", counting)
    broken = run_study(statement, packages, 60, tmp_path / "broken")
    assert broken.interrupted
    assert [len(group.index) for group in broken.groups] == [48, 24]
    assert {item.runs for item in comparisons(broken)} <= set(range(25)), "pairs are those both filters have"
    monkeypatch.setattr(running, "run_package", counting)
    again = run_study(statement, packages, 60, tmp_path / "broken")
    assert not again.interrupted
    assert len(calls) == 4 + 3
    same_study(whole, again)


def test_more_runs_add_to_what_is_there(small_chunks: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    statement, packages = stated()
    run_study(statement, packages, 30, tmp_path / "study")
    seen: list[int] = []
    original = storing.Store.save
    monkeypatch.setattr(
        storing.Store, "save", lambda self, chunk, outcomes: (seen.append(chunk.first), original(self, chunk, outcomes))
    )
    more = run_study(statement, packages, 60, tmp_path / "study")
    assert sorted(seen) == [24, 24, 48, 48], "the first chunk of each filter was whole"
    same_study(more, run_study(statement, packages, 60, tmp_path / "fresh"))


@pytest.mark.parametrize("damage", ["cut", "empty", "text"])
def test_a_damaged_chunk_is_run_again(damage: str, small_chunks: None, tmp_path: Path) -> None:
    statement, packages = stated()
    whole = run_study(statement, packages, 24, tmp_path)
    path = next((tmp_path / "runs").glob("*_ckf_*.npz"))
    raw = path.read_bytes()
    path.write_bytes({"cut": raw[: len(raw) // 2], "empty": b"", "text": b"hello"}[damage])
    same_study(whole, run_study(statement, packages, 24, tmp_path))
    assert path.read_bytes() != b"hello"


def test_a_chunk_is_written_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "file"
    storing.write_atomically(path, b"old")

    def full(handle: int) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(UserError, match=f"cannot write '{path}': no space"):
        storing.write_atomically(path, b"new")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(("change", "word"), [({"seed": 2}, "seed"), ({"vary": ("R=0.9:1.1",)}, "vary")])
def test_another_study_in_the_same_folder_is_refused(change: dict[str, Any], word: str, tmp_path: Path) -> None:
    run_study(*stated(), 4, tmp_path)
    with pytest.raises(UserError, match=f"holds another study \\({word} there: .* now: "):
        run_study(*stated(**change), 4, tmp_path)


def test_changed_code_is_another_study(tmp_path: Path) -> None:
    statement, packages = stated()
    run_study(statement, packages, 4, tmp_path)
    files = dict(packages[0].files)
    name = f"{DRIVE}_ckf_foc.c"
    changed = type(packages[0])(DRIVE, "ckf", tuple({**files, name: files[name] + "\n"}.items()))
    other = Statement(
        statement.subjects,
        (changed.digest, statement.digests[1]),
        statement.scenarios,
        statement.rated,
        statement.ranges,
        1,
    )
    with pytest.raises(UserError, match="holds another study"):
        run_study(other, [changed, packages[1]], 4, tmp_path)


# --- figures


@pytest.mark.parametrize(("successes", "runs"), [(0, 10), (10, 10), (7, 10), (934, 1000), (1, 3)])
def test_wilson_against_scipy(successes: int, runs: int) -> None:
    expected = stats.binomtest(successes, runs).proportion_ci(0.95, "wilson")
    found = wilson(successes, runs)
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high), abs=1e-12)
    assert found.rate == successes / runs


def _group(kind: str, locked: Any, start: Any, index: Any = None) -> Group:
    locked = np.asarray(locked, dtype=bool)
    columns = {name: np.asarray(start, dtype=float) for name in ("start", "load_step", "steady_rms", "angle")}
    zeros = np.zeros(len(locked))
    outcomes = Outcomes(
        **columns,
        angle_end=zeros,
        lock_time=zeros,
        locked=locked,
        reached=locked,
        status=zeros,
        finite=locked,
        mode=zeros,
        reason=zeros,
    )
    index = np.arange(len(locked)) if index is None else np.asarray(index)
    return Group("d", kind, index, {"theta": np.linspace(-90, 90, len(locked))}, outcomes)


def test_paired_differences_against_scipys_bootstrap() -> None:
    """Means with the interval of a percentile bootstrap; runs that one filter lost do not count in errors."""
    rng = np.random.default_rng(1)
    a, b = rng.normal(5, 1, 400), rng.normal(5.3, 1, 400)
    locked = rng.random((2, 400)) < 0.9
    found = {item.figure: item for item in paired(_group("ckf", locked[0], a), _group("ickf", locked[1], b))}
    both = locked.all(axis=0)
    for figure, values in (("start", (b - a)[both]), ("success", locked[1].astype(float) - locked[0])):
        item = found[figure]
        expected = stats.bootstrap((values,), np.mean, method="percentile", rng=2).confidence_interval
        assert item.mean == pytest.approx(values.mean())
        assert item.runs == values.size
        assert (item.low, item.high) == pytest.approx(tuple(expected), abs=0.01)
    assert found["start"].low > 0


def test_pairs_are_matched_by_index() -> None:
    first = _group("ckf", [1, 1, 1], [1.0, 2.0, 3.0], [0, 1, 2])
    second = _group("ickf", [1, 1], [30.0, 2.5], [2, 1])
    found = {item.figure: item for item in paired(first, second)}
    assert found["start"].mean == pytest.approx((27 + 0.5) / 2)


def test_quantiles_are_of_the_runs_that_locked() -> None:
    group = _group("ckf", [1, 1, 1, 0], [1.0, 2.0, 3.0, 1000.0])
    assert quantiles(group)["start"][1::2] == (2.0, 3.0)
    assert np.isnan(quantiles(_group("ckf", [0], [1.0]))["start"]).all()
    assert success(group).successes == 3


def test_success_over_a_variable() -> None:
    group = _group("ckf", np.r_[np.zeros(30), np.ones(31)], np.ones(61))
    rates = success_over(group, "theta", np.array([-90.0, 0.0, 90.0]))
    assert [(rate.successes, rate.runs) for rate in rates] == [(0, 30), (31, 31)]


def test_a_linear_measurement_makes_both_filters_one(tmp_path: Path) -> None:
    """Iterating is idle there: the paired difference is zero, with no width. Figures are drawn of it all."""
    study = run_study(*stated(), 64, tmp_path)
    assert {(item.mean, item.low, item.high) for item in comparisons(study)} == {(0.0, 0.0, 0.0)}
    paths = write_figures(study)
    assert [path.name for path in paths] == [
        f"{DRIVE}_errors.svg",
        f"{DRIVE}_success_over_theta.svg",
        f"{DRIVE}_map.svg",
    ]
    for path in paths:
        assert ET.parse(path).getroot().tag.endswith("svg")
    facts = json.loads(json.dumps(study_facts(study), allow_nan=False))
    assert [group["success"]["runs"] for group in facts["groups"]] == [64, 64]


def test_figures_where_nothing_locked(tmp_path: Path) -> None:
    study = run_study(*stated(vary=("theta=150:180", "psi_m=0.4:0.5")), 20, tmp_path)
    assert success(study.groups[0]).successes == 0
    write_figures(study)
    json.dumps(study_facts(study), allow_nan=False)


# --- the command


def _command(*words: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return forked.call("study", *words, cwd=cwd)


def test_the_command(tmp_path: Path) -> None:
    out, facts = tmp_path / "out", tmp_path / "facts.json"
    done = _command(DRIVE, "--runs", "32", "--vary", "R=0.9:1.1", "--out", str(out), "--json", str(facts), cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "identical" in done.stdout
    assert json.loads(facts.read_text())["vary"] == ["R=0.9:1.1"]
    other = _command(DRIVE, "--runs", "32", "--vary", "R=0.9:1.2", "--out", str(out), cwd=tmp_path)
    assert (other.returncode, other.stderr.count("\n")) == (2, 1)
    assert "holds another study (vary there: R=0.9:1.1, now: R=0.9:1.2)" in other.stderr


def test_without_matplotlib_nothing_is_run(tmp_path: Path) -> None:
    """One line before the work, not after it."""
    (tmp_path / "matplotlib.py").write_text("raise ImportError")
    environment = {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}
    words = ("study", DRIVE, "--runs", "32", "--out", "out")
    code, _, errors = finish(start("-m", "runtime", *words, cwd=tmp_path, environment=environment))
    assert code == 2
    assert errors == "pmsm-ickf: figures need matplotlib: pip install 'pmsm-ickf[report]'.\n"
    assert not (tmp_path / "out").exists()


@pytest.mark.thorough
def test_ctrl_c_keeps_what_is_done(tmp_path: Path) -> None:
    """The signal in the middle of a long study; the same command with fewer runs finds its chunks there."""
    words = [sys.executable, "-m", "runtime", "study", "paper_spmsm", "--out", str(tmp_path), "--runs"]
    process = subprocess.Popen([*words, "1000000"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    runs = tmp_path / "runs"
    for _ in range(1200):
        if runs.is_dir() and len(list(runs.glob("*.npz"))) >= 2:
            break
        try:
            process.wait(0.1)
        except subprocess.TimeoutExpired:
            continue
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=120)
    assert process.returncode == 130, errors
    assert "the same command goes on" in output
    kept = {path: path.stat().st_mtime_ns for path in runs.glob("*.npz")}
    assert len(kept) >= 2
    done = subprocess.run([*words, "512"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert kept.items() <= {path: path.stat().st_mtime_ns for path in runs.glob("*.npz")}.items()
