"""Statistics of replays, their table and drawings: each figure again from the arrays, by another way."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

import runtime.replay.replay
from runtime.drive.experiment import simulate
from runtime.estimator.folder import find_folder
from runtime.recorded.truth import Errors, errors
from runtime.replay.figures import estimate_figure, innovation_figure
from runtime.replay.innovations import Innovations, held_inputs
from runtime.replay.replay import Settings, replay, start
from runtime.replay.statistics import LAGS, NIS_BAND, consistency, mean_band
from runtime.replay.tables import replay_tables
from tests.judges.made import RPM, Kept, command, curves, read_json, replayed, text_of

# --- innovations and their statistics


def _innovations(scale: float = 1.0, shift: float = 0.0, N: int = 500) -> Innovations:
    C = np.array([[0.3, 0.0], [-0.1, 0.2]])
    S = C @ C.T
    nu = (scale * np.random.default_rng(5).normal(size=(N, 2)) + shift) @ C.T
    return Innovations(nu, np.tile([S[0, 0], S[1, 0], S[1, 1]], (N, 1)))


def test_whitened_squares_are_the_mahalanobis_distance() -> None:
    found = _innovations()
    z = found.whitened()
    for k in range(20):
        S = np.array([[found.S[k, 0], found.S[k, 1]], [found.S[k, 1], found.S[k, 2]]])
        assert z[k] @ z[k] == pytest.approx(found.nu[k] @ np.linalg.solve(S, found.nu[k]))
        np.testing.assert_allclose(np.linalg.cholesky(S) @ z[k], found.nu[k])


def test_consistency_step_by_step() -> None:
    found = _innovations(shift=0.1)
    nu, S = found.nu.copy(), found.S.copy()
    nu[100], S[100] = np.nan, np.nan
    result = consistency(Innovations(nu, S))
    assert result is not None
    good = [k for k in range(500) if k != 100]
    nis = [float(nu[k] @ np.linalg.inv([[S[k, 0], S[k, 1]], [S[k, 1], S[k, 2]]]) @ nu[k]) for k in good]
    low, high = stats.chi2.ppf([0.025, 0.975], 2)
    assert result.steps == 499
    assert result.nis_mean == pytest.approx(sum(nis) / 499)
    assert result.nis_inside == pytest.approx(sum(low <= one <= high for one in nis) / 499)
    assert result.nis_band == pytest.approx(tuple(stats.chi2.ppf([0.025, 0.975], 998) / 499), rel=1e-3)
    assert result.bias_band == result.correlation_band == pytest.approx(stats.norm.ppf(0.975) / math.sqrt(499))
    z = Innovations(nu, S).whitened()
    z[100] = 0.0
    assert result.bias == pytest.approx(tuple(z.sum(axis=0) / 499))
    for j in range(2):
        power = sum(z[k, j] ** 2 for k in range(500))
        for lag in (1, 7, LAGS):
            expected = sum(z[k, j] * z[k - lag, j] for k in range(lag, 500)) / power
            assert result.correlation[j][lag - 1] == pytest.approx(expected)
        Q = 499 * 501 * sum(r**2 / (499 - lag) for lag, r in enumerate(result.correlation[j], 1))
        assert result.ljung_box[j] == pytest.approx(stats.chi2.sf(Q, LAGS))
    beyond = [abs(r) > result.correlation_band for row in result.correlation for r in row]
    assert result.outside == pytest.approx(sum(beyond) / (2 * LAGS))
    assert (len(result.correlation), len(result.correlation[0])) == (2, LAGS)


def test_too_few_measurements_have_no_statistics() -> None:
    assert consistency(_innovations(N=2 * LAGS)) is None
    assert consistency(_innovations(N=2 * LAGS + 1)) is not None


@pytest.mark.parametrize(
    ("mean", "box", "words"),
    [
        (2.0, (0.5, 0.5), "innovations of the size the filter expects, white"),
        (2.6, (0.5, 0.5), "innovations larger than the filter expects: P, Q or R are too small for this data, white"),
        (
            31.0,
            (0.5, 0.5),
            "innovations far larger than the filter expects: currents, voltages and motor do not fit each other, white",
        ),
        (29.0, (0.5, 0.5), "innovations larger than the filter expects: P, Q or R are too small for this data, white"),
        (1.4, (0.5, 0.5), "innovations smaller than the filter expects: P, Q or R are too large for this data, white"),
        (2.0, (0.5, 0.009), "innovations of the size the filter expects, correlated in time"),
        (2.0, (0.009, 0.5), "innovations of the size the filter expects, correlated in time"),
        (2.0, (0.011, 0.02), "innovations of the size the filter expects, white"),
    ],
)
def test_words_of_consistency(mean: float, box: tuple[float, float], words: str) -> None:
    found = consistency(_innovations())
    assert found is not None
    said = replace(found, nis_mean=mean, nis_band=(1.5, 2.5), ljung_box=box)
    assert said.verdict == words
    assert said.to_json()["verdict"] == words


def test_a_rejected_voltage_holds_the_last_good_one() -> None:
    u = np.array([[np.nan, 1], [2, 3], [2, 31], [-31, 0], [4, -30], [np.inf, 0]])
    assert held_inputs(u, 30.0).tolist() == [[0, 0], [2, 3], [2, 3], [2, 3], [4, -30], [4, -30]]


# --- replay: figures, table, drawings


def test_json_of_a_replay(tmp_path: Path) -> None:
    status = np.zeros(200, int)
    status[:7] = 1
    status[5:9] |= 2
    found = replayed(status=status, notes=["n"], errors=Errors(speed_start=1.0, position_end=float("nan")))
    facts = found.to_json()
    assert (facts["rejected"], facts["not_converged"], facts["finite"]) == (7, 4, True)
    assert (facts["samples"], facts["seconds"], facts["sample_time"]) == (200, pytest.approx(0.199), 1e-3)
    assert facts["end"] == {"i_alpha": 0.0, "i_beta": 0.0, "omega": 100.0, "theta": 0.0}
    assert (facts["errors"]["speed_start"], facts["errors"]["position_end"]) == (1.0, None)
    assert (facts["drive"], facts["filter"], facts["backend"], facts["dtype"], facts["notes"]) == (
        "d",
        "ickf",
        "c",
        "float32",
        ["n"],
    )
    assert facts["innovations"] is None
    for place in ((0, 0), (199, 3), (100, 1)):
        x = replayed().x.copy()
        x[place] = np.nan
        spoiled = replayed(x=x)
        assert spoiled.finite is spoiled.to_json()["finite"] is False
    assert spoiled.to_json()["end"]["theta"] == 0.0
    x = replayed().x.copy()
    x[-1, 3] = np.inf
    assert replayed(x=x).to_json()["end"]["theta"] is None


def test_the_table_of_a_replay_has_sigmas_and_units() -> None:
    found = consistency(_innovations(shift=0.1))
    assert found is not None
    wrong = Errors(0.2, 11.0, 0.5, 7.0, 90.0, 31.0, -12.0, 0.25, -0.125)
    said = text_of(replay_tables(replayed(errors=wrong, consistency=found, status=np.full(200, 3))))

    def line(words: str) -> str:
        lines = [" ".join(row.replace("│", " ").split()) for row in said.splitlines()]
        (one,) = [row for row in lines if words in row]
        return one

    assert line("at the end i_alpha") == (
        "at the end i_alpha 0 +- 0.1 A, i_beta 0 +- 0.2 A, omega 100 +- 2 rad/s, theta 0 +- 0.3 rad"
    )
    assert line("data") == "data 200 samples, 0.199 s, T = 1000 us"
    assert line("filter d") == "filter d ickf, generated C, float32"
    assert line("status") == "status 200 rejected, 200 iterations not converged"
    assert line("before the load step") == "speed, largest before the load step 11.000 r/min"
    assert line("speed, rms") == "speed, rms at the end 0.500 r/min"
    assert line("after the load step") == "speed, largest after the load step at 0.2 s 7.000 r/min"
    assert line("position, largest") == "position, largest 90.000 deg electrical"
    assert line("position, rms") == "position, rms at the end 31.000 deg electrical"
    assert line("position, last") == "position, last row -12.000 deg electrical"
    assert line("load torque, rms") == "load torque, rms at the end 0.250 N m"
    assert line("load torque, last") == "load torque, last row -0.125 N m"
    assert "the rotor is LOST at the end" in said
    low, high = found.nis_band
    assert line("squared, mean").endswith(f"{found.nis_mean:.4g} {low:.4g} .. {high:.4g}")
    assert line("inside their own") == f"steps inside their own 95 % band {100 * found.nis_inside:.1f} % 95 %"
    for k, name in enumerate(("alpha", "beta")):
        assert line(f"mean, {name}").endswith(f"{found.bias[k]:+.4f} +- {found.bias_band:.4f}")
        lag = int(np.argmax(np.abs(found.correlation[k])))
        assert line(f"autocorrelation, {name}").endswith(
            f"(lag {lag + 1}) {found.correlation[k][lag]:+.4f} +- {found.correlation_band:.4f}"
        )
        assert line(f"Ljung-Box p, {name}").endswith(f"{found.ljung_box[k]:.2g} over 0.05")
    assert line("beyond the band").endswith(f"{100 * found.outside:.0f} % 5 %")
    assert found.verdict in said
    held = text_of(replay_tables(replayed(errors=Errors(position_steady_rms=1.0))))
    assert "LOST" not in held
    assert "too few measurements" in held
    assert "speed, largest" not in held


def test_the_drawing_of_an_estimate(kept: Kept) -> None:
    omega = np.full(200, 90.0)
    truth = {"omega": omega, "theta": np.linspace(0.1, 0.3, 200)}
    estimate_figure(replayed(truth=truth))
    speed, off, position, angle = kept.axes
    t = 1e-3 * np.arange(200)
    assert [axis.get_ylabel() for axis in kept.axes] == [
        "speed, r/min", "speed error,\nr/min", "position,\nrad electrical", "position error,\ndeg electrical"
    ]  # fmt: skip
    np.testing.assert_allclose(curves(speed)["estimate"].y, 100 * RPM)
    np.testing.assert_allclose(curves(speed)["true"].y, 90 * RPM)
    np.testing.assert_allclose(curves(off)["error"].y, 10 * RPM)
    np.testing.assert_allclose(curves(off)["2 sigma of the filter"].y, 2 * 2 * RPM)
    assert min(line.get_ydata()[0] for line in off.lines) == pytest.approx(-4 * RPM)
    np.testing.assert_allclose(curves(position)["estimate"].y, 0.0)
    np.testing.assert_allclose(curves(position)["true"].y, truth["theta"])
    np.testing.assert_allclose(curves(angle)["error"].y, -np.degrees(truth["theta"]))
    np.testing.assert_allclose(curves(angle)["2 sigma of the filter"].y, 2 * math.degrees(0.3))
    for axis in (off, angle):
        low, high = axis.get_ylim()
        assert low == -high < 0
        assert high > max(np.max(np.abs(curves(axis)["error"].y)), 1.3 * 2 * 0.3)
        np.testing.assert_array_equal(curves(axis)["error"].x, t)


@pytest.mark.parametrize(("turns", "first"), [(20, 1550), (6, 150), (5, 50), (4, 0), (0, 0)])
def test_the_drawing_of_a_position_is_its_last_turns(turns: int, first: int, kept: Kept) -> None:
    """Five turns at most, the lines broken where the angle wraps; a turn takes 100 samples, the first half of one."""
    N = 100 * turns if turns else 300
    rows = np.arange(N) if turns else np.zeros(N)
    theta = np.remainder(2 * np.pi * (rows + 0.5) / 100 + np.pi, 2 * np.pi) - np.pi
    x = np.column_stack([np.zeros((N, 3)), theta])
    estimate_figure(replayed(N=N, x=x, truth={"theta": theta + 0.01}))
    (position,) = [axis for axis in kept.axes if axis.get_ylabel() == "position,\nrad electrical"]
    for name, values in (("estimate", theta), ("true", theta + 0.01)):
        shown = curves(position)[name]
        np.testing.assert_allclose(shown.x, 1e-3 * np.arange(first, N))
        wraps = [k for k in range(first, N) if turns and k % 100 == 50 and (k > first or name == "estimate")]
        assert list(np.flatnonzero(np.isnan(shown.y)) + first) == wraps
        good = ~np.isnan(shown.y)
        np.testing.assert_allclose(shown.y[good], values[first:][good], atol=1e-9)


def test_the_drawing_of_a_position_has_100_000_points_at_most(kept: Kept) -> None:
    estimate_figure(replayed(N=100_007))
    assert curves(kept.axes[-1])["estimate"].x[0] == pytest.approx(7e-3)


def test_slow_states_have_panels_of_their_own(kept: Kept) -> None:
    x = np.column_stack([replayed().x, np.full(200, 3.5)])
    names, units = (*replayed().state_names, "load_torque"), (*replayed().state_units, "N m")
    P = np.eye(5)
    unpack = lambda words: np.tile(P, (len(words), 1, 1))  # noqa: E731
    estimate_figure(
        replayed(x=x, state_names=names, state_units=units, unpack=unpack, truth={"load_torque": np.full(200, 4.0)})
    )
    assert [axis.get_ylabel() for axis in kept.axes] == [
        "speed, r/min",
        "position,\nrad electrical",
        "load torque, N m",
    ]
    found = curves(kept.axes[2])
    assert (found["estimate"].y[0], found["true"].y[0]) == (3.5, 4.0)


def test_the_drawing_of_innovations(kept: Kept) -> None:
    made = replayed(N=2000)
    result = consistency(made.innovations)
    assert result is not None
    innovation_figure(replace(made, consistency=result))
    alpha, beta, nis, correlation = kept.axes
    for axis, column, sigma in ((alpha, 0, 0.2), (beta, 1, 0.5)):
        fill = axis.collections[0].get_paths()[0].vertices
        assert fill[:, 1].max() == pytest.approx(made.innovations.nu[:, column].max())
        assert fill[:, 1].min() == pytest.approx(made.innovations.nu[:, column].min())
        np.testing.assert_allclose(curves(axis)["2 sigma expected"].y, 2 * sigma)
        assert sorted(line.get_ydata()[0] for line in axis.lines) == pytest.approx([-2 * sigma, 2 * sigma])
    squares = (made.innovations.nu[:, 0] / 0.2) ** 2 + (made.innovations.nu[:, 1] / 0.5) ** 2
    width = 2000 // 400
    np.testing.assert_allclose(curves(nis)[f"mean over {width} steps"].y, squares.reshape(-1, width).mean(axis=1))
    flat = sorted(float(line.get_ydata()[0]) for line in nis.lines[1:])
    assert flat == pytest.approx(sorted([2.0, *mean_band(width)]))
    heights = [bar.get_height() for bar in correlation.patches if bar.get_width() < 1]
    assert heights[: 2 * LAGS] == pytest.approx([r for row in result.correlation for r in row])
    centres = [bar.get_x() + bar.get_width() / 2 for bar in correlation.patches if bar.get_width() < 1]
    assert [round(centre) for centre in centres] == 2 * list(range(1, LAGS + 1))
    innovation_figure(replayed(N=100))
    assert sorted(float(line.get_ydata()[0]) for line in kept.axes[2].lines[1:]) == pytest.approx(
        sorted([2.0, *NIS_BAND])
    )
    np.testing.assert_allclose(curves(kept.axes[0])["innovation"].y, replayed(N=100).innovations.nu[:, 0])


def test_where_a_replay_starts() -> None:
    estimator: Any = SimpleNamespace(state_names=("a", "b", "omega", "theta"), tuning={"x_0": (3.0, 0.0, 7.0, 0.5)})
    assert start(estimator, Settings()) is None
    assert list(start(estimator, Settings(x0=(1.0, 2.0, 3.0, 4.0)))) == [1, 2, 3, 4]  # type: ignore[arg-type]
    turned = start(estimator, Settings(theta0=0.5 + math.pi / 2))
    np.testing.assert_allclose(turned, [0.0, 3.0, 7.0, 0.5 + math.pi / 2], atol=1e-12)
    wrapped = start(estimator, Settings(theta0=4.0))
    assert wrapped is not None
    assert wrapped[3] == pytest.approx(4.0 - 2 * math.pi)
    for bad in (Settings(x0=(1.0,)), Settings(x0=(1.0,) * 4, theta0=0.0)):
        with pytest.raises(runtime.replay.replay.UserError):
            start(estimator, bad)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("replay") / "r.npz"
    (run,) = simulate("paper_spmsm", "no_load", ["ickf"])
    run.save(path)
    return path


def test_replay_ends_with_1_if_the_estimate_is_no_number(
    recording: Path, here: Path, monkeypatch: pytest.MonkeyPatch, kept: Kept
) -> None:
    """A real recording through the real filter; then one whose run of estimates holds a single infinity."""
    code, said = command("replay", "paper_spmsm", str(recording), "--json", "r.json", "--out", "e.npz", "--plots", "p")
    assert sorted(path.name for path in Path("p").iterdir()) == ["estimate.svg", "innovations.svg"]
    facts = read_json("r.json")
    assert (code, facts["finite"]) == (0, True), said
    with np.load(recording) as file, np.load("e.npz") as kept_:
        truth = {name: file[name] for name in ("omega", "theta", "load_torque")}
        again = errors(file["t"], kept_["x"], ("i_alpha", "i_beta", "omega", "theta"), truth)
        late = kept_["t"] >= kept_["t"][-1] - 0.05
        rms = math.sqrt(np.mean((kept_["x"][late, 2].astype(float) - file["omega"][late]) ** 2)) * RPM
        assert kept_["P"].shape == (len(kept_["t"]), 4, 4)
        assert np.linalg.eigvalsh(kept_["P"][-1].astype(float)).min() > 0
    assert again is not None
    assert facts["errors"] == pytest.approx(again.to_json(), nan_ok=True)
    assert facts["errors"]["speed_steady_rms"] == pytest.approx(rms)
    original = runtime.replay.replay._run

    def spoiled(*rest: Any) -> Any:
        x, *others = original(*rest)
        x[-500, 1] = np.inf
        return x, *others

    monkeypatch.setattr(runtime.replay.replay, "_run", spoiled)
    code, said = command("replay", "paper_spmsm", str(recording), "--json", "r.json")
    assert (code, read_json("r.json")["finite"]) == (1, False)
    assert "the estimate did not stay a number" in said


def test_a_run_of_which_most_was_rejected_ends_with_1(recording: Path, here: Path) -> None:
    with np.load(recording) as file:
        columns = {name: file[name].copy() for name in file.files}
    N = len(columns["t"])
    for bad, expected in ((0.51, 1), (0.49, 0)):
        columns["i_alpha"][-int(bad * N) :] = 1e9
        np.savez("bad.npz", **columns)
        columns["i_alpha"][:] = 0.0
        code, said = command("replay", "paper_spmsm", "bad.npz")
        assert code == expected
        assert ("most rows were rejected" in said) is bool(expected)


def test_rows_that_are_rejected_are_counted_and_bridged(recording: Path, here: Path) -> None:
    with np.load(recording) as file:
        columns = {name: file[name].copy() for name in file.files}
    columns["i_alpha"][[3, 500, 501]] = [np.nan, 1e9, -1e9]
    np.savez("bad.npz", **columns)
    code, said = command("replay", "paper_spmsm", "bad.npz", "--json", "r.json")
    facts = read_json("r.json")
    assert (code, facts["rejected"]) == (0, 3), said
    assert f"3 of {len(columns['t']):,} rows rejected" in facts["notes"][0]
    assert f"the first at t = {columns['t'][3]:.6g} s" in facts["notes"][0]
    assert facts["innovations"]["steps"] == len(columns["t"]) - 3


def test_missing_rows_are_bridged_and_keep_their_times(recording: Path) -> None:
    from runtime.recorded.data import read_recorded

    whole = read_recorded(recording)
    keep = np.setdiff1d(np.arange(len(whole.t)), [700, 701, 702])
    truth = {name: values[keep] for name, values in whole.truth.items()}
    gappy = replace(whole, t=whole.t[keep], u=whole.u[keep], y=whole.y[keep], truth=truth)
    folder = find_folder("paper_spmsm")
    a, b = (replay(folder, data, Settings()) for data in (whole, gappy))
    assert (len(b.x), len(b.innovations.nu), len(b.status)) == (len(keep),) * 3
    np.testing.assert_array_equal(a.x[:700], b.x[:700])
    assert not np.array_equal(a.x[703], b.x[700])
    assert b.errors is not None
    assert b.errors.position_max is not None
    assert b.errors.position_max < 45
