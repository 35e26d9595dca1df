"""[tolerance] in the generated text: nothing without it, and what it costs."""

from __future__ import annotations

from typing import Any

import casadi as ca
import pytest

from codegen.fast.dependent_rows import DependentRow, follows
from codegen.fast.frame import turns_freely
from codegen.generate import count, draft, generate_bare, print_c
from codegen.ir.expr import Expr
from codegen.ir.graph import Graph
from codegen.render.equations import readable
from model.drives.load import load_drive
from model.machines import MACHINES, Machine, SurfacePMSM
from model.machines.state_space import build
from model.schema import Tolerance
from tests.conftest import ALL_DRIVES
from tests.model.test_tolerance import ALL, tolerant

pytestmark = pytest.mark.unit


@pytest.mark.parametrize("form", ["fast", "literal"])
def test_zeros_are_the_same_text_as_no_section(form: str) -> None:
    drive = load_drive("spmsm_load_torque")
    plain, zeros = (generate_bare(tolerant(drive, t), form).files for t in (None, Tolerance()))
    assert {name: text for name, text in plain.items() if name != "manifest.json"} == {
        name: text for name, text in zeros.items() if name != "manifest.json"
    }


@pytest.mark.parametrize("name", ALL_DRIVES)
def test_every_share_that_is_printed_has_its_name(name: str) -> None:
    """No number of [tolerance] stands in the C without a name, and G is in the report entry by entry."""
    drive = tolerant(load_drive(name))
    model = build(drive)
    entries = sum(not column[i].is_zero() for column in model.G.values() for i in range(len(model.states)))
    lines = readable(drive).G
    assert len(lines) == entries
    assert {str(left) for left, _ in lines} == {
        f"G_{state.name}_{letter}"
        for letter, column in model.G.items()
        for i, state in enumerate(model.states)
        if not column[i].is_zero()
    }
    assert {c.name for c in model.constants} >= {str(s) for s in ca.symvar(ca.vertcat(*model.G.values()))} - {
        *(state.name for state in model.states),
        "v_alpha",
        "v_beta",
    }


def test_cost_of_three_uncertain_data() -> None:
    """Of the load-torque drive's 690 additions and multiplications at most a tenth more, and no division."""
    drive, sums = load_drive("spmsm_load_torque"), []
    for tolerance in (None, ALL):
        made = draft(tolerant(drive, tolerance))
        found = count(drive, print_c(made.about, made.steps, made.listings))["ckf"].filter.operations
        sums.append((found["add"] + found["mul"], found["div"], found["sincos"]))
    (plain, *others), (more, *same) = sums
    assert plain < more <= 1.1 * plain
    assert same == others


class _UnequalAxes(SurfacePMSM):
    """A winding of two inductances that stand still; where they are equal nothing tells, but for their errors."""

    def euler(self, z: Any, v: Any, omega_e: Any, theta: Any) -> Any:
        return Machine.euler(self, z, v, omega_e, theta)

    def derivative(self, z: Any, v: Any, omega_e: Any, rotor: Any) -> Any:
        alpha, beta = super().derivative(z, v, omega_e, rotor)
        return alpha, beta * self.par.L_d / self.par.L_q


def test_a_frame_turns_only_if_G_turns_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(MACHINES, "surface", _UnequalAxes)
    drive = load_drive("paper_spmsm")
    assert turns_freely(build(tolerant(drive, None)))
    assert turns_freely(build(tolerant(drive, Tolerance(stator_resistance=0.2))))
    assert not turns_freely(build(tolerant(drive, Tolerance(inductance=0.1))))


def test_theta_follows_omega_in_G_as_in_f() -> None:
    model = build(tolerant(load_drive("spmsm_load_torque")))
    graph = Graph()
    share = model.numeric(ca.jacobian(model.f[3], model.x[4])) / model.numeric(ca.jacobian(model.f[2], model.x[4]))
    for factor, true in ((float(share), True), (2 * float(share), False)):
        row = DependentRow(((2, Expr(graph, graph.const(factor))),), [])
        assert follows(row, 3, model) is true
    assert not follows(DependentRow(((2, Expr(graph, graph.input("a"))),), []), 3, model)
    assert follows(DependentRow(((2, Expr(graph, graph.input("a"))),), []), 3, build(load_drive("paper_spmsm")))
