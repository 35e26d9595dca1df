"""docs/results.md is what the command writes of the JSON that was kept, and its tables say what the JSON says."""

from __future__ import annotations

import importlib.util
import json
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

from model.drives.load import shipped_drives

ROOT = Path(__file__).parents[1]


def load_results() -> ModuleType:
    sys.path.insert(0, str(ROOT / "benchmarks"))
    spec = importlib.util.spec_from_file_location("results", ROOT / "benchmarks" / "results.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["results"] = module
    spec.loader.exec_module(module)
    return module


results = load_results()


def test_the_page_is_what_the_command_writes() -> None:
    assert (ROOT / "docs" / "results.md").read_text(encoding="utf-8") == results.page()


def test_what_is_kept_is_a_subject_and_what_is_not_is_said() -> None:
    kept = {file.stem for file in (ROOT / "docs" / "results").glob("*.json")}
    assert kept <= set(results.SUBJECTS)
    assert results.page().count(results.UNMEASURED) == len(results.SUBJECTS) - len(kept)


def test_cycles_are_those_of_the_folders_as_they_are() -> None:
    """``python benchmarks/results.py --measure cycles`` takes a second."""
    import cycles

    kept = json.loads((ROOT / "docs" / "results" / "cycles.json").read_text(encoding="utf-8"))
    assert kept["cycles"]["cycles"] == cycles.table(list(shipped_drives()), "f28335")
    manifest = json.loads((ROOT / "generated" / "paper_spmsm" / "manifest.json").read_text(encoding="utf-8"))
    facts = manifest["filters"]["ickf"]["interrupt"]["RUNNING"]
    (row,) = (
        row for row in kept["cycles"]["cycles"]["rows"] if (row["drive"], row["filter"]) == ("`paper_spmsm`", "ickf")
    )
    assert row["interrupt, RUNNING"] == f"**{facts['estimated_cycles']} ({100 * facts['share_of_sample']:.0f} %)**"
    assert row["interrupt, STARTING"] == ""


def cells(table: str) -> list[list[str]]:
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()]


def test_the_loop_table_says_what_its_json_says() -> None:
    run = {"drive": "d", "filter": "ckf", "scenario": "load_step", "locked": False}
    run |= {"start": 1.5, "load_step": 7.25, "steady_rms": 0.5, "angle": 0.125}
    other = run | {"filter": "ickf", "start": 1.625, "locked": True}
    head, _, first, second = cells(results.loop_table([run, other]))
    assert dict(zip(head, first, strict=True)) == {
        "drive": "`d`",
        "filter": "ckf",
        "scenario": "load_step",
        "start": "1.5",
        "load step": "7.25",
        "steady rms": "0.5",
        "angle, deg": "0.125",
        "locked": "**no**",
    }
    assert second[1] == "ickf"
    assert second[-1] == "yes"


def test_equal_filters_share_a_row() -> None:
    run = {"drive": "d", "filter": "ckf", "scenario": "no_load", "locked": True}
    run |= {"start": 1.0, "load_step": 2.0, "steady_rms": 3.0, "angle": 4.0}
    (row,) = cells(results.loop_table([run, run | {"filter": "ickf"}]))[2:]
    assert row[1] == "ckf = ickf"
    assert row[4] == "-"  # nothing was loaded


def test_faults_median_and_worst() -> None:
    runs = [{"time": time} for time in (0.001, 0.009, 0.002, None)]
    case = {"drive": "d", "filter": "ckf", "fault": "lost_sample", "runs": runs, "alone": [{"time": None}] * 4}
    (kept,) = results.condense_faults({"faults": [case]})
    assert (kept["recovered"], kept["median_s"], kept["worst_s"], kept["alone"]) == (3, 0.002, 0.009, 0)
    row = cells(results.faults_table([kept]))[-1]
    assert row == ["`d`", "ckf", "lost sample", "3 of 4", "2.0 (9.0)", "0 of 4"]


@pytest.mark.parametrize(
    ("used", "passed", "said"), [(0.0, True, "identical"), (0.5, True, "50 %"), (0.5, False, "**NOT proved**")]
)
def test_a_link_that_failed_is_not_proved(used: float, passed: bool, said: str) -> None:
    row = {"worst": used, "allowed": 1.0, "compared": 7}
    proof = {
        "drive": "d",
        "passed": passed,
        "links": [{"name": "A-B", "rows": [row, row | {"worst": 0.0}], "passed": passed}],
    }
    table = cells(results.proof_table(results.condense_proof({"verify": {"drives": [proof]}})))
    assert table[2] == ["A-B", said]
    assert table[3] == ["numbers compared", "14"]
    assert table[4][1] == ("proved" if passed else "**NOT proved**")


def test_what_was_not_compared_to_a_bound_counts_as_all_of_it() -> None:
    row = {"worst": 1.0, "allowed": 0.0, "compared": 1}
    proof = {"drive": "d", "passed": False, "links": [{"name": "D-E", "rows": [row], "passed": False}]}
    assert results.condense_proof({"verify": {"drives": [proof]}})["d"]["links"]["D-E"]["used"] == 1.0


def test_study_success_and_quantiles() -> None:
    share = {"rate": 0.934, "low": 0.917, "high": 0.948}
    numbers = {"0.5": 34.0, "0.95": 74.0}
    group = {"drive": "d", "filter": "ckf", "success": share, "locked_within_0.2_s": share | {"rate": 0.5}}
    group["quantiles"] = dict.fromkeys(("start", "load_step", "steady_rms", "angle"), numbers)
    study = {"vary": [], "seed": 1, "runs": 1000, "groups": [group]}
    row = cells(results.study_table(results.condense_study({"d": study})))[-1]
    assert row == ["`d`", "ckf", "1000", "93.4 (91.7 .. 94.8)", "50.0 (91.7 .. 94.8)", *["34 (74)"] * 4]


def test_readme_is_short_and_says_nothing_twice() -> None:
    """At most 9 kB; no heading stands twice, as after a merge gone wrong."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.encode()) <= 9 * 1024
    headings = re.findall(r"^#+ .*$", text, re.MULTILINE)
    assert len(headings) == len(set(headings))


def test_kept_json_is_json() -> None:
    for file in (ROOT / "docs" / "results").glob("*.json"):
        json.loads(file.read_text(encoding="utf-8"))
