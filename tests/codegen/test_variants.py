"""The fast form of any machine, mechanics, discretisation, kind and gain, with random numbers, is the literal form."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
import pytest

from codegen.evidence.box import sample_box
from codegen.fast import steps as fast_steps
from codegen.fast.frame import Frame, turns_freely
from codegen.generate import draft
from model.drives.load import load_drive
from model.filters import FilterStep
from model.machines import MACHINES
from model.machines.base import Pair, Rotor
from model.machines.state_space import build
from model.machines.surface import SurfacePMSM
from model.schema import Drive
from runtime.proof import link_guard
from runtime.proof.link_ab import Situations
from runtime.proof.link_bc import link_bc
from runtime.proof.result import Link
from runtime.proof.second import second_motor
from tests.conftest import thoroughly, variant

DRAWS = 60

#: Every machine with every mechanics and discretisation; gains and second kinds in turn. A third is in ``make test``.
VARIANTS = [
    pytest.param(
        machine,
        mechanics,
        discretization,
        ("cubature", "jacobian")[(k + m + d) % 2],
        ["ickf", ("ckf", "ekf", "ukf")[(k + 2 * m + d) % 3]],
        marks=[pytest.mark.thorough] * ((k + m + d) % 3 != 1),
    )
    for k, machine in enumerate(sorted(MACHINES))
    for m, mechanics in enumerate(("constant_speed", "load_torque"))
    for d, discretization in enumerate(("euler", "exact"))
]


def random_drive(rng: np.random.Generator, words: dict[str, Any], gain: str, kinds: list[str]) -> Drive:
    """A shipped drive's numbers, each up to 60 % off."""
    machine, mechanics = words["machine"], words["mechanics"]
    drive = load_drive("ipmsm_flux" if machine == "salient_flux" else "paper_spmsm")

    def near(value: float) -> float:
        return float(value * rng.uniform(0.4, 1.6))

    m, f = drive.motor, drive.filter
    motor: dict[str, Any] = {
        name: near(getattr(m, name)) for name in ("stator_resistance", "magnet_flux", "inertia", "inductance_d")
    }
    motor["inductance_q"] = near(m.inductance_q) if machine == "salient_flux" else motor["inductance_d"]
    motor["pole_pairs"] = int(rng.integers(1, 6))
    extra = [0.02] if mechanics == "load_torque" else []
    tuning = {
        "process_noise": [near(value) for value in [*f.process_noise[:4], *extra]],
        "initial_covariance": [near(value) for value in [*f.initial_covariance[:4], *extra]],
        "measurement_noise": [near(value) for value in f.measurement_noise],
        "initial_state": None,
        "kinds": kinds,
        "gain": gain,
    }
    return variant(drive, motor=motor, model={**words, "sample_time": 4e-5}, filter=tuning)


def module_of(drive: Drive, form: str) -> tuple[ModuleType, dict[str, FilterStep]]:
    """The Python module alone: no C, no certificate."""
    made = draft(drive, form)
    return made.load(form), made.steps


def situations(drive: Drive, draws: int) -> Situations:
    """Random states, covariances and inputs from the operating box."""
    box = sample_box(drive, build(drive), draws)
    n = len(box.x)
    P = np.empty((draws, n, n))
    rows, columns = np.tril_indices(n)
    P[:, rows, columns] = P[:, columns, rows] = box.P.T
    return Situations("operating box", box.x.T, P, box.u.T, box.y.T, {}, [], np.zeros(draws))


def compare(drive: Drive) -> list[Link]:
    literal, steps = module_of(drive, "literal")
    fast, _ = module_of(drive, "fast")
    where = situations(drive, DRAWS)
    return [link_bc(literal, fast, steps[kind], drive.name, where) for kind in steps]


@pytest.mark.parametrize(("machine", "mechanics", "discretization", "gain", "kinds"), VARIANTS)
def test_fast_is_literal(machine: str, mechanics: str, discretization: str, gain: str, kinds: list[str]) -> None:
    """B-C's own bound, 1e-9 of each sigma, in x_pred, P_pred, every iterate, x and P."""
    words = {"machine": machine, "mechanics": mechanics, "discretization": discretization}
    rng = np.random.default_rng(sum(map(ord, machine + mechanics + discretization)))
    for link in compare(random_drive(rng, words, gain, kinds)):
        assert link.passed, (link.kind, [(row.stage, row.worst) for row in link.rows if not row.passed])


@pytest.mark.parametrize(("name", "order"), [("paper_spmsm", [3, 2, 0, 1]), *thoroughly(("ipmsm_flux", [1, 3, 0, 2]))])
def test_fast_is_literal_in_any_order_of_the_root(name: str, order: list[int]) -> None:
    """And it is another filter than in the state's own order: the points lie elsewhere."""
    drive = variant(load_drive(name), filter={"kinds": ["ckf", "ickf", "ukf"], "gain": "cubature"})
    states = [state.name for state in build(drive).states]
    ordered = variant(drive, filter={"root_order": [states[k] for k in order]})
    for link in compare(ordered):
        assert link.passed, (link.kind, [(row.stage, row.worst) for row in link.rows if not row.passed])
    (literal, _), (fast, steps) = module_of(drive, "literal"), module_of(ordered, "fast")
    crossed = link_bc(literal, fast, steps["ckf"], name, situations(drive, DRAWS))
    assert max(row.worst for row in crossed.rows) > 1e-3


def test_an_iterate_that_does_not_settle_is_known_no_better_than_its_roundings(monkeypatch: pytest.MonkeyPatch) -> None:
    """A current at its limit, far from what is expected: each iterate grows what the one before was rounded by.

    The literal form does what the reference does, so what is between them is rounding; without the measure of it the
    link would fail here.
    """
    drive = variant(load_drive("ipmsm_flux"), filter={"kinds": ["ickf"], "root_order": None})
    module, steps = module_of(drive, "literal")
    drawn = situations(drive, 200)

    def link() -> Link:
        draws = drawn.x, drawn.P, drawn.u, drawn.y
        return link_guard.link_guard(
            module, steps["ickf"], drive.name, "literal", drive.model_dump(), second_motor(drive), draws
        )

    assert link().passed
    monkeypatch.setattr(link_guard, "ROUNDINGS", 0)
    assert [row.stage for row in link().rows if not row.passed] == [
        "x, good, bad and missing",
        "P, good, bad and missing",
    ]


# --- the turning frame


def test_a_turned_form_is_right_where_another_is_cheaper_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """With noise of its own on either axis, which the frame mixes."""
    monkeypatch.setattr(fast_steps, "_cheapest", lambda forms, means: forms[0])
    words = {"machine": "salient_flux", "mechanics": "constant_speed", "discretization": "exact"}
    drive = random_drive(np.random.default_rng(5), words, "cubature", ["ckf"])
    assert drive.filter.measurement_noise[0] != drive.filter.measurement_noise[1]
    for link in compare(drive):
        assert link.passed, (link.kind, [(row.stage, row.worst) for row in link.rows if not row.passed])


class LopsidedPMSM(SurfacePMSM):
    """Made up: the beta axis has its own decay and a product, and its sensor sees alpha. No frame is like another."""

    def euler(self, z: Pair, v: Pair, omega_e: Any, theta: Any) -> Any:
        sampled = super().euler(z, v, omega_e, theta)
        a, b = sampled.z
        return type(sampled)((a, b + 0.05 * z[1] + 0.01 * z[0] * z[1]), sampled.torque_at, sampled.named)

    def currents(self, z: Pair, rotor: Rotor) -> tuple[Pair, dict[str, Any]]:
        return (z[0], z[1] + 0.1 * z[0] * rotor.cos), {}


class ProductPMSM(SurfacePMSM):
    """Made up: beside a current its sensor shows the product of both, whose slope is a state as it stands."""

    def currents(self, z: Pair, rotor: Rotor) -> tuple[Pair, dict[str, Any]]:
        return (z[0], z[0] * z[1]), {}


@pytest.mark.parametrize("gain", ["jacobian", "cubature"])
def test_what_the_last_iterate_saw_is_of_that_iterate(monkeypatch: pytest.MonkeyPatch, gain: str) -> None:
    """x^j moves on after its slope is taken: what follows the loop must not take the one for the other."""
    monkeypatch.setitem(MACHINES, "surface", ProductPMSM)
    (link,) = compare(variant(load_drive("paper_spmsm"), filter={"kinds": ["ickf"], "gain": gain}))
    assert any(row.stage == "x_next, j = 1" for row in link.rows)
    assert link.passed, [(row.stage, row.worst) for row in link.rows if not row.passed]


def lopsided(monkeypatch: pytest.MonkeyPatch) -> Drive:
    monkeypatch.setitem(MACHINES, "surface", LopsidedPMSM)
    return variant(load_drive("paper_spmsm"), filter={"kinds": ["ckf", "ickf"], "gain": "cubature"})


def test_shipped_machines_turn_freely(drive: Drive) -> None:
    for discretization in ("euler", "exact"):
        assert turns_freely(build(variant(drive, model={"discretization": discretization})))


def test_a_lopsided_machine_does_not_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not turns_freely(build(lopsided(monkeypatch)))


def test_without_the_symmetry_no_frame_is_used_and_the_filter_is_right(monkeypatch: pytest.MonkeyPatch) -> None:
    drive = lopsided(monkeypatch)

    def refuse(*args: Any) -> Any:
        raise AssertionError("a frame was turned for a machine that has no such symmetry")

    monkeypatch.setattr(Frame, "at", refuse)
    for link in compare(drive):
        assert link.passed, (link.kind, [(row.stage, row.worst) for row in link.rows if not row.passed])


def test_a_frame_turned_against_the_symmetry_would_be_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """The oracle itself: the same machine, the test of symmetry overruled, the turned form chosen."""
    drive = lopsided(monkeypatch)
    monkeypatch.setattr(fast_steps, "turns_freely", lambda model: True)
    monkeypatch.setattr(fast_steps, "_cheapest", lambda forms, means: forms[0])
    assert not all(link.passed for link in compare(drive))
