"""The chain of proof holds for what is shipped, and breaks, at the right place, for what is wrong."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from codegen.generate import Package, generate, generate_bare
from codegen.output.folder import write_folder
from model.drives.load import load_drive
from model.filters import ckf as ckf_module
from model.filters import cubature, sigma_point
from model.filters import ickf as ickf_module
from model.filters.program import FilterStep, Node, Wrap
from model.machines import MACHINES
from model.machines.mechanics import ConstantSpeed
from model.machines.state_space import StateSpaceModel
from model.schema import Drive
from runtime.estimator.folder import GENERATED, GeneratedFolder
from runtime.folders.resolve import NamedDrive
from runtime.proof.drives import prove_or_recall
from runtime.proof.link_text import link_text
from runtime.proof.own_trajectory import trajectory_of
from runtime.proof.result import Link, Proof
from runtime.proof.verify import Effort, Literal, Prover, literal_package, prove, verify
from runtime.system.errors import UserError
from tests.conftest import DRIVES, EVERY_DRIVE, LINKS, bare_package, thoroughly, variant

QUICK = Effort(
    trajectory=0.004,
    box_draws=20,
    bit_steps=300,
    drift_steps=500,
    chip_steps=50,
    optimisations=(("-O0",), ("-O3", "-march=native")),
)


@pytest.mark.parametrize("name", [DRIVES[0], *thoroughly(*DRIVES[1:])])
@pytest.mark.parametrize("kind", ["ekf", "ukf"])
def test_the_filters_one_compares_with_are_proven_too(name: str, kind: str, tmp_path: Path) -> None:
    drive = variant(load_drive(name), filter={"kinds": ["ekf", "ukf"]})
    package = generate_bare(drive)
    write_folder(tmp_path / name, package.files)
    prover = _prover(drive, package, tmp_path / name)
    text = link_text(GeneratedFolder(tmp_path / name, checked=False), kind, drive.filter.gain)
    for link in [*prover.along_trajectory(kind), *prover._box(kind), prover._bits(kind).link(("-O2",)), text]:
        assert link.passed, str(link.divergence)


#: float32 against float64 over 100 000 steps at speed, by unit; P relative to sqrt(P_ii P_jj). Of an angle a unit in
#: the last place at pi is 2.4e-7: 2.13e-6 is met on the currents of least amplitude, 1.99e-6 was on those of i_d = 0.
AT_SPEED = {"A": 1e-5, "Wb": 2e-6, "rad/s": 1e-3, "rad": 3e-6, "relative": 1e-4}

#: ICKF - CKF in sigmas. On the paper's drive it is rounding, with flux states many orders more, with both gains.
EFFECTS = {"paper_spmsm": (0.0, 1e-12, "rounding"), "ipmsm_flux": (1e-3, np.inf, "real")}


def _holds(name: str, effort: Effort | None = None) -> Proof:
    seen: list[str] = []
    if effort is None:  # as the commands do it, which other tests run too
        proof, _ = prove_or_recall(name, progress=seen.append)
    else:
        proof, _ = verify(name, effort, seen.append, current=True)  # generate --check says that it is
    assert proof.passed, list(proof.failures())
    waves = {"injection"} if hasattr(GeneratedFolder(GENERATED / name, checked=False).module, "inject") else set()
    assert {link.name for link in proof.links} == LINKS | waves
    assert {link.variant for link in proof.links if link.name == "A-B"} == {
        "ckf",
        "ickf, cubature gain",
        "ickf, jacobian gain",
    }
    assert all(row.compared > 0 for link in proof.links for row in link.rows)
    assert {effect.gain for effect in proof.effects} == {"cubature", "jacobian"}
    assert seen or proof.kept
    return proof


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper_spmsm", *thoroughly("ipmsm_flux")])
def test_chain_holds_in_full(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every figure the README promises: 1e-10, 10 000 steps of identical bits, 100 000 steps at speed."""
    monkeypatch.delenv("PMSM_ICKF_FRESH")
    proof = _holds(name)
    for link in proof.links:
        for row in link.rows:
            if link.name == "A-B":
                assert row.allowed <= 1e-10, row
            if link.name == "D-E":
                assert row.allowed == 0.0, row
            if link.name == "C-D" and link.gain == load_drive(name).filter.gain:  # what is shipped
                assert row.worst <= AT_SPEED[row.meaning], row
    low, high, verdict = EFFECTS[name]
    if verdict == "real":  # else the reference iterates N_max times, to show that it is idle
        assert any(row.stage == "same number of iterates" for link in proof.links for row in link.rows)
    for effect in proof.effects:
        assert effect.verdict == verdict
        assert low <= effect.in_sigma <= high, effect


@pytest.mark.slow
@pytest.mark.parametrize("name", EVERY_DRIVE[1:])
def test_chain_holds_for_the_other_drives(name: str) -> None:
    _holds(name, QUICK)


# --- the chain can fail: mutants of the model, of the filters, of the emitted text


@lru_cache
def _literal(drive: str) -> Literal:
    """By the drive's text, for a variant has another literal form; only where nothing is patched."""
    return literal_package(Drive.model_validate_json(drive))


def _prover(drive: Drive, package: Package, folder: Path) -> Prover:
    """``package`` may be a mutant; the reference works from ``drive``."""
    truth = Package(drive, package.model, package.steps, package.files)
    short = trajectory_of(drive, steps=60)
    shipped = GeneratedFolder(folder, checked=False)
    if shipped.module.COVARIANCE == "P":
        literal = Literal(package.steps, shipped.module)
    else:
        literal = _literal(drive.model_dump_json())
    return Prover(truth, literal, shipped, short, (short, 10), QUICK, lambda text: None)


def _ab(drive: Drive, folder: Path, kind: str) -> list[Link]:
    """Generate as things stand now (mutated), prove against the unmutated reference."""
    package = generate_bare(drive, "literal")
    write_folder(folder, package.files, force=True)
    return _prover(drive, package, folder).along_trajectory(kind)


def _swap_inductances(monkeypatch: pytest.MonkeyPatch) -> None:
    original = MACHINES["salient_flux"].currents

    def swapped(self: Any, z: Any, theta: Any) -> Any:
        par = self.par
        self.par = type(par)(**{**par.__dict__, "L_d": par.L_q, "L_q": par.L_d})
        try:
            return original(self, z, theta)
        finally:
            self.par = par

    monkeypatch.setattr(MACHINES["salient_flux"], "currents", swapped)


def _reverse_back_emf(monkeypatch: pytest.MonkeyPatch) -> None:
    original = MACHINES["surface"].euler
    monkeypatch.setattr(MACHINES["surface"], "euler", lambda self, z, v, w, th: original(self, z, v, -w, th))


def _forget_pole_pairs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ConstantSpeed, "electrical_speed", lambda self, omega: omega)


def _stale_jacobian(monkeypatch: pytest.MonkeyPatch) -> None:
    """H taken at x_pred instead of x^j."""
    original = ickf_module._jacobian

    def stale(b: Any, model: Any, x_j: Any) -> Any:
        port = next((port for port in b._inputs if port.name == "x_pred"), None)
        return original(b, model, list(port.entries) if port else x_j)

    monkeypatch.setattr(ickf_module, "_jacobian", stale)


def _wrong_weight(monkeypatch: pytest.MonkeyPatch) -> None:
    original = cubature.spread

    def heavier(rule: Any, a: Any, b: Any) -> Any:
        return [[entry * 1.000001 for entry in row] for row in original(rule, a, b)]

    monkeypatch.setattr(sigma_point, "spread", heavier)


def _no_wrap(monkeypatch: pytest.MonkeyPatch) -> None:
    """A step without its last node: the right angle modulo a turn, but float32 would lose digits."""

    def without(kind: str, gain: str, model: StateSpaceModel, body: tuple[Node, ...]) -> FilterStep:
        assert isinstance(body[-1], Wrap)
        return FilterStep(kind, gain, model, body[:-1])

    monkeypatch.setattr(ckf_module, "FilterStep", without)


def _shifted_angle(monkeypatch: pytest.MonkeyPatch) -> None:
    original = StateSpaceModel.kept
    monkeypatch.setattr(StateSpaceModel, "kept", lambda model, x: original(model, [*x[:3], x[3] + 1e-6]))


def test_an_angle_that_is_not_wrapped_is_caught(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    _no_wrap(monkeypatch)
    drive = load_drive("ipmsm_flux")
    package = generate_bare(drive, "literal")
    write_folder(tmp_path / drive.name, package.files)
    prover = _prover(drive, package, tmp_path / drive.name)
    prover.trajectory = trajectory_of(drive, steps=600)
    assert not prover.along_trajectory("ckf")[0].passed


MODEL_MUTANTS: list[tuple[str, str, Callable[[pytest.MonkeyPatch], None], str]] = [
    ("paper_spmsm", "ckf", _reverse_back_emf, "15"),
    ("paper_spmsm", "ickf", _forget_pole_pairs, "15"),
    ("ipmsm_flux", "ckf", _swap_inductances, "20"),
    ("ipmsm_flux", "ickf", _swap_inductances, "28"),
    ("ipmsm_flux", "ickf", _stale_jacobian, "28"),
    ("ipmsm_flux", "ckf", _wrong_weight, "17"),
    ("paper_spmsm", "ckf", _shifted_angle, "25"),
]


@pytest.mark.parametrize(("name", "kind", "mutate", "equation"), MODEL_MUTANTS)
def test_model_mutants_are_caught_at_their_equation(
    name: str,
    kind: str,
    mutate: Callable[[pytest.MonkeyPatch], None],
    equation: str,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    mutate(monkeypatch)
    link, *_ = _ab(load_drive(name), tmp_path / name, kind)
    assert not link.passed
    assert link.divergence is not None
    assert link.divergence.equation == equation, str(link.divergence)


@pytest.mark.parametrize("key", ["stator_resistance", "magnet_flux", "inductance_q"])
def test_one_part_in_a_million_of_motor_data_is_caught(key: str, tmp_path: Path) -> None:
    drive = load_drive("ipmsm_flux")
    mutant = variant(drive, motor={key: getattr(drive.motor, key) * (1 + 1e-6)})
    package = generate_bare(mutant, "literal")
    write_folder(tmp_path / drive.name, package.files)
    link, *_ = _prover(drive, package, tmp_path / drive.name).along_trajectory("ckf")
    assert link.divergence is not None


PYTHON_MUTANTS = [
    (r"(P_pred_22 = [^\n]*(?:\n        [^\n]*)*) \+ Q_2", r"\1", "17"),  # a dropped Q
    (r"innovation_i_alpha = i_alpha_meas - ", "innovation_i_alpha = i_alpha_meas + ", "25"),
    (r"S_21 = \(P_21 - ", "S_21 = (P_21 + ", "13"),
    (r"K_20 = Pxy_20 \* Pyy_inv_00 - ", "K_20 = Pxy_20 * Pyy_inv_00 + ", "24"),
]


@pytest.mark.parametrize(("pattern", "replacement", "equation"), PYTHON_MUTANTS)
def test_mutants_of_the_generated_python_are_caught(
    pattern: str, replacement: str, equation: str, tmp_path: Path
) -> None:
    drive = load_drive("paper_spmsm")
    package = bare_package(drive.name, "literal")
    text = package.files["paper_spmsm.py"]
    mutated = re.sub(pattern, replacement, text, count=0)
    assert mutated != text
    write_folder(tmp_path / drive.name, {**package.files, "paper_spmsm.py": mutated})
    link, *_ = _prover(drive, package, tmp_path / drive.name).along_trajectory("ckf")
    assert link.divergence is not None
    assert link.divergence.equation == equation, str(link.divergence)


FAST_MUTANTS = [
    (r"(P_pred_22 = [^=]*?) \+ Q_2\b", r"\1", "17"),  # a dropped Q
    (r"(odd_theta_next_1 = \w+ \* \w+) \+", r"\1 -", "17"),
    (r"innovation_i_alpha = i_alpha_meas -", "innovation_i_alpha = i_alpha_meas +", "25, 34"),
    (r"D_new_i_beta = ", "D_new_i_beta = 1.000001 * ", "26, 32"),
    (r"(def _small_angle_4_f64.*?)-0\.6666666666666666", r"\1-0.66666", "17"),  # a coarse sine
]


@pytest.mark.parametrize(("pattern", "replacement", "equation"), FAST_MUTANTS)
def test_mutants_of_the_fast_form_are_caught(pattern: str, replacement: str, equation: str, tmp_path: Path) -> None:
    drive = load_drive("paper_spmsm")
    package = bare_package(drive.name)
    text = package.files["paper_spmsm.py"]
    mutated = re.sub(pattern, replacement, text, flags=re.DOTALL)
    assert mutated != text
    write_folder(tmp_path / drive.name, {**package.files, "paper_spmsm.py": mutated})
    link = _prover(drive, package, tmp_path / drive.name).along_trajectory("ckf")[-1]
    assert link.name == "B-C"
    assert link.divergence is not None
    assert link.divergence.equation == equation, str(link.divergence)


C_MUTANTS = [
    ("fast", "i_alpha_meas - i_alpha_pred", "i_alpha_meas + i_alpha_pred", "innovation", "25"),
    ("fast", "#define GAIN_V 0.023952097f", "#define GAIN_V 0.0239521f", "x_pred", "16"),
    ("fast", "POLE_PAIRS_SAMPLE_TIME + L_31", "POLE_PAIRS_SAMPLE_TIME - L_31", "odd_i_alpha_next", "15"),
    ("fast", "#define SINC_1 -0.6665821f", "#define SINC_1 -0.6665822f", "time_update", "17"),
    ("literal", "i_alpha_meas - y_i_alpha_pred", "i_alpha_meas + y_i_alpha_pred", "innovation", "25"),
    ("literal", "P_21 - S_20 * S_10", "P_21 - S_20 * S_11", "S", "13"),
    ("literal", "- (KPyy_20 * K_20 + KPyy_21 * K_21)", "- (KPyy_20 * K_20 - KPyy_21 * K_21)", "P", "26"),
]


@pytest.mark.parametrize(("form", "old", "new", "stage", "equation"), C_MUTANTS)
def test_mutants_of_the_generated_c_are_caught_and_located(
    form: str, old: str, new: str, stage: str, equation: str, tmp_path: Path
) -> None:
    drive = load_drive("paper_spmsm")
    package = bare_package(drive.name, form)
    text = package.files["paper_spmsm_ckf.c"]
    assert old in text
    write_folder(tmp_path / drive.name, {**package.files, "paper_spmsm_ckf.c": text.replace(old, new)})
    link = _prover(drive, package, tmp_path / drive.name)._bits("ckf").link(("-O2",))
    assert not link.passed
    assert link.divergence is not None
    assert (link.divergence.stage, link.divergence.equation) == (stage, equation), str(link.divergence)


def test_reordered_float_operations_are_caught(tmp_path: Path) -> None:
    """Mathematically equal, not the same bits: (a + b) + c against a + (b + c)."""
    drive = load_drive("paper_spmsm")
    package = bare_package(drive.name)
    text = package.files["paper_spmsm_ckf.c"]
    mutated = re.sub(
        r"= DECAY_I \* i_alpha \+ (\w+ \* \w+) \+ (GAIN_V \* v_alpha)", r"= DECAY_I * i_alpha + (\1 + \2)", text
    )
    assert mutated != text
    write_folder(tmp_path / drive.name, {**package.files, "paper_spmsm_ckf.c": mutated})
    assert not _prover(drive, package, tmp_path / drive.name)._bits("ckf").link(("-O2",)).passed


def test_contraction_would_be_caught() -> None:
    """The reason for -ffp-contract=off: with fused multiply-add the bits differ (on processors that have it)."""
    import subprocess

    if (
        "__FMA__"
        not in subprocess.run(
            ["gcc", "-march=native", "-dM", "-E", "-x", "c", "/dev/null"], capture_output=True, text=True
        ).stdout
    ):
        pytest.skip("this processor has no fused multiply-add")
    drive = load_drive("paper_spmsm")
    package = bare_package(drive.name)
    prover = _prover(drive, package, GENERATED / drive.name)
    link = prover._bits("ckf").link(("-O2", "-march=native", "-ffp-contract=fast"))
    assert not link.passed


# --- what verify refuses


def test_stale_and_edited_folders_are_refused(tmp_path: Path) -> None:
    drive = load_drive("paper_spmsm")
    with pytest.raises(UserError, match="no generated folder"):
        prove(NamedDrive("paper_spmsm", drive, tmp_path / "none"), QUICK, lambda text: None)
    other = variant(drive, motor={"inertia": 0.009})
    write_folder(tmp_path / drive.name, generate(other).files)
    with pytest.raises(UserError, match="is stale"):
        prove(NamedDrive("paper_spmsm", drive, tmp_path / drive.name), QUICK, lambda text: None)
    write_folder(tmp_path / drive.name, bare_package(drive.name).files)
    path = tmp_path / drive.name / "paper_spmsm_ckf.c"
    path.write_text(path.read_text().replace("0.25f", "0.26f", 1))
    with pytest.raises(UserError, match="was edited by hand"):
        prove(NamedDrive("paper_spmsm", drive, tmp_path / drive.name), QUICK, lambda text: None)
