"""How soaks and campaigns are judged, and the commands around them: planted evidence ends in exit 1."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import runtime.endurance.fuzz
import runtime.endurance.soak
from runtime.endurance.figures import soak_figure
from runtime.endurance.fuzz import Campaign, Finding, _report
from runtime.endurance.soak import Soak, Soaker, _decades
from runtime.endurance.tables import campaigns_table, finding_lines, soak_table, soaks_verdict
from tests.judges.made import (
    Kept,
    cells_of,
    command,
    curves,
    decade,
    read_json,
    soak,
)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({}, None),
        ({"deviation": (1e-6, 1e-6, 0.99e-5, 1e-6)}, None),
        ({"deviation": (1e-6, 1e-6, 1.01e-5, 1e-6)}, "differ in omega by 1e-05 rad/s, allowed 1e-05"),
        ({"deviation": (float("nan"), 1e-6, 1e-6, 1e-6)}, "differ in i_alpha by nan A"),
        ({"share": (1e-4, 1e-2, 1e-4, 1e-4)}, None),
        ({"share": (1e-4, 1.1e-2, 1e-4, 1e-4)}, "differ in i_beta by 0.011 sigma, allowed 0.01"),
        ({"covariance": 1e-2}, None),
        ({"covariance": 1.1e-2}, "differ in P by 0.011, allowed 0.01"),
        (
            {"unexpected": 2, "bits": 9, "first_unexpected": 77},
            "without a reason in 2 steps (bits 0x9), first at step 77",
        ),
        ({"not_finite": 3}, "3 steps after which a number is none"),
        ({"angle": math.radians(44.9)}, None),
        ({"angle": math.radians(45.1)}, "the lock was lost, theta off by 45 degrees"),
        ({"rejected": 1}, "0 steps had no currents, 1 said so"),
        ({"not_converged": 99_999}, None),
    ],
)
def test_what_fails_a_soak(change: dict[str, Any], words: str | None) -> None:
    for several in ([decade(**change)], [decade(), decade(900_000, **change)]):
        failures = soak(*several).failures()
        assert len(failures) == (words is not None), failures
        if words:
            assert words in failures[0]
            assert failures[0].startswith("d/ickf")


def test_lost_currents_are_counted_by_hand() -> None:
    """50 steps before every 1 000 003rd are without currents."""
    for steps, lost in (
        (1_000_002, 49),
        (1_000_003, 50),
        (1_000_004, 50),
        (3_000_000, 141),
        (999_953, 0),
        (999_954, 1),
    ):
        expected = sum(1 for k in range(4) for j in range(50) if (k + 1) * 1_000_003 - 50 + j < steps)
        assert expected == lost
        assert soak(decade(steps, rejected=lost)).failures() == []
        assert soak(decade(100_000, rejected=lost), decade(steps)).failures() == []
        for wrong in (lost + 1, lost - 1):
            assert f"{lost} steps had no currents, {wrong} said so" in soak(decade(steps, rejected=wrong)).failures()[0]


def test_growth_and_the_truths_own_angle() -> None:
    def grown(factor: float, until: int = 2_000_000) -> list[str]:  # 94 steps of these are without currents
        small = tuple(factor * 1e-6 for _ in range(4))
        return soak(decade(10**6), decade(until, deviation=small, rejected=94)).failures()

    assert grown(3.0) == []
    assert len(grown(3.1)) == 4
    assert "the deviation of theta grew 3.1 times up to step 2e+06" in grown(3.1)[3]
    assert soak(decade(10**5), decade(900_000, deviation=(9e-6,) * 4)).failures() == []
    assert soak(decade(), turned=1e-9).failures() == []
    assert "off by 2e-09 rad, allowed 1e-09" in soak(decade(), turned=2e-9).failures()[0]
    assert "off by nan rad" in soak(decade(), turned=float("nan")).failures()[0]


def test_slow_states_are_held_to_a_tenth_of_sigma_alone() -> None:
    names = ("i_alpha", "i_beta", "omega", "theta", "magnet_flux")
    wide: dict[str, Any] = {"deviation": (1.0,) * 5, "slow": (1.0,) * 5}
    assert soak(decade(share=(0.1,) * 5, **wide), names=names).failures() == []
    assert (
        "magnet_flux by 0.11 sigma, allowed 0.1"
        in soak(decade(share=(0.1,) * 4 + (0.11,), **wide), names=names).failures()[0]
    )


def test_decades_and_the_angle_by_fractions() -> None:
    assert _decades(100) == [100]
    assert _decades(10**5) == [10**5]
    assert _decades(3 * 10**6) == [10**5, 10**6, 3 * 10**6]
    self: Any = SimpleNamespace(_at=10_000, journey=SimpleNamespace(u=np.zeros((7, 2)), theta=np.array([0.0, 1.25])))
    exact = float(Fraction(5, 4) * (10_000 // 7) % Fraction("6.28318530717958647692528676655900576839433879875021"))
    assert Soaker._off(self, exact) < 1e-12
    assert Soaker._off(self, exact + 2e-9) == pytest.approx(2e-9, rel=1e-3)
    assert Soaker._off(self, exact - 2 * math.pi) < 1e-12


@pytest.mark.parametrize("bad", [None, 0, 1])
def test_soak_ends_with_1_if_one_failed(
    bad: int | None, here: Path, monkeypatch: pytest.MonkeyPatch, kept: Kept
) -> None:
    def played(runs: Any, kind: str, tell: Any) -> list[Soak]:
        asked.append((list(runs), kind))
        return [soak(decade(unexpected=int(k == bad)), drive=name) for k, (name, _) in enumerate(runs)]

    asked: list[Any] = []
    monkeypatch.setattr(runtime.endurance.soak, "soak", played)
    code, said = command("soak", "ipmsm", "paper_spmsm", "--steps", "1000", "--json", "s.json", "--plots", "p")
    assert code == (bad is not None), said
    assert asked == [([("ipmsm", 1000), ("paper_spmsm", 100)], None)]
    facts = read_json("s.json")
    assert facts["passed"] is (bad is None)
    assert [bool(one["failures"]) for one in facts["runs"]] == [k == bad for k in range(2)]
    assert said.count("held over 100,000 steps") == (2 if bad is None else 1)
    assert facts["runs"][0]["decades"][0]["until"] == 100_000


def test_the_table_and_figure_of_a_soak(kept: Kept) -> None:
    one = decade(
        share=(1e-4, 7e-3, 1e-4, 2e-3),
        rejected=50,
        unexpected=4,
        angle=math.radians(12.34),
        deviation=(1e-6, 2e-6, 3e-6, 4e-6),
    )
    made = soak(
        decade(),
        replace(one, until=10**6, slow=(1.0, 2.0, 3.0, 8e-6)),
        reference=(1e-7, 2e-7, 3e-7, 8e-7, 1e-5),
        seconds=3.0,
    )
    rows = cells_of(soak_table(made))
    assert rows[1] == [
        "1e+06",
        "1.0e-06",
        "2.0e-06",
        "3.0e-06",
        "4.0e-06",
        "8.0e-06",
        "7e-03",
        "1e-05",
        "12.3",
        "0.50",
        "50",
        "4",
    ]
    assert rows[2][:5] == ["reference", "1.0e-07", "2.0e-07", "3.0e-07", "8.0e-07"]
    assert rows[2][7] == "1e-05"
    assert str(soak_table(made).title) == f"d/ickf: {10**6 * 1e-4 / 3600:.2g} h of drive time in 3 s"
    headers = [str(one.header) for one in soak_table(made).columns]
    assert headers == [
        "up to step", "i_alpha, A", "i_beta, A", "omega, rad/s", "theta, rad", "theta, slow", "of sigma", "P",
        "theta off, deg", "omega off, rad/s", "lost", "status",
    ]  # fmt: skip
    styles = [str(getattr(cell, "style", "")) for cell in soak_table(made).columns[-1].cells]
    assert styles[:2] == ["green", "bold red"]
    lines = soaks_verdict([made, soak(decade())])
    assert [style for _, style in lines] == ["red"] * (len(lines) - 1) + ["green"]
    soak_figure([made])
    omega, theta = kept.axes
    assert (omega.get_ylabel(), theta.get_ylabel()) == ("largest |float32 - float64|\nover that of 100 000 steps", "")
    assert [axis.get_title() for axis in kept.axes] == ["omega", "theta"]
    assert [axis.get_xlabel() for axis in kept.axes] == ["steps", "steps"]
    assert [text.get_text() for text in kept.figures[-1].legends[0].get_texts()] == ["d"]
    assert (list(curves(omega)["d"].x), list(curves(omega)["d"].y)) == ([1e5, 1e6], pytest.approx([1e-6 / 3e-7, 10.0]))
    assert list(curves(theta)["d"].y) == pytest.approx([1e-6 / 8e-7, 5.0])
    assert any(list(line.get_ydata()) == [10.0, 10.0] for line in omega.lines)


# --- fuzz


FOUND = [
    Finding("a: word 3", b"\x01\x02\x03", "long"),
    Finding("a: word 4", b"\x09", "short"),
    Finding("b: x", b"\xff", "other"),
]


@pytest.mark.parametrize("bad", [None, 0, 1])
def test_fuzz_ends_with_1_if_anything_was_found(bad: int | None, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = [Campaign(f"t{k}", 100, 4.0, 5, 6, FOUND if k == bad else []) for k in range(2)]
    asked: list[Any] = []
    monkeypatch.setattr(runtime.endurance.fuzz, "fuzz", lambda tasks, corpus, tell: asked.extend(tasks) or made)
    code, said = command("fuzz", "paper_spmsm", "--executions", "1000", "--json", "f.json")
    assert code == (bad is not None), said
    facts = read_json("f.json")
    assert facts["passed"] is (bad is None)
    assert [len(one["findings"]) for one in facts["targets"]] == [3 if k == bad else 0 for k in range(2)]
    assert (facts["targets"][0]["executions"], facts["targets"][0]["target"]) == (100, "t0")
    assert (f"t{bad}: a: word 4 (and 1 more words) -- short [input 09]" in said) is (bad is not None)
    runs = {bool(target.form): count for target, count in asked}
    assert runs == {False: 1000, True: 100}
    asked.clear()
    command("fuzz", "paper_spmsm", "--executions", "5")
    assert {bool(target.form): count for target, count in asked} == {False: 5, True: 1}, "one at least"


def test_lines_and_table_of_a_campaign() -> None:
    one = Campaign("t", 1000, 4.0, 5, 6, FOUND)
    assert finding_lines([one]) == [
        "t: a: word 4 (and 1 more words) -- short [input 09]",
        "t: b: x -- other [input ff]",
    ]
    assert cells_of(campaigns_table([one, Campaign("u")])) == [
        ["t", "1,000", "250", "5", "6", "3"],
        ["u", "0", "0", "0", "0", "0"],
    ]
    assert [str(c.style) for c in campaigns_table([one, Campaign("u")]).columns[-1].cells] == ["bold red", "green"]  # type: ignore[union-attr]
    assert _report("x\na.c:3: runtime error: nan\ny") == "a.c:3: runtime error: nan"
    assert _report("==12== ERROR: AddressSanitizer: oops\n") == "AddressSanitizer: oops"
    assert _report("") == "the process died: it says nothing"
