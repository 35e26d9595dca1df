"""Drives side by side: their tables, drawings and JSON tell what their manifests and runs hold."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgba

from runtime.compare.facts import certificates, costs, kinds, to_json
from runtime.compare.figures import accuracy_figure, cost_figure, sparsity_figure
from runtime.compare.subject import Subject
from runtime.compare.tables import accuracy_rows, alike, certificate_table, compare_tables, cost_cells, firsts, shown
from runtime.estimator.folder import find_folder
from tests.judges.made import Kept, curves, run, text_of

NAMES = ("paper_spmsm", "ipmsm_flux")


@pytest.fixture
def subjects() -> list[Subject]:
    found = []
    for k, name in enumerate(NAMES):
        runs = [run(s, kind, 1.0 + k, 2.0) for s in ("load_step", "no_load") for kind in ("ickf", "ckf")]
        runs.append(run("no_load", "ickf", angle_error=50.0))
        found.append(Subject(name, find_folder(name), tuple(runs)))
    return found


# --- drives side by side


def test_costs_are_the_manifests(subjects: list[Subject]) -> None:
    found = {(cost.label, cost.kind): cost for cost in costs(subjects)}
    assert list(found) == [(name, kind) for kind in kinds(subjects) for name in NAMES]
    first = firsts(costs(subjects))
    for (name, kind), cost in found.items():
        manifest = find_folder(name).manifest
        stated, measured = manifest["filters"][kind], manifest["measured"][f"{name}_{kind}_step"]
        T = manifest["parameters"]["model"]["sample_time"]
        cells = cost_cells(cost, first[kind])
        assert cells[:2] == (kind, name)
        assert [cell.replace(",", "") for cell in cells[2:10]] == [
            str(stated["operations"][op]) for op in ("add", "mul", "div", "sqrt", "compare", "select", "branch", "call")
        ]
        assert cells[10] == f"{stated['cycles']['2.5']:,}/{stated['cycles']['5']:,}"
        base = find_folder(NAMES[0]).manifest["filters"][kind]["cycles"]["2.5"]
        assert cells[11] == f"{stated['cycles']['2.5'] / base:.2f}"
        assert cells[12] == f"{stated['cycles']['2.5'] / 150e6 / T * 100:.0f} %"
        whole = stated["controller"]["cycles"]
        assert cells[13] == f"{whole['2.5']:,}/{whole['5']:,}"
        assert cells[14] == str(stated["state_words"])
        assert cells[15:] == (f"{measured['stack_bytes']:,}", f"{measured['text_bytes']:,}")
    assert cost_cells(replace(cost, stack=None, text=None), cost)[-2:] == ("-", "-")


def test_json_costs_by_name(subjects: list[Subject]) -> None:
    facts = to_json(subjects)
    for name in NAMES:
        manifest = find_folder(name).manifest
        for kind, stated in manifest["filters"].items():
            cost = facts["cost"][name][kind]
            measured = manifest["measured"][f"{name}_{kind}_step"]
            assert cost["operations"] == stated["operations"]
            assert cost["cycles"] == {k: stated["cycles"][k] for k in ("2.5", "5")}
            assert cost["cycles_with_controller"] == {k: stated["controller"]["cycles"][k] for k in ("2.5", "5")}
            assert (cost["stack_bytes_m4"], cost["text_bytes_m4"]) == (measured["stack_bytes"], measured["text_bytes"])
            assert cost["ram_words"] == stated["state_words"]
            own = facts["certificate"][name][kind]
            states = [state["name"] for state in manifest["states"]]
            assert [own[state] for state in states] == stated["certificate"]["x"]
            assert (own["P, 99 %"], own["P, worst"]) == (stated["certificate"]["P_99"], stated["certificate"]["P"])
            assert own["P, 99 %"] < own["P, worst"]


def test_the_table_of_certificates(subjects: list[Subject]) -> None:
    columns, cells = certificate_table(subjects)
    assert columns == [
        "filter", "drive", "i_alpha, A", "i_beta, A", "omega, rad/s", "theta, rad", "psi_alpha, Wb", "psi_beta, Wb",
        "P, 99 %", "P, worst",
    ]  # fmt: skip
    for label, kind, values in certificates(subjects):
        (cell,) = [one for one in cells if one[:2] == [kind, label]]
        keys = [column.partition(",")[0] if not column.startswith("P,") else column for column in columns[2:]]
        assert cell[2:] == [f"{values[key]:.1e}" if key in values else "-" for key in keys]


def test_accuracy_in_order_and_with_verdicts(subjects: list[Subject]) -> None:
    rows = accuracy_rows(subjects)
    assert [one[:3] for one in rows[:3]] == [("no_load", "ckf", name) for name in NAMES] + [
        ("no_load", "ickf", NAMES[0])
    ]
    assert rows[0][3:] == ("1.00", "-", "1.000", "2.000", "locked")
    assert rows[-1] == ("load_step", "ickf", NAMES[1], "2.00", "2.00", "2.000", "2.000", "locked")
    assert [one[-1] for one in rows].count("LOST LOCK") == 2
    said = text_of(compare_tables(subjects))
    assert said.count("LOST LOCK") == 2
    assert f"{sum(r == '.' for p in subjects[0].patterns['F'] for r in p)} of" not in said
    filled = sum(mark != "." for line in subjects[0].patterns["F"] for mark in line)
    assert f"{filled} of 16" in said


def test_values_as_words() -> None:
    assert [shown(v) for v in (None, [1.5, 2], [], 0.1234567, 3, "x")] == ["-", "1.5, 2", "none", "0.123457", "3", "x"]
    rows: Any = [SimpleNamespace(differs=d) for d in (True, False, False)]
    assert (alike(rows), alike(rows[:1])) == ("2 alike are left out", "none is alike")


def test_drawings_of_a_comparison(subjects: list[Subject], kept: Kept) -> None:
    sparsity_figure(subjects)
    axes = kept.axes
    for column, subject in enumerate(subjects):
        for axis, which in ((axes[column], "F"), (axes[2 + column], "H")):
            shades = np.asarray(axis.collections[0].get_array()).ravel()
            marks = "".join(subject.patterns[which])
            assert list(shades) == [".c1x".index(mark) for mark in marks]
            filled = f"{which}, {len(marks) - marks.count('.')} of {len(marks)}"
            assert axis.get_title() == (f"{subject.label}\n{filled}" if which == "F" else filled)
            n, across = len(subject.patterns[which]), len(subject.patterns[which][0])
            assert list(axis.get_xticks()) == [k + 0.5 for k in range(across)]
            assert list(axis.get_yticks()) == [k + 0.5 for k in range(n)]
            assert axis.yaxis_inverted()
            states = [label.get_text() for label in axis.get_xticklabels()]
            left = [label.get_text() for label in axis.get_yticklabels()]
            assert left == (states if which == "F" else [r"$i_\alpha$", r"$i_\beta$"])
            assert len(set(states)) == across == len(subject.state_names)
    (legend,) = kept.figures[-1].legends
    colours = {
        text.get_text(): patch.get_facecolor()
        for text, patch in zip(legend.get_texts(), legend.get_patches(), strict=True)
    }
    drawn = axes[0].collections[0].get_cmap().colors
    meanings = ("zero", "constant", "one", "depends on state or input")
    assert len(set(drawn)) == 4
    assert colours == {meaning: to_rgba(colour) for meaning, colour in zip(meanings, drawn, strict=True)}
    cost_figure(subjects)
    found = costs(subjects)
    wanted = {
        "cycles a step, k = 2.5 (line: 5)": [cost.cycles["2.5"] for cost in found],
        "RAM, 16-bit words": [cost.ram_words for cost in found],
        "stack, bytes (M4F)": [cost.stack for cost in found],
        "code, bytes (M4F)": [cost.text for cost in found],
    }
    for axis, (title, values) in zip(kept.axes, wanted.items(), strict=True):
        assert axis.get_xlabel() == title
        assert [bar.get_width() for bar in axis.patches] == values
        middles = [bar.get_y() + bar.get_height() / 2 for bar in axis.patches]
        assert middles == pytest.approx([0.0, 1.0, 2.7, 3.7]), "a bar a unit, and the filters' groups apart"
        assert list(axis.get_yticks()) == pytest.approx(middles)
    labels = [label.get_text() for label in kept.axes[0].get_yticklabels()]
    assert labels == [f"{cost.label}  {cost.kind}" for cost in found]
    ends = [segment[1][0] for segment in kept.axes[0].collections[0].get_segments()]
    assert ends == [cost.cycles["5"] for cost in found]
    accuracy_figure(subjects, "ckf")
    step_speed, step_angle, *_ = kept.axes
    assert [axis.get_title("left") for axis in kept.axes] == ["load_step, ckf", "", "no_load, ckf", ""]
    for k, name in enumerate(NAMES):
        np.testing.assert_allclose(curves(step_speed)[f"_{name}"].y, 1.0 + k)
        np.testing.assert_allclose(curves(step_angle)[f"_{name}"].y, 2.0, atol=1e-9)
    assert (step_speed.get_ylabel(), step_angle.get_ylabel()) == (
        "speed error, r/min",
        "position error,\ndeg electrical",
    )
