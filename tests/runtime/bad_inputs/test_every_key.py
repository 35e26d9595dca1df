"""Every key of a drive file and of a facts file with values of other types and beyond its range: one line each."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from typing import Any

import pytest

from model.drives.load import _SECTIONS, DRIVES, accepted_range, parse_drive
from model.schema import DriveError
from runtime.design.facts import EXAMPLE, SECTIONS, parse_facts
from runtime.system.errors import UserError

SERVO = tomllib.loads((DRIVES / "servo_24v.toml").read_text(encoding="utf-8"))
#: Of no key the right one, but for a list of no adaptive states, a choice of yes and no, and a target's name: which
#: names there are is not for the drive file's reader to know; generate refuses "x".
WRONG = (
    *("x", "1", "", True, False, [], {}, [1, "x"], [True], ["1"], float("nan"), float("inf"), 1e308, -1e308),
    *(10**400, -1, tomllib.loads("t = 1979-05-27")["t"]),
)
RIGHT = [
    ("model", "adaptive", []),
    *(("target", "constant_time", yes) for yes in (True, False)),
    ("target", "name", "x"),
]
FILES: list[tuple[Any, Any, Callable[[Any], Any]]] = [
    (_SECTIONS, SERVO, lambda tables: parse_drive(tables, "d.toml")),
    (SECTIONS, EXAMPLE, lambda tables: parse_facts(tables, "f.toml")),
]


def refused(parse: Callable[[Any], Any], tables: Any) -> bool:
    try:
        parse(tables)
    except (DriveError, UserError) as error:
        return len(str(error).splitlines()) == 1
    return False


@pytest.mark.parametrize(("sections", "whole", "parse"), FILES, ids=["drive", "facts"])
def test_every_key_of_another_type_or_beyond_its_range(sections: Any, whole: Any, parse: Any) -> None:
    parse(whole)
    taken = []
    for title, section in sections.items():
        for key in section.model_fields:
            _, low, high = accepted_range(section, key)
            beyond = [] if low is None or high is None else [low - abs(low) * 1e-6 - 1e-9, high * (1 + 1e-6)]
            for value in (*WRONG, *beyond):
                if not refused(parse, {**whole, title: {**whole.get(title, {}), key: value}}):
                    taken.append((title, key, value))
        for value in (1, "x", [], True, [{}]):
            if not refused(parse, {**whole, title: value}):
                taken.append((title, value))
    assert all(entry in RIGHT for entry in taken), [entry for entry in taken if entry not in RIGHT]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"line_resistance": 0.6}, "state the same quantity"),
        ({"stator_resistance": None}, "is missing; one is enough"),
        ({"inductance_d": 1e-3}, "motor.line_inductance"),
        ({"line_inductance": None, "inductance_d": 1e-3}, "go together"),
        ({"ke_v_per_krpm": 5.0}, "state the same quantity"),
        ({"kv_rpm_per_v": 100.0}, "state the same quantity"),
        ({"magnet_flux": None}, "is missing; one is enough"),
        ({"poles": 8}, "state the same quantity"),
        ({"poles": 7, "pole_pairs": None}, "poles"),
        ({"inertia": None}, "motor.inertia is missing"),
        ({"inertia": -1e-5}, "motor.inertia = -1e-05"),
        ({"pole_pairs": 4.5}, "pole_pairs"),
        ({"statr_resistance": 0.3}, "Did you mean 'stator_resistance'?"),
    ],
)
def test_facts_that_are_twice_or_missing(changes: dict[str, Any], said: str) -> None:
    motor = {key: value for key, value in {**EXAMPLE["motor"], **changes}.items() if value is not None}
    with pytest.raises(UserError, match=said):
        parse_facts({**EXAMPLE, "motor": motor}, "f.toml")
