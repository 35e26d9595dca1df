"""The report page shows what proofs, runs and gates hold; and what makes ``run`` fail."""

from __future__ import annotations

import html
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import runtime.commands.run
from codegen.fast.ablation import OPERATIONS
from codegen.output.version import __version__
from model.drives.load import load_drive
from runtime.estimator.folder import GENERATED, find_folder
from runtime.firmware.gates import Gated
from runtime.proof.result import IterationEffect
from runtime.report.chapter import Chapter
from runtime.report.page import write_page
from runtime.report.run import Ran
from tests.judges.made import Kept, check, command, earned, evidence, link, proof, row, run, sweep

# --- run: a chapter, the page, the exit code


def _chapter(**changes: Any) -> Chapter:
    made: dict[str, Any] = {
        "drive": load_drive("paper_spmsm"),
        "folder": GENERATED / "paper_spmsm",
        "proof": proof(link(row(0.4), name="guard"), link(row(3.0, 5.0), name="D-E"), drive="paper_spmsm"),
        "evidence": evidence(),
        "runs": [run("no_load"), run("load_step")],
        "hard": [run("load_step", speed_error=np.where(np.arange(400) == 250, 9.0, 8.0))],
        "sweep": sweep(),
        "firmware": Gated("paper_spmsm", (check(),)),
        "earned": [earned()],
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


#: What stands on the page of a chapter whose proof is broken and of which one gate fails.
#: Columns of the table of costs.
COUNTED = ("add", "mul", "div", "sqrt", "compare", "select", "branch", "call")
SHOWN = (
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
)


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
        *SHOWN,
        *(
            " ".join(
                map(
                    str,
                    [
                        kind,
                        *(f["operations"][op] for op in COUNTED),
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
        ["filter", *COUNTED, "estimated cycles", "state, 16-bit words"],
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
