"""Tables and figures of a proof, against the rows and arrays behind them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import runtime.commands.words
import runtime.proof.drives
import runtime.proof.verify
from runtime.drive.figures import SLICES
from runtime.proof.figures import NONE, drift_figure, effect_figure, stage_figure, trajectory_figure
from runtime.proof.link_ab import ALLOWED
from runtime.proof.link_cd import Drift
from runtime.proof.result import Divergence, IterationEffect, Proof, Row
from runtime.proof.tables import proof_tables, stages_by_equation, whole_links
from runtime.proof.trajectory import Trajectory
from runtime.proof.verify import Evidence
from tests.judges.made import RPM, Kept, curves, link, proof, row, text_of

PARTED = Divergence(3, "17", "P_pred", "(2, 0)", 1.0, 2.0, "identical bits")
EFFECT = IterationEffect("d", "cubature", 1e-12, {"omega": 1e-13}, True, "rounding")


def test_stages_by_equation_shows_the_worst_of_all() -> None:
    links = [
        link(Row("17", "P_pred", "m", 1e-12, 1e-10, 5), Row("9", "first", "m", 1e-13, 1e-10, 5)),
        link(Row("17", "P_pred", "m", 3e-12, 1e-10, 5)),
        link(Row("17", "P_pred", "m", 2e-12, 1e-10, 5)),
        link(Row("17", "P_pred", "m", 7e-12, 1e-10, 5), kind="ickf"),
        link(
            Row("33", "x, j = 1", "m", 1e-12, 1e-10, 5), Row("33", "x, j = 2 (idle)", "m", 4e-12, 1e-10, 5), kind="ickf"
        ),
        link(Row("17", "P_pred", "m", 1.0, 1e-10, 5), name="B-C"),
    ]
    found = stages_by_equation(links)
    assert list(found) == [("9", "first"), ("17", "P_pred"), ("33", "x"), ("33", "x, further iterates")]
    assert found["17", "P_pred"] == {"ckf": 3e-12, "ickf, cubature gain": 7e-12}
    assert found["33", "x, further iterates"] == {"ickf, cubature gain": 4e-12}
    assert stages_by_equation(links, "B-C")["17", "P_pred"] == {"ckf": 1.0}
    nan = [link(Row("17", "P_pred", "m", float("nan"), 1e-10, 5))]
    assert stages_by_equation(nan)["17", "P_pred"]["ckf"] == float("inf"), "no number is no zero"


def test_the_proofs_tables_say_what_the_rows_say() -> None:
    links = [
        link(Row("-", "f", "m", 0.0, 0.0, 12), Row("-", "h", "m", 2.0, 0.0, 34), name="model"),
        link(Row("17", "P_pred", "m", 3.3e-12, 1e-10, 5), Row("33", "same number of passes", "m", 2.0, 0.0, 5)),
        link(Row("13", "S", "m", 1.0, 1e-9, 5), Row("14", "X", "m", 0.0, 1e-9, 5), name="B-C"),
        link(Row("-", "a", "m", 0.25, 0.5, 1234), Row("-", "b", "m", 0.0, 0.0, 10), name="guard"),
        link(Row("-", "a", "m", 0.0, 0.5, 1), Row("-", "b", "m", 3.0, 0.0, 10), name="text"),
        link(Row("25", "x", "m", 2.0, 0.0, 1000), Row("26", "P", "m", 5.0, 0.0, 2000), name="D-E"),
        link(Row("25", "omega", "rad/s", 3e-4, 1e-2, 9), name="C-D"),
        link(Row("25", "omega", "rad/s", 7e-2, 1e-2, 9), name="D-chip"),
    ]
    effects = [EFFECT, replace(EFFECT, gain="jacobian", verdict="unexplained", in_sigma=0.3)]
    said = text_of(proof_tables(proof(*links, effects=effects, notes=["a note"])))

    def line(*words: str) -> str:
        (found,) = [one for one in said.splitlines() if all(word in one for word in words)]
        return " ".join(found.replace("│", " ").split())

    assert line("f ", "12", "ok") == "f 12 0 ok"
    assert line("h ", "34") == "h 34 2 FAILED"
    assert line("P_pred") == "17 P_pred 3.3e-12"
    assert line("same number of passes") == "33 same number of passes no: 2"
    assert line("13 ", "S ") == "13 S 1.0e+00"
    assert line("14 ", "X ") == "14 X 0"
    assert line("guard", "1,244") == "guard ckf a claim some data 1,244 50 % of allowed ok"
    assert line("text ", "a claim") == "text ckf a claim some data 11 3 differ FAILED"
    assert line("3,000") == "ckf some data 3,000 7 FAILED"
    assert line("3.0e-04") == "ckf 3.0e-04 ok"
    assert line("7.0e-02") == "ckf 7.0e-02 FAILED"
    assert said.count("allowed 1.0e-02".replace(" ", "")) == 0
    assert "omega, rad/s" in said
    assert line("1e-12 sigma").endswith("rounding: iterating is proved idle")
    assert line("0.3 sigma").endswith("UNEXPLAINED")
    assert "A-B: reference against generated float64" in said
    assert "(allowed 1e-10)" in said
    assert "(allowed 1e-09)" in said
    assert "a note" in said
    assert "C-D: float32 against float64" in said
    assert "D-chip: the chip's arithmetic as modelled" in said


def test_a_machine_of_ones_own_is_told_apart() -> None:
    own = text_of(proof_tables(proof(link(), unchecked=["f and h of x.py, not checked"])))
    assert "f and h of x.py" in own
    assert "not checked" in own
    assert "reference filter, on CasADi's own f, h, H, against" in own
    stated = link(Row("-", "f", "m", 3e-13, 1e-12, 500), name="model")
    said = text_of(proof_tables(proof(stated)))
    assert "(allowed 1e-12)" in said
    assert "3.0e-13" in said
    assert "CasADi against SymPy's own derivation, symbolically" in text_of(
        proof_tables(proof(link(row(0, 0), name="model")))
    )


def test_shares_of_what_is_allowed() -> None:
    found = whole_links(proof(link(row(0.4, 0.5), row(0.1, 0.5), name="data"), link(row(1, 10), name="guard")))
    assert [(one.name, used) for one, used in found] == [("guard", "10 % of allowed"), ("data", "80 % of allowed")]


# --- figures


def test_the_figure_of_stages_has_the_worst_of_each(kept: Kept) -> None:
    rows = [Row("17", "P_pred", "m", 3e-12, 1e-10, 5), Row("9", "first", "m", 0.0, 1e-10, 5)]
    rows.append(Row("33", "same number of passes", "m", 2.0, 0.0, 5))
    stage_figure(proof(link(*rows), link(replace(rows[0], worst=5e-12)), link(*rows[:1], kind="ickf")))
    (axis,) = kept.axes
    found = curves(axis)
    np.testing.assert_allclose(found["ckf"].x, [NONE, 5e-12])
    np.testing.assert_allclose(found["ckf"].y, [0, 1])
    np.testing.assert_allclose((found["ickf, cubature gain"].x[0], found["ickf, cubature gain"].y[0]), (3e-12, 1))
    assert [label.get_text() for label in axis.get_yticklabels()] == ["(9)  first", "(17)  P_pred"]
    assert any(list(line.get_xdata()) == [ALLOWED, ALLOWED] for line in axis.lines), "what is allowed is marked"


def test_figures_of_drift_effect_and_trajectory(kept: Kept) -> None:
    N = 1210
    x = np.zeros((N, 2))
    x[1001, 0], x[1001, 1], P = 3e-3, 7e-5, np.full(N, 2e-6)
    exact: Any = None
    t, omega = 1e-4 * np.arange(N), np.linspace(0, 100, N)
    u, y = np.column_stack([t, 2 * t]), np.column_stack([3 * t, 4 * t])
    trajectory = Trajectory(t, u, y, omega, omega, u)
    effects = {"cubature": np.where(np.arange(N) == 700, 0.4, 0.0)}
    evidence = Evidence(t, {"ckf": Drift(x, P, exact).envelope()}, effects, trajectory)
    drift_figure(evidence, 1e-4, {"omega": "rad/s", "theta": "rad"})
    axes = kept.axes
    assert [axis.get_ylabel() for axis in axes] == ["omega\nrad/s", "theta\nrad", "P\nrelative"]
    tops = [curves(axis)["ckf"] for axis in axes]
    assert [top.y.max() for top in tops] == [3e-3, 7e-5, 2e-6]
    assert tops[0].x[np.argmax(tops[0].y)] == pytest.approx(0.1002, abs=3e-3)
    assert len(tops[0].x) >= SLICES // 2
    effect_figure(evidence)
    found = curves(kept.axes[0])["cubature gain"]
    assert np.nanmax(found.y) == 0.4
    assert np.count_nonzero(np.isfinite(found.y)) == 1, "zero has no logarithm"
    assert found.x[np.nanargmax(found.y)] == pytest.approx(0.07, abs=2e-4)
    trajectory_figure(evidence)
    speed, current, voltage = kept.axes
    assert speed.lines[0].get_ydata()[-1] == pytest.approx(100 * RPM)
    assert (speed.get_ylabel(), current.get_ylabel(), voltage.get_ylabel()) == ("speed, r/min", "i, A", "v, V")
    for axis, values in ((current, y), (voltage, u)):
        for k, name in enumerate(("alpha", "beta")):
            low, high = (line.get_ydata() for line in axis.lines if line.get_label() == f"_{name}")
            assert (low[0], high[-1]) == (values[0, k], pytest.approx(values[-1, k], rel=0.05))
            assert np.all(low <= high)


@pytest.mark.parametrize(
    ("made", "style"),
    [(proof(link()), "green"), (proof(link(row(1.0))), "bold red"), (proof(link(), unchecked=["u, v"]), "yellow")],
)
def test_the_colour_of_a_verdict(made: Proof, style: str, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setattr("runtime.commands.words.console", SimpleNamespace(print=lambda text, **keys: said.append(text)))
    runtime.commands.words.show_summary(made)
    assert f"d: [{style}]{made.verdict}[/{style}]" in said[-1]
