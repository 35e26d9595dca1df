"""Conversions, each against its definition written out here."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from model.drives.load import load_drive
from model.schema import Rated
from runtime.drive.scenario import SCENARIOS, Scenario, find_scenario, scenarios, step_start
from runtime.recorded.data import read_recorded
from runtime.recorded.frames import FRAMES, WIRINGS, rewired
from runtime.recorded.units import RPM, SI, UNITS, find_unit, split_unit
from runtime.system.errors import UserError
from tests.judges.made import run

#: Spelling -> quantity, and one of it in SI, by the definitions of the SI and of the turn.
TOLD = {
    "s": ("time", 1.0),
    "sec": ("time", 1.0),
    "second": ("time", 1.0),
    "seconds": ("time", 1.0),
    "ms": ("time", 0.001),
    "us": ("time", 0.000001),
    "µs": ("time", 0.000001),
    "μs": ("time", 0.000001),
    "ns": ("time", 0.000000001),
    "V": ("voltage", 1.0),
    "volt": ("voltage", 1.0),
    "volts": ("voltage", 1.0),
    "mV": ("voltage", 0.001),
    "kV": ("voltage", 1000.0),
    "A": ("current", 1.0),
    "amp": ("current", 1.0),
    "amps": ("current", 1.0),
    "ampere": ("current", 1.0),
    "mA": ("current", 0.001),
    "kA": ("current", 1000.0),
    "rad": ("angle", 1.0),
    "deg": ("angle", 2 * math.pi / 360),
    "°": ("angle", 2 * math.pi / 360),
    "rad/s": ("speed", 1.0),
    "deg/s": ("speed", 2 * math.pi / 360),
    "r/min": ("speed", 2 * math.pi / 60),
    "rpm": ("speed", 2 * math.pi / 60),
    "RPM": ("speed", 2 * math.pi / 60),
    "1/min": ("speed", 2 * math.pi / 60),
    "min-1": ("speed", 2 * math.pi / 60),
    "Nm": ("torque", 1.0),
    "N m": ("torque", 1.0),
    "N*m": ("torque", 1.0),
    "N·m": ("torque", 1.0),
    " N.m ": ("torque", 1.0),
    "mNm": ("torque", 0.001),
    "turn": ("angle", 2 * math.pi),
    "turns": ("angle", 2 * math.pi),
    "rev": ("angle", 2 * math.pi),
    "turn/s": ("speed", 2 * math.pi),
    "turns/s": ("speed", 2 * math.pi),
    "rev/s": ("speed", 2 * math.pi),
    "%": ("share", 0.01),
    "percent": ("share", 0.01),
}


@pytest.mark.parametrize("text", TOLD)
def test_a_unit_is_what_it_is(text: str) -> None:
    unit = find_unit(text)
    assert unit is not None
    quantity, factor = TOLD[text]
    assert unit.quantity == quantity
    assert unit.factor == pytest.approx(factor, rel=1e-15)


def test_no_unit_is_left_out_and_no_other_is_known() -> None:
    assert set(UNITS) <= set(TOLD)
    for text in ("", "furlong", "kHz", "mrad", "Hz", "M", "Ms", "x"):
        assert find_unit(text) is None, text
    units = {"time": "s", "voltage": "V", "current": "A", "angle": "rad", "speed": "rad/s", "torque": "N m"}
    assert {**units, "share": "parts of 1"} == SI
    for quantity, name in units.items():
        unit = find_unit(name)
        assert unit is not None
        assert (unit.quantity, unit.factor) == (quantity, 1.0)


def test_a_letter_behind_an_underscore_is_a_phase_and_two_are_a_unit() -> None:
    assert [split_unit(cell) for cell in ("I_A", "u_V", "t_s", "duty_%")] == [
        (c, "") for c in ("I_A", "u_V", "t_s", "duty_%")
    ]
    assert [split_unit(cell) for cell in ("I_A_mA", "t_ms", "n_rpm", "w_rad/s")] == [
        ("I_A", "mA"), ("t", "ms"), ("n", "rpm"), ("w", "rad/s")
    ]  # fmt: skip


def test_a_thousand_turns_a_minute() -> None:
    assert pytest.approx(1000 / 60 * 2 * math.pi) == 1000 / RPM


COLUMNS = {
    "t": ("ms", 1e-3),
    "u_alpha": ("mV", 1e-3),
    "u_beta": ("kV", 1e3),
    "i_alpha": ("mA", 1e-3),
    "i_beta": ("kA", 1e3),
}
COLUMNS |= {"omega": ("deg/s", math.pi / 180), "theta": ("deg", math.pi / 180), "load_torque": ("mNm", 1e-3)}


@pytest.mark.parametrize("by", ["header", "scale", "number"])
def test_columns_arrive_in_si(by: str, tmp_path: Path) -> None:
    """The unit beside a name, --scale with a unit, or with a number."""
    path, rows = tmp_path / "d.csv", np.arange(1.0, 25.0).reshape(3, 8)
    names = [f"{name} [{unit}]" if by == "header" else name for name, (unit, _) in COLUMNS.items()]
    np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="")
    scales = [f"{name}={unit if by == 'scale' else factor}" for name, (unit, factor) in COLUMNS.items()]
    found = read_recorded(path, [], [] if by == "header" else scales)
    arrays = [found.t, *found.u.T, *found.y.T, *(found.truth[name] for name in ("omega", "theta", "load_torque"))]
    for column, array, (name, (_, factor)) in zip(rows.T, arrays, COLUMNS.items(), strict=True):
        np.testing.assert_allclose(array, column * factor, rtol=1e-12, err_msg=name)
    assert len(found.notes) == 8
    assert any(note.startswith("omega: ") and note.endswith("times 0.0174533") for note in found.notes)


def test_a_unit_of_something_else_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "d.npz"
    np.savez(path, **{name: np.ones(3) for name in COLUMNS})
    for scale in (
        "omega=deg",
        "theta=rad/s",
        "i_alpha=V",
        "t=Nm",
        "u_alpha=furlong",
        "i_beta=0",
        "i_beta=nan",
        "i_beta=inf",
    ):
        with pytest.raises(UserError):
            read_recorded(path, [], [scale])


def test_frames_against_phasors() -> None:
    """A balanced system of amplitude 3 at any angle is the pair of its phasor, whatever common part voltages have."""
    angle = np.linspace(-3.0, 3.0, 13)
    a, b, c = (3 * np.cos(angle - k * 2 * np.pi / 3) for k in range(3))
    common, link = np.linspace(-5, 5, 13), np.linspace(10, 30, 13)
    made = {
        ("i", ("i_a", "i_b", "i_c")): (a, b, c),
        ("i", ("i_a", "i_b")): (a, b),
        ("i", ("i_a", "i_c")): (a, c),
        ("i", ("i_b", "i_c")): (b, c),
        ("u", ("u_a", "u_b", "u_c")): (a + common, b + common, c + common),
        ("u", ("u_ab", "u_bc")): (a - b, b - c),
        ("u", ("u_ab", "u_ca")): (a - b, c - a),
        ("u", ("u_bc", "u_ca")): (b - c, c - a),
        ("u", ("duty_a", "duty_b", "duty_c", "u_dc")): (*(0.5 + x / link for x in (a, b, c)), link),
    }
    assert {(kind, names) for kind, frames in FRAMES.items() for names in frames} == set(made)
    for (kind, names), values in made.items():
        alpha, beta = FRAMES[kind][names](*values)
        np.testing.assert_allclose(alpha, 3 * np.cos(angle), atol=1e-12, err_msg=str(names))
        np.testing.assert_allclose(beta, 3 * np.sin(angle), atol=1e-12, err_msg=str(names))


def test_a_wiring_is_what_its_word_says() -> None:
    """Column k of the three that are recorded holds the current of phase word[k]."""
    angle = np.linspace(-3.0, 3.0, 13)
    phases = dict(zip("abc", (3 * np.cos(angle - k * 2 * np.pi / 3) for k in range(3)), strict=True))
    assert len(set(WIRINGS)) == 12
    for word in WIRINGS:
        sign, order = (-1, word[1:]) if word[0] == "-" else (1, word)
        columns = [sign * phases[phase] for phase in order]
        recorded = np.column_stack(FRAMES["i"]["i_a", "i_b", "i_c"](*columns))
        np.testing.assert_allclose(
            rewired(recorded, word), 3 * np.column_stack([np.cos(angle), np.sin(angle)]), atol=1e-12
        )


def test_a_scenarios_reference_and_load() -> None:
    task = Scenario("x", speed=600.0, ramp=0.1, load=3.0, load_at=0.2)
    t = np.array([0.0, 0.05, 0.1, 0.15, 0.2, 0.3])
    np.testing.assert_allclose(task.speed_reference(t), 600 * 2 * np.pi / 60 * np.array([0, 0.5, 1, 1, 1, 1]))
    assert list(task.load_torque(t)) == [0, 0, 0, 0, 3, 3]
    assert list(task.load_torque(0.2 - np.array([1.05e-12, 1e-12]))) == [0, 3], "a sample's time is rounded"


def test_the_papers_scenarios() -> None:
    """To 1000 r/min within 0.15 s; in the second 5 N m from 0.2 s on; 0.4 s in all."""
    drive = load_drive("paper_spmsm")
    assert set(SCENARIOS) == set(scenarios(drive)) == {"no_load", "load_step"}
    for name, load in (("no_load", 0.0), ("load_step", 5.0)):
        task = find_scenario(name, drive)
        assert (task.name, task.duration) == (name, 0.4)
        t = np.array([0.0, 0.075, 0.15, 0.1999, 0.2, 0.4])
        np.testing.assert_allclose(task.speed_reference(t) * 60 / (2 * math.pi), [0, 500, 1000, 1000, 1000, 1000])
        assert list(task.load_torque(t)) == [0, 0, 0, 0, load, load]
    hardest = step_start(drive)
    assert hardest.speed_reference(np.array([0.5e-3, 1e-3])) * 60 / (2 * math.pi) == pytest.approx([500, 1000])
    assert (hardest.load, hardest.load_at, hardest.duration) == (5.0, 0.2, 0.4)
    for name in ("", "step_start", "no load"):
        with pytest.raises(UserError, match="no_load, load_step"):
            find_scenario(name, drive)


def test_a_scenario_belongs_to_its_motor() -> None:
    """Speed, load and times from [rated] and the speed loop; what is asked for takes their place."""
    drive = load_drive("paper_spmsm")
    slow = drive.control.model_copy(update={"speed_bandwidth": 20.0})
    own = drive.model_copy(update={"rated": Rated(speed=200.0, torque=0.25), "control": slow})
    task = find_scenario("load_step", own)
    assert (task.speed * 2 * math.pi / 60, task.load) == pytest.approx((200.0, 0.25))
    assert task.ramp == pytest.approx(0.008 * 200.0 / (0.5 * 1.5 * 4 * 0.175 * 20.0))  # J omega over half of the torque
    assert (task.load_at - task.ramp, task.duration - task.load_at) == pytest.approx((0.15, 0.6))
    assert task.least_band == pytest.approx(0.02 * task.speed)
    asked = find_scenario("load_step", own, speed=60.0, load=0.1, ramp=0.5)
    assert (asked.speed, asked.load, asked.ramp) == (60.0, 0.1, 0.5)
    assert (asked.load_at, asked.duration) == pytest.approx((0.65, 1.25))
    assert find_scenario("no_load", own, load=0.1).load == 0.0
    for words in ({"speed": math.nan}, {"load": math.inf}, {"ramp": math.nan}, {"ramp": 0.0}, {"ramp": -1.0}):
        with pytest.raises(UserError, match=next(iter(words))):
            find_scenario("load_step", own, **words)


@pytest.mark.parametrize(("ms", "told"), [(149, 0.0), (151, 90.0), (399, 90.0)])
def test_a_start_is_over_after_150_ms(ms: int, told: float) -> None:
    """Sample k is taken at k + 1 ms; from 150 ms on an error of the angle is none of the start's."""
    off = np.zeros(400)
    off[ms - 1] = 90.0
    assert run("no_load", angle_error=off).figures()["angle"] == pytest.approx(told, abs=1e-9)
