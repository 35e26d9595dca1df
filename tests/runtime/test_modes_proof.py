"""Links supervisor and modes hold of the shipped drives, and what they say is what the drive does."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
import pytest

from model.drives.load import load_drive
from model.filters.conditions import All, Compare, Entry, Name, Number, Reported, square
from model.machines.state_space import build
from model.supervisor import Supervisor, supervisor
from runtime.estimator.folder import GENERATED, GeneratedFolder
from runtime.proof import exhaust
from runtime.proof.abstract import Interrupt, Machine, Ways, relevant
from runtime.proof.exhaust import explore, link_exhaust, longest_stay, small_limits
from runtime.proof.link_drive import Compiled, any_memory, link_drive
from runtime.proof.link_drive_lanes import link_drive_lanes
from runtime.proof.link_modes import link_modes
from runtime.proof.modes import Modes
from runtime.proof.result import Link
from runtime.proof.second import second_motor
from tests.conftest import EVERY_DRIVE, thoroughly

#: One with a rival filter, one without.
WITH, WITHOUT = "ipmsm_flux", "paper_spmsm"


def declared(name: str) -> Supervisor:
    drive = load_drive(name)
    return supervisor(drive, build(drive))


def by_hand(name: str) -> Modes:
    drive = load_drive(name)
    return Modes(drive.model_dump(), flux=build(drive).states[0].unit == "Wb")


def exhausted(name: str) -> Link:
    return link_exhaust(declared(name), name, load_drive(name).model.sample_time, by_hand(name).longest)


def linked(name: str, **effort: tuple[int, int]) -> Link:
    drive = load_drive(name)
    folder = GeneratedFolder(GENERATED / name)
    return link_modes(folder, folder.kinds[0], "as shipped", drive.model_dump(), second_motor(drive), **effort)


# --- the modes by hand


@pytest.mark.parametrize("name", EVERY_DRIVE)
def test_every_transition_is_what_is_told_of_it(name: str) -> None:
    link = linked(name)
    assert link.passed, [str(row) for row in link.rows if not row.passed]
    counts = {row.stage: row.compared for row in link.rows if row.meaning == "times too seldom"}
    assert set(counts) == set(by_hand(name).events)
    assert len(counts) == len(declared(name).transitions)
    assert min(counts.values()) >= 5
    assert f" {sum(counts.values())} transitions" in link.data


@pytest.mark.parametrize("name", EVERY_DRIVE)
def test_supervisor_and_drive_in_c_have_the_bits_of_the_module(name: str) -> None:
    folder = GeneratedFolder(GENERATED / name)
    for kind in folder.kinds[:1]:
        hand, bits = link_drive(folder, kind, "as shipped", load_drive(name).model_dump())
        assert (hand.name, bits.name) == ("supervisor", "D-E")
        assert hand.passed, [str(row) for row in hand.rows]
        assert bits.passed, [str(row) for row in bits.rows]
        assert {row.stage for row in bits.rows} >= {"supervisor, every field", "lanes = scalars", "drive, every field"}


@pytest.mark.parametrize("name", EVERY_DRIVE)
def test_supervisor_and_drive_in_lanes_have_the_bits_of_the_scalar_c(name: str) -> None:
    folder = GeneratedFolder(GENERATED / name)
    link = link_drive_lanes(folder, folder.kinds[0], "as shipped", load_drive(name).model_dump())
    assert link.passed, [str(row) for row in link.rows]
    counts = {row.stage: row.compared for row in link.rows}
    assert counts["transitions, in lanes"] == len(declared(name).transitions)
    assert counts["modes of the drive, in lanes"] == len(declared(name).modes)


@pytest.mark.thorough
@pytest.mark.parametrize("name", [WITH, WITHOUT])
def test_longer_walks_find_no_more(name: str) -> None:
    assert linked(name, effort=(120, 300)).passed
    folder = GeneratedFolder(GENERATED / name)
    for kind in folder.kinds:
        data = load_drive(name).model_dump()
        links = link_drive(folder, kind, "as shipped", data, effort=(200, 600))
        for link in (*links, link_drive_lanes(folder, kind, "as shipped", data, effort=(200, 600))):
            assert link.passed, [str(row) for row in link.rows]


@pytest.mark.parametrize(("name", "count"), [(WITH, 20_000), *thoroughly((WITHOUT, 500_000), (WITH, 500_000))])
def test_whatever_is_in_memory_a_mode_comes_out_and_what_it_allows(name: str, count: int) -> None:
    folder = GeneratedFolder(GENERATED / name)
    row = any_memory(Compiled(folder, folder.kinds[0]), folder.module, count, seed=7)
    assert row.passed, row
    assert row.compared == count


# --- every state


@pytest.mark.parametrize("name", EVERY_DRIVE)
def test_every_state_of_the_machine_is_as_it_must_be(name: str) -> None:
    link = exhausted(name)
    assert link.passed, [str(row) for row in link.rows if not row.passed]
    stays = dict(re.match(r"(\w+) ends: (\d+)", row.stage).groups() for row in link.rows if " ends: " in row.stage)  # type: ignore[union-attr]
    T = load_drive(name).model.sample_time
    assert float(stays["PROBING"]) * T == pytest.approx(2e-3, rel=0.05)
    assert float(stays["WAITING"]) * T == pytest.approx(2e-3, rel=0.05)
    assert float(stays["CATCHING"]) * T == pytest.approx(20e-3, rel=0.05)
    assert ("STARTING" in stays) == by_hand(name).two


@pytest.mark.parametrize(("name", "enough"), thoroughly((WITHOUT, 3), (WITH, 3)))
def test_larger_limits_change_no_verdict(name: str, enough: int, monkeypatch: pytest.MonkeyPatch) -> None:
    few = len(explore(declared(name)).edges)
    monkeypatch.setattr(exhaust, "ENOUGH", enough)
    assert exhausted(name).passed
    assert len(explore(declared(name)).edges) > few


def test_small_limits_keep_the_order_of_the_times() -> None:
    machine = declared(WITH)
    small, large = small_limits(machine), {limit.name: limit.value for limit in machine.limits}
    times = [name for name in small if name.endswith("_SAMPLES")]
    for one in times:
        for other in times:
            assert (small[one] < small[other]) == (large[one] < large[other]), (one, other)
    assert small["TRIP_SQUARED"] == large["TRIP_SQUARED"]


def test_what_is_reached_is_little_and_has_every_mode() -> None:
    found = explore(declared(WITH))
    assert {state[0] for state in found.edges} == {mode.name for mode in declared(WITH).modes}
    assert 100 < len(found.edges) < 10_000


def test_a_mode_that_lasts_has_no_longest_stay() -> None:
    assert longest_stay(declared(WITHOUT), ("RUNNING",)) == np.inf


# --- one interrupt with free answers


def test_ways_are_all_and_each_once() -> None:
    ways, seen = Ways(), []
    for _ in ways.runs():
        first = ways.choose(2)
        seen.append((first, ways.choose(3) if first else 0))
    assert seen == [(0, 0), (1, 0), (1, 1), (1, 2)]


def answers(*conditions: object) -> Iterator[tuple[bool, ...]]:
    machine = declared(WITHOUT)
    abstract = Machine(machine, {limit.name: limit.value for limit in machine.limits}, relevant(machine))
    ways = Ways()
    for _ in ways.runs():
        interrupt = Interrupt(abstract, ("RESTING", (("failures", 3),)), ways)
        yield tuple(interrupt.holds(condition) for condition in conditions)  # type: ignore[arg-type]


def test_answers_about_one_quantity_agree() -> None:
    i = square(Entry("phase", 0))
    zero, shows, trip = (Compare("<=", i, Name(f"{name}_SQUARED")) for name in ("ZERO", "PROBE", "TRIP"))
    ordered = {(True, True, True), (False, True, True), (False, False, True), (False, False, False)}
    assert set(answers(zero, shows, trip)) == ordered
    assert set(answers(trip, shows, zero)) == {found[::-1] for found in ordered}
    beyond = Compare(">", i, Name("TRIP_SQUARED"))
    assert set(answers(trip, beyond)) == {(True, False), (False, True), (False, False)}  # the last: no number
    other = Compare("<=", square(Entry("phase", 1)), Name("ZERO_SQUARED"))
    assert len(set(answers(zero, other))) == 4


def test_a_limit_that_is_met_is_told_from_one_that_is_passed() -> None:
    x, one = Entry("turning", 0), Number(1.0)
    assert set(answers(Compare(">=", x, one), Compare(">", x, one))) == {(True, True), (True, False), (False, False)}
    assert set(answers(Compare("<=", x, one), Compare(">=", x, one))) >= {(True, True)}


def test_integers_are_compared_and_bits_are_free() -> None:
    few = Compare(">=", Entry("failures"), Name("MAX_FAILURES"))
    assert set(answers(few)) == {(False,)}
    bit = Reported(("RESTARTED",))
    assert set(answers(bit, All((bit, bit)))) == {(True, True), (False, False)}
