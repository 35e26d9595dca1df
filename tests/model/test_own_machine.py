"""A machine from a file outside the packages: it is found, tried, and what is wrong with it is said in one line."""

from __future__ import annotations

import hashlib
import shutil
from pathlib import Path

import pytest

from codegen.generate import generate
from codegen.ir.graph import UnsupportedOperationError
from model.drives.load import DRIVES, load_drive
from model.machines import find_machine
from model.machines.own import title
from model.machines.state_space import build, default_initial_state
from model.schema import DriveError

pytestmark = pytest.mark.unit

EXAMPLE = Path(__file__).parents[2] / "docs" / "own_machine"


@pytest.fixture
def desk(tmp_path: Path) -> Path:
    """The documented example in a folder of its own; gives the drive file."""
    shutil.copytree(EXAMPLE, tmp_path / "desk", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path / "desk" / "my_motor.toml"


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def test_the_example_loads(desk: Path) -> None:
    drive = load_drive(desk)
    assert find_machine(drive).__name__ == "HarmonicPMSM"
    assert [s.name for s in build(drive).states] == ["psi_alpha", "psi_beta", "omega", "theta", "load_torque"]
    assert default_initial_state(drive)[0] == pytest.approx(0.175 * 1.04)  # all harmonics add up at angle 0
    assert title(find_machine(drive)) == "surface PMSM with a fifth and a seventh harmonic, flux-linkage states"


def test_the_hash_is_of_both_files_and_nothing_is_dumped(desk: Path) -> None:
    drive = load_drive(desk)
    both = desk.read_bytes() + (desk.parent / "my_machine.py").read_bytes()
    assert drive.sha256 == hashlib.sha256(both).hexdigest()
    dumped = drive.model_dump()
    assert "machine_text" not in dumped
    assert dumped["model"]["machine"] == "my_machine.py:HarmonicPMSM"
    machine = desk.parent / "my_machine.py"
    machine.write_bytes(machine.read_bytes().replace(b"\n", b"\r\n"))
    assert load_drive(desk).sha256 == drive.sha256


def test_a_changed_file_is_another_class(desk: Path) -> None:
    before = find_machine(load_drive(desk))
    assert find_machine(load_drive(desk)) is before
    edit(desk.parent / "my_machine.py", "FIFTH, SEVENTH = 0.03", "FIFTH, SEVENTH = 0.04")
    assert find_machine(load_drive(desk)) is not before


@pytest.mark.thorough
def test_a_folder_beside_the_drive_file(desk: Path) -> None:
    (desk.parent / "mine").mkdir()
    (desk.parent / "my_machine.py").rename(desk.parent / "mine" / "m.py")
    edit(desk, "my_machine.py:", "mine/m.py:")
    package = generate(load_drive(desk), samples=1)
    assert package.files["machine/m.py"] == (desk.parent / "mine" / "m.py").read_text()
    assert not [name for name, text in package.files.items() if str(desk.parent) in text]


WORD = "my_machine.py:HarmonicPMSM"


@pytest.mark.parametrize(
    ("word", "expected"),
    [
        ("salient_flx", "'salient', 'salient_flux', and no 'FILE.py:CLASS' of your own. Did you mean 'salient_flux'?"),
        ("my_machine.py", "names no class. Did you mean 'my_machine.py:MyMachine'"),
        ("my_machin.py:HarmonicPMSM", "machine file 'my_machin.py' cannot be read: No such file"),
        (f"{Path('my_machine.py').absolute()}:HarmonicPMSM", "give the file's path relative to the drive file"),
        ("C:/my_machine.py:HarmonicPMSM", "give the file's path relative to the drive file"),
        ("my_machine.py:HarmonicPMSN", "has no class 'HarmonicPMSN'. Did you mean 'HarmonicPMSM'?"),
        ("my_machine.py:Motor", "has no class 'Motor'. Its machines: HarmonicPMSM."),
        ("my_machine.py:Reference", "'Reference' is no machine; derive it: class Reference(Machine)"),
        ("my_machine.py:FIFTH", "'FIFTH' is no machine"),
        ("my_machine.py:Machine", "class Machine does not say its currents, derivative, electrical_state, torque."),
    ],
)
def test_wrong_words(desk: Path, word: str, expected: str) -> None:
    edit(desk, WORD, word)
    assert expected in refused(desk)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (
            "def torque(self, z, rotor):",
            "def torque(self, z, rotor)",
            "'my_machine.py', line 33: SyntaxError: expected",
        ),
        ("import numpy as np", "import numpi as np", "line 3: ModuleNotFoundError: No module named 'numpi'"),
        ("FIFTH, SEVENTH = 0.03, 0.01", "FIFTH, SEVENTH = 0.03", "line 9: TypeError: cannot unpack"),
        ("FIFTH, SEVENTH = 0.03", "raise SystemExit(3)\nFIFTH, SEVENTH = 0.03", "line 9: SystemExit: 3"),
        ("def torque(", "def torqe(", "class HarmonicPMSM does not say its torque."),
        ("c6, s6 = sixth(rotor)\n        k_d", "c6, s6 = sixt(rotor)\n        k_d", "NameError: name 'sixt' is not"),
        ("c6, s6 = sixth(rotor)\n        k_d", "c6, s6 = sixt(rotor)\n        k_d", "(in HarmonicPMSM.torque)"),
        ('return i, {"magnet', 'return i  # {"magnet', "HarmonicPMSM.currents must return a pair of currents in A and"),
        ("return v[0] - self.par.R * i[0], v", "return v", "HarmonicPMSM.derivative must return a pair, dz/dt of both"),
        ("* i[0] + m[0]", "* i[0]", "HarmonicPMSM.electrical_state is not the inverse of currents: at theta ="),
        ('Quantity("psi_beta"', 'Quantity("psi_alpha"', "a state called 'psi_alpha' is there already."),
        ('Quantity("psi_beta"', 'Quantity("theta"', "a state called 'theta' is there already."),
        ('Quantity("psi_beta"', 'Quantity("psi beta"', "state 'psi beta' must be called like a C variable"),
        ("linkage, beta axis", "linkage */ axis", "plain ASCII, please"),
        ("    states = (", "    states = 2, (", "states must be a tuple of two Quantity"),
    ],
)
def test_wrong_files(desk: Path, old: str, new: str, expected: str) -> None:
    edit(desk.parent / "my_machine.py", old, new)
    assert expected in refused(desk)


def test_tuning_must_fit_the_machines_states(desk: Path) -> None:
    edit(desk, "process_noise = [1e-8, ", "process_noise = [")
    assert "filter.process_noise has 4 entries; this model has 5 states: psi_alpha, psi_beta, omega" in refused(desk)


def refused(path: Path) -> str:
    with pytest.raises(DriveError) as caught:
        load_drive(path)
    message = str(caught.value)
    assert message.startswith("drive 'my_motor.toml': ")
    assert "\n" not in message
    return message


def test_an_operation_no_printer_has_is_named(desk: Path) -> None:
    edit(desk.parent / "my_machine.py", "self.par.R * i[0],", "self.par.R * abs(i[0]),")
    with pytest.raises(UnsupportedOperationError, match="OP_FABS"):
        generate(load_drive(desk), samples=1)


@pytest.mark.thorough
def test_a_shipped_machine_by_way_of_a_file_is_the_same_filter(tmp_path: Path) -> None:
    """Equations that come from outside go the same way: every C file but its head is the shipped one's."""
    (tmp_path / "mine.py").write_text(
        "from model.machines import SurfacePMSM\nclass Mine(SurfacePMSM):\n    'Surface PMSM, current states.'\n"
    )
    shipped = (DRIVES / "spmsm_load_torque.toml").read_text()
    path = tmp_path / "mine.toml"
    path.write_text(shipped.replace('machine = "surface"', 'machine = "mine.py:Mine"'))
    ours, theirs = (generate(load_drive(d), samples=10) for d in (path, "spmsm_load_torque"))
    for name, text in theirs.files.items():
        if name.endswith((".c", ".h")) and not name.startswith("board/"):
            mine = ours.files[name].replace(ours.drive.sha256[:16], theirs.drive.sha256[:16])
            assert mine == text, name
