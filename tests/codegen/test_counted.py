"""The ledger against a count of what the text executes: no step does more than it says, and some come close.

The other count shares nothing with the ledger: a C++ compiler chooses operators that count, and the text is run
(:mod:`tests.codegen.counted`).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from codegen.evidence import ledger
from codegen.evidence.box import sample_box
from codegen.evidence.emitted import EmittedError
from codegen.evidence.ledger import Program
from codegen.targets.find import default_target
from model.drives.load import load_drive
from model.machines.state_space import build
from model.supervisor.table import MODES
from runtime.estimator.folder import GENERATED, GeneratedFolder
from runtime.firmware.link_ef import RECORDINGS
from runtime.firmware.subject import Part, Subject, subjects
from runtime.folders.stated import stated_drive
from runtime.proof.own_trajectory import trajectory_of
from runtime.proof.starts import Start, from_box, piece_count, pieces
from tests.codegen.counted import KINDS, Count, Executed, Piece, compiler, run
from tests.conftest import ALL_DRIVES, shipped_accounts, thoroughly

pytestmark = pytest.mark.skipif(compiler() is None, reason="needs a C++ compiler (Debian: apt-get install g++)")

PRICES = default_target().prices
STEPS = 300
#: Share of the ledger's price that the dearest step reaches at least: over the shipped drives it is 0.88 to 0.99 of a
#: filter, 0.90 to 0.96 of a controller, 0.81 to 0.90 of a drive.
REACHED: dict[Part, float] = {"": 0.87, "foc": 0.88, "drive": 0.81}
#: A mean of the normalised innovation squared with which a filter restarts.
LOST = 1e30


def said(program: Program, function: str, n_max: int, given: dict[str, int] | None = None) -> Count:
    """What the ledger counts, selections and branches together."""
    count = program.count(function, n_max, given or {})
    count["choice"] = count["select"] + count["branch"]
    return {kind: count[kind] for kind in KINDS}


def priced(count: Count) -> int:
    """Cycles at the typical price, a choice as a branch."""
    assert PRICES is not None
    return PRICES.total({**count, "branch": count["choice"]}, PRICES.factors[0])


def recorded(folder: GeneratedFolder, subject: Subject) -> list[Piece]:
    """What the processors are given: trajectory, draws from the box, inputs to reject, every transition of a drive."""
    recording = RECORDINGS[subject.part](folder, STEPS)
    return [Piece(segment.inputs, segment.fields, {}, segment.option) for segment in recording.segments]


def worst_starts(folder: GeneratedFolder) -> Iterator[Piece]:
    """Where bits are proved from, turns wide in one column and in all; and all of that in a filter that is lost."""
    module, drive = folder.module, stated_drive(folder)
    trajectory = trajectory_of(drive, 4 * piece_count(module) + 1)
    box = sample_box(drive, build(drive), 16)
    for start in (pieces(module, trajectory.u[1:], trajectory.y[1:]), *from_box(module, box)):
        for lane in range(start.lanes):
            yield from _lane(module.COVARIANCE, start, lane)


def _lane(covariance: str, start: Start, lane: int) -> Iterator[Piece]:
    later = {f"x[{k}]": float(value) for k, value in enumerate(start.x[:, lane])}
    later |= {f"{covariance}[{k}]": float(value) for k, value in enumerate(start.words[:, lane])}
    inputs = np.column_stack([start.u[:, :, lane], start.y[:, :, lane]])
    yield Piece(inputs[:4], later=later)
    yield Piece(inputs[:1], later={**later, "nis": LOST, "repairs": 0})


def lost_in(folder: GeneratedFolder, subject: Subject) -> Iterator[Piece]:
    """Every piece again, with a filter, and a rival where there is one, whose turns are all wide and which are lost."""
    *_, words = (piece.later for piece in list(worst_starts(folder))[2:4])
    for piece in recorded(folder, subject):
        owners = [subject.filter_place] + ["supervisor.rival."] * (piece.fields.get("supervisor.rivals", 0) == 1)
        later = {f"{owner}{name}": value for owner in owners for name, value in words.items()}
        yield Piece(piece.inputs[:1], piece.fields, later, piece.option)


@lru_cache(maxsize=4)
def executed(name: str, kind: str, part: Part) -> tuple[Subject, Executed]:
    """A subject of a shipped drive, run on all of its inputs; once a process."""
    folder = GeneratedFolder(GENERATED / name)
    stem = f"{name}_{kind}_{part}" if part else f"{name}_{kind}"
    (subject,) = (each for each in subjects(folder) if each.name == stem)
    more = lost_in(folder, subject) if part else worst_starts(folder)
    with TemporaryDirectory() as path:
        return subject, run(subject, [*recorded(folder, subject), *more], Path(path))


def complaints(subject: Subject, ran: Executed, program: Program, n_max: int) -> list[str]:
    """Where more was executed than the ledger says, or, where it knows of no branch, anything else."""
    found = []
    whole = {-1: said(program, f"{subject.name}_step", n_max)}
    for place, mode in enumerate(MODES):
        fields = {"mode": place, "runs": mode.runs, "torque": mode.torque, "rivals": mode.rivals}
        whole[place] = said(program, f"{subject.name}_step", n_max, fields) if subject.part == "drive" else whole[-1]
    for number, (mode, step) in enumerate(zip(ran.modes, ran.steps, strict=True)):
        allowed = whole.get(mode, whole[-1])
        found += [
            f"step {number}: {kind} {step[kind]} > {allowed[kind]}" for kind in KINDS if step[kind] > allowed[kind]
        ]
    for name, (least, most) in ran.functions.items():
        told = _function(program, name, n_max)
        straight = told is not None and program.count(name, n_max)["branch"] == 0
        if straight and not least == most == told:
            found.append(f"{name}: {least} to {most}, not {told}")
        if told is not None:
            found += [f"{name}: {kind} {most[kind]} > {told[kind]}" for kind in KINDS if most[kind] > told[kind]]
    return found


def _function(program: Program, name: str, n_max: int) -> Count | None:
    """The ledger of a function; None of those that are not of the text, or whose loops only a call bounds."""
    try:
        return said(program, name, n_max)
    except EmittedError:
        return None


def reached(subject: Subject, ran: Executed, program: Program, n_max: int) -> float:
    """The dearest step's share of the ledger's price."""
    return max(map(priced, ran.steps)) / priced(said(program, f"{subject.name}_step", n_max))


def _account(name: str, kind: str) -> tuple[Program, int]:
    account = shipped_accounts(name)[kind]
    return account.program, account.max_iterations


CASES: list[tuple[str, str, Part]] = [
    ("paper_spmsm", "ickf", ""),
    ("paper_spmsm", "ickf", "drive"),
    ("ipmsm_flux", "ickf", ""),
]
ALL = [
    (name, kind, part) for name in ALL_DRIVES for kind in load_drive(name).filter.kinds for part in ("", "foc", "drive")
]
EVERY_CASE = [*CASES, *thoroughly(*(case for case in ALL if case not in CASES))]


@pytest.mark.parametrize(("name", "kind", "part"), EVERY_CASE)
def test_no_step_executes_more_than_the_ledger_says(name: str, kind: str, part: Part) -> None:
    """Function by function, too; where nothing branches, exactly what it says."""
    subject, ran = executed(name, kind, part)
    program, n_max = _account(name, kind)
    assert len(ran.steps) >= STEPS
    assert complaints(subject, ran, program, n_max) == []
    exact = [least for each, (least, most) in ran.functions.items() if least == most == _function(program, each, n_max)]
    assert max(count["mul"] for count in exact) >= 50  # a whole block of the filter among them
    # What is left of it: turns small and wide at once, or halved oftener than any can be; every transition in one.
    assert reached(subject, ran, program, n_max) > REACHED[part]
    settled = np.median([priced(step) for step in ran.steps[STEPS // 4 : STEPS // 2]])
    assert 0.45 < settled / priced(said(program, f"{subject.name}_step", n_max)) < 0.85 or part


@pytest.mark.parametrize(
    "plant",
    [
        {"_ARITHMETIC": {"+": "add", "-": "add", "/": "div"}},
        {"_ARITHMETIC": {"+": "add", "*": "mul", "/": "div"}},
        {"_ARITHMETIC": {"+": "add", "-": "add", "*": "mul"}},
        {"_COMPARISONS": frozenset({"<", ">", ">="})},
    ],
    ids=["no mul", "no minus", "no div", "no <="],
)
def test_an_operation_that_the_ledger_drops_is_found(plant: dict[str, object], monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in plant.items():
        monkeypatch.setattr(ledger, name, value)
    _judged_wrong(monkeypatch)


@pytest.mark.parametrize("node", ["UnaryOp", "If", "For", "TernaryOp", "FuncCall"])
def test_a_node_that_the_ledger_passes_over_is_found(node: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its children count as before."""
    monkeypatch.setattr(ledger._Body, f"_count_{node}", ledger._Body._children)
    _judged_wrong(monkeypatch)


def _judged_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    """By one of those that are run anyway; counted anew, as a program keeps what it has counted without the plant."""
    for name in {name for name, *_ in CASES}:
        for account in shipped_accounts(name).values():
            monkeypatch.setattr(account.program, "known", {})
    assert any(complaints(*executed(*case), *_account(*case[:2])) for case in CASES)
