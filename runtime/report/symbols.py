"""The unit of every symbol of a drive's equations: of states, inputs and constants as stated, of all else by dimension.

A named intermediate states no unit. Its dimension follows from what it is made of, and a sum of unlike things is an
error in the equations: the units on the page are checked, not copied.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import sympy as sp

from codegen.render.equations import Readable
from model.machines.state_space import INPUTS, OUTPUTS, SIGNS, UNSURE
from model.quantities import Constant, Quantity

#: Powers of V, A, s and rad.
Dimension = tuple[int, int, int, int]
NONE: Dimension = (0, 0, 0, 0)

_BASES: dict[str, Dimension] = {
    "1": NONE, "V": (1, 0, 0, 0), "A": (0, 1, 0, 0), "s": (0, 0, 1, 0), "rad": (0, 0, 0, 1),
    "Wb": (1, 0, 1, 0), "H": (1, -1, 1, 0), "ohm": (1, -1, 0, 0), "N": (1, 1, 1, 0), "m": NONE,
}  # fmt: skip
#: Names of what intermediates are, the usual one of each dimension first.
_NAMES = (
    "1", "V", "A", "Wb", "N m", "rad/s", "rad", "s", "ohm", "H", "A/V", "A/Wb", "1/A", "A/rad", "A s", "A/H",
    "rad/s per N m",
)  # fmt: skip
#: Units of the data that formulas of constants name.
_DATA = {"stator_resistance": "ohm", "magnet_flux": "Wb", "R": "ohm", "L_d": "H", "L_q": "H", "psi_m": "Wb", "V_d": "V"}
#: Words of intermediates' names.
_MEANINGS = {
    "next": "a sample later", "mid": "at mid-interval", "between": "mean over the interval", "now": "now",
    "off": "what it is off", "e": "electrical", "d": "d axis", "q": "q axis",
    "alpha": "alpha axis", "beta": "beta axis",
    "i": "current", "v": "voltage", "psi": "flux linkage", "omega": "speed", "theta": "angle", "emf": "back-EMF",
    "step": "over a sample", "drive": "change by the voltage", "torque": "torque of the motor",
    "salient": "that saliency adds",
    "sign": "sign of a leg's current", "decay": "decay of the current", "coupling": "of the axes by the turning",
}  # fmt: skip


@dataclass(frozen=True)
class Symbol:
    """A letter of the equations: ``unit`` is "1" where it has none, "?" where its parts contradict each other."""

    symbol: sp.Symbol
    unit: str
    meaning: str


def symbols(equations: Readable, states: Iterable[Quantity]) -> list[Symbol]:
    """Every symbol that f, h, H and the inverter have, constants aside, in order of appearance.

    Parameters
    ----------
    equations : Readable
    states : iterable of Quantity
    """
    stated: dict[str, tuple[str, str]] = {q.name: (q.unit, q.meaning) for q in (*states, *INPUTS, *SIGNS, UNSURE)}
    stated |= {f"{q.name}_next": (q.unit, f"{q.meaning}, a sample later") for q in states}
    stated |= {f"y_{q.name}": (q.unit, f"{q.meaning}, expected") for q in OUTPUTS}
    stated |= {f"u_{axis}": ("V", f"commanded voltage, {axis} axis") for axis in ("alpha", "beta")}
    units = {c.name: constant_unit(c, equations.constants) for c in equations.constants}
    known = {name: dimension_of(unit) for name, unit in (units | {n: u for n, (u, _) in stated.items()}).items()}
    found: dict[str, Symbol] = {}
    for left, right in (*equations.inverter, *equations.f, *equations.h):
        for symbol in (*sorted(right.free_symbols, key=str), left):
            name = str(symbol)
            if name in units or name in found:
                continue
            if name not in stated:
                known[name] = _dimension_or_none(right, known)
            unit, meaning = stated.get(name, ("", _in_words(name)))
            found[name] = Symbol(symbol, unit or unit_of(known[name]), meaning)
    return list(found.values())


def _dimension_or_none(expression: Any, known: Mapping[str, Dimension | None]) -> Dimension | None:
    """As :func:`dimension`; a machine of one's own may state units that do not fit, and has a page all the same."""
    try:
        return dimension(expression, known)
    except ContradictionError:
        return None


def _in_words(name: str) -> str:
    return ", ".join(_MEANINGS.get(word, word) for word in name.split("_"))


def constant_unit(constant: Constant, others: Iterable[Constant] = ()) -> str:
    """The unit that a constant's formula ends with; of a change in another constant, that one's.

    Parameters
    ----------
    constant : Constant
    others : iterable of Constant
        Those it may be about.

    >>> constant_unit(Constant("HALF_T", 5e-5, "T / 2, s", None))
    's'
    >>> constant_unit(Constant("DECAY", 0.5, "exp(-T R / L)", None))
    '1'
    """
    of = re.search(r"what (\w+) changes with", constant.formula)
    if of:
        return next((constant_unit(other) for other in others if other.name == of[1]), "1")
    for words in (*re.split(r", |: ", constant.formula)[1:], constant.formula.partition(":")[0]):
        if dimension_of(words) is not None:
            return words.replace(" / ", "/")
    about = re.search(r"the motor's (\w+)|one sigma of (\w+)", constant.formula)
    return _DATA.get((about[1] or about[2]) if about else "", "1")


def dimension_of(unit: str) -> Dimension | None:
    """Powers of V, A, s and rad of a unit as it is written; None where it is none.

    >>> dimension_of("A s/rad"), dimension_of("kilogramme")
    ((0, 1, 1, -1), None)
    """
    total, sign = [0, 0, 0, 0], 1
    words = re.findall(r"per|/|[A-Za-z]+(?:\^\d+)?|1|[^\sA-Za-z/]+", unit)
    for word in words:
        if word in ("/", "per"):
            sign = -1
            continue
        base, _, power = word.partition("^")
        if base not in _BASES or (power and not power.isdigit()):
            return None
        for k, value in enumerate(_BASES[base]):
            total[k] += sign * value * int(power or 1)
    return (total[0], total[1], total[2], total[3]) if words else None


class ContradictionError(ValueError):
    """A sum of unlike things."""


def dimension(expression: Any, known: Mapping[str, Dimension | None]) -> Dimension | None:
    """The dimension of a formula, None where it has no part that tells.

    Angles come and go, as in v = r omega: terms of a sum may differ in rad alone.

    Raises
    ------
    ContradictionError
        A sum of unlike things.
    """
    if expression.is_Symbol:
        return known.get(str(expression))
    if expression.is_Mul or expression.is_Pow:
        return _product(expression, known)
    if expression.is_Add or expression.func in (sp.Min, sp.Max, sp.Abs):
        return _sum(expression, known)
    return NONE


def _product(expression: Any, known: Mapping[str, Dimension | None]) -> Dimension | None:
    total = [0, 0, 0, 0]
    for factor in sp.Mul.make_args(expression):
        base, power = factor.as_base_exp()
        part = NONE if base.is_number else dimension(base, known)
        if part is None or not power.is_number:
            return None
        for k in range(4):
            total[k] += int(part[k] * power)
    return total[0], total[1], total[2], total[3]


def _sum(expression: Any, known: Mapping[str, Dimension | None]) -> Dimension | None:
    found = [part for term in expression.args if (part := dimension(term, known)) is not None]
    if len({part[:3] for part in found}) > 1:
        raise ContradictionError(f"{expression} adds unlike things: {', '.join(map(str, found))}")
    return max(found, key=lambda part: abs(part[3]), default=None)


def unit_of(found: Dimension | None) -> str:
    """A dimension as one writes it; "?" of None. Radians are written of angles and speeds alone.

    >>> unit_of((1, 0, 1, 0)), unit_of((1, 1, 1, 0)), unit_of((1, 0, 0, 1))
    ('Wb', 'N m', 'V')
    """
    if found is None:
        return "?"
    for unit in _NAMES:
        if dimension_of(unit) == found:
            return unit
    for unit in _NAMES:
        named = dimension_of(unit)
        if named is not None and named[:3] == found[:3]:
            return unit
    words = [
        f"{base}^{power}" if power != 1 else base for base, power in zip(("V", "A", "s"), found, strict=False) if power
    ]
    return " ".join(words)
