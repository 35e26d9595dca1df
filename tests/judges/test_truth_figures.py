"""Figures of an estimate against the truth, sample by sample."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from runtime.recorded.clock import check_clock
from runtime.recorded.truth import errors, find_load_step
from runtime.system.errors import UserError
from tests.judges.made import RPM

T = 1e-3
TIME = T * np.arange(1, 401)


def test_errors_of_an_estimate_sample_by_sample() -> None:
    t = 1e-3 * np.arange(400)
    x = np.zeros((400, 5))
    x[:, 4] = 1.5
    x[50, 2], x[300, 2], x[399, 2] = 2.0, -7.0, 1.0
    x[10, 3], x[399, 3] = -2.0, 0.25
    truth = {"omega": np.zeros(400), "theta": np.zeros(400), "load_torque": np.where(t >= 0.2, 5.0, 0.0)}
    found = errors(t, x, ("i_alpha", "i_beta", "omega", "theta", "load_torque"), truth)
    assert found is not None
    late = 51  # rows of the last 50 ms, both ends included
    assert found.load_step_at == pytest.approx(0.2)
    assert (found.speed_start, found.speed_load_step) == pytest.approx((2 * RPM, 7 * RPM))
    assert found.speed_steady_rms == pytest.approx(RPM / math.sqrt(late))
    assert (found.position_max, found.position_end) == pytest.approx((math.degrees(2), math.degrees(0.25)))
    assert found.position_steady_rms == pytest.approx(math.degrees(0.25) / math.sqrt(late))
    assert (found.load_torque_steady_rms, found.load_torque_end) == pytest.approx((3.5, -3.5))
    assert not found.lost
    flat = errors(t, x, ("i_alpha", "i_beta", "omega", "theta", "load_torque"), {"omega": truth["omega"]})
    assert flat is not None
    assert (flat.speed_start, flat.speed_load_step, flat.load_step_at) == (pytest.approx(7 * RPM), None, None)
    short = errors(t[:40], x[:40], ("i_alpha", "i_beta", "omega", "theta"), {"theta": np.full(40, 0.3)})
    assert short is not None
    assert short.position_steady_rms == pytest.approx(math.degrees(0.3))
    assert errors(t[:1], x[:1], (), {"theta": np.zeros(1)}) is not None
    assert errors(t, x, ("i_alpha", "i_beta", "omega", "theta"), {}) is None


def test_a_load_step_in_the_first_row_leaves_no_start() -> None:
    t, load = 1e-3 * np.arange(400), np.full(400, 5.0)
    load[1:11] = 0.0
    x = np.zeros((400, 4))
    x[0, 2], x[1, 2] = -3.0, 2.0
    found = errors(t, x, (), {"omega": np.zeros(400), "load_torque": load})
    assert found is not None
    assert (found.load_step_at, found.speed_start, found.speed_load_step) == (0.0, 0.0, pytest.approx(3 * RPM))


@pytest.mark.parametrize(("degrees", "lost"), [(29.9, False), (30.1, True), (-31.0, True), (float("nan"), True)])
def test_a_lost_rotor_is_told(degrees: float, lost: bool) -> None:
    t = 1e-3 * np.arange(400)
    x = np.zeros((400, 4))
    x[:, 3] = math.radians(degrees)
    found = errors(t, x, (), {"theta": np.zeros(400)})
    assert found is not None
    assert found.lost is lost
    assert (found.to_json()["position_end"] is None) is math.isnan(degrees)
    assert found.to_json()["speed_start"] is None


def test_a_load_step_is_dated_and_noise_is_none() -> None:
    t = 1e-3 * np.arange(400)
    noise = 0.3 * np.random.default_rng(1).normal(size=400)
    assert find_load_step(t, np.where(t >= 0.25, 5.0, 1.0)) == 250
    assert find_load_step(t, np.where(t >= 0.25, 1.0, 5.0)) == 250
    assert find_load_step(t, 5.0 + noise) is None
    assert find_load_step(t, np.full(400, 2.0)) is None
    assert find_load_step(t, np.full(400, np.nan)) is None
    spike = np.where(np.arange(400) == 100, 5.0, 0.0)
    assert find_load_step(t, spike) is None, "it does not settle on another level"
    half = np.where(t >= 0.3, 4.0, np.where(t >= 0.1, 1.0, 0.0))
    assert find_load_step(t, half) == 300, "the first level is left by half of the range"


def test_the_clock_of_a_recording() -> None:
    where, T = Path("d"), 1e-3
    even = T * np.arange(100)
    assert check_clock(even, T, where, "d").notes == []
    assert not check_clock(even, T, where, "d").gaps
    for scale in (1.0099, 0.9901):
        (note,) = check_clock(scale * even, T, where, "d").notes
        assert f"{1000 * scale:.6g} us, the drive's 1000 us" in note
    for scale in (1.0101, 0.9899):
        with pytest.raises(UserError, match="is sampled every"):
            check_clock(scale * even, T, where, "d")
    lost = np.delete(even, [40, 41, 70])
    clock = check_clock(lost, T, where, "d")
    assert clock.gaps
    assert list(np.flatnonzero(np.diff(clock.steps) > 1)) == [39, 67]
    assert (clock.steps[40], clock.steps[-1]) == (42, 99)
    assert clock.notes == [
        "2 gaps, 3 samples missing, the first after t = 0.039 s: bridged by prediction, the last voltage held"
    ]
    late = even.copy()
    late[50] += 0.0004
    (note,) = check_clock(late, T, where, "d").notes
    assert note.startswith("t jitters by 400 us at most")
    assert f"{math.sqrt(2 * 400**2 / 99):.3g} us rms" in note
    late[50] = even[50] + 0.00004
    assert check_clock(late, T, where, "d").notes == []
    for k, bad in ((7, np.nan), (7, even[6]), (7, even[5])):
        wrong = even.copy()
        wrong[k] = bad
        with pytest.raises(UserError, match=r"row [78]"):
            check_clock(wrong, T, where, "d")
    with pytest.raises(UserError, match="more is missing than recorded"):
        check_clock(np.r_[0, T, 2 * T, 30 * T, 31 * T, 32 * T], T, where, "d")
    as_many = check_clock(T * np.r_[0:3, 9:12], T, where, "d")
    assert as_many.notes[0].startswith("1 gaps, 6 samples missing"), "as much is missing as was recorded"
    with pytest.raises(UserError, match="more is missing than recorded"):
        check_clock(T * np.r_[0:3, 10:13], T, where, "d")
    alone = check_clock(np.zeros(1), T, where, "d")
    assert (alone.steps, alone.count) == (None, 1)
    rms = 0.1 * math.sqrt(100 / 2)  # one late row makes two intervals, each off by it
    for share, even_enough in ((0.98, True), (1.02, False)):
        late = T * np.arange(101)
        late[50] += share * rms * T
        if even_enough:
            assert check_clock(late, T, where, "d").notes[0].startswith("t jitters by")
        else:
            with pytest.raises(UserError, match="is not sampled evenly"):
                check_clock(late, T, where, "d")
