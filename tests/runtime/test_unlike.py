"""Recordings unlike what a filter takes: what is unlike is found, told with an option, and mended by that option."""

from __future__ import annotations

import re
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime.estimator.folder import find_folder
from runtime.folders.stated import stated_drive
from runtime.proof.own_trajectory import trajectory_of
from runtime.recorded.clock import check_clock
from runtime.recorded.data import Corrections, Recorded, read_recorded
from runtime.recorded.frames import WIRINGS
from runtime.recorded.resample import resample
from runtime.recorded.rest import find_rest, offset_notes
from runtime.replay.replay import Replay, Settings, replay
from runtime.system.errors import UserError
from tests.conftest import thoroughly

STEPS = 1500
SIGMA = 0.05


def columns_of(drive: str) -> dict[str, np.ndarray]:
    """A start of a drive's motor to its rated speed, with noise, as a board would record it."""
    made = trajectory_of(stated_drive(find_folder(drive)), steps=STEPS)
    pairs = dict(zip(("u_alpha", "u_beta", "i_alpha", "i_beta"), np.hstack([made.u, made.y]).T, strict=True))
    return {"t": made.t, **pairs, "omega": made.omega, "theta": made.theta}


@pytest.fixture(scope="module")
def columns() -> dict[str, np.ndarray]:
    return columns_of("spmsm_load_torque")


def phases(alpha: np.ndarray, beta: np.ndarray) -> tuple[np.ndarray, ...]:
    return tuple(alpha * np.cos(k * 2 * np.pi / 3) + beta * np.sin(k * 2 * np.pi / 3) for k in range(3))


def replayed(folder: Path, columns: dict[str, np.ndarray], *options: str, drive: str = "spmsm_load_torque") -> Replay:
    """A recording written, read with the options of a command line, replayed by the drive's CKF."""
    np.savez(folder / "d.npz", **columns)
    given: dict[str, list[str]] = {"--scale": [], "--offset": [], "--wiring": []}
    words = iter(options)
    begins = False
    for word in words:
        name, _, value = word.partition("=")
        if name == "--begins":
            begins = True
        elif name in given:
            given[name].append(value if value else next(words))
    asked = Corrections(given["--offset"], next(iter(given["--wiring"]), None), begins)
    recorded = read_recorded(folder / "d.npz", (), given["--scale"], corrections=asked)
    return replay(find_folder(drive), recorded, Settings("ckf"))


def proposed(note: str) -> list[str]:
    """The options that a note ends with."""
    return shlex.split(" ".join(re.findall(r"--(?:scale|offset|wiring|begins)(?:[ =]\S+)?", note))) if note else []


# --- wiring


@pytest.mark.parametrize("wiring", WIRINGS[1:])
def test_every_wiring_is_found_and_mended(wiring: str, columns: dict[str, np.ndarray], tmp_path: Path) -> None:
    """The sensor of column k sits on phase word[k], or counts the other way."""
    sign, order = (-1, wiring[1:]) if wiring[0] == "-" else (1, wiring)
    true = dict(zip("abc", phases(columns["i_alpha"], columns["i_beta"]), strict=True))
    wired = {f"i_{name}": sign * true[phase] for name, phase in zip("abc", order, strict=True)}
    made = {name: column for name, column in columns.items() if not name.startswith("i_")} | wired
    wrong = replayed(tmp_path, made)
    assert wrong.consistency is not None
    assert wrong.consistency.verdict.startswith("innovations far larger than the filter expects: currents, voltages")
    (note,) = [note for note in wrong.notes if "do not fit" in note]
    assert re.search(rf"With --wiring[ =]{re.escape(wiring)} it is [0-9.]+$", note), note
    assert wrong.conventions == {}, "no word of the truth where the data do not fit the motor"
    right = replayed(tmp_path, made, f"--wiring={wiring}")
    plain = replayed(tmp_path, columns)
    np.testing.assert_allclose(right.x[-1], plain.x[-1], rtol=1e-3, atol=1e-3)
    assert not any("do not fit" in note for note in right.notes)


def test_voltages_of_the_next_step_are_moved_back(columns: dict[str, np.ndarray], tmp_path: Path) -> None:
    """A recording of commands: each row has the voltage of the interval that begins at it."""
    early = columns | {name: np.roll(columns[name], -1) for name in ("u_alpha", "u_beta")}
    mended = replayed(tmp_path, early, "--begins")
    plain = replayed(tmp_path, {name: column[1:] for name, column in columns.items()})
    np.testing.assert_array_equal(mended.recorded.u, plain.recorded.u)
    np.testing.assert_array_equal(mended.x, plain.x)


def test_what_no_wiring_mends_is_said(columns: dict[str, np.ndarray], tmp_path: Path) -> None:
    made = columns | {"u_alpha": 3 * columns["u_alpha"], "u_beta": 3 * columns["u_beta"]}
    (note,) = [note for note in replayed(tmp_path, made).notes if "do not fit" in note]
    assert note.endswith("nor in another order or sign of the phases: units, motor data, --x0, --theta0?")


# --- the truth's convention

ANGLES: dict[str, tuple[float, float]] = {
    # theta of the file = factor * rotor's electrical angle + offset (rad); p is 4
    "mechanical": (1 / 4, 0.0),
    "degrees": (180 / np.pi, 0.0),
    "turns": (1 / (2 * np.pi), 0.0),
    "mechanical degrees, reversed": (-180 / np.pi / 4, 0.0),
    "mechanical turns": (1 / (8 * np.pi), 0.0),
    "the q axis": (1.0, np.pi / 2),
    "back-EMF": (1.0, -np.pi / 2),
    "reversed": (-1.0, 0.0),
    "encoder": (1 / 4, 1.1),
    "reversed encoder in degrees": (-180 / np.pi / 4, 20.0),
}


@pytest.mark.parametrize("what", ANGLES)
def test_an_angle_of_another_convention_is_told_from_a_lost_rotor(
    what: str, columns: dict[str, np.ndarray], tmp_path: Path
) -> None:
    factor, offset = ANGLES[what]
    made = columns | {"theta": factor * np.unwrap(columns["theta"]) + offset}
    wrong = replayed(tmp_path, made)
    assert wrong.errors is not None
    assert set(wrong.conventions) == {"theta"}, wrong.errors
    assert wrong.conventions["theta"] in wrong.notes
    right = replayed(tmp_path, made, *proposed(wrong.conventions["theta"]))
    assert right.errors is not None
    assert right.errors.position_steady_rms is not None
    assert right.errors.position_steady_rms < 4.0, wrong.conventions["theta"]
    assert right.conventions == {}


def test_options_come_on_top_of_those_a_column_was_read_with(columns: dict[str, np.ndarray], tmp_path: Path) -> None:
    made = columns | {"theta": np.degrees(np.unwrap(columns["theta"])) / 4 + 10.0}
    half = replayed(tmp_path, made, "--scale", "theta=deg", "--offset", "theta=-5deg")
    right = replayed(tmp_path, made, *proposed(half.conventions["theta"]))
    assert right.errors is not None
    assert right.errors.position_steady_rms is not None
    assert right.errors.position_steady_rms < 4.0
    by_resolver = {"cos_theta": np.cos(columns["theta"] + 1.6), "sin_theta": np.sin(columns["theta"] + 1.6)}
    found = replayed(tmp_path, {name: c for name, c in columns.items() if name != "theta"} | by_resolver)
    assert "exchange their columns or signs" in found.conventions["theta"]


SPEEDS = {
    "electrical": 4.0,
    "r/min": 30 / np.pi,
    "electrical r/min": 120 / np.pi,
    "reversed": -1.0,
    "turns/s": 0.5 / np.pi,
}


@pytest.mark.parametrize("what", SPEEDS)
def test_a_speed_of_another_convention_is_told(what: str, columns: dict[str, np.ndarray], tmp_path: Path) -> None:
    made = columns | {"omega": SPEEDS[what] * columns["omega"]}
    wrong = replayed(tmp_path, made)
    assert set(wrong.conventions) == {"omega"}
    right = replayed(tmp_path, made, *proposed(wrong.conventions["omega"]))
    assert right.conventions == {}
    assert right.errors is not None
    assert right.errors.speed_steady_rms is not None
    assert right.errors.speed_steady_rms < 5.0


def test_a_convention_is_not_blamed_for_what_is_none(columns: dict[str, np.ndarray], tmp_path: Path) -> None:
    theta = np.unwrap(columns["theta"])
    others: dict[str, np.ndarray] = {
        "right": theta,
        "a bias of the estimate": theta + 0.3,
        "another rotor": theta + 30 * columns["t"],
        "noise": np.random.default_rng(1).uniform(-3, 3, STEPS),
        "a constant": np.full(STEPS, 1.0),
        "no numbers": np.full(STEPS, np.nan),
    }
    for what, truth in others.items():
        found = replayed(tmp_path, columns | {"theta": truth})
        assert found.conventions == {}, what
        assert found.errors is not None
        assert found.errors.lost is (what not in {"right", "a bias of the estimate"}), what
    rest = {name: 0 * column for name, column in columns.items()} | {"t": columns["t"]}
    standing = replayed(tmp_path, rest | {"theta": np.full(STEPS, 1.0)})
    assert standing.conventions == {}, "any convention fits a rotor that stands"
    assert standing.errors is not None
    assert standing.errors.lost
    for omega in (0.9 * columns["omega"], 1.5 * columns["omega"], np.zeros(STEPS), np.full(STEPS, np.nan)):
        assert replayed(tmp_path, columns | {"omega": omega}).conventions == {}


@pytest.mark.parametrize(
    "drive", ["ipmsm_flux", "hub_36v", *thoroughly("ipmsm", "servo_24v", "traction_70kw", "spmsm_adaptive")]
)
def test_of_another_drive_too(drive: str, tmp_path: Path) -> None:
    """Salient machines and other pole pairs."""
    columns = columns_of(drive)
    p = stated_drive(find_folder(drive)).motor.pole_pairs
    plain = replayed(tmp_path, columns, drive=drive)
    assert plain.conventions == {}
    assert not any("do not fit" in note for note in plain.notes)
    made = columns | {"theta": np.unwrap(columns["theta"]) / p, "omega": p * columns["omega"]}
    assert set(replayed(tmp_path, made, drive=drive).conventions) == {"theta", "omega"}
    for wiring, signs in (("acb", (1, -1)), ("-acb", (-1, 1)), ("-abc", (-1, -1))):
        wired = {name: sign * columns[name] for name, sign in zip(("i_alpha", "i_beta"), signs, strict=True)}
        found = replayed(tmp_path, columns | wired, drive=drive)
        (note,) = [note for note in found.notes if "do not fit" in note]
        assert re.search(rf"With --wiring[ =]{wiring} it is", note), note
        assert found.conventions == {}


# --- other rates


def held(rows: int, count: int = 200) -> tuple[Recorded, np.ndarray, np.ndarray]:
    """Voltages held over steps, currents straight within them, ``rows`` rows a step; and the steps themselves."""
    rng = np.random.default_rng(rows)
    u, y = rng.normal(size=(2, count, 2))
    t = 0.3 + 1e-4 * np.arange(1 - rows, (count - 1) * rows + 1) / rows
    fine = np.column_stack([np.interp(t, 0.3 + 1e-4 * np.arange(count), column) for column in y.T])
    theta = np.linspace(0.0, 40.0, len(t))
    return Recorded(Path("d.csv"), t, np.repeat(u, rows, axis=0), fine, {"theta": theta}), u, y


@pytest.mark.parametrize("rows", [2, 3, 10, 37])
def test_steps_that_end_on_rows_are_exact(rows: int) -> None:
    recorded, u, y = held(rows)
    found = resample(recorded, 1e-4, "mine")
    np.testing.assert_allclose(found.t, 0.3 + 1e-4 * np.arange(200), atol=1e-12)
    np.testing.assert_allclose(found.u, u, atol=1e-9)
    np.testing.assert_allclose(found.y, y, atol=1e-7)
    np.testing.assert_array_equal(found.truth["theta"], recorded.truth["theta"][rows - 1 :: rows])
    assert check_clock(found.t, 1e-4, Path("d"), "mine").notes == []
    assert f"resampled from {200 * rows:,} rows" in found.notes[0]


def test_rows_that_come_as_they_like_are_averaged_by_their_times() -> None:
    """Against the integral of known voltages; 12 rows a step with jitter, and 4.7 rows a step without."""
    rng = np.random.default_rng(4)
    jittered = np.sort(1e-4 / 12 * (np.arange(6000) + rng.uniform(-0.3, 0.3, 6000)))
    w = 2 * np.pi * 150
    for t in (jittered, 1e-4 / 4.7 * np.arange(2000)):
        edges = np.concatenate(([t[0] - np.median(np.diff(t))], t))
        u = np.diff(np.sin(w * edges)) / (w * np.diff(edges))  # the mean of cos over each row's interval
        made = Recorded(Path("d"), t, np.column_stack([u, -u]), np.column_stack([np.cos(w * t)] * 2), {})
        found = resample(made, 1e-4, "mine")
        begin = found.t - 1e-4
        np.testing.assert_allclose(found.u[:, 0], (np.sin(w * found.t) - np.sin(w * begin)) / (w * 1e-4), atol=3e-3)
        np.testing.assert_allclose(found.y[:, 0], np.cos(w * found.t), atol=2e-4)


def test_what_is_missing_spoils_its_step_alone() -> None:
    recorded, u, y = held(10)
    holed = recorded.u.copy()
    holed[57], holed[91] = np.nan, 1e308
    keep = np.r_[0:300, 308:2000]  # eight rows of step 30
    made = replace(recorded, t=recorded.t[keep], u=holed[keep], y=recorded.y[keep], truth={})
    found = resample(made, 1e-4, "mine")
    assert list(np.flatnonzero(np.isnan(found.u[:, 0]))) == [5, 9, 30]
    good = np.setdiff1d(np.arange(200), [5, 9, 30])
    np.testing.assert_allclose(found.u[good], u[good], atol=1e-9)
    np.testing.assert_allclose(found.y[good], y[good], atol=1e-7)


def test_switching_voltages_say_how_well_their_means_are_known() -> None:
    recorded, _, _ = held(20)
    duty = np.tile(np.where(np.arange(20) < 7, 300.0, 0.0), 200)
    found = resample(replace(recorded, u=np.column_stack([duty, 0 * duty])), 1e-4, "mine")
    np.testing.assert_allclose(found.u[:, 0], 300 * 7 / 20)
    assert "each mean to 15 V" in found.notes[-1]


@pytest.mark.parametrize(
    ("t", "expected"),
    [
        (1e-4 / 1.5 * np.arange(300), "1.5 rows a step"),
        (1e-4 / 3.3 * np.arange(300), "3.3 rows a step"),
        (2e-4 * np.arange(300), "0.5 rows a step"),
        (np.cumsum(1e-4 * np.random.default_rng(2).uniform(0.2, 1.8, 300)), "Log at a fixed step"),
        (np.full(300, 1e308), "does not increase"),
        (1e300 * np.arange(300), "rows a step"),
    ],
)
def test_too_few_rows_a_step_are_refused(t: np.ndarray, expected: str) -> None:
    made = Recorded(Path("d.csv"), t, np.zeros((300, 2)), np.zeros((300, 2)), {})
    with pytest.raises(UserError) as caught:
        resample(made, 1e-4, "mine")
    assert expected in str(caught.value)
    with pytest.raises(UserError):
        check_clock(t, 1e-4, Path("d.csv"), "mine")


def test_what_is_sampled_with_the_drive_stays_as_it_is() -> None:
    recorded, _, _ = held(1)
    assert resample(recorded, 1e-4, "mine") is recorded
    with pytest.raises(UserError, match="--resample averages u over each step"):
        check_clock(held(10)[0].t, 1e-4, Path("d"), "mine")
    with pytest.raises(UserError, match="Record faster and --resample, or generate the drive"):
        check_clock(1e-4 / 1.5 * np.arange(100), 1e-4, Path("d"), "mine")


# --- offsets


def at_rest(
    rest: int, offset: tuple[float, float] = (0.0, 0.0), **changes: Any
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """A stretch without voltage, then a machine that turns."""
    rng = np.random.default_rng(rest)
    angle = 0.05 * np.arange(1000)
    u = np.vstack([np.zeros((rest, 2)), 50 * np.column_stack([np.cos(angle), np.sin(angle)])])
    i = np.vstack([np.zeros((rest, 2)), 5 * np.column_stack([np.cos(angle), np.sin(angle)])])
    noisy = i + changes.get("noise", 0.05) * rng.normal(size=i.shape) + offset
    return u + changes.get("measured", 0.0) * rng.normal(size=u.shape), dict(zip(("i_a", "i_b"), noisy.T, strict=True))


@pytest.mark.parametrize("measured", [0.0, 0.2])
def test_offsets_are_estimated_where_there_is_a_rest(measured: float) -> None:
    u, currents = at_rest(400, (0.3, -0.12), measured=measured)
    (note,) = offset_notes(u, currents)
    told = {name: float(value) for name, value in re.findall(r"--offset (i_.)=(\S+)", note)}
    assert told["i_a"] == pytest.approx(-0.3, abs=5 * 0.05 / 20)
    assert told["i_b"] == pytest.approx(0.12, abs=5 * 0.05 / 20)
    (note,) = offset_notes(*at_rest(400, (0.3, 0.0)))
    assert "i_b" not in note, "an offset that is none is not told"


def test_offsets_are_not_told_where_there_is_none_or_no_rest() -> None:
    assert offset_notes(*at_rest(400)) == []
    assert offset_notes(*at_rest(30, (0.3, 0.3))) == [], "a rest of 30 rows is none"
    u, currents = at_rest(400, (0.3, 0.3))
    turning = currents["i_a"].copy()
    turning[:400] += 2 * np.cos(0.1 * np.arange(400))
    assert offset_notes(u, currents | {"i_a": turning}) == [], "a rotor that turns makes currents alternate"
    assert offset_notes(0 * u, currents) == [], "no voltage anywhere is no recording of a rest"
    steady = u.copy()
    steady[:400] = 0.4
    assert offset_notes(steady, currents) == [], "a small steady voltage makes a current"
    assert offset_notes(u, dict.fromkeys(currents, np.full(1400, np.nan))) == []
    assert find_rest(np.zeros((0, 2))) is None


def test_an_offset_is_told_and_taken_away(columns: dict[str, np.ndarray], tmp_path: Path) -> None:
    rest = {name: np.concatenate([np.zeros(300), column]) for name, column in columns.items()}
    rest["t"] = columns["t"][0] + np.median(np.diff(columns["t"])) * np.arange(-300, STEPS)
    rng = np.random.default_rng(8)
    for name, offset in (("i_alpha", 0.4), ("i_beta", -0.3)):
        rest[name] = rest[name] + offset
        rest[name][:300] += SIGMA * rng.normal(size=300)
    found = replayed(tmp_path, rest)
    (note,) = [note for note in found.notes if "without voltage" in note]
    mended = replayed(tmp_path, rest, *proposed(note))
    assert not any("without voltage" in note for note in mended.notes)
    assert abs(np.mean(mended.recorded.y[:300])) < 0.01
