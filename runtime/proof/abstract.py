"""One interrupt of a declared machine with integers as they are, and every other question answered both ways.

A question about real numbers is free as far as it can be: answers about one quantity agree with each other (who is
within a small limit is within a large one), and what is not a number is beyond all limits. Nothing is asked before it
matters, so that the ways through an interrupt are few.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from model.filters.conditions import (
    All,
    Compare,
    Condition,
    Either,
    Entry,
    Label,
    Name,
    Not,
    Number,
    Reported,
    Value,
    Whole,
)
from model.filters.program import Count, If, Set, entries_of, nodes
from model.supervisor.words import OnRival, Supervisor

#: What a comparison of two integers asks.
SIGNS: Mapping[str, Callable[[Any, Any], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
}
#: Set from outside before any interrupt.
GIVEN = ("acknowledged",)
#: Integers that follow from the mode.
TOLD = ("inverter", "runs", "torque", "rivals", "aligns")
#: Below and above all numbers.
BOTTOM, TOP = (-float("inf"), 0), (float("inf"), 1)
#: Any reason that no guard asks for.
OTHER = "another"

#: A mode, and the integers that still matter in it.
State = tuple[str, tuple[tuple[str, Any], ...]]


class Ways:
    """All ways through something that makes choices: each run takes the next one."""

    def __init__(self) -> None:
        self._ahead: list[int] = []
        self._made: list[tuple[int, int]] = []

    def choose(self, options: int) -> int:
        """One of so many.

        Parameters
        ----------
        options : int
        """
        place = len(self._made)
        chosen = self._ahead[place] if place < len(self._ahead) else 0
        self._made.append((chosen, options))
        return chosen

    def runs(self) -> Iterator[None]:
        """Once for each way; what runs between two must make the same choices up to where it differs."""
        while True:
            self._made = []
            yield
            made = self._made
            while made and made[-1][0] + 1 == made[-1][1]:
                made.pop()
            if not made:
                return
            self._ahead = [chosen for chosen, _ in made]
            self._ahead[-1] += 1


@dataclass
class Taken:
    """What an interrupt did: the transition's number (0: none), the state after it; integers asked for and set."""

    number: int
    after: State
    read: frozenset[str] = frozenset()
    written: frozenset[str] = frozenset()


@dataclass
class Machine:
    """A machine, the integers that are kept, and the limits they are compared with.

    Parameters
    ----------
    machine : Supervisor
    limits : mapping of str to float
        By name; small ones in the place of large ones, where that changes no answer.
    kept : frozenset of str
        Integers that are known; any other is not, and a question about it is answered both ways.
    above : mapping of Value to float
        Quantities that are numbers beyond these, for questions about them.
    """

    machine: Supervisor
    limits: Mapping[str, float]
    kept: frozenset[str]
    above: Mapping[Value, float] = field(default_factory=dict)
    live: dict[str, frozenset[str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        m = self.machine
        guards = [transition.guard for transition in m.transitions]
        self.asked_reasons = {label.name for guard in guards for label in _labels(guard) if "REASON" in label.name}
        self.modes = {mode.name: mode for mode in m.modes}
        self.leaving = {mode: m.leaving(mode) for mode in self.modes}
        self.actions = {action.name: self._kept_nodes(action.body) for action in m.actions}
        self.watch = self._kept_nodes(m.watch)

    def _kept_nodes(self, body: Any) -> tuple[Any, ...]:
        """What changes what is kept, at every depth."""
        kept = [node for node in body if changed_by(node) & (self.kept | set(GIVEN))]
        return tuple(
            replace(node, then=self._kept_nodes(node.then), otherwise=self._kept_nodes(node.otherwise))
            if isinstance(node, If)
            else node
            for node in kept
        )

    def state(self, mode: str, values: Mapping[str, Any]) -> State:
        """A state in which only that is known which still matters.

        Parameters
        ----------
        mode : str
        values : mapping
        """
        names = self.live.get(mode, self.kept)
        return mode, tuple((name, values[name]) for name in sorted(names) if values.get(name) is not None)

    def interrupts(self, state: State) -> Iterator[Taken]:
        """All that one interrupt may do from a state.

        Parameters
        ----------
        state : State
        """
        ways = Ways()
        for _ in ways.runs():
            yield Interrupt(self, state, ways).run()

    def limit(self, name: str) -> float | None:
        """A limit's number, or None.

        Parameters
        ----------
        name : str
        """
        return self.limits.get(name)


def changed_by(node: Any) -> set[str]:
    """Names of the fields that a node sets or counts.

    Parameters
    ----------
    node : Node
    """
    found = {own.counter for own in nodes((node,)) if isinstance(own, Count)}
    return found | {own.target.name for own in nodes((node,)) if isinstance(own, Set)}


def _labels(condition: Condition) -> Iterator[Label]:
    match condition:
        case Compare():
            yield from (side for side in (condition.left, condition.right) if isinstance(side, Label))
        case Not():
            yield from _labels(condition.condition)
        case All() | Either():
            for part in condition.conditions:
                yield from _labels(part)


class Interrupt:
    """One way through one interrupt."""

    def __init__(self, machine: Machine, state: State, ways: Ways) -> None:
        self.m, self.ways, self.mode = machine, ways, state[0]
        self.values: dict[str, Any] = dict(state[1])
        mode = machine.modes[self.mode]
        self.values |= {name: int(getattr(mode, name)) for name in TOLD}
        self.answers: dict[Any, Any] = {}
        self.regions: dict[Value, tuple[Any, Any, bool]] = {
            quantity: ((least, 1), TOP, False) for quantity, least in machine.above.items()
        }
        self.read: set[str] = set()
        self.written: set[str] = set(TOLD)

    def run(self) -> Taken:
        """Count, and take the first transition whose guard holds."""
        self._do(self.m.watch)
        for number, transition in self.m.leaving[self.mode]:
            if not self.holds(transition.guard):
                continue
            for action in transition.actions:
                if not isinstance(action, OnRival):
                    self._do(self.m.actions[action])
            if transition.reason:
                self._set("reason", self._reason(f"REASON_{transition.reason}"))
            if transition.target is not None:
                self.mode = transition.target
                self._set("since", 0)
            return self._taken(number)
        return self._taken(0)

    def _reason(self, label: str) -> str:
        return label if label in self.m.asked_reasons else OTHER

    def _taken(self, number: int) -> Taken:
        for name in (*GIVEN, *TOLD):
            self.values.pop(name, None)
        return Taken(number, self.m.state(self.mode, self.values), frozenset(self.read), frozenset(self.written))

    # --- what it does

    def _do(self, body: tuple[Any, ...]) -> None:
        for node in body:
            if isinstance(node, If):
                self._do(node.then if self.holds(node.condition) else node.otherwise)
            elif isinstance(node, Count):
                value, most = self.values.get(node.counter), self.m.limit(node.most)
                if value is not None and most is not None and value < most:
                    self.values[node.counter] = value + 1
            elif isinstance(node, Set):
                value = self._integer(node.value) if isinstance(node.value, (Whole, Name)) else None
                reason = self._reason("REASON_NONE") if node.target.name == "reason" and value == 0 else value
                self._set(node.target.name, reason)

    def _set(self, name: str, value: Any) -> None:
        if name in self.m.kept or name in GIVEN:
            self.values[name] = value
        self.written.add(name)

    # --- what it asks

    def holds(self, condition: Condition) -> bool:
        """Whether a condition holds, on this way.

        Parameters
        ----------
        condition : Condition
        """
        match condition:
            case Not():
                return not self.holds(condition.condition)
            case All():
                return all(self.holds(part) for part in condition.conditions)
            case Either():
                return any(self.holds(part) for part in condition.conditions)
            case Reported():
                return any(self._either_way(bit) for bit in condition.bits)
            case Compare():
                return self._compare(condition)
        return self._either_way(condition)

    def _either_way(self, question: Any) -> bool:
        """The same question has one answer in an interrupt."""
        if question not in self.answers:
            self.answers[question] = bool(self.ways.choose(2))
        return bool(self.answers[question])

    def _compare(self, condition: Compare) -> bool:
        left, right = self._integer(condition.left), self._integer(condition.right)
        if left is not None and right is not None:
            return SIGNS[condition.sign](left, right)
        whole = isinstance(condition.left, Entry) and condition.left.place is None
        if isinstance(condition.left, Entry) and whole and condition.left.name not in {"nis", "rival_nis"}:
            return self._unknown(condition)
        threshold = self._threshold(condition.right)
        if threshold is None:
            return self._either_way(condition)
        return self._real(condition.left, condition.sign, threshold)

    def _integer(self, value: Value) -> Any:
        match value:
            case Whole():
                return value.value
            case Label():
                return value.name
            case Name():
                limit = self.m.limit(value.name)
                return limit if isinstance(limit, int) else None
            case Entry(name="mode"):
                return self.mode
            case Entry(name=name, place=None):
                if name not in self.written:
                    self.read.add(name)
                if name in GIVEN and self.values.get(name) is None:
                    self.values[name] = self.ways.choose(2)
                return self.values.get(name)
        return None

    def _unknown(self, condition: Compare) -> bool:
        """An integer that is not kept: each answer is possible, and none is remembered."""
        return bool(self.ways.choose(2))

    def _threshold(self, value: Value) -> float | None:
        if isinstance(value, Number):
            return value.value
        return self.m.limit(value.name) if isinstance(value, Name) else None

    def _real(self, quantity: Value, sign: str, threshold: float) -> bool:
        """Where a quantity lies is told apart only as far as it was asked for; what is no number compares as false."""
        low, high, nan = self.regions.get(quantity, (BOTTOM, TOP, True))
        cut = threshold, 0 if sign in {"<", ">="} else 1  # the threshold itself is above the cut, or below
        below, above = (low, min(high, cut)), (max(low, cut), high)
        yes, no = (below, above) if sign in {"<", "<="} else (above, below)
        able = yes[0] < yes[1], nan or no[0] < no[1]
        answer = bool(self.ways.choose(2)) if all(able) else able[0]
        self.regions[quantity] = (*yes, False) if answer else (*no, nan)
        return answer


def relevant(machine: Supervisor) -> frozenset[str]:
    """Integers that guards ask for, and those that decide how these change.

    Parameters
    ----------
    machine : Supervisor
    """
    whole = {own.name for own in machine.fields if own.whole} - {"mode", *GIVEN, *TOLD}
    found = {entry.name for t in machine.transitions for entry in entries_of(t.guard)} & whole
    bodies = [machine.watch, *(action.body for action in machine.actions)]
    branches = [node for body in bodies for node in nodes(body) if isinstance(node, If)]  # type: ignore[arg-type]
    while True:
        deciding = [node for node in branches if changed_by(node) & found]
        more = found | ({entry.name for node in deciding for entry in entries_of(node.condition)} & whole)
        if more == found:
            return frozenset(found)
        found = more


def liveness(machine: Machine) -> dict[str, frozenset[str]]:
    """By mode: the kept integers that are asked for before they are set again.

    Two states that differ in others do the same for ever. A count that is only counted on is not asked for.

    Parameters
    ----------
    machine : Machine
    """
    ways = {
        mode: list({(t.after[0], t.read & machine.kept, t.written) for t in machine.interrupts((mode, ()))})
        for mode in machine.modes
    }
    live: dict[str, frozenset[str]] = {mode: frozenset() for mode in machine.modes}
    while True:
        more = {
            mode: frozenset(live[mode].union(*(read | (live[after] - written) for after, read, written in ways[mode])))
            for mode in live
        }
        if more == live:
            return live
        live = more
