"""supervisor.svg and the tables of REPORT.md: whole, the same every time, and nothing lies on anything else."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from itertools import combinations, pairwise
from pathlib import Path

import pytest

from codegen.render.diagram import CORNER, MARGIN, RADIUS, Arc, Box, lay_out, render_diagram
from codegen.render.transitions import longest_stays, modes_context, spell_condition, stay_texts
from model.drives.load import load_drive
from model.filters.conditions import All, Compare, Either, Entry, Not, Number
from model.machines.state_space import build
from model.supervisor import Supervisor, supervisor
from model.supervisor.words import at_least
from runtime.proof.exhaust import longest_stay
from tests.conftest import ALL_DRIVES

pytestmark = pytest.mark.unit

GENERATED = Path(__file__).parents[2] / "generated"


def machine_of(name: str) -> Supervisor:
    drive = load_drive(name)
    return supervisor(drive, build(drive))


def picture(name: str) -> str:
    machine = machine_of(name)
    return render_diagram(machine, name, stay_texts(machine, load_drive(name).model.sample_time))


@pytest.mark.parametrize("name", ALL_DRIVES)
def test_the_picture_is_the_same_every_time_and_in_the_folder(name: str) -> None:
    assert picture(name) == picture(name) == (GENERATED / name / "supervisor.svg").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ALL_DRIVES)
def test_every_mode_and_transition_is_in_it(name: str) -> None:
    machine = machine_of(name)
    words = [element.text for element in ET.fromstring(picture(name)).iter("{http://www.w3.org/2000/svg}text")]
    for mode in machine.modes:
        assert words.count(mode.name) == 1
    numbers = sorted(int(word) for word in words if word and word.isdigit())
    assert numbers == list(range(1, len(machine.transitions) + 1))
    assert words.count("rival") == (len(machine.modes) if machine.rivals else 0)
    assert sum(str(word).startswith("at most") for word in words) == sum(not mode.lasting for mode in machine.modes)


@pytest.mark.parametrize("name", ALL_DRIVES)
def test_arcs_lead_where_the_transitions_do(name: str) -> None:
    machine = machine_of(name)
    boxes, arcs = lay_out(machine)
    place = {box.mode.name: box for box in boxes}
    for arc in arcs:
        for number, transition in arc.numbers:
            assert machine.transitions[number - 1] is transition
            assert (transition.source, transition.target or transition.source) == (arc.source, arc.target)
        for end, mode in ((arc.start, arc.source), (arc.end, arc.target)):
            assert place[mode].top < end < place[mode].top + place[mode].height
        assert arc.right == (place[arc.target].top >= place[arc.source].top)


def numbers_of(arc: Arc) -> list[tuple[float, int]]:
    return [(y, arc.lane) for y in arc.places]


@pytest.mark.parametrize("name", ALL_DRIVES)
def test_nothing_lies_on_anything_else(name: str) -> None:
    boxes, arcs = lay_out(machine_of(name))
    for above, below in pairwise(boxes):
        assert below.top - above.top - above.height > MARGIN
    for right in (False, True):
        side = [arc for arc in arcs if arc.right == right]
        ends = sorted(y for arc in side for y in (arc.start, arc.end))
        assert min(b - a for a, b in pairwise(ends)) >= 10.0, "heads of arrows have room"
        for one, other in combinations(side, 2):
            apart = one.span[1] < other.span[0] or other.span[1] < one.span[0]
            assert apart or one.lane != other.lane, "two arcs share a lane"
        places = [place for arc in side for place in numbers_of(arc)]
        for (y, lane), (other_y, other_lane) in combinations(places, 2):
            assert lane != other_lane or abs(y - other_y) > 2 * RADIUS
        for arc in side:
            assert all(arc.span[0] + CORNER <= y - RADIUS and y + RADIUS <= arc.span[1] - CORNER for y in arc.places)
            across = [y for other in side if other.lane > arc.lane for y in (other.start, other.end)]
            assert all(abs(y - line) > RADIUS for y in arc.places for line in across), "a line through a number"
    assert crossings(arcs) <= 1


def crossings(arcs: list[Arc]) -> int:
    """How often the way from a box to a lane crosses a lane that is nearer."""
    return sum(
        one.span[0] < y < one.span[1]
        for one in arcs
        for other in arcs
        if one.right == other.right and other.lane > one.lane
        for y in (other.start, other.end)
    )


def test_words_stay_within_their_box() -> None:
    boxes: list[Box] = lay_out(machine_of("ipmsm_flux"))[0]
    text = picture("ipmsm_flux")
    for box in boxes:
        lines = re.findall(r'font-size="11.5">([^<]*)<', text)
        assert " ".join(lines).count(box.mode.meaning) == 1, "every word of a meaning, in lines"
        assert max(map(len, lines)) <= 52


@pytest.mark.parametrize("name", ALL_DRIVES)
def test_the_longest_stays_are_those_of_the_table(name: str) -> None:
    """They are stated beside the limits; the proof goes through every state."""
    machine = machine_of(name)
    stays = longest_stays(machine)
    assert set(stays) == {mode.name for mode in machine.modes if not mode.lasting}
    assert stays == {mode: longest_stay(machine, (mode,)) for mode in stays}


def test_a_picture_that_is_another_machines_is_another() -> None:
    assert picture("ipmsm") != picture("paper_spmsm")


def test_guards_in_words() -> None:
    count, small = at_least("since", "MOST"), Compare("<=", Entry("phase", 1), Number(0.5))
    assert spell_condition(All((count, All((small, small))))) == "since >= MOST and phase[1] <= 0.5 and phase[1] <= 0.5"
    assert (
        spell_condition(All((count, Either((small, count))))) == "since >= MOST and (phase[1] <= 0.5 or since >= MOST)"
    )
    assert spell_condition(Not(All((small, count)))) == "not (phase[1] <= 0.5 and since >= MOST)"
    assert spell_condition(Not(small)) == "not phase[1] <= 0.5"


@pytest.mark.parametrize("name", ALL_DRIVES)
def test_the_report_lists_modes_and_transitions(name: str) -> None:
    text = (GENERATED / name / "REPORT.md").read_text(encoding="utf-8")
    assert "## Modes of the drive" in text
    assert "](supervisor.svg)" in text
    machine = machine_of(name)
    context = modes_context(machine, load_drive(name).model.sample_time)
    for number, transition in enumerate(machine.transitions, start=1):
        target = transition.target or "stays"
        assert f"\n| {number} | {transition.source} | {target} | {transition.why} | `" in text
    for item in context["modes"]:
        assert re.search(rf"\n\| {item['mode'].name} \|.* {re.escape(item['stay'])} \|\n", text)
    for limit in re.findall(
        r"`[^`]*\b([A-Z]+_[A-Z_]+)\b[^`]*`", text.split("## Modes of the drive")[1].split("## Budget")[0]
    ):
        assert limit.startswith("REASON_") or any(limit == one.name for one in machine.limits), limit
