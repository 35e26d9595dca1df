"""Drive files: what is wrong is said in one line that names the key, its unit and its range."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from model.drives.load import DRIVES, cautions, load_drive, parse_drive, shipped_drives
from model.drives.states import most_angle_variance
from model.schema import DriveError, Rated
from tests.conftest import variant

pytestmark = pytest.mark.unit

PAPER = (DRIVES / "paper_spmsm.toml").read_text()


def test_shipped_drives_load() -> None:
    assert {"paper_spmsm", "ipmsm_flux"} <= set(shipped_drives())
    for name in shipped_drives():
        assert load_drive(name).name == name


def test_paper_drive_is_the_papers_table() -> None:
    drive = load_drive("paper_spmsm")
    m = drive.motor
    assert (m.stator_resistance, m.inductance_d, m.inductance_q, m.magnet_flux) == (2.875, 835e-6, 835e-6, 0.175)
    assert (m.pole_pairs, m.inertia, m.friction) == (4, 0.008, 0.002)
    assert drive.filter.initial_covariance == [0.1, 0.1, 50, 0.1]
    assert drive.filter.process_noise == [0.01, 0.02, 0.24, 0.001]
    assert drive.filter.measurement_noise == [0.01, 0.01]


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (
            "inductance_d = 835e-6",
            "inductance_d = 0.835",
            "motor.inductance_d = 0.835 H is outside 1e-07 .. 0.5 H. Did you mean 0.835 mH",
        ),
        ("inductance_d = 835e-6", "inductance_d = 0.8", "Did you mean 0.8 mH = 0.0008?"),
        ("sample_time = 20e-6", "sample_time = 20", "Did you mean 20 us = 2e-05?"),
        ("sample_time = 20e-6", "sample_time = 0.0", "model.sample_time = 0.0 s is outside"),
        ("stator_resistance = 2.875", "stator_resistance = -2.875", "motor.stator_resistance = -2.875 ohm is outside"),
        ("stator_resistance = 2.875", "stator_resistance = 0", "motor.stator_resistance = 0"),
        ("stator_resistance = 2.875", "stator_resistance = nan", "motor.stator_resistance"),
        ("stator_resistance = 2.875", "stator_resistance = 'high'", "motor.stator_resistance = 'high'"),
        ("inertia = 0.008", "inertia = 0", "motor.inertia"),
        ("pole_pairs = 4", "pole_pairs = 4.5", "motor.pole_pairs = 4.5"),
        ("pole_pairs = 4", "", "motor.pole_pairs is missing (1 .. 200)"),
        ("pole_pairs = 4", "pole_pair = 4", "unknown key motor.pole_pair. Did you mean 'pole_pairs'?"),
        ("friction = 0.002", "friction = 0.002\ncogging = 1", "unknown key motor.cogging"),
        ('machine = "surface"', 'machine = "surfaces"', "model.machine = 'surfaces' is none of"),
        ("inductance_q = 835e-6", "inductance_q = 900e-6", "machine 'surface' needs them equal"),
        ("[0.1, 0.1, 50, 0.1]", "[0.1, 0.1, 50]", "filter.initial_covariance has 3 entries; this model has 4 states"),
        ("[0.1, 0.1, 50, 0.1]", "[0.1, 0.1, -50, 0.1]", "filter.initial_covariance[2] = -50 is not positive"),
        (
            "[0.1, 0.1, 50, 0.1]",
            "[0.1, 0.1, 50, 2.23]",
            "initial_covariance[3] = 2.23 rad^2, of theta: its points would be half a turn off and more, "
            "where they tell no angle; at most 2.22 for 4 states.",
        ),
        (
            "[0.01, 0.01]",
            "[0.01, 1e-30]",
            "filter.measurement_noise[1] = 1e-30 is below 1e-18.",
        ),
        ("[0.01, 0.01]", "[0.01, 0.0]", "filter.measurement_noise[1] = 0.0 is not positive"),
        ('kinds = ["ckf", "ickf"]', 'kinds = ["ckff"]', "filter.kinds"),
        ("[filter]", '[filter]\nroot_order = ["theta"]', "it must name each of the model's states once: i_alpha,"),
        ("max_iterations = 3", "max_iterations = 0", "filter.max_iterations"),
        ("[motor]", "[motors]", "unknown key motors. Did you mean 'motor'?"),
        ("cycles = 3000 ", "cycles = 50", "budget.cycles = 50 cycles is outside 100 .. 1e+06 cycles."),
        ("cycles = 3000 ", "cycles = 3000.5", "budget.cycles = 3000.5"),
        ("cycles = 3000 ", "k = 0.5", "budget.k = 0.5 is outside 1 .. 10."),
        ("cycles = 3000 ", "cycle = 3000", "unknown key budget.cycle. Did you mean 'cycles'?"),
        ("cycles = 3000 ", "ram_words = 1", "budget.ram_words = 1 16-bit words is outside 10 .. 10000"),
        ("[motor]", "[motor", "not valid TOML"),
        ('name = "paper_spmsm"', 'name = "Paper SPMSM"', "name = 'Paper SPMSM'"),
        ('name = "paper_spmsm"', 'name = "paper_spmsm"\nsha256 = "0"', "unknown key sha256"),
    ],
)
def test_bad_input_is_explained(tmp_path: Path, old: str, new: str, expected: str) -> None:
    assert old in PAPER
    path = tmp_path / "my_motor.toml"
    path.write_text(PAPER.replace(old, new, 1))
    with pytest.raises(DriveError) as caught:
        load_drive(path)
    message = str(caught.value)
    assert expected in message
    assert message.startswith("drive 'my_motor.toml': ")
    assert "\n" not in message or "TOML" in message


@pytest.mark.parametrize(("kinds", "reach"), [(["ckf"], 2.0), (["ickf", "ekf"], 2.0), (["ekf", "ukf"], math.sqrt(5))])
def test_the_points_of_the_widest_angle_tell_it(kinds: list[str], reach: float) -> None:
    """A point and its opposite, ``reach`` sigmas off on either side, are not yet one; none much wider is accepted."""
    widest = most_angle_variance(4, kinds)
    assert math.pi * 0.9 < reach * math.sqrt(widest) < math.pi < reach * 1.1 * math.sqrt(widest)
    data = tomllib.loads(PAPER)
    data["filter"] |= {"kinds": kinds, "initial_covariance": [0.1, 0.1, 50, widest]}
    parse_drive(data, "widest")
    data["filter"]["initial_covariance"][3] = 1.0001 * widest
    with pytest.raises(DriveError, match="half a turn off"):
        parse_drive(data, "wider")


def test_an_ekf_draws_no_points() -> None:
    data = tomllib.loads(PAPER)
    data["filter"] |= {"kinds": ["ekf"], "initial_covariance": [0.1, 0.1, 50, 9.0]}
    parse_drive(data, "ekf")


def test_unknown_name_suggests_a_near_one() -> None:
    with pytest.raises(DriveError, match="Did you mean 'paper_spmsm'"):
        load_drive("paper_spm")


def test_initial_state_is_optional_and_taken(tmp_path: Path) -> None:
    from model.machines.state_space import default_initial_state

    assert default_initial_state(load_drive("paper_spmsm")) == [0.0, 0.0, 0.0, 0.0]
    assert default_initial_state(load_drive("ipmsm_flux")) == [0.545, 0.0, 0.0, 0.0]
    path = tmp_path / "started.toml"
    path.write_text(PAPER.replace("max_iterations = 3", "max_iterations = 3\ninitial_state = [0, 0, 10, 0.5]"))
    assert default_initial_state(load_drive(path)) == [0.0, 0.0, 10.0, 0.5]


def test_line_endings_do_not_change_the_hash(tmp_path: Path) -> None:
    path = tmp_path / "paper_spmsm.toml"
    path.write_bytes(PAPER.replace("\n", "\r\n").encode())
    assert load_drive(path).sha256 == load_drive("paper_spmsm").sha256


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le with a mark"])
def test_no_editors_encoding_changes_the_hash(encoding: str, tmp_path: Path) -> None:
    """Notepad and PowerShell put a mark before the text, and write UTF-16."""
    path = tmp_path / "paper_spmsm.toml"
    text = "# 0.5 \u00b5s of dead time\n" + PAPER
    plain = tmp_path / "plain.toml"
    plain.write_bytes(text.encode())
    mark = "\ufeff" if encoding.endswith("mark") else ""
    path.write_bytes((mark + text).replace("\n", "\r\n").encode(encoding.partition(" ")[0]))
    assert load_drive(path).sha256 == load_drive(plain).sha256
    assert load_drive(path).motor == load_drive("paper_spmsm").motor


@pytest.mark.parametrize(
    ("raw", "said"),
    [
        ("# one\n# 0.5 \u00b5s\n".encode("latin-1"), "line 2 is no UTF-8 (byte 0xb5); save the file as UTF-8"),
        (b"\xff\xfea", "line 1 is no UTF-8"),
    ],
)
def test_another_encoding_is_said_with_its_line(raw: bytes, said: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_bytes(raw)
    with pytest.raises(DriveError) as caught:
        load_drive(path)
    assert said in str(caught.value)


def test_design_contract_example_is_accepted(tmp_path: Path) -> None:
    """A drive file without the optional operating box is complete."""
    data = tomllib.loads(PAPER)
    del data["operating_box"]
    head, _, _ = PAPER.partition("[operating_box]")
    path = tmp_path / "boxless.toml"
    path.write_text(head)
    assert load_drive(path).operating_box.speed > 0


def test_cautions_say_what_is_coarse() -> None:
    """Euler's share of a winding's and of the speed's decay in a sample, each with a sample time that will do."""
    paper = load_drive("paper_spmsm")
    assert [cautions(load_drive(name)) for name in shipped_drives()] == [[]] * len(shipped_drives())
    for word, motor, longest in (
        ("T R / L = 0.34", {"stator_resistance": 14.375}, 0.2 * 835e-6 / 14.375),
        ("T D / J = 0.50", {"friction": 10.0, "inertia": 4e-4}, 0.2 * 4e-4 / 10),
    ):
        coarse = variant(paper, motor=motor)
        (line,) = cautions(coarse)
        assert f"forward Euler with {word}; above 0.2" in line
        assert float(line.split("sample_time <= ")[1].split()[0]) == pytest.approx(longest, rel=1e-2)
        assert not cautions(variant(coarse, model={"sample_time": 0.999 * longest}))
        assert not cautions(variant(coarse, model={"discretization": "exact"}))


@pytest.mark.parametrize(
    ("sections", "words"),
    [
        ({"control": {"max_current": 100.1}}, "control.max_current = 100.1 A is beyond operating_box.current = 100 A"),
        ({"operating_box": {"voltage": 179.5}}, "= 179.6 V is beyond operating_box.voltage = 179.5 V"),
        (
            {"rated": Rated(speed=201.0, torque=1.0)},
            "rated.speed = 201 rad/s is beyond operating_box.speed",
        ),
        (
            {"rated": Rated(speed=10.0, torque=21.0)},
            "rated.torque = 21 N m is beyond operating_box.load_torque",
        ),
    ],
)
def test_what_the_box_excludes_is_cautioned(sections: dict[str, Any], words: str) -> None:
    """The controller's limits and the rated task against the box beyond which the step rejects inputs."""
    drive = load_drive("paper_spmsm")
    rated = sections.pop("rated", None)
    drive = variant(drive, **sections).model_copy(update={"rated": rated})
    lines = cautions(drive)
    assert len(lines) == 1
    assert words in lines[0]


def test_a_return_that_float32_rounds_away_is_cautioned() -> None:
    """What is said is what float32 does: within that share of its own value an adaptive state stays where it is."""
    drive = variant(load_drive("spmsm_adaptive"), model={"adaptive_time": 300.0})
    (line,) = cautions(drive)
    assert "return of magnet_flux and stator_resistance away within 12% of the motor's own; 1.2e+02 s" in line
    assert not cautions(variant(drive, model={"adaptive_time": 118.0}))
    f = np.float32
    for own in (drive.motor.magnet_flux, drive.motor.stator_resistance):
        for share, stays in ((0.12, True), (-0.11, True), (0.5, False), (-0.3, False)):
            value = f(own * (1 + share))
            after = f(value + f(f(drive.model.return_rate) * f(f(own) - value)))
            assert bool(after == value) is stays, (own, share)
