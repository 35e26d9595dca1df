"""Comparisons and the report page show what manifests, runs and proofs hold; and what makes ``run`` fail."""

from __future__ import annotations

import html
import re
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgba

import runtime.commands.run
from codegen.fast.ablation import OPERATIONS
from codegen.output.version import __version__
from model.drives.load import load_drive
from runtime.compare.facts import certificates, costs, kinds, to_json
from runtime.compare.figures import accuracy_figure, cost_figure, sparsity_figure
from runtime.compare.subject import Subject
from runtime.compare.tables import accuracy_rows, alike, certificate_table, compare_tables, cost_cells, firsts, shown
from runtime.drive.experiment import SweepPoint
from runtime.estimator.folder import GENERATED, find_folder
from runtime.firmware.gates import Gated
from runtime.proof.link_cd import Drift
from runtime.proof.result import IterationEffect
from runtime.proof.trajectory import Trajectory
from runtime.proof.verify import Evidence
from runtime.report.chapter import Chapter
from runtime.report.page import write_page
from runtime.report.run import Ran
from tests.judges.made import Kept, check, command, curves, link, proof, row, run, text_of

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
        assert [cell.replace(",", "") for cell in cells[2:7]] == [
            str(stated["operations"][op]) for op in ("add", "mul", "div", "sqrt", "sincos")
        ]
        assert cells[7] == f"{stated['cycles']['2.5']:,}/{stated['cycles']['5']:,}"
        base = find_folder(NAMES[0]).manifest["filters"][kind]["cycles"]["2.5"]
        assert cells[8] == f"{stated['cycles']['2.5'] / base:.2f}"
        assert cells[9] == f"{stated['cycles']['2.5'] / 150e6 / T * 100:.0f} %"
        whole = stated["controller"]["cycles"]
        assert cells[10] == f"{whole['2.5']:,}/{whole['5']:,}"
        assert cells[11] == str(stated["state_words"])
        assert cells[12:] == (f"{measured['stack_bytes']:,}", f"{measured['text_bytes']:,}")
    assert cost_cells(SimpleNamespace(**{**vars(cost), "stack": None, "text": None}), cost)[-2:] == ("-", "-")  # type: ignore[arg-type]


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
        np.testing.assert_allclose(curves(step_speed)[name].y, 1.0 + k)
        np.testing.assert_allclose(curves(step_angle)[name].y, 2.0, atol=1e-9)
    assert (step_speed.get_ylabel(), step_angle.get_ylabel()) == (
        "speed error, r/min",
        "position error,\ndeg electrical",
    )


# --- run: a chapter, the page, the exit code


def _chapter(**changes: Any) -> Chapter:
    N = 30
    t, pair = 1e-4 * np.arange(N), np.zeros((N, 2))
    trajectory = Trajectory(t, pair, pair, t, t, pair)
    exact: Any = None
    evidence = Evidence(
        t, {"ckf": Drift(np.full((N, 4), 1e-5), np.full(N, 1e-6), exact).envelope()}, {"cubature": t}, trajectory
    )
    earned: Any = SimpleNamespace(ablation=SimpleNamespace(name="literal"), operations=Counter(add=71), weight=4321)
    made: dict[str, Any] = {
        "drive": load_drive("paper_spmsm"),
        "folder": GENERATED / "paper_spmsm",
        "proof": proof(link(row(0.4), name="guard"), link(row(3.0, 5.0), name="D-E"), drive="paper_spmsm"),
        "evidence": evidence,
        "runs": [run("no_load"), run("load_step")],
        "hard": [run("load_step", speed_error=np.where(np.arange(400) == 250, 9.0, 8.0))],
        "sweep": [
            SweepPoint(1e-4, "euler", False, {"start": 1.0, "angle": 9.876}),
            SweepPoint(1e-4, "exact", True, {"start": 2.0, "angle": 1.0}),
        ],
        "firmware": Gated("paper_spmsm", (check(),)),
        "earned": [earned],
    }  # fmt: skip
    return Chapter(**(made | changes))


BAD_PROOF = proof(link(), link(row(1.0)), drive="paper_spmsm")
FAULTS: dict[str, dict[str, Any]] = {
    "a link": {"proof": BAD_PROOF},
    "the first firmware check": {"firmware": Gated("d", (check("failed"), check()))},
    "the last firmware check": {"firmware": Gated("d", (check(), check("failed")))},
    "the first run": {"runs": [run("no_load", angle_error=90.0), run()]},
    "the last run": {"runs": [run("no_load"), run(angle_error=90.0)]},
}


def test_what_is_no_fault_of_a_chapter() -> None:
    assert _chapter().good
    assert _chapter(hard=[run(angle_error=90.0)]).good, "the cheap inverter is shown, not judged"
    assert _chapter(firmware=Gated("d", (check("not run"), check("not proved")))).good


def test_run_ends_with_0_where_no_gate_was_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first floor has no firmware checks, and shows none."""
    chapters = [_chapter(firmware=None)]
    monkeypatch.setattr(runtime.commands.run, "run_drives", lambda *rest: Ran([], chapters, Path("page.html"), True))
    code, said = command("run")
    assert (code, "a gate" in said) == (0, False), said


@pytest.mark.parametrize("runs", [0, 1])
def test_run_ends_with_1_if_nothing_was_simulated(runs: int, monkeypatch: pytest.MonkeyPatch) -> None:
    chapters = [_chapter(), _chapter(runs=[run()] * runs)]
    monkeypatch.setattr(runtime.commands.run, "run_drives", lambda *rest: Ran([], chapters, Path("page.html"), True))
    code, said = command("run")
    assert (code, "not simulated" in said) == (1 - runs, not runs), said


@pytest.mark.parametrize("place", [0, 1])
@pytest.mark.parametrize("fault", FAULTS)
def test_run_ends_with_1_whatever_failed(fault: str, place: int, monkeypatch: pytest.MonkeyPatch) -> None:
    chapters = [_chapter(), _chapter()]
    monkeypatch.setattr(runtime.commands.run, "run_drives", lambda *rest: Ran([], chapters, Path("page.html"), True))
    code, said = command("run")
    assert (code, said.count("a gate")) == (0, 2), said
    chapters[place] = _chapter(**FAULTS[fault])
    assert not chapters[place].good
    code, said = command("run")
    assert code == 1, said
    assert ("NOT proved" in said) is (fault == "a link")
    assert ("LOST LOCK" in said) is fault.endswith("run")
    assert ("failed" in said) is fault.endswith("check")


def heads_of(page: Path) -> list[list[str]]:
    """The heads of a page's tables, in order."""
    rows = re.findall(r"<tr>((?:<th[^>]*>[^<]*</th>)+)</tr>", page.read_text(encoding="utf-8"))
    return [[html.unescape(cell) for cell in re.findall(r"<th[^>]*>([^<]*)</th>", row)] for row in rows]


def _page(tmp_path: Path, *chapters: Chapter) -> str:
    write_page(tmp_path / "report" / "index.html", list(chapters))
    text = (tmp_path / "report" / "index.html").read_text(encoding="utf-8")
    return " ".join(html.unescape(re.sub(r"<[^>]*>", " ", text)).split())


@pytest.mark.parametrize(
    ("changes", "flags"),
    [
        ({}, (True, False, False)),
        ({"proof": BAD_PROOF}, (False, False, False)),
        ({"firmware": Gated("d", (check("failed"),))}, (False, False, False)),
        ({"firmware": Gated("d", (check("not run"),))}, (True, True, False)),
        ({"proof": proof(link(), unchecked=["f, not checked"])}, (True, False, True)),
    ],
)
def test_one_chapter_of_two_decides_what_the_page_begins_with(
    changes: dict[str, Any], flags: tuple[bool, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[tuple[bool, ...]] = []

    def render(**keys: Any) -> str:
        said.append((keys["passed"], keys["missing"], keys["unchecked"]))
        return ""

    monkeypatch.setattr("runtime.report.page.page_template", lambda path: SimpleNamespace(render=render))
    monkeypatch.setattr("runtime.report.page._chapter", lambda chapter: None)
    for chapters in ([_chapter(**changes), _chapter()], [_chapter(), _chapter(**changes)]):
        write_page(tmp_path / "report" / "index.html", chapters)
    assert said == [flags, flags]


def _broken_page(tmp_path: Path) -> str:
    """A chapter whose proof is broken and of which one gate fails."""
    effects = [IterationEffect("d", "cubature", 0.25, {}, True, "unexplained")]
    links = [
        link(row(2.5e-11, 1e-10, "P_pred")),
        link(row(3e-10, 1e-9, "S"), name="B-C"),
        link(row(0.4), name="guard", kind="ickf"),
        link(row(3.0, 0.0, compared=4321), name="D-E"),
        link(row(2e-3, 1e-2, "omega"), name="C-D"),
        link(row(7e-2, 1e-2, "omega"), name="D-chip"),
    ]
    broken = proof(*links, effects=effects, notes=["a note of the proof"], drive="paper_spmsm")
    checks = (check(figure="12 cycles", detail=("a remark",)), check("failed", name="another gate"))
    runs = [
        run("no_load", "ckf", 3.0, 4.0),
        run("load_step", "ickf", np.where(np.arange(400) == 100, -6.0, -5.0), 90.0),
    ]
    return _page(tmp_path, _chapter(proof=broken, firmware=Gated("paper_spmsm", checks), runs=runs))


def test_the_page_shows_what_the_chapters_hold(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kept: Kept) -> None:
    monkeypatch.setattr("runtime.report.cost_figures.svg_text", kept)
    said = _broken_page(tmp_path)
    manifest = find_folder("paper_spmsm").manifest["filters"]
    for words in (
        f"pmsm-ickf {__version__}",
        "Chain of proof: BROKEN",
        "T = 20 us",
        "NOT proved.",
        "link D-E on some data: x_pred (eq. 16) deviates by 3, allowed 0",
        "16 P_pred 2.5e-11",
        "16 S 3.0e-10",
        "guard ickf, cubature gain a claim some data 10 80 % of allowed",
        "ckf some data 4,321 3",
        "a gate a subject 12 cycles measured passed",
        "another gate a subject a figure measured failed",
        "a remark",
        "ckf 2.0e-03",
        "ckf 7.0e-02",
        "cubature 0.25 sigma unexplained",
        "a note of the proof",
        "no_load ckf 3.00 3.000 4.000 locked",
        "load_step ickf 6.00 5.00 5.000 90.000 LOST LOCK",
        "load_step, PWM ckf 8.00 9.00 8.000 0.000 locked",
        "100 us euler loses lock 9.88",
        "100 us exact 2.0 r/min 1.00",
        "literal 4321 71 0",
        "What each pass earns (ckf)",
        *(
            " ".join(
                map(
                    str,
                    [
                        kind,
                        *(f["operations"][op] for op in ("add", "mul", "div", "sqrt", "sincos")),
                        f["estimated_cycles"],
                        f["state_words"],
                    ],
                )
            )
            for kind, f in manifest.items()
        ),
    ):
        assert words in said, words
    assert heads_of(tmp_path / "report" / "index.html")[-4:] == [
        ["scenario", "filter", "start, r/min", "load step, r/min", "steady rms, r/min", "angle after start, deg", ""],
        ["T", "discretisation", "largest error", "angle after start, deg"],
        ["filter", "add", "mul", "div", "sqrt", "sincos", "estimated cycles", "state, 16-bit words"],
        ["form, each with what the one before has", "weight", *OPERATIONS],
    ]
    for words in (
        "1000 r/min",
        "0.05 A rms",
        "2 us of dead time",
        "12-bit currents",
        "computed from published ones (k = 2.5)",
    ):
        assert words in said, words
    four = [run(scenario, kind) for scenario in ("no_load", "load_step") for kind in ("ckf", "ickf")]
    assert "Chain of proof: all links hold ." in _page(tmp_path, _chapter(runs=four))
    assert ["claim", "theirs", "ours", "why"] in heads_of(tmp_path / "report" / "index.html")
    missing = Gated("paper_spmsm", (check("not run"),))
    assert "Chain of proof: all links that could be run here hold ." in _page(tmp_path, _chapter(firmware=missing))


#: Name of a chapter -> was its proof made by an earlier run, were its firmware checks (None: it has none), is it told.
MADE_BEFORE: dict[str, tuple[bool, bool | None, bool]] = {
    "nothing": (False, False, False),
    "proof": (True, False, True),
    "firmware": (False, True, True),
    "both": (True, True, True),
    "proof alone": (True, None, True),
    "nothing alone": (False, None, False),
}


def test_the_page_says_of_each_chapter_whether_an_earlier_run_made_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kept: Kept
) -> None:
    monkeypatch.setattr("runtime.report.cost_figures.svg_text", kept)
    chapters = []
    for old_proof, old_firmware, _ in MADE_BEFORE.values():
        made = None if old_firmware is None else Gated("paper_spmsm", (check(),), kept=old_firmware)
        chapters.append(_chapter(proof=proof(link(), drive="paper_spmsm", kept=old_proof), firmware=made))
    parts = _page(tmp_path, *chapters).split("paper_spmsm surface machine,")[1:]
    told = {name: "were kept from an earlier run" in part for name, part in zip(MADE_BEFORE, parts, strict=True)}
    assert told == {name: wanted for name, (*_, wanted) in MADE_BEFORE.items()}
