"""What was found, written into drive files: estimates made by hand, no search."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from codegen.generate import generate_bare
from model.drives.load import DRIVES, load_drive, shipped_drives
from model.inverter import lost_voltage
from runtime.identify.intervals import Estimate
from runtime.identify.subject import read_subject
from runtime.identify.unknowns import DATA
from runtime.identify.write import Findings, written_text
from runtime.system.errors import UserError

#: Of what the file says: what was found, and the interval's half-width.
FACTOR, HALF = {"R": 1.15, "L": 0.93, "L_d": 0.93, "L_q": 0.9, "psi_m": 1.04, "J": 0.8}, 0.03


def found_of(path: Path, volts: float, **untold: bool) -> Any:
    """What a search would give."""
    subject = read_subject(str(path), None)
    estimates = []
    for datum in subject.free:
        value = volts if datum.word == "V_dead" else FACTOR[datum.word] * subject.guess(datum)
        told = not untold.get(datum.word, False)
        estimates.append(Estimate(datum, subject.guess(datum), value, value * (1 - HALF), value * (1 + HALF), told))
    return Findings(subject.name, subject.facts, subject.facts, estimates)


def comments(text: str) -> list[str]:
    """What stands behind numbers and between them."""
    return [line.partition("#")[2].strip() for line in text.splitlines() if "#" in line]


@pytest.mark.parametrize("name", shipped_drives())
def test_a_drive_file_is_edited_and_means_what_was_found(name: str, tmp_path: Path) -> None:
    path, volts = tmp_path / f"{name}.toml", 0.012 * load_drive(name).control.dc_link
    before = (DRIVES / f"{name}.toml").read_text(encoding="utf-8")
    path.write_text(before, encoding="utf-8")
    text = written_text(found_of(path, volts, psi_m=True), path)
    path.write_text(text, encoding="utf-8")
    old, new = load_drive(name), load_drive(path)
    salient = old.model.machine != "surface"
    for word, key in (("R", "stator_resistance"), ("J", "inertia"), ("L_d" if salient else "L", "inductance_d")):
        assert getattr(new.motor, key) == pytest.approx(FACTOR[word] * getattr(old.motor, key), rel=1e-5)
    assert new.motor.inductance_q == pytest.approx(FACTOR["L_q" if salient else "L"] * old.motor.inductance_q, rel=1e-5)
    assert new.motor.magnet_flux == old.motor.magnet_flux, "it was not told"
    assert new.motor.friction == old.motor.friction
    assert lost_voltage(new) == pytest.approx(volts, rel=1e-5)
    assert new.tolerance is not None
    assert new.tolerance.stator_resistance == new.tolerance.inductance == pytest.approx(HALF)
    assert new.filter == old.filter
    kept = comments(text)
    assert all(any(said.startswith(comment) for said in kept) for comment in comments(before)), "comments stay"
    assert sum("identified, 95 %" in said for said in kept) == 5


def test_dead_time_is_that_of_the_switching_frequency(tmp_path: Path) -> None:
    """Two periods a sample, and a drop of the switches, which is no dead time."""
    path = tmp_path / "servo_24v.toml"
    text = (DRIVES / "servo_24v.toml").read_text(encoding="utf-8")
    text = text.replace("switching_frequency = 10000.0", "switch_drop = 0.1\nswitching_frequency = 20000.0")
    path.write_text(text, encoding="utf-8")
    path.write_text(written_text(found_of(path, 0.58), path), encoding="utf-8")
    inverter = load_drive(path).inverter
    assert inverter is not None
    assert inverter.dead_time == pytest.approx(0.48 / (24.0 * 20000.0), rel=1e-5)


@pytest.mark.slow
def test_the_edited_file_is_generated(tmp_path: Path) -> None:
    path = tmp_path / "paper_spmsm.toml"
    path.write_text((DRIVES / "paper_spmsm.toml").read_text(encoding="utf-8"), encoding="utf-8")
    path.write_text(written_text(found_of(path, 5.0), path), encoding="utf-8")
    files = generate_bare(load_drive(path)).files
    assert any(name.endswith("paper_spmsm_ckf.c") for name in files)


def test_what_would_be_refused_is_not_written(tmp_path: Path) -> None:
    path = tmp_path / "ipmsm.toml"
    path.write_text((DRIVES / "ipmsm.toml").read_text(encoding="utf-8"), encoding="utf-8")
    found = found_of(path, 5.0)
    huge = Estimate(DATA["L_q"], 0.05, 5.0, 4.9, 5.1, True)
    found = replace(found, estimates=[huge])
    with pytest.raises(UserError, match="inductance_q"):
        written_text(found, path)
    other = tmp_path / "other.toml"
    other.write_text(path.read_text(encoding="utf-8").replace('name = "ipmsm"', 'name = "other"'), encoding="utf-8")
    with pytest.raises(UserError, match="is of 'other'"):
        written_text(found, other)
