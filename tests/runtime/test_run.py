"""``run``: two floors, their page, and a verdict that anything wrong in them turns."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from model.drives.load import load_drive, shipped_drives
from runtime.cli import main
from runtime.drive import experiment
from runtime.drive.scenario import find_scenario
from runtime.firmware.gates import Gated
from runtime.firmware.static.check import Check
from runtime.proof.result import Proof
from runtime.proof.verify import Evidence
from runtime.report import page as page_module
from runtime.report import run as run_module
from runtime.report.run import Simulations
from tests.judges import made

CHECK = Check("E-F, Cortex-M4F", "paper_spmsm_ckf", "passed", "1000 steps x 26 words identical", "measured")


def proved() -> tuple[Proof, Evidence]:
    return made.proof(made.link(name="guard"), made.link(name="D-E"), drive="paper_spmsm"), made.evidence()


def simulated() -> Simulations:
    return Simulations([made.run()], [made.run()], made.sweep())


@pytest.fixture
def parts(monkeypatch: pytest.MonkeyPatch) -> dict[str, Callable[..., Any]]:
    """The pieces of a run, each made small and in this process; a test may exchange one."""
    pieces: dict[str, Callable[..., Any]] = {
        "prove_or_recall": lambda name, *more: proved(),
        "check_or_recall": lambda name, *more: Gated(name, (CHECK,)),
        "_simulated": lambda name, whole: simulated() if whole else replace(simulated(), hard=[], sweep=[]),
        "_earned": lambda name: [made.earned()],
    }
    for name in pieces:
        monkeypatch.setattr(run_module, name, lambda *arguments, piece=name: pieces[piece](*arguments))

    @contextmanager
    def here(count: int, words: Any = None) -> Iterator[Callable[..., Future[Any]]]:
        def submit(work: Callable[..., Any], *arguments: Any) -> Future[Any]:
            future: Future[Any] = Future()
            future.set_result(work(*arguments))
            return future

        yield submit

    monkeypatch.setattr(run_module, "workers", here)
    monkeypatch.setattr(run_module, "generate_drives", lambda *arguments, **more: [])
    return pieces


#: The figures of what is proved: the same evidence in every test here, drawn for the first.
OF_EVIDENCE = ("trajectory_figure", "drift_figure", "effect_figure")
DRAWN: dict[str, str] = {}


@pytest.fixture(autouse=True)
def _drawn_once(monkeypatch: pytest.MonkeyPatch) -> None:
    def once(name: str, draw: Callable[..., str]) -> Callable[..., str]:
        def drawn(*arguments: Any) -> str:
            if name not in DRAWN:
                DRAWN[name] = draw(*arguments)
            return DRAWN[name]

        return drawn

    for name in OF_EVIDENCE:
        monkeypatch.setattr(page_module, name, once(name, getattr(page_module, name)))


def ran(tmp_path: Path, *arguments: str) -> tuple[int, str]:
    """Exit code, and the page."""
    with pytest.raises(SystemExit) as end:
        main(["run", *arguments, "--build", str(tmp_path)])
    return int(end.value.code or 0), (tmp_path / "report" / "index.html").read_text()


def test_with_a_drive_the_page_has_everything(parts: dict[str, Any], tmp_path: Path) -> None:
    code, page = ran(tmp_path, "paper_spmsm")
    assert code == 0
    # The loop on the first screen; then the proof, whose filters are one, and the passes; modes, scenario, sweep.
    assert page.count("<svg") == 1 + 4 + 1 + 1 + 1
    assert "all links hold" in page
    assert "E-F, Cortex-M4F" in page
    assert "were not run" not in page
    assert not re.findall(r"(?:src|href)=\"(?!#)", page), "nothing is fetched from elsewhere"


def test_without_one_the_page_says_what_is_missing(
    parts: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, page = ran(tmp_path)
    assert code == 0
    assert page.count("<svg") == 1 + 3 + 1 + 1  # as above, without proof of one's own and sweep
    assert "all links that could be run here hold" in page
    assert "were not run: <code>pmsm-ickf run --all</code>" in page
    assert "Run: pmsm-ickf run --all" in capsys.readouterr().out


def test_all_is_all(parts: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[str] = []
    monkeypatch.setattr(run_module, "_chapters", lambda names, whole, *more: seen.extend([*names, str(whole)]) or [])
    with pytest.raises(SystemExit):
        main(["run", "--all", "--build", str(tmp_path)])
    assert seen == [*shipped_drives(), "True"]


def broken_proof() -> tuple[Proof, Evidence]:
    proof, evidence = proved()
    link = proof.links[1]
    row = replace(link.rows[0], worst=2 * link.rows[0].allowed)
    return replace(proof, links=[proof.links[0], replace(link, rows=(row, *link.rows[1:]))]), evidence


def lost() -> Simulations:
    found = simulated()
    run = found.runs[0]
    return replace(found, runs=[replace(run, x=run.x + 10.0)])


FAULTS: Sequence[tuple[str, Any, str, bool]] = (
    ("prove_or_recall", lambda name, *more: broken_proof(), "paper_spmsm: NOT proved", True),
    ("_simulated", lambda name, whole: lost(), "paper_spmsm: ckf lost the rotor in load_step", True),
    ("_simulated", lambda name, whole: Simulations([], [], []), "paper_spmsm: not simulated", True),
    (
        "check_or_recall",
        lambda name, *more: Gated(name, (CHECK, replace(CHECK, state="failed"))),
        "paper_spmsm: E-F, Cortex-M4F of paper_spmsm_ckf failed",
        False,
    ),
)


@pytest.mark.parametrize(("piece", "instead", "line", "first_floor"), FAULTS)
def test_what_is_wrong_ends_in_1_and_is_said(
    parts: dict[str, Any],
    piece: str,
    instead: Any,
    line: str,
    first_floor: bool,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    parts[piece] = instead
    code, page = ran(tmp_path, *([] if first_floor else ["paper_spmsm"]))
    out = capsys.readouterr().out
    assert code == 1
    assert line in out.splitlines()
    assert "FAILED: paper_spmsm" in out
    assert "GOOD" not in out
    assert ("BROKEN" in page) is ("simulated" not in piece)


def test_checks_that_could_not_be_run_are_counted(
    parts: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    parts["check_or_recall"] = lambda name, *more: Gated(name, (CHECK, replace(CHECK, state="not run")))
    code, page = ran(tmp_path, "paper_spmsm")
    assert code == 0
    assert "Not run here: 1 firmware checks" in capsys.readouterr().out
    assert "all links that could be run here hold" in page


def test_the_first_floor_simulates_both_scenarios_with_the_drives_filters(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[tuple[Any, ...]] = []
    monkeypatch.setattr(run_module, "simulate", lambda *arguments, **more: seen.append(arguments) or [])
    monkeypatch.setattr(run_module, "sample_time_sweep", lambda *arguments, **more: seen.append(arguments) or [])
    run_module._simulated("paper_spmsm", False)
    assert seen == [("paper_spmsm", name, ["ckf", "ickf"]) for name in ("no_load", "load_step")]
    seen.clear()
    run_module._simulated("paper_spmsm", True)
    assert ("paper_spmsm", "no_load", experiment.KINDS) in seen
    assert seen[-1] == ("paper_spmsm",), "the sweep"
    assert [find_scenario(arguments[1], load_drive("paper_spmsm")).name for arguments in seen[:-1]] == [
        "no_load",
        "load_step",
        "load_step",
    ]
