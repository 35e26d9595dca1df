"""Compare: what it says differs does, what it says is alike is, and its figures are those of the folders and runs."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from model.drives.load import DRIVES as FILES
from runtime.compare.differences import _merged, constant_rows, equation_lines, file_rows, tuning_rows
from runtime.compare.facts import certificates, costs, to_json
from runtime.compare.subject import CONSTANT, ONE, VARYING, ZERO, Subject, collect
from runtime.drive.experiment import simulate
from runtime.estimator.folder import GENERATED, find_folder
from runtime.proof.reference import jacobian, make_motor
from runtime.system.errors import UserError
from tests.runtime.test_cli import call

#: Two that differ in sampling and mechanics, and one of another machine.
COMPARED = ("paper_spmsm", "ipmsm_flux", "spmsm_load_torque")


@pytest.fixture(scope="module")
def subjects() -> list[Subject]:
    return collect(COMPARED)


@pytest.mark.parametrize("name", COMPARED)
def test_structure_is_that_of_the_references_jacobians(name: str) -> None:
    """Complex steps through the hand-written f and h at random points: what is zero, one, constant, varying."""
    subject = Subject(name, find_folder(name))
    motor = make_motor(subject.manifest["parameters"])
    rng = np.random.default_rng(8)
    n = len(subject.state_names)
    at = [(rng.normal(0.0, 3.0, n), rng.normal(0.0, 100.0, 2)) for _ in range(4)]
    for which, jacobians in (
        ("F", np.array([jacobian(lambda z, u=u: motor.f(z, u), x) for x, u in at])),
        ("H", np.array([jacobian(motor.h, x) for x, _ in at])),
    ):
        scale = np.max(np.abs(jacobians), axis=0)
        moves = np.ptp(jacobians, axis=0) > 1e-9 * scale
        for i, row in enumerate(subject.patterns[which]):
            for j, mark in enumerate(row):
                kind = VARYING if moves[i, j] else ZERO if scale[i, j] < 1e-14 else CONSTANT
                kind = ONE if kind == CONSTANT and abs(jacobians[0, i, j] - 1.0) < 1e-14 else kind
                assert mark == kind, (which, i, j, jacobians[:, i, j])


def test_figures_are_those_of_folders_and_runs(subjects: list[Subject]) -> None:
    facts = to_json(subjects)
    assert json.loads(json.dumps(facts)) is not None
    for name in COMPARED:
        manifest = find_folder(name).manifest
        for kind, cost in facts["cost"][name].items():
            stated = manifest["filters"][kind]
            assert cost["cycles"] == {k: stated["cycles"][k] for k in ("2.5", "5")}
            assert cost["ram_words"] == stated["state_words"]
            assert cost["text_bytes_m4"] == manifest["measured"][f"{name}_{kind}_step"]["text_bytes"]
            T = manifest["parameters"]["model"]["sample_time"]
            assert cost["percent_of_sample_time"] == pytest.approx(stated["cycles"]["2.5"] / (150e6 * T) * 100)
    assert len(costs(subjects)) == len(certificates(subjects)) == 2 * len(COMPARED)
    (run,) = simulate("ipmsm_flux", "load_step", ("ickf",))
    found = next(r for r in facts["accuracy"]["ipmsm_flux"] if (r["scenario"], r["filter"]) == ("load_step", "ickf"))
    assert found["load_step"] == run.figures()["load_step"]


def test_lines_and_keys_are_told_apart(subjects: list[Subject]) -> None:
    lines = {(line.function, str(line.left)): line for line in equation_lines(subjects)}
    assert not lines["f", "omega_e"].differs
    current = lines["f", "i_alpha_next"]
    assert current.differs
    assert [owners for _, owners in current.variants] == [(0,), (2,)]  # COMPARED
    keys = {row.key: row for row in file_rows(subjects)}
    assert keys["model.machine"].values == ("surface", "salient_flux", "surface")
    assert not keys["filter.kinds"].differs
    tuning = {row.key: row.values for row in tuning_rows(subjects)}
    assert tuning["Q load_torque"] == (None, None, 0.005)
    assert tuning["P_0 omega"] == (50.0, 50.0, 0.01)
    constants = {row.key: row.values for row in constant_rows(subjects)}
    assert constants["INV_L_D"] == (None, pytest.approx(1 / 0.036), None)


def test_merging_keeps_every_order() -> None:
    assert _merged([["a", "c"], ["a", "b", "c"], ["c", "d"]]) == ["a", "b", "c", "d"]


@pytest.mark.parametrize(
    ("drives", "expected"),
    [
        (["paper_spmsm"], "needs two drives or more"),
        (["paper_spmsm", "paper_spmsm"], "'paper_spmsm' is there twice"),
        (["paper_spmsm", "ipmsm_flax"], "Did you mean 'ipmsm_flux'"),
    ],
)
def test_bad_words_are_refused(drives: list[str], expected: str) -> None:
    with pytest.raises(UserError, match=expected):
        collect(drives)


@pytest.mark.thorough
def test_one_changed_key_is_all_that_is_told(tmp_path: Path) -> None:
    """The same drive with another inertia, before and after: one key, the constants made of it, no equation."""
    text = (FILES / "spmsm_load_torque.toml").read_text()
    shutil.copytree(GENERATED / "spmsm_load_torque", tmp_path / "before" / "spmsm_load_torque")
    (tmp_path / "a.toml").write_text(re.sub(r"inertia = [\d.e-]+", "inertia = 0.009", text))
    assert call("generate", "a.toml", "--out", "after", cwd=tmp_path).returncode == 0
    before, after = "before/spmsm_load_torque", "after/spmsm_load_torque"
    pytest.importorskip("matplotlib")
    done = call("compare", before, after, "--json", "f.json", "--out", "page", cwd=tmp_path)
    assert done.returncode == 0, done.stderr + done.stdout
    facts = json.loads((tmp_path / "f.json").read_text())
    assert facts["drives"] == [before, after]
    assert facts["differences"]["file"] == {"motor.inertia": {before: 0.008, after: 0.009}}
    assert facts["differences"]["equations"] == []
    assert set(facts["differences"]["constants"]) == {"DECAY_OMEGA", "GAIN_OMEGA"}
    assert facts["differences"]["tuning"] == {}
    names = {path.name for path in (tmp_path / "page").iterdir()}
    assert names == {"index.html", "sparsity.svg", "cost.svg", "accuracy_ckf.svg", "accuracy_ickf.svg"}
    page = (tmp_path / "page" / "index.html").read_text()
    assert page.count("<svg") == 4
    assert "<math>" in page
    assert not re.search(r'(src|href)="http', page)
