"""The facts file asked for: what is asked, and what an answer may be, derive from :mod:`runtime.design.facts`.

>>> questions = every_question()
>>> len(questions), questions[0].ways
(21, (('stator_resistance',), ('line_resistance',)))
>>> meaning("motor", "line_inductance"), default("motor", "line_inductance"), default("tolerance", "inductance")
('inductance between two terminals, round rotor (H)', None, 0.1)
>>> read_answer("0.25 mH", "H"), read_answer("20 %", "of the value"), read_answer("4", "pairs"), read_answer("x", "H")
(0.00025, 0.2, 4, 'x')
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

from pydantic import ValidationError

from model.drives.load import accepted_range, explain
from runtime.design.facts import SECTIONS, FactsFile, Section

#: Letters before a unit, and what they scale it by.
PREFIXES = {"": "1", "n": "1e-9", "u": "1e-6", "\u00b5": "1e-6", "\u03bc": "1e-6", "m": "1e-3", "k": "1e3"}
#: Units as people write them, and as a facts file does.
SPELLINGS = {
    "rpm": "r/min",
    "Nm": "N m",
    "Ohm": "ohm",
    "\u03a9": "ohm",
    "\u2126": "ohm",
    "deg": "degrees",
    "kgm^2": "kg m^2",
}
#: Unit of a tolerance.
SHARE = "of the value"

Tables = dict[str, Any]


@dataclass(frozen=True)
class Question:
    """A fact that is asked for: its section, and the ways to state it, each a key or some that go together."""

    section: str
    ways: tuple[tuple[str, ...], ...]


def every_question() -> list[Question]:
    """Every key of a facts file once, in the order of the file; alternatives are one question."""
    found = []
    for title, section in SECTIONS.items():
        asked: set[str] = set()
        for key in section.model_fields:
            if key not in asked:
                ways = next((ways for ways in section.alternatives if (key,) in ways or key in ways[0]), ((key,),))
                asked |= {name for way in ways for name in way}
                found.append(Question(title, ways))
    return found


def section_of(title: str) -> type[Section]:
    """A section of the facts file; "" is what stands before all of them.

    Parameters
    ----------
    title : str
    """
    return SECTIONS[title] if title else FactsFile


def unit_of(section: str, key: str) -> str:
    """The unit a fact is stated in; "" where it has none.

    Parameters
    ----------
    section, key : str
    """
    return accepted_range(section_of(section), key)[0].strip()


def meaning(section: str, key: str) -> str:
    """What a fact is, and its unit.

    Parameters
    ----------
    section, key : str
    """
    words, unit = section_of(section).model_fields[key].description or key, unit_of(section, key)
    if not unit or unit in words.split():
        return words
    return f"{words} {unit}" if unit == SHARE else f"{words} ({unit})"


def default(section: str, key: str) -> Any:
    """What is taken where nothing is answered; None where nothing can be, or that is no number.

    Parameters
    ----------
    section, key : str
    """
    return None if is_needed(section, key) else section_of(section).model_fields[key].default


def is_needed(section: str, key: str) -> bool:
    """Whether a fact, once asked for, must be answered.

    Parameters
    ----------
    section, key : str
    """
    holder = section_of(section)
    stated = any(key in way for ways in holder.alternatives for way in ways)
    return stated or holder.model_fields[key].is_required()


def read_answer(text: str, unit: str) -> Any:
    """An answer as a facts file would state it: a number, with its unit and a prefix or without; else the text itself.

    Parameters
    ----------
    text : str
    unit : str
        Of the fact.
    """
    spelled = [unit, *(other for other, meant in SPELLINGS.items() if meant == unit)]
    scales = {"": "1", **{prefix + word: scale for word in spelled for prefix, scale in PREFIXES.items()}}
    if unit == SHARE:
        scales |= {SHARE: "1", "%": "1e-2"}
    found = re.fullmatch(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d{1,3})?)\s*(.*)", text, re.ASCII | re.IGNORECASE)
    if found is None or found[2] not in scales:
        return text
    if re.fullmatch(r"[+-]?\d{1,15}", found[1]) and scales[found[2]] == "1":
        return int(found[1])
    return float(Decimal(found[1]) * Decimal(scales[found[2]]))


def refusal(tables: Tables, section: str, key: str, last: bool = False) -> str | None:
    """Why the facts file would refuse what was answered, in its words; None where it would not.

    Parameters
    ----------
    tables : dict
        All answers so far, as tables of a facts file.
    section, key : str
        What was answered last; "" and "name" for the drive's name.
    last : bool
        Whether nothing more of this section is asked: what its facts say against each other counts, too.
    """
    place = (section, key) if section else (key,)
    answered = tables.get(section, {}) if section else tables
    if key not in answered and is_needed(section, key):
        return explain({"loc": place, "type": "missing", "input": None}, SECTIONS, FactsFile)
    try:
        FactsFile.model_validate(tables)
    except ValidationError as error:
        for problem in error.errors():
            if problem["loc"][:2] == place or (last and problem["loc"] == (section,)):
                return explain(problem, SECTIONS, FactsFile)
    return None
