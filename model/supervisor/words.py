"""The words in which a state machine is declared: modes, transitions, and what they count, ask and do.

Guards and actions are those of a filter's step (:mod:`model.filters.conditions`, :mod:`model.filters.program`), so that
the same printers spell them. A machine runs once an interrupt: it counts (``watch``), then the first transition of its
mode whose guard holds is taken, with its actions in order.
"""

from __future__ import annotations

from dataclasses import dataclass

from model.filters.conditions import All, Compare, Condition, Entry, Label, Name, Whole, square
from model.filters.program import Call, Node
from model.filters.program import nodes as all_nodes
from model.quantities import Block


@dataclass(frozen=True)
class Mode:
    """What the drive is doing, and what is allowed meanwhile.

    ``inverter``: gates are enabled; ``runs``: filter and controller take their step; ``torque``: the controller may ask
    for current; ``rivals``: the rival filter takes its step too; ``aligns``: a direct current turns the rotor,
    without the filter. ``lasting``: the drive may stay here for ever; else a
    transition ends it after a stated time.
    """

    name: str
    meaning: str
    inverter: bool = False
    runs: bool = False
    torque: bool = False
    rivals: bool = False
    aligns: bool = False
    lasting: bool = False


@dataclass(frozen=True)
class Reason:
    """Why the drive last gave up a rotor, or does not start; its place in the list is its number in C."""

    name: str
    meaning: str


@dataclass(frozen=True)
class Field:
    """A number that the machine keeps: an integer, or ``size`` float32; or a ``filter`` of its own."""

    name: str
    meaning: str
    size: int = 0
    filter: bool = False

    @property
    def whole(self) -> bool:
        """It is an integer."""
        return self.size == 0 and not self.filter


@dataclass(frozen=True)
class Limit:
    """A constant of the generated text: an integer (samples, as a rule) or a float32."""

    name: str
    value: int | float
    meaning: str


@dataclass(frozen=True)
class CopyFilter:
    """The rival becomes a copy of the filter, its tuning included."""


@dataclass(frozen=True)
class ExchangeFilters:
    """The filter and its rival change places."""


@dataclass(frozen=True)
class Action:
    """Something to do, under a name that becomes a function's; what it says of the filter it does to the one given."""

    name: str
    meaning: str
    body: tuple[Node | CopyFilter | ExchangeFilters, ...]


@dataclass(frozen=True)
class OnRival:
    """An action that is done to the rival filter."""

    name: str


@dataclass(frozen=True)
class Transition:
    """From ``source``, where ``guard`` holds: ``actions`` in order, then ``target``; None: the drive stays.

    Who goes (to the same mode, too) begins to count its time there anew; who stays does not. ``why`` ends the sentence
    "the drive does so because ...". ``reason``: it is kept as what went wrong.
    """

    source: str
    target: str | None
    guard: Condition
    why: str
    actions: tuple[str | OnRival, ...] = ()
    reason: str = ""


@dataclass(frozen=True)
class Supervisor:
    """A whole machine. Transitions of a mode stand in the order in which they are tried."""

    modes: tuple[Mode, ...]
    reasons: tuple[Reason, ...]
    fields: tuple[Field, ...]
    limits: tuple[Limit, ...]
    watch: tuple[Node, ...]
    actions: tuple[Action, ...]
    transitions: tuple[Transition, ...]

    def place(self, mode: str) -> int:
        """Return a mode's number in C and in Python.

        Parameters
        ----------
        mode : str
            Its name.
        """
        return [m.name for m in self.modes].index(mode)

    def leaving(self, mode: str) -> list[tuple[int, Transition]]:
        """Return a mode's transitions, each with its number, which counts from 1 over all modes.

        Parameters
        ----------
        mode : str
            Its name.
        """
        return [(k, t) for k, t in enumerate(self.transitions, start=1) if t.source == mode]

    def action(self, name: str) -> Action:
        """Return an action.

        Parameters
        ----------
        name : str
        """
        return next(action for action in self.actions if action.name == name)

    @property
    def rivals(self) -> bool:
        """It has a second filter, for a start from an unknown angle."""
        return any(field.filter for field in self.fields)

    @property
    def aligns(self) -> bool:
        """A start begins with an alignment."""
        return any(mode.aligns for mode in self.modes)

    @property
    def blocks(self) -> list[Block]:
        """The symbolic blocks that it calls, each once."""
        bodies = (self.watch, *(action.body for action in self.actions))
        calls = (node for body in bodies for node in all_nodes(body) if isinstance(node, Call))  # type: ignore[arg-type]
        return list({call.block.name: call.block for call in calls}.values())


# --- how guards are spelled


def at_least(field: str, limit: str) -> Condition:
    """Hold where a count has reached a limit.

    Parameters
    ----------
    field, limit : str
        Names.
    """
    return Compare(">=", Entry(field), Name(limit))


def equals(field: str, value: int) -> Condition:
    """Hold where an integer has a value.

    Parameters
    ----------
    field : str
        Its name.
    value : int
    """
    return Compare("==", Entry(field), Whole(value))


def is_label(field: str, label: str) -> Condition:
    """Hold where an integer is one of the port header's, such as a mode.

    Parameters
    ----------
    field, label : str
        Its name, and the number's.
    """
    return Compare("==", Entry(field), Label(label))


def within(pair: str, limit_squared: str) -> Condition:
    """Hold where two numbers are within +- a limit; what is not a number is not.

    Parameters
    ----------
    pair : str
        Name of the array.
    limit_squared : str
        Name of the limit's square.
    """
    sizes = (square(Entry(pair, k)) for k in range(2))
    return All(tuple(Compare("<=", size, Name(limit_squared)) for size in sizes))
