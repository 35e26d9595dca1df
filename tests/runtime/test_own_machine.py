"""A machine of one's own in the proof, in folders and beside other drives."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from codegen.generate import generate
from codegen.output.folder import write_folder
from model.drives.load import DRIVES, load_drive
from model.machines.state_space import build
from model.schema import Drive
from runtime.estimator.folder import GeneratedFolder
from runtime.firmware.recording import filter_recording
from runtime.firmware.static.eva import eva_check
from runtime.folders.resolve import drive_folder
from runtime.folders.stated import stated_drive
from runtime.proof.own_trajectory import trajectory_of
from runtime.proof.result import Proof
from runtime.proof.second import UNCHECKED, CasadiMotor, compare_statements, second_motor
from runtime.proof.tables import proof_tables
from runtime.system.errors import UserError
from tests.conftest import variant
from tests.model.test_own_machine import EXAMPLE, edit
from tests.target.need import need


@pytest.fixture
def desk(tmp_path: Path) -> Path:
    shutil.copytree(EXAMPLE, tmp_path / "desk", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path / "desk" / "my_motor.toml"


def through_a_file(tmp_path: Path, shipped: str, machine: str, name: str) -> Drive:
    """A shipped drive whose machine comes from a file."""
    (tmp_path / "mine.py").write_text(f"from model.machines import {name}\nclass Mine({name}): pass\n")
    text = (DRIVES / f"{shipped}.toml").read_text()
    assert f'machine = "{machine}"' in text
    (tmp_path / "mine.toml").write_text(text.replace(f'machine = "{machine}"', 'machine = "mine.py:Mine"'))
    return load_drive(tmp_path / "mine.toml")


@pytest.mark.parametrize(
    ("shipped", "machine", "name"),
    [("paper_spmsm", "surface", "SurfacePMSM"), ("ipmsm_flux", "salient_flux", "SalientFluxPMSM")],
)
def test_trajectory_is_the_one_made_by_hand(tmp_path: Path, shipped: str, machine: str, name: str) -> None:
    """The same motion and currents; the voltage is held over a sample, not its mean."""
    mine = trajectory_of(through_a_file(tmp_path, shipped, machine, name), 2500)
    theirs = trajectory_of(load_drive(shipped), 2500)
    np.testing.assert_array_equal(mine.omega, theirs.omega)
    np.testing.assert_allclose(mine.y, theirs.y, atol=1e-9)
    np.testing.assert_allclose(mine.u, theirs.u, atol=0.02 if machine == "surface" else 0.2)


@pytest.mark.parametrize(
    ("old", "new", "stages"),
    [
        ("k_q = 1 - (5", "k_q = 1 + (5", {"f", "F"}),  # torque
        ("1 + (FIFTH + SEVENTH)", "1 + (FIFTH - SEVENTH)", {"f", "h", "F", "H"}),  # magnet
        ("return v[0] - self.par.R * i[0]", "return v[0] + self.par.R * i[0]", {"f", "F"}),
        ("+ 7 * SEVENTH * np.cos(7", "+ 6.999 * SEVENTH * np.cos(7", {"f", "F"}),  # in the reference
    ],
)
def test_a_slip_on_either_side_is_found(desk: Path, old: str, new: str, stages: set[str]) -> None:
    edit(desk.parent / "my_machine.py", old, new)
    link = compare_statements(load_drive(desk))
    assert link is not None
    assert {row.stage for row in link.rows if not row.passed} == stages


def test_a_jacobian_stated_wrongly_is_found(desk: Path) -> None:
    stated = "    def H(self, x):\n        return np.eye(2, 5)\n\n    def current("
    edit(desk.parent / "my_machine.py", "    def current(", stated)
    link = compare_statements(load_drive(desk))
    assert link is not None
    assert [row.stage for row in link.rows if not row.passed] == ["H, as the reference states it"]


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (
            "return Reference(motor_data(parameters))",
            "return parameters['moto']",
            r"line \d+: KeyError: 'moto' \(in ref",
        ),
        ("return Reference(motor_data(parameters))", "return 3", "has no method f"),
        ("return self.current(x[:2], x[3])", "return x", r"reference\(parameters\).h .* must return 2 numbers, not 5"),
        ("return self.current(x[:2], x[3])", "return y", r"NameError: name 'y' .* \(in reference\(parameters\).h"),
    ],
)
def test_a_bad_reference_is_one_line(desk: Path, old: str, new: str, expected: str) -> None:
    edit(desk.parent / "my_machine.py", old, new)
    with pytest.raises(UserError, match=expected):
        compare_statements(load_drive(desk))


def test_without_a_reference_nothing_is_called_proved_of_the_equations(desk: Path) -> None:
    edit(desk.parent / "my_machine.py", "def reference(", "def not_a_reference(")
    drive = load_drive(desk)
    assert compare_statements(drive) is None
    assert isinstance(second_motor(drive), CasadiMotor)
    proof = Proof("my_motor", unchecked=[UNCHECKED])
    assert proof.verdict == "NOT proved"  # no links at all
    link = compare_statements(load_drive("paper_spmsm"))
    assert link is not None
    proof.links.append(link)
    assert proof.verdict == "filters proved; motor's equations: no second statement, not checked"
    assert proof.to_json()["unchecked"] == [UNCHECKED]
    from rich.console import Console

    console = Console(width=160)
    with console.capture() as shown:
        console.print(proof_tables(proof))
    assert "not checked" in shown.get()
    assert "SymPy" not in shown.get()


def test_casadis_own_numbers_are_a_motor() -> None:
    """The reference's model where there is no second statement: against motors.py, by hand."""
    drive = load_drive("ipmsm_flux")
    ours, theirs = CasadiMotor(build(drive)), second_motor(drive)
    x, u = np.array([0.5, 0.1, 30.0, 0.4]), np.array([20.0, -7.0])
    np.testing.assert_allclose(ours.f(x, u), theirs.f(x, u), rtol=1e-12)
    np.testing.assert_allclose(ours.h(x), theirs.h(x), rtol=1e-12)
    np.testing.assert_allclose(ours.H(x), theirs.H(x), rtol=1e-12, atol=1e-12)


def test_motors_side_by_side_are_each_on_its_own(desk: Path) -> None:
    """CasADi's own numbers, and a machine file's reference, of three states at once."""
    rng = np.random.default_rng(3)
    x, u = rng.normal(size=(5, 3)), 10 * rng.normal(size=(2, 3))
    drive = load_drive(desk)
    for motor in (second_motor(drive), CasadiMotor(build(drive))):
        alone = [(motor.f(x[:, k], u[:, k]), motor.h(x[:, k]), motor.H(x[:, k])) for k in range(3)]
        for found, each in zip((motor.f(x, u), motor.h(x), motor.H(x)), zip(*alone, strict=True), strict=True):
            np.testing.assert_allclose(found, np.stack(each, axis=-1), rtol=1e-13)
    slopes = np.stack([motor.F(x[:, k], u[:, k]) for k in range(3)], axis=-1)
    np.testing.assert_allclose(motor.F(x, u), slopes, rtol=1e-13)


@pytest.fixture
def folder(desk: Path, monkeypatch: pytest.MonkeyPatch) -> GeneratedFolder:
    monkeypatch.chdir(desk.parent)
    drive = variant(load_drive(desk), filter={"kinds": ["ckf"]})
    edit(desk, 'kinds = ["ckf", "ickf"]', 'kinds = ["ckf"]')
    write_folder(Path("generated/my_motor"), generate(drive, samples=5).files)
    return GeneratedFolder(Path("generated/my_motor"))


@pytest.mark.thorough
def test_a_folder_carries_its_machine(folder: GeneratedFolder, desk: Path) -> None:
    """Folders are compared, recorded and replayed though the files they came from changed; a change is noticed."""
    assert drive_folder("my_motor.toml").path == folder.path
    edit(desk.parent / "my_machine.py", "FIFTH, SEVENTH = 0.03", "FIFTH, SEVENTH = 0.04")
    with pytest.raises(UserError, match="is stale"):
        drive_folder("my_motor.toml")
    desk.unlink()
    (desk.parent / "my_machine.py").unlink()
    assert "FIFTH, SEVENTH = 0.03" in stated_drive(folder).machine_text
    recording = filter_recording(folder, 60)
    assert recording.steps == 60
    assert recording.segments[1].fields["x_0[0]"] != 0.0  # the trajectory's own state, under the machine's own name


@pytest.mark.thorough
def test_eva_is_not_asked(folder: GeneratedFolder) -> None:
    need("frama-c")
    check = eva_check(folder.path, "ckf")
    assert check.state == "not proved"
    assert "EVA was not run" in check.detail[0]
