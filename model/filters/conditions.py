"""What a step's control flow asks and sets: numbers by the names of their arrays, comparisons, and their logic.

A comparison with what is not a number is false; so ``Not(Compare("<", a, b))`` is not ``Compare(">=", a, b)``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce


@dataclass(frozen=True)
class Entry:
    """An entry of an array; ``place`` None: the filter's field that is one number."""

    name: str
    place: int | None = None


@dataclass(frozen=True)
class Name:
    """A constant, or a number that the step has made, by its name."""

    name: str


@dataclass(frozen=True)
class Operation:
    """``left sign right``, rounded once; ``sign`` is + - or *."""

    sign: str
    left: Value
    right: Value


@dataclass(frozen=True)
class Number:
    """A literal."""

    value: float


@dataclass(frozen=True)
class Whole:
    """An integer's literal."""

    value: int


@dataclass(frozen=True)
class Label:
    """An integer by the name that it has in the port header, without what such names begin with."""

    name: str


Value = Entry | Name | Number | Whole | Label | Operation


@dataclass(frozen=True)
class Accepted:
    """The measurement is taken: u and y passed the input guard."""


@dataclass(frozen=True)
class Compare:
    """``left sign right``; ``sign`` is < <= > or >=, of integers == as well."""

    sign: str
    left: Value
    right: Value


@dataclass(frozen=True)
class Reported:
    """One of these status bits is set."""

    bits: tuple[str, ...]


@dataclass(frozen=True)
class Not:
    """The condition does not hold."""

    condition: Condition


@dataclass(frozen=True)
class All:
    """Each of them holds."""

    conditions: tuple[Condition, ...]


@dataclass(frozen=True)
class Either:
    """One of them holds, or more."""

    conditions: tuple[Condition, ...]


Condition = Accepted | Compare | Reported | Not | All | Either

ACCEPTED = Accepted()


def square(value: Value) -> Value:
    """A number times itself.

    Parameters
    ----------
    value : Value
    """
    return Operation("*", value, value)


def total(*values: Value) -> Value:
    """Their sum, from left to right.

    Parameters
    ----------
    *values : Value
        One or more.
    """
    return reduce(lambda left, right: Operation("+", left, right), values)
