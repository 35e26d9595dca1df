"""Does a verdict follow from its rows, and does one that fails reach the exit code, the JSON and the table?"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import runtime.commands.words
import runtime.proof.drives
import runtime.proof.verify
from model.drives.load import load_drive
from runtime.proof import link_guard
from runtime.proof.compare import Sigmas, relative_error, row_scale, scale_of
from runtime.proof.link_ab import Situations, _sigmas
from runtime.proof.link_cd import drift, drift_rows
from runtime.proof.link_de import same_bits
from runtime.proof.result import Divergence, IterationEffect, Link, Proof
from runtime.proof.trajectory import Trajectory
from runtime.proof.verify import Effort, Evidence, Prover
from tests.judges.made import command, link, proof, read_json, row

PARTED = Divergence(3, "17", "P_pred", "(2, 0)", 1.0, 2.0, "identical bits")
EFFECT = IterationEffect("d", "cubature", 1e-12, {"omega": 1e-13}, True, "rounding")


# --- a link, a proof


@pytest.mark.parametrize(
    ("worst", "allowed", "passed"),
    [
        (0.0, 0.0, True),
        (1.0, 0.0, False),
        (0.5, 0.5, True),
        (0.500001, 0.5, False),
        (0.1, 0.5, True),
        (float("nan"), 0.5, False),
        (float("inf"), 0.5, False),
    ],
)
def test_a_row_passes_up_to_what_is_allowed(worst: float, allowed: float, passed: bool) -> None:
    assert row(worst, allowed).passed is passed
    assert link(row(worst, allowed)).passed is passed
    assert link(row(), row(worst, allowed), row()).passed is passed


def test_a_link_without_a_comparison_is_not_passed() -> None:
    assert not Link("A-B", "a claim", "d", "ckf", "cubature", "some data", ()).passed
    assert not link(row(compared=0)).passed
    assert link(row(compared=0), row(compared=1)).passed


def test_a_first_divergence_is_no_pass_whatever_the_rows_say() -> None:
    assert not link(row(), divergence=PARTED).passed


def test_figures_of_a_link() -> None:
    several = link(row(0.1, 0.5, compared=3), row(0.2, 0.25, compared=4), row(0.3, 3.0, compared=5))
    assert (several.worst, several.used, several.compared) == (0.3, 0.8, 12)
    assert link(row(0.0, 0.0)).used == 0.0
    nothing = replace(link(), rows=())
    assert (nothing.worst, nothing.used, nothing.compared) == (0.0, 0.0, 0)
    assert link(row(2.0, 0.0), row(0.1, 0.5)).used == float("inf")
    assert link(row(float("nan"))).worst == link(row(0.1), row(float("nan"))).used == float("inf")
    assert (link(kind="ickf").variant, link(kind="ckf").variant) == ("ickf, cubature gain", "ckf")


def test_a_proof_needs_every_link_and_every_effect() -> None:
    assert proof(link(), link()).passed
    assert proof().passed is False
    assert not proof(link(row(1.0)), link()).passed
    assert not proof(link(), link(row(1.0))).passed
    assert proof(link(), effects=[EFFECT, replace(EFFECT, verdict="real")]).passed
    for place in (0, 1):
        effects = [EFFECT, EFFECT]
        effects[place] = replace(EFFECT, verdict="unexplained")
        assert not proof(link(), effects=effects).passed


def test_words_of_a_proof() -> None:
    assert proof(link()).verdict == "proved"
    assert (
        proof(link(), unchecked=["h, not checked", "f, neither"]).verdict
        == "filters proved; h, not checked; f, neither"
    )
    assert proof(link(row(1.0)), unchecked=["h, not checked"]).verdict == "NOT proved"
    assert proof().verdict == "NOT proved"


def test_every_broken_link_is_a_line_and_no_other() -> None:
    broken = link(row(), row(0.7, 0.5, "P_pred"), row(0.9, 0.5, "later"), name="B-C", kind="ickf", gain="jacobian")
    lines = list(proof(link(), broken, link(divergence=PARTED, name="D-E")).failures())
    assert lines == [
        "verify d/ickf (jacobian gain), link B-C on some data: P_pred (eq. 16) deviates by 0.7, allowed 0.5",
        "verify d/ckf (cubature gain), link D-E on some data: first divergence at step 3, P_pred (eq. 17) element "
        "(2, 0): expected 1, found 2, allowed identical bits",
    ]


def test_json_of_a_proof() -> None:
    facts = proof(link(row(0.1)), link(row(0.7)), effects=[EFFECT], notes=["n"], unchecked=["u, v"]).to_json()
    assert facts["passed"] is False
    assert [(entry["passed"], entry["worst"]) for entry in facts["links"]] == [(True, 0.1), (False, 0.7)]
    assert facts["links"][1]["rows"][0]["worst"] == 0.7
    assert (facts["drive"], facts["notes"], facts["unchecked"]) == ("d", ["n"], ["u, v"])
    assert facts["iteration"][0]["in_sigma"] == 1e-12
    assert proof(link()).to_json()["passed"] is True


# --- verify


def _verifying(monkeypatch: pytest.MonkeyPatch, *links: Link) -> None:
    found = Proof("paper_spmsm", list(links))
    monkeypatch.setattr(runtime.proof.drives, "verify", lambda drive, *rest, **keys: (found, None))


def test_verify_ends_with_1_if_one_link_fails(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    path = tmp_path / "v.json"
    for broken, code in ((False, 0), (True, 1)):
        _verifying(monkeypatch, link(drive="paper_spmsm"), link(row(1.0 if broken else 0.1), drive="paper_spmsm"))
        ended, said = command("verify", "paper_spmsm", "--json", str(path))
        facts = read_json(path)
        assert (ended, facts["passed"], facts["drives"][0]["passed"]) == (code, not broken, not broken)
        assert ("paper_spmsm: NOT proved" in said, "paper_spmsm: proved" in said) == (broken, not broken)
        assert ("20 numbers compared" in said) is not broken
        assert ("deviates by 1, allowed 0.5" in said) is broken


@pytest.mark.parametrize("bad", [0, 1, 2])
def test_one_drive_of_three_that_fails_fails_all(bad: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    path = tmp_path / "v.json"
    names = ["paper_spmsm", "ipmsm", "ipmsm_flux"]
    found = [(Proof(name, [link(row(1.0 if k == bad else 0.1))]), None) for k, name in enumerate(names)]
    monkeypatch.setattr(runtime.proof.drives, "_verify_all", lambda names, *rest: found)
    ended, said = command("verify", *names, "--json", str(path))
    facts = read_json(path)
    assert ended == 1, said
    assert facts["passed"] is False
    assert [entry["passed"] for entry in facts["drives"]] == [k != bad for k in range(3)]


@pytest.mark.slow
def test_a_wrong_motor_in_the_reference_is_found_by_verify(monkeypatch: pytest.MonkeyPatch) -> None:
    """The chain itself, its first links alone and short: the reference is told a resistance that is a per mille off."""
    original = runtime.proof.verify.second_motor

    def wrong(drive: Any) -> Any:
        motor = drive.motor.model_copy(update={"stator_resistance": 1.001 * drive.motor.stator_resistance})
        return original(drive.model_copy(update={"motor": motor}))

    drive = load_drive("paper_spmsm")
    own = drive.filter.gain
    monkeypatch.setattr(Prover, "links", lambda self, kind, evidence: self.along_trajectory(kind))
    monkeypatch.setattr(runtime.proof.verify, "GAINS", (own,))
    monkeypatch.setattr(
        runtime.proof.verify,
        "Effort",
        lambda: Effort(trajectory=40 * drive.model.sample_time, drift_steps=1, bit_steps=1),
    )
    monkeypatch.setattr(runtime.proof.verify, "second_motor", wrong)
    ended, said = command("verify", "paper_spmsm")
    assert ended == 1, said
    assert "paper_spmsm/ckf (cubature gain), link A-B on trajectory: first divergence at step 0" in said
    assert "link B-C on" not in said, "both forms have the same motor"


# --- how a deviation is measured


def _stage(scale: str, rows: tuple[int, ...]) -> Any:
    return SimpleNamespace(scale=scale, rows=rows, entries=rows)


def test_scales_are_the_rows_largest_or_its_natural_size() -> None:
    sigmas = Sigmas(
        state=np.array([[0.1, 4.0]]),
        innovation=np.array([[0.5, 2.0]]),
        noise=np.array([0.3, 0.6]),
        condition=np.array([10.0]),
    )
    small, large = np.array([[0.01, -0.02]]), np.array([[-7.0, 9.0]])
    expected = {
        "state": [0.1, 4.0],
        "output": [0.3, 0.6],
        "cross": [0.1 * 0.5, 4.0 * 0.5],
        "gain": [0.1 / 2.0, 4.0 / 2.0],
        "row": [0.01, 0.02],
    }
    for scale, natural in expected.items():
        found = row_scale(_stage(scale, (0, 1)), small, sigmas)
        np.testing.assert_allclose(found, [np.maximum(natural, [0.01, 0.02])], err_msg=scale)
        np.testing.assert_allclose(row_scale(_stage(scale, (0, 1)), large, sigmas), [np.maximum(natural, [7.0, 9.0])])
    matrix = np.array([[[0.5, -3.0], [1.0, 2.0]]])
    np.testing.assert_allclose(row_scale(_stage("row", (0, 0, 1, 1)), matrix, sigmas), [[3.0, 3.0, 2.0, 2.0]])


def test_sigmas_of_a_step_are_those_of_its_predictions() -> None:
    """Roots of variances; x_pred in its own sigmas, of which the largest counts."""
    P_pred, Pyy = np.array([[[4.0, 0.1], [0.1, 1e-4]]]), np.array([[[9.0, 0.0], [0.0, 1.0]]])
    stages = {"P_pred": P_pred, "Pyy": Pyy, "x_pred": np.array([[6.0, -0.5]])}
    nothing = np.zeros((1, 2))
    sigmas = _sigmas(Situations("made", nothing, P_pred, nothing, nothing, stages, [], nothing), np.array([0.25, 0.04]))
    np.testing.assert_allclose(sigmas.state, [[2.0, 0.01]])
    np.testing.assert_allclose(sigmas.innovation, [[3.0, 1.0]])
    np.testing.assert_allclose(sigmas.noise, [0.5, 0.2])
    np.testing.assert_allclose(sigmas.condition, [9.0])
    np.testing.assert_allclose(sigmas.offset, [50.0])


def test_an_entry_of_a_covariance_is_judged_by_its_two_sigmas() -> None:
    """In its own unit: a covariance of A and rad/s by neither variance."""
    stage = _stage("covariance", (0, 1, 1))
    values = np.array([[[4.0, 0.1], [0.1, 1e-4]]])
    sigmas = Sigmas(np.array([[20.0, 3.0]]), np.ones((1, 2)), np.ones(2), np.array([10.0]))
    np.testing.assert_allclose(scale_of(stage, values, sigmas), [[4.0, 0.02, 1e-4]])
    difference = _stage("difference", (0, 1, 1))
    np.testing.assert_allclose(scale_of(difference, values, sigmas), [[4.0, 0.02, 9e-4]])
    ill = replace(sigmas, condition=np.array([1e4]))
    np.testing.assert_allclose(scale_of(difference, values, ill), [[40.0, 6.0, 0.9]])
    far = replace(sigmas, offset=np.array([5e4]))
    np.testing.assert_allclose(scale_of(difference, values, far), [[40.0, 6.0, 0.9]])
    addend = _stage("addend", (0, 1, 1))
    np.testing.assert_allclose(scale_of(addend, values, ill), [[4.0, 0.02, 9e-4]])
    row = _stage("row", (0, 1))
    np.testing.assert_allclose(scale_of(row, np.array([[3.0, 4.0]]), sigmas), [[3.0, 4.0]])


def test_a_deviation_is_relative_turns_with_the_circle_and_is_never_no_number() -> None:
    sigmas = Sigmas(np.full((1, 2), 2.0), np.ones((1, 2)), np.ones(2), np.ones(1))
    stage = _stage("state", (0, 1))
    expected = np.array([[1.0, np.pi - 0.01]])
    found = relative_error(stage, expected, np.array([[1.5, -np.pi + 0.01]]), sigmas, angle=1)
    np.testing.assert_allclose(found, [[0.25, 0.02 / np.pi]], rtol=0.01)
    plain = relative_error(_stage("row", (0, 1)), expected, np.array([[1.0, -np.pi + 0.01]]), sigmas, angle=1)
    assert plain[0, 1] > 1.9, "what is no state does not turn"
    assert relative_error(stage, expected, np.array([[np.nan, 0.0]]), sigmas, 1)[0, 0] == np.inf
    zero = np.zeros((1, 2))
    assert list(relative_error(_stage("row", (0, 1)), zero, np.array([[0.0, 1e-9]]), sigmas, 1)[0]) == [0.0, np.inf]


def _estimator(x: Any, P: Any, *more: str) -> Any:
    names = ("i_alpha", "omega", "theta", *more)
    return SimpleNamespace(
        state_names=names,
        state_units=("A", "rad/s", "rad", "Wb")[: len(names)],
        run=lambda u, y: SimpleNamespace(x=np.array(x, float), P=np.array(P, float)),
    )


def test_drift_is_the_difference_and_its_allowance_a_share_of_that_steps_sigma() -> None:
    P = np.array([np.diag([4.0, 9.0, 0.25]), np.diag([1.0, 9.0, 0.25]), np.diag([0.01, 9.0, 0.25])])
    exact = np.array([[0.0, 1.0, 3.0], [0.0, 2.0, 3.1], [0.0, 3.0, 3.13]])
    single = exact + np.array([[0.5, 0.0, 0.0], [0.004, 0.0, 0.0], [0.0005, -0.02, 2 * np.pi - 0.001]])
    wider = P.copy()
    wider[1, 0, 1] = wider[1, 1, 0] = 0.06
    a, b = _estimator(single, wider), _estimator(exact, P)
    found = drift(a, b, np.zeros((3, 2)), np.zeros((3, 2)))
    np.testing.assert_allclose(found.x[2], [0.0005, 0.02, 0.001], atol=1e-12)
    np.testing.assert_allclose(found.P, [0.0, 0.02, 0.0], atol=1e-12)
    rows = drift_rows(b, found, 1)
    assert [r.stage for r in rows] == ["i_alpha", "omega", "theta", "P"]
    assert [r.meaning for r in rows] == ["A", "rad/s", "rad", "relative"]
    # The worst share of sigma decides, not the worst deviation: 0.0005 of 0.1 is more than 0.004 of 1.
    assert (rows[0].worst, rows[0].allowed) == pytest.approx((0.0005, 0.001))
    assert (rows[1].worst, rows[1].allowed) == pytest.approx((0.02, 0.03))
    assert (rows[2].worst, rows[2].allowed) == pytest.approx((0.001, 0.005))
    assert (rows[3].worst, rows[3].allowed) == pytest.approx((0.02, 0.01))
    assert [r.passed for r in rows] == [True, True, True, False]
    assert {r.compared for r in rows} == {2}
    assert not drift_rows(b, found, 0)[0].passed, "the first step counts if nothing has to settle"


def test_drift_of_slow_states_has_its_own_share_and_no_number_is_infinite() -> None:
    x, P = np.zeros((2, 4)), np.tile(np.eye(4), (2, 1, 1))
    b = _estimator(x, P, "magnet_flux")
    off = x.copy()
    off[1, 0] = 0.04
    assert drift_rows(b, drift(_estimator(off, P, "magnet_flux"), b, x, x), 0)[0].passed
    off[1, 0] = 0.06
    assert not drift_rows(b, drift(_estimator(off, P, "magnet_flux"), b, x, x), 0)[0].passed
    off[1, 0] = np.nan
    bad = P.copy()
    bad[0, 3, 3] = np.nan
    rows = drift_rows(b, drift(_estimator(off, bad, "magnet_flux"), b, x, x), 0)
    assert rows[0].worst == rows[-1].worst == np.inf
    assert (rows[0].passed, rows[1].passed, rows[-1].passed) == (False, True, False)
    P[1, 0, 0] = 4.0
    assert drift_rows(b, drift(_estimator(off, P, "magnet_flux"), b, x, x), 0)[0].allowed == pytest.approx(0.05)


def test_bits_are_compared_as_bits() -> None:
    a = np.array([1.0, 0.0, np.nan, 1.0], dtype=np.float32)
    b = np.array([np.nextafter(np.float32(1), np.float32(2)), -0.0, np.nan, 1.0], dtype=np.float32)
    assert list(same_bits(a, b)) == [False, False, True, True]


# --- what iterating changed


@pytest.mark.parametrize(
    ("idle", "off", "verdict"),
    [(True, 1e-12, "rounding"), (True, 1e-3, "unexplained"), (False, 1e-3, "real"), (False, 1e-12, "unexplained")],
)
def test_effect_of_iterating(idle: bool, off: float, verdict: str, monkeypatch: pytest.MonkeyPatch) -> None:
    P = np.tile(np.diag([1.0, 1.0, 4.0, 0.25]), (3, 1, 1))
    ckf, ickf = np.zeros((3, 4)), np.zeros((3, 4))
    ckf[:, 3], ickf[:, 3] = np.pi, -np.pi  # the same angle
    ickf[1, 2] = 2 * off
    runs = {"ckf": ckf, "ickf": ickf}

    def load(folder: Any, kind: str, backend: str, dtype: str) -> Any:
        assert dtype == "float64"
        return SimpleNamespace(run=lambda u, y: SimpleNamespace(x=runs[kind], P=P if kind == "ckf" else 100 * P))

    monkeypatch.setattr(runtime.proof.verify, "load_folder", load)
    states = [SimpleNamespace(name=name) for name in ("i_alpha", "i_beta", "omega", "theta")]
    drive = SimpleNamespace(name="d", filter=SimpleNamespace(gain="cubature"))
    steps = {"ickf": SimpleNamespace(iteration_proof="idle" if idle else None)}
    package = SimpleNamespace(drive=drive, steps=steps, model=SimpleNamespace(angle=3, states=states))
    trajectory = Trajectory(*(np.zeros(3) for _ in range(6)))
    evidence = Evidence(trajectory.t, {}, {}, trajectory)
    self: Any = SimpleNamespace(package=package, folder=None, trajectory=trajectory)
    effect = Prover.effect(self, evidence)
    assert effect.verdict == verdict
    assert effect.in_sigma == pytest.approx(off, rel=1e-6)
    assert effect.by_state["omega"] == pytest.approx(2 * off)
    assert effect.by_state["theta"] < 1e-12
    np.testing.assert_allclose(evidence.effects["cubature"], [0.0, off, 0.0], atol=1e-15)


# --- tables


@pytest.mark.parametrize(
    ("off", "condition", "swayed", "passed"),
    [
        (1e-9, 1.0, 0.0, True),
        (1e-8, 1.0, 0.0, False),
        (1e-8, 1e8, 0.0, True),
        (1e-4, 1e8, 0.0, False),
        (1e-8, 1.0, 1e-9, True),
        (1e-5, 1.0, 1e-9, False),
    ],
)
def test_guard_judges_an_estimate_by_its_predictions_sigma(
    off: float, condition: float, swayed: float, passed: bool
) -> None:
    """Three samples of one filter, x off by so many sigmas.

    More is allowed only where Pyy is ill-conditioned, or a rounding before the sample sways x by so many sigmas.
    """
    x, P = np.zeros(2), np.diag([4.0, 0.01])
    sigma = np.array([2.0, 0.1])
    wanted = [np.array([[value] * 3]) for value in (x, P, 0, 1, sigma, condition, np.zeros(2), swayed * sigma, 0.0 * P)]
    found = [((x + off * sigma)[None], P[None], np.zeros(1, int), np.ones(1, int))] * 3
    link = link_guard._compare(SimpleNamespace(kind="ckf", gain="cubature"), "d", "fast", 1, wanted, found)  # type: ignore[arg-type]
    assert link.passed is passed
