"""The output of generate: always the same bytes, clean C89 without a hidden double, readable names."""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pycparser import c_ast, c_parser

from codegen.evidence.measure import Measurer, kept_records
from codegen.generate import generate, generate_bare
from codegen.output.folder import difference
from model.drives.load import load_drive
from model.machines.state_space import build
from model.schema import Drive
from runtime.estimator.folder import GENERATED
from tests.codegen.strict import STRICT, interrupt_files
from tests.conftest import DRIVES, bare_package, thoroughly, variant
from tests.features import FEATURES


@pytest.mark.thorough
def test_committed_folders_are_current(drive: Drive) -> None:
    folder = GENERATED / drive.name
    assert difference(folder, generate(drive, measurer=Measurer(kept_records(folder))).files) == ""


@pytest.mark.thorough
def test_regeneration_is_byte_identical_anywhere_anytime(tmp_path: Path) -> None:
    """Two fresh processes, other folders, hash seeds, time zones and clocks a year apart."""
    digests = []
    for name, seed, zone in (("one", "1", "UTC"), ("two words ü", "77", "Pacific/Auckland")):
        folder = tmp_path / name
        folder.mkdir()
        code = (
            f"import time; real = time.time; time.time = lambda: real() + 3e7 * {seed}\n"
            "from runtime.cli import main; import sys\n"
            "sys.argv = ['pmsm-ickf', 'generate', 'ipmsm_flux', '--out', 'out']; main()"
        )
        environment = {**os.environ, "PYTHONHASHSEED": seed, "TZ": zone}
        subprocess.run([sys.executable, "-c", code], cwd=folder, env=environment, check=True, capture_output=True)
        files = sorted(path for path in (folder / "out").rglob("*") if path.is_file())
        text = [(str(path.relative_to(folder)), hashlib.sha256(path.read_bytes()).hexdigest()) for path in files]
        digests.append(text)
    assert digests[0] == digests[1]
    assert len(digests[0]) == 60


def _c_files(drive: Drive) -> list[Path]:
    return sorted((GENERATED / drive.name).rglob("*.c"))


@pytest.mark.parametrize("optimisation", ["-O2", *thoroughly("-O0")])
def test_generated_c_is_clean_under_strict_warnings(drive: Drive, optimisation: str, tmp_path: Path) -> None:
    folder = GENERATED / drive.name
    assert len(_c_files(drive)) == 30
    for path in _c_files(drive):
        command = [
            "gcc",
            *STRICT,
            optimisation,
            f"-I{folder}",
            "-c",
            str(path),
            "-o",
            str(tmp_path / "x.o"),
        ]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr


def test_strict_warnings_catch_a_hidden_double(drive: Drive, tmp_path: Path) -> None:
    """The gate can fail: one unsuffixed literal."""
    folder = GENERATED / drive.name
    source = (folder / f"{drive.name}_ckf.c").read_text().replace("ROUND 1.2582912e+07f", "ROUND 1.2582912e+07", 1)
    (tmp_path / "x.c").write_text(source)
    command = ["gcc", *STRICT, f"-I{folder}", "-c", str(tmp_path / "x.c"), "-o", str(tmp_path / "x.o")]
    assert subprocess.run(command, capture_output=True, check=False).returncode != 0


class _Uses(c_ast.NodeVisitor):
    """Functions called and types named inside a piece of C."""

    def __init__(self) -> None:
        self.calls: set[str] = set()
        self.types: set[str] = set()

    def visit_FuncCall(self, node: c_ast.FuncCall) -> None:
        self.calls.add(node.name.name)
        self.generic_visit(node)

    def visit_IdentifierType(self, node: c_ast.IdentifierType) -> None:
        self.types.add(" ".join(node.names))


def test_firmware_c_has_no_char_double_or_foreign_call(drive: Drive) -> None:
    """Read as C, not as text: its own functions and the square root are all it calls; no char, no double."""
    for path in interrupt_files(drive.name):
        done = subprocess.run(["gcc", "-E", "-P", str(path)], capture_output=True, text=True, check=True)
        tree = c_parser.CParser().parse(done.stdout)
        functions = [item for item in tree.ext if isinstance(item, c_ast.FuncDef)]
        uses = _Uses()
        for function in functions:
            uses.visit(function)
        stem = re.sub("_(foc|supervisor|drive)$", "", path.stem)
        rival = "STARTING" in (GENERATED / drive.name / f"{stem}_supervisor.h").read_text()
        root = "__builtin_sqrtf"  # PMSM_SQRT of GCC
        foreign = {
            "": set(),
            "_foc": {f"{stem}_init", f"{stem}_step", root},
            "_supervisor": {f"{stem}_reset", root} | ({f"{stem}_init"} if rival else set()),
            "_drive": {f"{stem}_{end}" for end in ("foc_init", "foc_step", "supervisor_init", "supervise")}
            | ({f"{stem}_step"} if rival else set()),
        }[path.stem.removeprefix(stem)]
        assert uses.calls - {function.decl.name for function in functions} == foreign
        around = {f"{stem}{end}_t" for end in ("", "_foc", "_supervisor")} if path.stem != stem else set()
        assert uses.types <= {"float32", "int", "Uint32", "void", "pmsm_pair", "pmsm_word", f"{path.stem}_t"} | around


def test_literals_of_the_firmware_carry_the_suffix(drive: Drive) -> None:
    for path in interrupt_files(drive.name):
        code = re.sub(r"/\*.*?\*/", "", path.read_text(), flags=re.DOTALL)
        literals = re.findall(r"(?<![\w.])\d+\.\d*(?:e[+-]?\d+)?\w?", code)
        assert len(literals) > (1 if path.stem.endswith("_drive") else 20)
        assert all(literal.endswith("f") for literal in literals)


def test_every_local_has_a_meaning(drive: Drive) -> None:
    """No numbered temporaries: what no stage names is named after what it is made of."""
    for path in interrupt_files(drive.name):
        names = re.findall(r"^    const float32 (\w+) =", path.read_text(), flags=re.MULTILINE)
        least = {"foc": 40, "supervisor": 20, "drive": 0}.get(path.stem.rpartition("_")[2], 100)
        assert len(names) > least
        assert not [name for name in names if re.fullmatch(r"(_?tmp|t|v|w|shared|angle)_?\d*", name)]


def test_sections_follow_the_papers_equations(drive: Drive) -> None:
    text = (GENERATED / drive.name / f"{drive.name}_ckf.c").read_text()
    numbers = [int(n) for heading in re.findall(r"/\* --- eq\. .*", text) for n in re.findall(r"eq\. (\d+)", heading)]
    assert {14, 15, 16, 17, 18, 25, 26} <= set(numbers)
    literal = bare_package(drive.name, "literal").files[f"{drive.name}_ckf.c"]
    numbers = [int(n) for n in re.findall(r"/\* --- eq\. (\d+)", literal)]
    assert numbers == sorted(numbers)
    assert {13, 14, 15, 16, 17, 18, 19, 22, 23, 24, 25, 26} <= set(numbers)


def test_no_dates_paths_or_machine_names(drive: Drive) -> None:
    home = str(Path.home())
    for path in (GENERATED / drive.name).rglob("*"):
        if path.is_file():
            text = path.read_text()
            assert not re.search(r"20\d\d-\d\d-\d\d", text)
            assert home not in text
            assert str(GENERATED) not in text


def test_data_stays_data() -> None:
    """Tuning goes into the struct: another Q changes the init function and nothing else of the C."""
    drive = load_drive("paper_spmsm")
    a = bare_package(drive.name).files
    b = generate_bare(variant(drive, filter={"process_noise": [0.5, 0.5, 0.5, 0.5]})).files
    changed = {
        line
        for name in a
        if name.endswith("_ckf.c") and "/" not in name
        for line in set(b[name].splitlines()) - set(a[name].splitlines())
        if not line.startswith((" *", "/*"))
    }
    assert changed == {f"    f->Q[{k}] = 0.5f;" for k in range(4)}


@pytest.mark.parametrize("name", DRIVES)
def test_report_says_what_was_proved(name: str) -> None:
    report = (GENERATED / name / "REPORT.md").read_text()
    assert ("Proved idle." in report) == FEATURES["idle"](load_drive(name))
    assert "nothing was run on the chip" in report


def test_certificate_bounds_other_draws() -> None:
    """The certificate's worst case is not beaten by more than a little on draws it has not seen."""
    from codegen.evidence.box import sample_box
    from codegen.evidence.certificate import certify

    drive = load_drive("paper_spmsm")
    model = build(drive)
    namespace: dict[str, object] = {}
    exec(bare_package("paper_spmsm").files["paper_spmsm.py"], namespace)
    seen, unseen = (certify(namespace, "ickf", sample_box(drive, model, 2000, seed)) for seed in (1, 2))
    assert np.all(np.array(unseen.x) <= 3 * np.array(seen.x))
    assert unseen.not_finite == unseen.indefinite == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "mechanics", "discretization", "kinds"),
    [  # any two of them in every combination
        ("paper_spmsm", "constant_speed", "exact", ("ckf", "ekf")),
        *thoroughly(
            ("paper_spmsm", "load_torque", "euler", ("ickf", "ukf")),
            ("ipmsm_flux", "constant_speed", "euler", ("ukf", "ickf")),
            ("ipmsm_flux", "load_torque", "exact", ("ekf", "ckf")),
        ),
    ],
)
def test_every_combination_is_clean_readable_and_proven(
    machine: str, mechanics: str, discretization: str, kinds: tuple[str, str], tmp_path: Path
) -> None:
    """Drives nobody ships: strict C, no anonymous local, links A-B, B-C and D-E.

    Fast against literal form is tested for every combination in test_variants.
    """
    from codegen.output.folder import write_folder
    from runtime.estimator.folder import GeneratedFolder
    from runtime.proof.own_trajectory import trajectory_of
    from runtime.proof.verify import Effort, Prover, literal_package

    base = load_drive(machine)
    more = 1 if mechanics == "load_torque" else 0
    settings = {
        "kinds": list(kinds),
        "process_noise": base.filter.process_noise + [0.01] * more,
        "initial_covariance": base.filter.initial_covariance + [0.1] * more,
    }
    T = 20e-6 if discretization == "euler" else 100e-6
    model = {"mechanics": mechanics, "discretization": discretization, "sample_time": T}
    drive = variant(base, model=model, filter=settings)
    package = generate(drive, samples=20)
    write_folder(tmp_path / "d", package.files)
    for path in sorted((tmp_path / "d").rglob("*.c")):
        command = ["gcc", *STRICT, "-O2", f"-I{tmp_path / 'd'}", "-c", str(path), "-o", str(tmp_path / "x.o")]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert not re.search(r"\bshared\b|part_of_the_result", path.read_text())
    data = trajectory_of(drive, steps=150)
    effort = Effort(box_draws=50, bit_steps=150)
    literal = literal_package(drive)
    prover = Prover(package, literal, GeneratedFolder(tmp_path / "d"), data, (data, 50), effort, lambda text: None)
    for kind in package.steps:
        bits = prover._bits(kind).link(("-O3", "-march=native"))
        for link in [*prover.along_trajectory(kind), *prover._box(kind), bits]:
            assert link.passed, (kind, link.name, str(link.divergence))
