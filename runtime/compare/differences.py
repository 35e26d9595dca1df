"""The differences between drives: keys of their files, tuning state by state, lines of their equations."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import sympy as sp

from runtime.compare.subject import Subject

#: Lists in state order: the tuning table has them by state.
BY_STATE = ("filter.initial_state", "filter.initial_covariance", "filter.process_noise")

TUNED = ("x_0", "P_0", "Q")


@dataclass(frozen=True)
class Row:
    """One key, a value a drive; None where a drive has none."""

    key: str
    values: tuple[Any, ...]

    @property
    def differs(self) -> bool:
        """Whether the drives do not all say the same."""
        return any(value != self.values[0] for value in self.values[1:])


@dataclass(frozen=True)
class Line:
    """One line of f or h: its left side, and each different right side with the numbers of the drives that have it.

    A drive in no variant has no such line.
    """

    function: str
    left: sp.Symbol
    variants: tuple[tuple[sp.Expr, tuple[int, ...]], ...]
    drives: int

    @property
    def differs(self) -> bool:
        """Whether the drives do not all say the same."""
        return len(self.variants) > 1 or len(self.variants[0][1]) < self.drives


def file_rows(subjects: Sequence[Subject]) -> list[Row]:
    """Every key of the drive files but the lists in state order, in the files' order."""
    flat = [_flat(subject.manifest["parameters"]) for subject in subjects]
    keys = [key for key in dict.fromkeys(key for side in flat for key in side) if key not in BY_STATE]
    return [Row(key, tuple(side.get(key) for side in flat)) for key in keys]


def tuning_rows(subjects: Sequence[Subject]) -> list[Row]:
    """x_0, P_0 and Q of every state that any of the drives has."""
    columns: list[dict[str, float]] = []
    for subject in subjects:
        tuning = subject.folder.module.DEFAULTS
        columns.append(
            {f"{name} {state}": tuning[name][k] for name in TUNED for k, state in enumerate(subject.state_names)}
        )
    keys = dict.fromkeys(key for column in columns for key in column)
    order = sorted(keys, key=lambda key: TUNED.index(key.partition(" ")[0]))
    return [Row(key, tuple(column.get(key) for column in columns)) for key in order]


def constant_rows(subjects: Sequence[Subject]) -> list[Row]:
    """The folded constants of the equations."""
    columns = [{constant.name: float(constant.value) for constant in s.equations.constants} for s in subjects]
    return [
        Row(key, tuple(column.get(key) for column in columns)) for key in dict.fromkeys(k for c in columns for k in c)
    ]


def equation_lines(subjects: Sequence[Subject]) -> list[Line]:
    """Lines of f, then of h, of all drives, told apart by their left sides."""
    return [
        line
        for function in ("f", "h")
        for line in _lines(function, [getattr(subject.equations, function) for subject in subjects])
    ]


def _lines(function: str, sides: Sequence[Iterable[tuple[sp.Symbol, sp.Expr]]]) -> list[Line]:
    tables = [dict(side) for side in sides]
    found = []
    for left in _merged([list(table) for table in tables]):
        variants: dict[sp.Expr, tuple[int, ...]] = {}
        for k, table in enumerate(tables):
            if left in table:
                variants[table[left]] = (*variants.get(table[left], ()), k)
        found.append(Line(function, left, tuple(variants.items()), len(sides)))
    return found


def _merged(sequences: Sequence[list[Any]]) -> list[Any]:
    """All items once; an item new in a later sequence comes after the one before it there."""
    merged: list[Any] = []
    for sequence in sequences:
        place = 0
        for item in sequence:
            if item in merged:
                place = merged.index(item) + 1
            else:
                merged.insert(place, item)
                place += 1
    return merged


def _flat(sections: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested sections as dotted keys."""
    flat: dict[str, Any] = {}
    for key, value in sections.items():
        flat |= _flat(value, f"{prefix}{key}.") if isinstance(value, Mapping) else {f"{prefix}{key}": value}
    return flat
