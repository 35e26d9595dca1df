"""What a design gives up beside a tuned copy: the benchmark's ratio sees a bad design, and is 1 for the same one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks import design_tuned
from benchmarks.design_tuned import TOLERANCES, TUNED_ON, Bench, Errors, judged, least
from runtime.design.facts import read_facts
from runtime.design.rules import design
from tests.runtime.test_design_trial import DATA

#: Entry of the load torque's walk among the factors.
LOAD = 3


@pytest.fixture(scope="module")
def bench() -> Bench:
    facts = replace(read_facts(DATA / "servo_24v.toml"), dead_time=0.0, **TOLERANCES["small"])
    return Bench(facts, design(facts))


def test_a_copy_that_is_the_design_has_a_ratio_of_1(bench: Bench) -> None:
    own = np.ones(4)
    found = judged(bench, {"design": own, "tuned": own, "free": own})
    assert found["ratio"] == found["free ratio"] == 1.0
    assert found["errors"]["design"] == found["errors"]["tuned"]
    assert 0 < found["errors"]["design"]["steady"] < found["errors"]["design"]["load"]


def test_a_design_that_expects_no_load_is_seen(bench: Bench) -> None:
    own, planted = np.ones(4), np.array([1.0, 1.0, 1.0, 1e-4])
    assert judged(bench, {"design": planted, "tuned": own, "free": own})["ratio"] > 2.0


def test_a_search_mends_a_planted_design_and_leaves_a_limit_alone(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(design_tuned, "ROUNDS", 4)
    good = bench.noise
    (limit,) = bench.errors(np.ones(4), TUNED_ON)
    (tuned,) = bench.errors(bench.tuned(free=False), TUNED_ON)
    assert tuned.load <= limit.load
    assert tuned.excess(limit) == 0.0
    monkeypatch.setattr(bench, "noise", good * [1.0, 1.0, 1.0, 1.0, 1e-4])
    (planted,) = bench.errors(np.ones(4), TUNED_ON)
    (mended,) = bench.errors(bench.tuned(free=True), TUNED_ON)
    assert planted.load > 2.0 * mended.load


def test_a_copy_that_loses_a_rotor_is_none_to_keep(bench: Bench) -> None:
    own, losing = np.ones(4), np.array([1e-6, 1e-6, 1e-6, 1e-12])
    found = judged(bench, {"design": own, "tuned": losing, "free": losing})
    assert found["errors"]["tuned"]["load"] == np.inf
    assert found["ratio"] == found["free ratio"] == 1.0
    assert judged(bench, {"design": losing, "tuned": own, "free": own})["ratio"] == np.inf


def test_excess_is_the_worse_of_start_and_end() -> None:
    one = Errors(start=10.0, steady=2.0, load=50.0)
    assert one.excess(one) == 0.0
    assert Errors(start=9.0, steady=1.0, load=99.0).excess(one) == 0.0
    assert Errors(start=15.0, steady=1.0, load=1.0).excess(one) == pytest.approx(0.5)
    assert Errors(start=1.0, steady=6.0, load=1.0).excess(one) == pytest.approx(2.0)


def test_the_search_finds_a_minimum_along_a_limit() -> None:
    """Least of x y^2 where x y >= 8 and y >= 0.5: at y = 0.5, x = 16, far from where it begins."""

    def costs(points: np.ndarray) -> list[float]:
        x, y = points.T
        return np.where((x * y >= 8.0) & (y >= 0.5), x * y**2, 1e3).tolist()

    assert costs(least(costs, np.array([10.0, 10.0]))[None])[0] == pytest.approx(4.0, rel=0.05)
    flat = least(lambda points: [1.0] * len(points), np.array([3.0, 7.0]))
    assert flat.tolist() == [3.0, 7.0]
