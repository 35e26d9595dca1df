"""Replay: the estimate is the filter's, its expectations are the reference's, its statistics are SciPy's."""

from __future__ import annotations

import json
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import runtime
from codegen.ir.trig import sin_cos_bound
from runtime.drive.simulation import Run, Simulator
from runtime.estimator.folder import find_folder
from runtime.folders.stated import stated_drive
from runtime.proof.own_trajectory import trajectory_of
from runtime.proof.reference import make_reference
from runtime.recorded.data import Recorded, read_recorded
from runtime.recorded.truth import errors, find_load_step
from runtime.replay.innovations import Innovations, held_inputs
from runtime.replay.replay import Replay, Settings, replay
from runtime.replay.statistics import (
    NIS_BAND,
    autocorrelation,
    chi_square_tail,
    consistency,
    ljung_box,
    mean_band,
)
from runtime.system.errors import UserError
from tests.conftest import DRIVES, TASKS, thoroughly
from tests.runtime.test_cli import call


def start_of(drive: str, steps: int) -> Recorded:
    folder = find_folder(drive)
    made = trajectory_of(stated_drive(folder), steps=steps)
    return Recorded(Path("made.npz"), made.t, made.u, made.y, {"omega": made.omega, "theta": made.theta})


@pytest.fixture(scope="module")
def run() -> Run:
    return Simulator(find_folder("spmsm_load_torque"), "ickf").run(TASKS["load_step"])


@pytest.fixture(scope="module")
def replayed(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Replay:
    path = tmp_path_factory.mktemp("run") / "run.npz"
    run.save(path)
    return replay(find_folder("spmsm_load_torque"), read_recorded(path), Settings())


@pytest.mark.parametrize("drive", DRIVES)
def test_expected_measurements_are_the_references(drive: str) -> None:
    """y - y_pred and Pyy, eq. 21 and 22, against the hand-written CKF."""
    recorded = start_of(drive, 300)
    found = replay(find_folder(drive), recorded, Settings("ckf", "numpy", "float64"))
    folder = find_folder(drive)
    reference = make_reference(
        folder.manifest["parameters"], "ckf", "cubature", np.array(folder.module.DEFAULTS["x_0"])
    )
    for k in range(300):
        stages = reference.step(recorded.u[k], recorded.y[k])
        Pyy = stages["Pyy"]
        np.testing.assert_allclose(found.innovations.nu[k], stages["innovation"], atol=1e-7)
        np.testing.assert_allclose(found.innovations.S[k], [Pyy[0, 0], Pyy[1, 0], Pyy[1, 1]], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found.x[-1], reference.x, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("drive", DRIVES)
def test_both_back_ends_and_the_estimator_agree_bit_for_bit(drive: str) -> None:
    recorded = start_of(drive, 400)
    by_c, by_numpy = (replay(find_folder(drive), recorded, Settings(backend=name)) for name in ("c", "numpy"))
    np.testing.assert_array_equal(by_c.x, by_numpy.x)
    np.testing.assert_array_equal(by_c.words, by_numpy.words)
    np.testing.assert_array_equal(by_c.innovations.nu, by_numpy.innovations.nu)
    trace = runtime.load(drive, None, "c", "float32").run(recorded.u, recorded.y)
    np.testing.assert_array_equal(by_c.x, trace.x)
    np.testing.assert_array_equal(by_c.P(slice(None)), trace.P)


def test_rejected_and_missing_rows_are_predictions() -> None:
    """A gap is what the filter does when it is given nothing; statistics leave both out."""
    recorded = start_of("spmsm_load_torque", 500)
    holed = recorded.y.copy()
    holed[100:120] = np.nan
    folder = find_folder("spmsm_load_torque")
    rejected = replay(folder, Recorded(recorded.path, recorded.t, recorded.u, holed, recorded.truth), Settings())
    assert "20 of 500 rows rejected" in rejected.notes[0]
    assert "first at t = 0.0101 s" in rejected.notes[0]
    assert np.all(np.isnan(rejected.innovations.nu[100:120]))
    assert np.all(np.isfinite(rejected.innovations.nu[120:]))
    assert rejected.consistency is not None
    assert rejected.consistency.steps == 480
    kept = np.r_[0:100, 120:500]
    rows = Recorded(
        recorded.path,
        recorded.t[kept],
        recorded.u[kept],
        recorded.y[kept],
        {name: column[kept] for name, column in recorded.truth.items()},
    )
    gapped = replay(folder, rows, Settings())
    by_hand = runtime.load("spmsm_load_torque", None, "c", "float32")
    u, y = recorded.u.copy(), recorded.y.copy()
    u[100:120], y[100:120] = np.nan, np.nan
    np.testing.assert_array_equal(gapped.x, by_hand.run(u, y).x[kept])
    assert "1 gaps, 20 samples missing" in gapped.notes[0]
    everything = Recorded(recorded.path, recorded.t, 1e4 * recorded.u + 1e5, recorded.y, {})
    with pytest.raises(UserError, match="rejects every row"):
        replay(folder, everything, Settings())


def test_a_rejected_voltage_is_held() -> None:
    u = np.array([[np.nan, 0.0], [1.0, 2.0], [3.0, 900.0], [4.0, 5.0]])
    np.testing.assert_array_equal(held_inputs(u, 800.0), [[0, 0], [1, 2], [1, 2], [4, 5]])


def test_the_angle_to_start_from_turns_the_flux() -> None:
    """Data of a motor at rest at 1 rad: from the drive's start the filter is wrong, from theta0 it is right.

    At rest nothing says where the angle is but the flux that was assumed: float32 sine and cosine turn it a little in
    every step, always the same way. With a pair rounded correctly 5e-5 degrees are left, with the generated one 1e-3.
    """
    folder = find_folder("ipmsm_flux")
    T, theta = folder.module.SAMPLE_TIME, 1.0
    rest = Recorded(
        Path("rest"), T * np.arange(50), np.zeros((50, 2)), np.zeros((50, 2)), {"theta": np.full(50, theta)}
    )
    found = replay(folder, rest, Settings(theta0=theta))
    assert found.errors is not None
    assert found.errors.position_max is not None
    assert found.errors.position_max < np.degrees(len(rest.t) * sin_cos_bound().proved)  # 2.3e-3
    psi_m = folder.manifest["parameters"]["motor"]["magnet_flux"]
    np.testing.assert_allclose(found.x[0, :2], psi_m * np.array([np.cos(theta), np.sin(theta)]), atol=1e-6)
    x0 = (psi_m * np.cos(theta), psi_m * np.sin(theta), 0.0, theta)
    np.testing.assert_array_equal(replay(folder, rest, Settings(x0=x0)).x, found.x)
    for settings, expected in (
        (Settings(x0=(0.0, 0.0)), "this drive's state is psi_alpha,psi_beta,omega,theta"),
        (Settings(x0=(0.0,) * 4, theta0=1.0), "not both"),
    ):
        with pytest.raises(UserError, match=expected):
            replay(folder, rest, settings)


def test_figures_of_a_simulated_run(run: Run, replayed: Replay) -> None:
    """The loop's own estimate was made of the same samples, so its figures are the replay's."""
    figures, found = run.figures(), replayed.errors
    assert found is not None
    assert found.load_step_at == pytest.approx(0.2)
    assert found.speed_start == pytest.approx(figures["start"], rel=1e-3)
    assert found.speed_load_step == pytest.approx(figures["load_step"], rel=1e-3)
    assert found.speed_steady_rms == pytest.approx(figures["steady_rms"], rel=1e-2)
    assert found.load_torque_end == pytest.approx(float(run.x[-1, 4]) - 5.0, abs=1e-3)
    assert not found.lost


def test_the_load_step_is_found_where_it_is() -> None:
    t = 1e-4 * np.arange(5000)
    noise = np.random.default_rng(2).normal(0.0, 0.3, 5000)
    assert find_load_step(t, np.zeros(5000)) is None
    assert find_load_step(t, noise) is None
    assert find_load_step(t, np.where(t < 0.2, 0.0, -5.0) + noise) == 2000
    assert find_load_step(t, np.clip((t - 0.1) / 0.1, 0.0, 1.0)) == pytest.approx(1500, abs=1)


def test_errors_by_hand() -> None:
    t = 0.01 * np.arange(100)
    x = np.zeros((100, 5), dtype=np.float32)
    x[:, 3], x[10, 2] = 3.1, 1.0
    truth = {"omega": np.zeros(100), "theta": np.full(100, -3.1), "load_torque": np.where(t < 0.495, 0.0, 2.0)}
    found = errors(t, x, ("i_alpha", "i_beta", "omega", "theta", "load_torque"), truth)
    assert found is not None
    assert found.speed_start == pytest.approx(60 / (2 * np.pi))
    assert found.speed_load_step == 0.0
    assert found.position_end == pytest.approx(np.degrees(6.2 - 2 * np.pi), abs=1e-4)
    assert found.load_torque_end == -2.0
    assert errors(t, x, (), {}) is None


def test_statistics_are_scipys() -> None:
    stats = pytest.importorskip("scipy.stats")
    assert list(NIS_BAND) == pytest.approx(stats.chi2.ppf([0.025, 0.975], 2))
    for steps in (50, 1000, 1_000_000):
        assert mean_band(steps) == pytest.approx(stats.chi2.ppf([0.025, 0.975], 2 * steps) / steps, rel=1e-4)
    for q in (0.0, 1.0, 20.0, 31.41, 200.0):
        assert chi_square_tail(q, 20) == pytest.approx(stats.chi2.sf(q, 20), rel=1e-9)
    assert chi_square_tail(1e7, 20) == 0.0
    z = np.random.default_rng(4).normal(size=500)
    r = autocorrelation(z, 4)
    full = np.correlate(z, z, "full")
    np.testing.assert_allclose(r, full[500:504] / full[499])
    Q = 500 * 502 * np.sum(r**2 / (500 - np.arange(1, 5)))
    assert ljung_box(r, 500) == pytest.approx(stats.chi2.sf(Q, 4))


def test_a_consistent_filter_is_found_consistent_and_others_are_not() -> None:
    rng = np.random.default_rng(11)
    C = np.array([[0.3, 0.0], [-0.1, 0.2]])
    S = C @ C.T
    nu = rng.normal(size=(20_000, 2)) @ C.T
    words = np.tile([S[0, 0], S[1, 0], S[1, 1]], (20_000, 1))

    def judged(nu: np.ndarray) -> SimpleNamespace:
        found = consistency(Innovations(nu, words))
        assert found is not None
        return SimpleNamespace(found=found, verdict=found.verdict)

    good = judged(nu)
    assert good.found.nis_band[0] < good.found.nis_mean < good.found.nis_band[1]
    assert good.found.nis_mean == pytest.approx(np.mean(np.einsum("ki,ij,kj->k", nu, np.linalg.inv(S), nu)))
    assert good.found.nis_inside == pytest.approx(0.95, abs=0.01)
    assert good.verdict == "innovations of the size the filter expects, white"
    assert "too small" in judged(1.2 * nu).verdict
    assert "too large" in judged(0.8 * nu).verdict
    coloured = nu + 0.2 * np.roll(nu, 1, axis=0)
    assert "correlated in time" in judged(coloured).verdict
    assert consistency(Innovations(nu[:30], words[:30])) is None


def test_estimates_on_disk(replayed: Replay, run: Run, tmp_path: Path) -> None:
    replayed.write_estimates(tmp_path / "est.npz")
    with np.load(tmp_path / "est.npz") as data:
        assert set(data) == {"t", "x", "P", "status"}
        trace = runtime.load("spmsm_load_torque", None, "c", "float32").run(run.u, run.i)
        np.testing.assert_array_equal(data["x"], trace.x)
        np.testing.assert_array_equal(data["P"], trace.P)
        assert data["P"].dtype == np.float32
        np.testing.assert_array_equal(data["t"], run.t)
        np.testing.assert_array_equal(data["status"], trace.status)


def test_figures_can_be_drawn(replayed: Replay) -> None:
    pytest.importorskip("matplotlib")
    from runtime.replay.figures import estimate_figure, innovation_figure

    for text, labels in (
        (
            estimate_figure(replayed),
            ["speed, r/min", "speed error, r/min", "position, rad electrical", "position error, deg electrical",
             "load torque, N m"],
        ),
        (
            innovation_figure(replayed),
            ["innovation alpha, A", "innovation beta, A", "normalised innovation squared", "autocorrelation"],
        ),
    ):  # fmt: skip
        upright = re.findall(r"<text[^>]*rotate\(-90[^>]*>([^<]*)</text>", text)  # a label's lines one by one
        assert " ".join(upright) == " ".join(labels)
        assert text.count("<clipPath") == len(labels)  # an area to draw in for each
        assert "<title>time " in text
        assert "<title>lag " not in text  # the label of the last panel, not of those above it


@pytest.mark.parametrize("rows", [1, 60, 3000, *thoroughly(2)])
def test_absurd_data_make_figures_and_no_warning(rows: int, tmp_path: Path) -> None:
    """Noise over the whole range, numbers beyond float32, no numbers at all, next to nothing."""
    pytest.importorskip("matplotlib")
    from runtime.replay.figures import write_figures

    folder = find_folder("ipmsm_flux")
    rng = np.random.default_rng(1)
    u, y = rng.uniform(-800, 800, (rows, 2)), rng.uniform(-30, 30, (rows, 2))
    u[1:60:2], y[2:60:3] = 1e300, -1e200
    y[60 : rows // 2] = np.nan
    truth = {"omega": np.full(rows, 3.0), "theta": np.zeros(rows), "load_torque": np.zeros(rows)}
    t = folder.module.SAMPLE_TIME * np.arange(rows)
    found = replay(folder, Recorded(Path("absurd"), t, u, y, truth), Settings())
    json.dumps(found.to_json(), allow_nan=False)
    assert len(write_figures(found, tmp_path)) == 2
    if rows == 3000:
        assert found.consistency is not None
        assert "do not fit each other" in found.consistency.verdict
        assert "do not fit each other" in found.notes[-1]


def test_replay_command(run: Run, tmp_path: Path) -> None:
    run.save(tmp_path / "run.csv")
    done = call(
        "replay", "spmsm_load_torque", "run.csv", "--filter", "ckf", "--out", "est.npz", "--json", "f.json",
        "--plots", "plots", cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "speed, largest after the load step at 0.2 s" in done.stdout
    facts = json.loads((tmp_path / "f.json").read_text())
    assert facts["filter"] == "ckf"
    assert facts["samples"] == len(run.t)
    assert facts["errors"]["load_step_at"] == pytest.approx(0.2)
    assert 0.9 < facts["innovations"]["nis_inside"] < 1.0
    assert np.load(tmp_path / "est.npz")["P"].shape == (len(run.t), 5, 5)
    assert sorted(path.name for path in (tmp_path / "plots").iterdir()) == ["estimate.svg", "innovations.svg"]


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("spmsm_load_torqe", "run.npz"), "Did you mean 'spmsm_load_torque'?"),
        (("paper_spmsm", "run.npz"), "is sampled every 100 us (median), drive 'paper_spmsm' steps every 20 us"),
        (("spmsm_load_torque", "none.npz"), "cannot be read as recorded data"),
        (("spmsm_load_torque", "run.npz", "--filter", "pf"), "has no filter 'pf'"),
        (("spmsm_load_torque", "run.npz", "--backend", "rust"), "backend 'rust' is not numpy or c"),
        (("spmsm_load_torque", "run.npz", "--dtype", "half"), "dtype 'half' is not float32 or float64"),
        (("spmsm_load_torque", "run.npz", "--out", "est.csv"), "estimates are written as .npz"),
        (("spmsm_load_torque", "run.npz", "--x0", "a,b"), "'a' is not a number"),
        (("mine.toml", "run.npz"), "is not generated yet: no generated folder"),
    ],
)
def test_bad_words_are_one_line(arguments: tuple[str, ...], expected: str, run: Run, tmp_path: Path) -> None:
    from model.drives.load import DRIVES as FILES

    run.save(tmp_path / "run.npz")
    text = (FILES / "spmsm_load_torque.toml").read_text()
    (tmp_path / "mine.toml").write_text(text.replace('"spmsm_load_torque"', '"mine"'))
    done = call("replay", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert expected in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_a_toml_file_means_its_generated_folder(run: Run, tmp_path: Path) -> None:
    from model.drives.load import DRIVES as FILES

    run.save(tmp_path / "run.npz")
    text = (FILES / "spmsm_load_torque.toml").read_text().replace('"spmsm_load_torque"', '"mine"')
    text = text.replace('["ckf", "ickf"]', '["ckf"]')  # one filter is enough to generate here
    (tmp_path / "mine.toml").write_text(text)
    assert call("generate", "mine.toml", cwd=tmp_path).returncode == 0
    done = call("replay", "mine.toml", "run.npz", "--backend", "numpy", "--json", "f.json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "f.json").read_text())["drive"] == "mine"
    (tmp_path / "mine.toml").write_text(text.replace("magnet_flux = 0.175", "magnet_flux = 0.17"))
    stale = call("replay", "mine.toml", "run.npz", cwd=tmp_path)
    assert stale.returncode == 2
    assert "is stale" in stale.stderr
