"""The cost benchmark: what it counts with, that its hand-written peer is the same filter, and that no row is lost."""

from __future__ import annotations

import os
import platform
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from codegen.fast.ablation import ABLATION, build_ablation, earned, earnings
from codegen.ir.layout import lay_out
from codegen.passes import optimise
from model.drives.load import load_drive
from model.machines.state_space import build
from model.schema import Drive
from runtime.estimator.compiler import build_program
from runtime.firmware.callgrind import count_instructions, instructions_per_step
from runtime.system.errors import UserError

# The benchmark is a script with modules beside it, not a package of the project.
sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))

from costs import blocks, growth, ours, peers, step_tables
from costs.counting import Inputs, Missing, deviation, host_instructions, trace
from costs.table import Table, Wanted

#: float32 spacing over sigma, some ten roundings a step, forgotten within some ten steps: 6e-8 x 100; ten times that.
FLOAT32 = 6e-5


def _need_valgrind() -> None:
    if shutil.which("valgrind") is None:
        if os.environ.get("CI"):
            pytest.fail("valgrind not found (Debian: valgrind)")
        pytest.skip("valgrind not found (Debian: valgrind)")


@pytest.fixture(scope="module")
def paper() -> tuple[ours.Problem, Inputs]:
    problem = ours.Problem.of(load_drive("paper_spmsm"))
    return problem, step_tables.inputs_of(problem, step_tables.Length(steps=300, settle=100))


# --- the counter

ASSEMBLY = """
int loops(void);
__asm__(".text\\n.globl loops\\n.type loops, @function\\nloops:\\n"
        "movl $1000, %ecx\\n1: decl %ecx\\njne 1b\\nxorl %eax, %eax\\nret\\n.size loops, . - loops\\n");
int main(int argc, char **argv)
{
    int k, n = 0;
    for (k = 0; argc > 1 && argv[1][k]; k++) { n = 10 * n + (argv[1][k] - '0'); }
    for (k = 0; k < n; k++) { loops(); }
    return 0;
}
"""


@pytest.mark.skipif(platform.machine() != "x86_64", reason="the loop is written in x86-64 assembly")
def test_a_known_loop_is_counted_exactly() -> None:
    """movl, 1000 times (decl, jne), xorl, ret: 2003 instructions a call."""
    _need_valgrind()
    program = build_program({"loop.c": ASSEMBLY}, {})
    assert count_instructions(program, "loops", "3") == 3 * 2003
    assert instructions_per_step(program, "loops", 2, 7) == 2003
    with pytest.raises(UserError, match="'elsewhere' was never entered"):
        count_instructions(program, "elsewhere", "3")


# --- the peers are the same filter


@pytest.mark.parametrize("iterations", [1, 3])
def test_the_hand_written_filter_is_ours(paper: tuple[ours.Problem, Inputs], iterations: int) -> None:
    """Against the reference in float64, freely running: float32 rounding and no more."""
    assert deviation(peers.handwritten(iterations), paper[1]) < FLOAT32


def test_casadis_own_c_is_ours(paper: tuple[ours.Problem, Inputs]) -> None:
    assert deviation(peers.casadi_c(paper[0].drive), paper[1]) < FLOAT32


@pytest.mark.parametrize(("good", "bad"), [("2.0f * S[i][c]", "1.9f * S[i][c]"), ("- emf * rotor", "+ emf * rotor")])
def test_another_filter_is_noticed(paper: tuple[ours.Problem, Inputs], good: str, bad: str) -> None:
    candidate = peers.handwritten()
    text = candidate.sources["handwritten_ckf.c"]
    assert good in text
    wrong = replace(candidate, sources={**candidate.sources, "handwritten_ckf.c": text.replace(good, bad)})
    assert deviation(wrong, paper[1]) > 10 * FLOAT32


# --- our forms


@pytest.mark.thorough
def test_every_rung_is_the_same_filter(paper: tuple[ours.Problem, Inputs]) -> None:
    for ablation in ABLATION:
        assert deviation(ours.candidate(paper[0], "ckf", ablation)[0], paper[1]) < FLOAT32, ablation.name


@pytest.mark.thorough
def test_no_rung_costs_more_than_the_one_before(drive: Drive) -> None:
    weights = [item.weight for item in earnings(build(drive), "ckf", "cubature")]
    assert weights == sorted(weights, reverse=True)


@pytest.mark.thorough
def test_the_last_rung_is_the_shipped_form(drive: Drive) -> None:
    from codegen.generate import build_steps

    model, steps = build_steps(drive)
    for kind, step in steps.items():
        shipped = earned(ABLATION[-1], step, {b.name: lay_out(optimise(b), model.constants) for b in step.blocks})
        assert shipped == earned(ABLATION[-1], *build_ablation(model, kind, drive.filter.gain, ABLATION[-1]))


def test_the_fast_form_takes_fewer_instructions_than_any_peer_here(paper: tuple[ours.Problem, Inputs]) -> None:
    """Ratios of counts, which compilers move by some percent: far from 1."""
    _need_valgrind()
    problem, inputs = paper
    fast = host_instructions(ours.candidate(problem, "ckf")[0], inputs)
    others = [ours.candidate(problem, "ckf", ours.LITERAL)[0], peers.casadi_c(problem.drive), peers.handwritten()]
    for other in others:
        assert fast / host_instructions(other, inputs) < 0.5, other.label


@pytest.mark.thorough
def test_a_sixth_state_needs_no_change_of_the_packages() -> None:
    """The benchmark's own mechanics: six states, and both forms of its filter are the same."""
    problem = growth.problem(growth.DriftingLoad)
    assert [state.name for state in problem.model.states][4:] == ["load_torque", "torque_rate"]
    inputs = step_tables.inputs_of(ours.Problem.of(load_drive("spmsm_load_torque")), step_tables.Length(200, 0))
    sigma = np.column_stack([inputs.sigma, np.full(200, 10.0)])
    inputs = replace(inputs, sigma=sigma, reference=np.zeros((200, 6)))
    literal, fast = (ours.candidate(problem, "ckf", ablation)[0] for ablation in (ours.LITERAL, ours.SHIPPED))
    moved = deviation(literal, inputs)
    assert moved > 1.0
    inputs = replace(inputs, reference=trace(literal, inputs))
    assert deviation(fast, inputs) < 2 * FLOAT32


# --- the tables


def _rows(table: Table) -> dict[str, dict[str, object]]:
    return {str(next(iter(row.values()))): dict(row) for row in table.rows}


def test_what_is_missing_is_named_in_its_row(monkeypatch: pytest.MonkeyPatch) -> None:
    """No valgrind, no cross compiler, no SymForce: nine rows all the same, each saying what it lacks."""
    found = shutil.which
    hidden = {"valgrind", "arm-none-eabi-gcc", "qemu-system-arm"}
    monkeypatch.setattr(shutil, "which", lambda name, *args, **kw: None if name in hidden else found(name, *args, **kw))
    monkeypatch.setitem(sys.modules, "symforce", None)
    monkeypatch.setitem(sys.modules, "symforce.symbolic", None)
    table = step_tables.peers_table(step_tables.Length(20, 5), lambda text: None)
    rows = _rows(table)
    assert len(rows) == 9
    for label, row in rows.items():
        cells = [row[column] for column in (step_tables.X86, step_tables.M4, step_tables.TEXT, step_tables.STACK)]
        assert all(isinstance(cell, Missing) for cell in cells), label
    assert "valgrind not found" in rows[step_tables.FAST][step_tables.X86].why  # type: ignore[attr-defined]
    assert "symforce" in rows["SymForce's C++"][step_tables.X86].why  # type: ignore[attr-defined]
    assert all(item.row["verdict"] == "not measured" for item in step_tables.wanted(table, None))
    assert table.facts()["rows"][2][step_tables.X86] == {"not_measured": "valgrind not found (Debian: valgrind)"}


@pytest.mark.thorough
def test_every_row_is_there_or_says_why() -> None:
    length = step_tables.Length(20, 5)
    peers_rows = step_tables.peers_table(length, lambda text: None)
    forms = step_tables.forms_table(length, lambda text: None, drives=["ipmsm_flux"])
    assert (len(peers_rows.rows), len(forms.rows)) == (9, 2)
    _all_there(peers_rows)
    _all_there(forms)


@pytest.mark.parametrize("kind", ["ckf", "ickf"])
def test_the_parts_of_a_step_are_all_of_it(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the listings count of whole blocks, a way of counting of their own, is what the parts add up to."""
    monkeypatch.setattr(shutil, "which", lambda name: None)
    rows = _rows(blocks.blocks_table(step_tables.Length(20, 5), lambda text: None, ["ipmsm_flux"]))
    problem = ours.Problem.of(load_drive("ipmsm_flux"))
    for column, ablation in (("literal", ours.LITERAL), ("fast", ours.SHIPPED)):
        step, listings = build_ablation(problem.model, kind, problem.drive.filter.gain, ablation)
        count = earned(ablation, step, listings).operations
        expected = sum(count.values()) + 17 * count["sincos"] + 10 * count["small_angle"]
        of_kind = {label: row[column] for label, row in rows.items() if label.startswith(f"ipmsm_flux, {kind}")}
        *parts, whole, instructions = of_kind.values()
        assert len(parts) == {"ckf": 3, "ickf": 4}[kind]
        assert sum(map(float, parts)) == whole == expected  # type: ignore[arg-type]
        assert isinstance(instructions, Missing)


@pytest.mark.thorough
def test_operations_need_no_tool(monkeypatch: pytest.MonkeyPatch) -> None:
    """The gain of passes, and how cost grows, but for the instructions."""
    monkeypatch.setattr(shutil, "which", lambda name, which=shutil.which: None if name == "valgrind" else which(name))
    length = step_tables.Length(20, 5)
    passes = step_tables.passes_table(length, lambda text: None, drives=["paper_spmsm"])
    sizes = growth.growth_table(length, lambda text: None)
    assert (len(passes.rows), len(sizes.rows)) == (len(ABLATION), 6)
    for table in (passes, sizes):
        _all_there(table)
        assert all(isinstance(row[step_tables.X86], Missing) for row in table.rows)
    for row in sizes.rows:
        assert sum(float(str(row[part])) for part in growth.COLUMNS) == row["weight"]


def _all_there(table: Table) -> None:
    for row in table.rows:
        assert set(table.columns) <= set(row)
        for cell in row.values():
            assert cell.why if isinstance(cell, Missing) else isinstance(cell, str) or cell >= 0


def test_the_python_table_has_a_row_for_every_peer_and_back_end() -> None:
    from costs import python_time

    table = python_time.python_table(20, lambda text: None)
    assert len(table.rows) == 6
    for label, row in _rows(table).items():
        cell = row["deviation, sigma"]
        assert cell.why if isinstance(cell, Missing) else float(cell) < FLOAT32, label  # type: ignore[arg-type]


def test_a_figure_is_judged_on_its_side() -> None:
    assert Wanted("cost", 3.0, 4.0).row["verdict"] == "reached"
    assert Wanted("gain", 3.0, 4.0, at_least=True).row["verdict"] == "not reached"
    assert Wanted("cost", Missing("no tool"), 4.0).row["verdict"] == "not measured"
