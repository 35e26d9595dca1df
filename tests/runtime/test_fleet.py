"""Fleets: a lane's run is the scalar simulator's, whatever runs beside it; noise is Gaussian and the seed's alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import stats

from model.schema import Drive
from runtime.drive.fleet import Cases, Fleet, Outcomes
from runtime.drive.scenario import Scenario
from runtime.drive.simulation import Conditions, Run, Simulator
from runtime.estimator.folder import find_folder
from runtime.recorded.units import RPM
from runtime.system.errors import UserError
from tests.conftest import thoroughly

RESTARTED = 0x20
SHORT = Scenario("short", speed=1000.0, ramp=0.05, load=3.0, load_at=0.07, duration=0.13)


@pytest.fixture(scope="module")
def fleet() -> Fleet:
    return Fleet(find_folder("spmsm_load_torque"), "ckf")


def _row(outcomes: Outcomes, index: int) -> dict[str, Any]:
    return {name: column[index] for name, column in outcomes.columns().items()}


def _expected(run: Run) -> dict[str, Any]:
    """The fleet's figures of one recorded run, worked out again from every sample."""
    bad = (np.abs(run.angle_error) > 30) | (
        np.sign(run.scenario.speed) * run.omega * RPM < -0.01 * abs(run.scenario.speed)
    )
    last = np.flatnonzero(bad)
    from_sample = last[-1] + 1 if last.size else 0
    return {
        **run.figures(),
        "angle_end": abs(run.angle_error[-1]),
        "lock_time": run.t[from_sample] if from_sample < len(run.t) else np.nan,
        "locked": run.locked,
        "reached": run.reached,
        "status": np.bitwise_or.reduce(run.status),
        "finite": True,
        "mode": -1,
        "reason": 0,
    }


def _agree(found: dict[str, Any], expected: dict[str, Any]) -> None:
    assert found.keys() == expected.keys()
    for name in ("start", "load_step"):  # maxima of differences of the same bits, turned into r/min
        assert found[name] == pytest.approx(expected[name], rel=1e-14), name
    for name in ("steady_rms", "angle", "angle_end", "lock_time"):
        assert found[name] == pytest.approx(expected[name], rel=1e-11, abs=1e-11, nan_ok=True), name
    for name in ("locked", "reached", "status", "finite"):
        assert found[name] == expected[name], name


@pytest.mark.parametrize("kind", ["ickf", *thoroughly("ckf")])
def test_without_noise_a_lane_is_the_scalar_simulators_run(drive: Drive, kind: str) -> None:
    folder = find_folder(drive.name)
    outcomes = Fleet(folder, kind).run(SHORT, Cases(noise=0.0))
    _agree(_row(outcomes, 0), _expected(Simulator(folder, kind).run(SHORT, Conditions(noise=0.0))))


@pytest.mark.parametrize("name", ["spmsm_load_torque", "ipmsm_flux"])
def test_every_lane_is_the_scalar_simulators_run(name: str) -> None:
    """Noise, angles, motors, loads, speeds and tunings that differ; some runs lose lock, some turn backwards."""
    rng = np.random.default_rng(5)
    fleet, runs = Fleet(find_folder(name), "ickf"), 21
    L = rng.uniform(0.8, 1.2, runs)
    Q = np.array(fleet.folder.module.DEFAULTS["Q"])[:, None] * rng.uniform(0.5, 5, runs)
    cases = Cases(
        seed=rng.integers(0, 2**63, runs), noise=rng.uniform(0, 0.1, runs), theta=np.linspace(-np.pi, np.pi, runs),
        R=rng.uniform(0.8, 1.2, runs), L_d=L, L_q=L, psi_m=rng.uniform(0.9, 1.1, runs), J=rng.uniform(0.5, 2, runs),
        load=np.where(np.arange(runs) % 5, rng.uniform(1, 5, runs), 0.0),
        speed=rng.choice([-800.0, 900.0, 1000.0], runs),
        tuning={"Q": Q, "P_0": tuple(0.02 for _ in Q)},
    )  # fmt: skip
    outcomes = fleet.run(SHORT, cases)
    for index in range(runs):
        _agree(_row(outcomes, index), _expected(fleet.trace(SHORT, cases, index)))
    assert np.isfinite(outcomes.lock_time).any()  # some starts held the angle to the end of so short a run
    assert not outcomes.locked.all()


@pytest.mark.parametrize("name", ["spmsm_load_torque", *thoroughly("ipmsm_flux", "paper_spmsm", "traction_70kw")])
def test_a_supervised_lane_is_the_scalar_simulators_run_from_power_up(name: str) -> None:
    """From anywhere; some rotors turn the wrong way, some attempts fail, and one ends in FAULT with its gates off."""
    rng = np.random.default_rng(8)
    fleet, runs = Fleet(find_folder(name), "ckf", supervised=True), 20
    speed = fleet.folder.manifest["parameters"]["operating_box"]["speed"]
    Q = np.tile(np.array(fleet.folder.module.DEFAULTS["Q"])[:, None], runs)
    Q[0, -1] = 3e38  # it never finds its rotor
    cases = Cases(
        seed=rng.integers(0, 2**63, runs), noise=rng.uniform(0, 0.1, runs), theta=np.linspace(-np.pi, np.pi, runs),
        R=rng.uniform(0.8, 1.2, runs), J=rng.uniform(0.5, 2, runs), speed=rng.choice([-2.0, 3.0], runs) * speed,
        load=rng.uniform(0, 0.3, runs), tuning={"Q": Q},
    )  # fmt: skip
    outcomes, module = fleet.run(SHORT, cases), fleet.folder.module
    modes = [module.MODES[mode] for mode in outcomes.mode]
    assert set(modes) >= {"RUNNING"}
    assert modes[-1] != "RUNNING"
    assert module.REASONS[outcomes.reason[-1]] == "RESTARTED"
    gave_up = np.flatnonzero(outcomes.reason)  # their gates went off while a current flowed
    for index in {0, 7, *gave_up.tolist()[:4], 19}:
        run = fleet.trace(SHORT, cases, index)
        own = {"mode": outcomes.mode[index], "reason": outcomes.reason[index]}  # a record does not have them
        _agree(_row(outcomes, index), _expected(run) | own)


def test_a_runs_outcome_is_its_own(fleet: Fleet) -> None:
    """The same in another batch, another lane, on other threads."""
    rng = np.random.default_rng(6)
    seed, theta = rng.integers(0, 2**62, 37), rng.uniform(-0.5, 0.5, 37)
    whole = fleet.run(SHORT, Cases(seed=seed, theta=theta), threads=1)
    for outcomes, index in (
        (fleet.run(SHORT, Cases(seed=seed, theta=theta), threads=3), np.arange(37)),
        (fleet.run(SHORT, Cases(seed=seed[30:], theta=theta[30:])), np.arange(30, 37)),
        (fleet.run(SHORT, Cases(seed=seed[::-1], theta=theta[::-1])), np.arange(37)[::-1]),
    ):
        for name, column in outcomes.columns().items():
            np.testing.assert_array_equal(column, getattr(whole, name)[index], name)


def test_progress_and_interruption(fleet: Fleet) -> None:
    seen: list[tuple[int, int]] = []
    fleet.run(SHORT, Cases(seed=np.arange(40)), progress=lambda done, of: seen.append((done, of)))
    assert sorted(done for done, _ in seen)[-1] == 40
    assert {of for _, of in seen} == {40}

    def stop(done: int, of: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fleet.run(SHORT, Cases(seed=np.arange(400)), progress=stop)


def test_a_filter_gone_to_nan_is_said(fleet: Fleet) -> None:
    """One lane restarts from what is no number; its figures are NaN, and its neighbour's as ever."""
    x = np.array(fleet.folder.module.DEFAULTS["x_0"])[:, None] + np.array([0.0, np.inf])
    outcomes = fleet.run(SHORT, Cases(seed=1, tuning={"x_0": x}))
    alone = fleet.run(SHORT, Cases(seed=1))
    assert outcomes.finite.tolist() == [True, False]
    assert not outcomes.locked[1]
    assert np.isnan(outcomes.start[1])
    assert outcomes.start[0] == alone.start[0]


def test_a_tuning_that_overflows_restarts_for_ever_and_says_so(fleet: Fleet) -> None:
    P = np.array(fleet.folder.module.DEFAULTS["P_0"])[:, None] * np.array([1.0, np.inf])
    outcomes = fleet.run(SHORT, Cases(seed=1, tuning={"P_0": P}))
    assert (outcomes.status & RESTARTED).astype(bool).tolist() == [False, True]
    assert outcomes.finite.all()
    assert outcomes.locked.tolist() == [True, False]


@pytest.mark.parametrize(
    ("cases", "message"),
    [
        (Cases(seed=[1, 2], theta=[0, 1, 2]), "different lengths: 2, 3"),
        (Cases(noise=-1.0), "noise holds a value that is not a number >= 0"),
        (Cases(theta=np.nan), "theta holds a value that is not a number"),
        (Cases(R=0.0), "the factor on R must be a positive number"),
        (Cases(L_q=1.1), "has one inductance: vary L_d and L_q together"),
        (Cases(tuning={"N_max": (1,)}), "no tuning 'N_max'; there are: Q, R, x_0, P_0"),
        (Cases(tuning={"Q": (1.0, 2.0)}), r"tuning Q has shape \(2,\); \(5,\) or \(5, 1\) is right"),
    ],
)
def test_cases_that_do_not_fit_are_named(fleet: Fleet, cases: Cases, message: str) -> None:
    with pytest.raises(UserError, match=message):
        fleet.run(SHORT, cases)


def test_an_unknown_filter_is_named() -> None:
    with pytest.raises(UserError, match="has no filter 'pf'; generated: ckf, ickf"):
        Fleet(find_folder("paper_spmsm"), "pf")


# --- the noise


def _philox(counter: list[int], key: list[int]) -> list[int]:
    """Philox4x32-10 after its paper, in Python's integers."""
    c, k = list(counter), list(key)
    for _ in range(10):
        p0, p1 = 0xD2511F53 * c[0], 0xCD9E8D57 * c[2]
        c = [(p1 >> 32) ^ c[1] ^ k[0], p1 & 0xFFFFFFFF, (p0 >> 32) ^ c[3] ^ k[1], p0 & 0xFFFFFFFF]
        k = [(k[0] + 0x9E3779B9) & 0xFFFFFFFF, (k[1] + 0xBB67AE85) & 0xFFFFFFFF]
    return c


@pytest.mark.parametrize(
    ("counter", "key", "words"),
    [
        ([0] * 4, [0] * 2, [0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8]),
        ([0xFFFFFFFF] * 4, [0xFFFFFFFF] * 2, [0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD]),
        (
            [0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344],
            [0xA4093822, 0x299F31D0],
            [0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1],
        ),
    ],
)
def test_known_answers_of_philox(counter: list[int], key: list[int], words: list[int]) -> None:
    """The vectors that its authors publish with Random123."""
    assert _philox(counter, key) == words


@pytest.mark.parametrize(("seed", "pair"), [(0, 0), (1, 1999), (2**64 - 1, 2**32 - 1), (0x299F31D0A4093822, 77)])
def test_the_generator_is_philox(fleet: Fleet, seed: int, pair: int) -> None:
    words = fleet._ffi.new("uint32_t[4]")
    fleet._library.fleet_philox(seed, pair, words)
    assert list(words) == _philox([pair, 0, 0, 0], [seed & 0xFFFFFFFF, seed >> 32])


def test_normals_are_box_and_muller_of_the_words(fleet: Fleet) -> None:
    """Against the library's float64 logarithm, sine and cosine."""
    found = fleet.noise(12345, 4000)
    words = np.array([_philox([pair, 0, 0, 0], [12345, 0]) for pair in range(2000)], dtype=float).reshape(-1, 2)
    radius, angle = np.sqrt(-2 * np.log((words[:, 0] + 0.5) / 2**32)), 2 * np.pi * words[:, 1] / 2**32
    exact = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    small = radius < 0.1  # there u is close to 1, and float32 has it in steps of 2^-24
    np.testing.assert_allclose(found[~small], exact[~small], atol=3e-6)
    np.testing.assert_allclose(found[small], exact[small], atol=5e-4)


def test_noise_is_gaussian(fleet: Fleet) -> None:
    """Two million draws: moments, Kolmogorov-Smirnov, tails; sensors, samples, neighbouring seeds independent."""
    draws = np.array([fleet.noise(seed, 10_000) for seed in range(100)])  # (seed, sample, sensor)
    flat = draws.ravel().astype(float)
    n = flat.size
    assert abs(flat.mean()) < 4 / np.sqrt(n)
    assert abs(flat.var() - 1) < 4 * np.sqrt(2 / n)
    assert abs(stats.skew(flat)) < 4 * np.sqrt(6 / n)
    assert abs(stats.kurtosis(flat)) < 4 * np.sqrt(24 / n)
    assert stats.kstest(flat, "norm").pvalue > 1e-3
    for beyond in (2.0, 3.0, 4.0, 4.5):
        expected = 2 * stats.norm.sf(beyond) * n
        assert abs(np.count_nonzero(np.abs(flat) > beyond) - expected) < 4 * np.sqrt(expected)
    limit = 4 / np.sqrt(n / 2)
    for a, b in (
        (draws[..., 0], draws[..., 1]),
        (draws[:, 1:, 0], draws[:, :-1, 0]),
        (draws[:, 1:, 0], draws[:, :-1, 1]),
        (draws[1:], draws[:-1]),
    ):
        assert abs(np.mean(a.astype(float) * b)) < limit
        assert abs(np.mean((a.astype(float) ** 2 - 1) * (b.astype(float) ** 2 - 1))) < 2 * limit
