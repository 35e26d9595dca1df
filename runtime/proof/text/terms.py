"""The results of a program as terms: two programs do the same for every input if their terms are the same.

A term is a number, an input, an operation, or a choice between two terms by a comparison. Choices are kept as decision
diagrams, their comparisons in one order, so that ``if``, ``?:``, masks and early returns that mean the same look the
same. Equal terms are one object. Arithmetic is never rearranged: float32 does not forgive it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np


class Term:
    """One value; made by :class:`Terms` alone. ``whole``: an integer (a truth is 0 or 1), not a float32."""

    __slots__ = ("args", "chooses", "kind", "order", "whole")

    def __init__(self, kind: str, args: tuple[Any, ...], whole: bool, order: tuple[int, bytes]) -> None:
        self.kind, self.args, self.whole = kind, args, whole
        self.chooses: bool
        #: How deep it is, and a digest of what it says: a comparison comes after those that it depends on.
        self.order = order
        #: There is a choice somewhere in it.
        self.chooses = kind == "choice" or any(isinstance(arg, Term) and arg.chooses for arg in args)

    def __repr__(self) -> str:
        return f"{self.kind}({', '.join(map(repr, self.args))})"


@dataclass(frozen=True)
class OverLanes:
    """A truth about all lanes of a program that runs many: ``condition`` holds in some of them, or in ``every`` one."""

    condition: Term
    every: bool = False


#: How deep a comparison of inputs is, ``u[0] * u[0] <= u_max * u_max``: what is known of those is put in wherever they
#: are asked again, because a lane form computes for rejected lanes what it then throws away.
GUARDS = 3

#: A cell of memory, by the name of its array and its place there.
Key = tuple[str, int]


class Terms:
    """Makes terms, each once."""

    def __init__(self) -> None:
        self._made: dict[tuple[Any, ...], Term] = {}
        self._known: dict[tuple[Any, ...], Term] = {}
        #: (condition, value, other): where the condition is 0, the value is the other one.
        self._chosen: set[tuple[Term, Term, Term]] = set()
        self._unknown = 0
        self.zero, self.one = self.integer(0), self.integer(1)

    def make(self, kind: str, *args: Any, whole: bool = False) -> Term:
        """Return the one term of a kind and its arguments.

        Parameters
        ----------
        kind : str
            Filter kind, such as "ickf".
        whole : bool, optional
        """
        key = (kind, whole, *(id(arg) if isinstance(arg, Term) else arg for arg in args))
        if key not in self._made:
            parts = (arg.order[1] if isinstance(arg, Term) else repr(arg).encode() for arg in args)
            digest = hashlib.blake2b(b"\0".join([kind.encode(), *parts]), digest_size=16).digest()
            depth = 1 + max((arg.order[0] for arg in args if isinstance(arg, Term)), default=0)
            self._made[key] = Term(kind, args, whole, (depth, digest))
        return self._made[key]

    def _once(self, of: Callable[..., Term], *args: Any) -> Term:
        """A function's value, computed once: terms share their parts."""
        key = (of.__name__, *args)
        if key not in self._known:
            self._known[key] = of(*args)
        return self._known[key]

    # --- leaves

    def integer(self, value: int) -> Term:
        """Return a whole number."""
        return self.make("integer", int(value), whole=True)

    def number(self, value: float) -> Term:
        """Return a float32 constant."""
        return self.make("number", repr(float(np.float32(value))))  # as text, so that 0 is not -0

    def symbol(self, name: str, place: int = 0, whole: bool = False) -> Term:
        """Return an input's cell.

        Parameters
        ----------
        name : str
            Of the input.
        place : int, optional
            From 0.
        whole : bool, optional
            It is an integer.
        """
        return self.make("symbol", name, place, whole=whole)

    def unknown(self, why: str) -> Term:
        """A term that a reader does not understand: equal to nothing, itself in another text included."""
        self._unknown += 1
        return self.make("unknown", f"{id(self)} {self._unknown}: {why}")

    # --- arithmetic

    def operation(self, sign: str, left: Term, right: Term) -> Term:
        """A float32 operation; on integers, one that goes through choices."""
        if left.whole and right.whole:
            return self._once(self._integers, sign, left, right)
        if left.whole or right.whole:
            return self.unknown(f"{sign} of an integer and a float")
        if left.kind == right.kind == "number":
            return self._constants(sign, left, right)
        return self.make("operation", sign, left, right)

    def _constants(self, sign: str, left: Term, right: Term) -> Term:
        """A product of two float32 is exact in Python's double, then rounded once as in C; no other operation is."""
        if sign != "*":
            return self.unknown(f"{sign} of two constants")
        return self.number(float(left.args[0]) * float(right.args[0]))

    def negative(self, operand: Term) -> Term:
        """Return minus an operand."""
        if operand.kind == "number":
            return self.number(-float(operand.args[0]))
        return self.integer(-operand.args[0]) if operand.kind == "integer" else self.make("negative", operand)

    def _integers(self, sign: str, left: Term, right: Term) -> Term:
        if left.kind == "choice":
            return self._through(left, lambda value: self.operation(sign, value, right))
        if right.kind == "choice":
            return self._through(right, lambda value: self.operation(sign, left, value))
        if left.kind == right.kind == "integer":
            a, b = left.args[0], right.args[0]
            results = {"+": a + b, "-": a - b, "*": a * b, "|": a | b, "&": a & b}
            if sign == "/" and a >= 0 and b > 0:
                return self.integer(a // b)
            return self.integer(results[sign]) if sign in results else self.unknown(f"{sign} of integers")
        if sign == "|" and right.kind == "integer" and left.kind == "whole" and left.args[0] == "|":
            return self._integers("|", left.args[1], self._integers("|", left.args[2], right))
        if right is self.zero and sign in "+-|":
            return left
        return self.make("whole", sign, left, right, whole=True)

    def _through(self, choice: Term, of: Callable[[Term], Term]) -> Term:
        atom, then, otherwise = choice.args
        return self.select(self.make("choice", atom, self.one, self.zero, whole=True), of(then), of(otherwise))

    # --- truths

    def compare(self, relation: str, left: Term, right: Term) -> Term:
        """1 where the relation holds, else 0; with NaN none holds, so ``a <= b`` is not the opposite of ``a > b``.

        Parameters
        ----------
        relation : {"<", "<=", ">", ">=", "==", "!="}
        left, right : Term
            Both integers, or both float32.
        """
        return self._once(self._compare, relation, left, right)

    def _compare(self, relation: str, left: Term, right: Term) -> Term:
        if relation in {">", ">="}:
            return self.compare(relation.replace(">", "<"), right, left)
        if relation == "!=":
            return self.opposite(self.compare("==", left, right))
        if left.whole != right.whole:
            return self.unknown(f"{relation} of an integer and a float")
        for k, side in enumerate((left, right)):
            if side.whole and side.kind == "choice":
                return self._through(side, lambda v, k=k: self.compare(relation, *((v, right), (left, v))[k]))  # type: ignore[misc]
        if left.kind == right.kind == "integer":
            a, b = left.args[0], right.args[0]
            return self.integer({"<": a < b, "<=": a <= b, "==": a == b}[relation])
        atom = self.make("atom", relation, left, right)
        return self.make("choice", atom, self.one, self.zero, whole=True)

    def truth(self, value: Term) -> Term:
        """1 for an integer that is not 0."""
        return self.compare("!=", value, self.zero)

    def opposite(self, value: Term) -> Term:
        """Return the opposite of a truth."""
        return self.select(value, self.zero, self.one)

    def both(self, left: Term, right: Term) -> Term:
        """Return whether two truths hold."""
        return self.select(left, self.truth(right), self.zero)

    def either(self, left: Term, right: Term) -> Term:
        """Return whether one of two truths holds."""
        return self.select(left, self.one, self.truth(right))

    def is_truth(self, value: Term) -> bool:
        """It is 0 or 1 whatever the input."""
        if value.kind == "choice":
            return self.is_truth(value.args[1]) and self.is_truth(value.args[2])
        return value is self.zero or value is self.one

    # --- choices

    def select(self, condition: Term, then: Term, otherwise: Term) -> Term:
        """``then`` where the condition is not 0, else ``otherwise``."""
        return self._once(self._select, condition, then, otherwise)

    def _select(self, condition: Term, then: Term, otherwise: Term) -> Term:
        if then is otherwise:
            return then
        if condition.kind == "integer":
            return then if condition.args[0] else otherwise
        if condition.kind != "choice":
            if not condition.whole:
                return self.unknown("a condition that is no truth")
            atom = self.make("atom", "==", condition, self.zero)
            return self._branch(atom, otherwise, then)
        parts = (condition, then, otherwise)
        atom = min((part.args[0] for part in parts if part.kind == "choice"), key=lambda atom: atom.order)
        high, low = ([self._side(part, atom, side) for part in parts] for side in (1, 2))
        return self._branch(atom, self.select(high[0], high[1], high[2]), self.select(low[0], low[1], low[2]))

    @staticmethod
    def _side(term: Term, atom: Term, side: int) -> Term:
        return term.args[side] if term.kind == "choice" and term.args[0] is atom else term

    def _branch(self, atom: Term, then: Term, otherwise: Term) -> Term:
        if atom.order[0] <= GUARDS:
            then, otherwise = self.assume(then, atom, True), self.assume(otherwise, atom, False)
        if then is otherwise:
            return then
        tops = [part.args[0].order for part in (then, otherwise) if part.kind == "choice"]
        if any(top < atom.order for top in tops):  # what is known changed a comparison further in
            return self.select(self.make("choice", atom, self.one, self.zero, whole=True), then, otherwise)
        return self.make("choice", atom, then, otherwise, whole=then.whole and otherwise.whole)

    def assume(self, term: Term, atom: Term, holds: bool) -> Term:
        """The term where it is known whether a comparison holds, wherever in it that is asked.

        Parameters
        ----------
        term : Term
        atom : Term
            The comparison.
        holds : bool
        """
        if not term.chooses or term.order[0] <= atom.order[0]:  # too shallow to ask
            return term
        return self._once(self._assume, term, atom, holds)

    def _assume(self, term: Term, atom: Term, holds: bool) -> Term:
        if term.kind == "choice":
            if term.args[0] is atom:
                return self.assume(term.args[1 if holds else 2], atom, holds)
            relation, left, right = term.args[0].args
            condition = self.compare(relation, self.assume(left, atom, holds), self.assume(right, atom, holds))
            condition = self._side(condition, atom, 1 if holds else 2)
            return self.select(
                condition, self.assume(term.args[1], atom, holds), self.assume(term.args[2], atom, holds)
            )
        args = [self.assume(arg, atom, holds) if isinstance(arg, Term) else arg for arg in term.args]
        if all(new is old for new, old in zip(args, term.args, strict=True)):
            return term
        if term.kind == "whole":
            return self._integers(str(args[0]), args[1], args[2])
        return self.make(term.kind, *args, whole=term.whole)

    def within(self, condition: Term, term: Term) -> Term:
        """The term where a truth holds; elsewhere it is of no interest.

        Parameters
        ----------
        condition, term : Term
        """
        return self._once(self._within, condition, term)

    def _within(self, condition: Term, term: Term) -> Term:
        if condition.kind != "choice" or term.kind != "choice":
            return term
        atom = min((part.args[0] for part in (condition, term)), key=lambda atom: atom.order)
        sides = [(self._side(condition, atom, side), self._side(term, atom, side)) for side in (1, 2)]
        left = [self.within(own, part) for own, part in sides if own is not self.zero]
        return left[0] if len(left) == 1 else self._branch(atom, *left)

    # --- merging, loops

    def merge(self, condition: Term | OverLanes, then: Term, otherwise: Term) -> Term:
        """The value of a cell after an ``if``.

        Where the condition is about all lanes, a lane may come through either branch on behalf of others: then it must
        find the same in both.

        Parameters
        ----------
        condition : Term or OverLanes
        then, otherwise : Term
            What either branch leaves in the cell.
        """
        if isinstance(condition, Term):
            chosen = self.select(condition, then, otherwise)
            self._chosen |= {(condition, chosen, otherwise), (self.opposite(condition), chosen, then)}
            return chosen
        if then is otherwise:
            return then
        surely = then if not condition.every else otherwise  # what this lane gets where its own condition decides
        own = condition.condition if not condition.every else self.opposite(condition.condition)
        return surely if self._agree(own, then, otherwise) else self.unknown("a lane's value depends on other lanes")

    def _agree(self, own: Term, then: Term, otherwise: Term) -> bool:
        """Two terms are one wherever ``own`` is 0; asked for every outcome of the guards that they begin with."""
        if not self._chosen.isdisjoint({(own, then, otherwise), (own, otherwise, then)}):
            return True
        if self.select(own, self.zero, then) is self.select(own, self.zero, otherwise):
            return True
        parts = (own, then, otherwise)
        guards = (part.args[0] for part in parts if part.kind == "choice" and part.args[0].order[0] <= GUARDS)
        atom = next(guards, None)
        return atom is not None and all(
            self._agree(*(self.assume(part, atom, holds) for part in parts)) for holds in (True, False)
        )

    def phi(self, key: Key, truth: bool, whole: bool) -> Term:
        """The value of a cell at the beginning of a pass through a loop.

        Parameters
        ----------
        key : Key
            Name and place of the cell.
        truth, whole : bool
            It holds a truth; an integer.
        """
        value = self.make("phi", *key, whole=whole)
        return self.truth(value) if truth else value

    def loop(
        self, start: Mapping[Key, tuple[Term, Term]], after: Mapping[Key, Term], again: Term | OverLanes
    ) -> dict[Key, Term]:
        """The values of cells after ``do ... while (again)``; ``start``: their phi, and what they held before.

        A loop that goes on for lanes together freezes the lanes that are done: then it is each lane's own loop.

        Parameters
        ----------
        start : mapping of Key to (Term, Term)
            By cell: its phi, and what it held before the loop.
        after : mapping of Key to Term
            By cell: what one pass leaves in it.
        again : Term or OverLanes
            What the loop asks after a pass.
        """
        once = self.one
        live = dict(after)
        if isinstance(again, OverLanes):
            masks = [key for key, value in after.items() if value is again.condition]
            if again.every or not masks:
                return {key: self.unknown("a loop over lanes without a mask") for key in after}
            mask, (going, once) = masks[0], start[masks[0]]
            for key, value in after.items():
                frozen = self.select(going, self.zero, value) is self.select(going, self.zero, start[key][0])
                live[key] = self._where(going, value) if frozen else self.unknown("not frozen")
            again = live[mask]
        found = {key: self._looped(key, start, live, again) for key in after}
        found |= {key: self.truth(value) for key, value in found.items() if self.is_truth(after[key])}
        return {key: self.select(once, value, start[key][1]) for key, value in found.items()}

    def _where(self, truth: Term, value: Term) -> Term:
        """The value where a truth that is one comparison holds."""
        if truth.kind != "choice":
            return value
        return self.assume(value, truth.args[0], truth.args[1] is self.one)

    def _looped(self, key: Key, start: Mapping[Key, tuple[Term, Term]], after: Mapping[Key, Term], again: Term) -> Term:
        """A loop as one term: the result, whether it goes on, and the cells that either depends on."""
        phis = {self.make("phi", *k, whole=phi.whole): k for k, (phi, _) in start.items()}
        needed: list[Key] = []
        waiting = [after[key], again]
        seen: set[int] = set()
        while waiting:
            term = waiting.pop()
            if id(term) in seen:
                continue
            seen.add(id(term))
            waiting += [arg for arg in term.args if isinstance(arg, Term)]
            cell = phis.get(term)
            if cell is not None and cell not in needed:
                needed.append(cell)
                waiting.append(after[cell])
        cells = [part for cell in sorted(needed) for part in (*cell, start[cell][1], after[cell])]
        return self.make("loop", again, after[key], *cells, whole=after[key].whole)
