"""Divisors bounded away from zero, proved by ranges read off one function's text.

The generated blocks are straight lines of constants, so each name has one definition and a range follows from it:
literals, sums, products, roots, ``larger``, comparisons that guard a branch, and factors that occur twice (a square
is not negative). What a header documents as positive is taken as positive. Nothing is assumed of any other input.
This is about zero alone; overflow and NaN are the business of :mod:`runtime.firmware.static.eva`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from pycparser import c_ast, c_generator

#: Inputs that the generated headers document as positive: arrays by their argument's name, gains by their local's.
POSITIVE = ("Q", "R", "gain_speed_p", "gain_current_d_p", "gain_current_q_p", "gain_dead_current")

#: Least normal float32: what is positive is at least this on a machine without denormals.
TINY = 2.0**-126

#: Distance of the denormals.
SPACING = 2.0**-149

#: Largest float32.
HUGE = (2.0 - 2.0**-23) * 2.0**127

#: More than the rounding of one float32 operation.
ROUNDING = 2.0**-22

SQRT = ("sqrtf", "__builtin_sqrtf")

_MIRRORED = {">": "<", ">=": "<=", "<": ">", "<=": ">="}
_write = c_generator.CGenerator().visit


@dataclass(frozen=True)
class Range:
    """All values lie in [low, high], or are not a number."""

    low: float = -math.inf
    high: float = math.inf

    @property
    def avoids_zero(self) -> bool:
        """Whether zero lies outside."""
        return self.low > 0.0 or self.high < 0.0

    def widened(self) -> Range:
        """After rounding once; what may underflow reaches zero."""
        return Range(_outward(self.low, -1.0), _outward(self.high, 1.0))


def _outward(bound: float, direction: float) -> float:
    size = abs(bound)
    if bound == 0.0:  # rounding and flushing are monotone, and zero is a number of the format: they never pass it
        return 0.0
    if bound * direction < 0.0:  # towards zero; rounding never passes TINY and HUGE, numbers of the format
        return 0.0 if size < TINY else math.copysign(min(max(size * (1.0 - ROUNDING), TINY), HUGE), bound)
    grown = size * (1.0 + ROUNDING) + SPACING  # among the denormals rounding is absolute
    return math.copysign(grown if grown <= HUGE else math.inf, bound)


ANY = Range()
POSITIVE_RANGE = Range(TINY, math.inf)
NOT_NEGATIVE = Range(0.0, math.inf)


@dataclass(frozen=True)
class Division:
    """One division of a file: where it is, what it divides by, and what is known of that."""

    function: str
    line: int
    divisor: str
    range: Range


@dataclass
class Function:
    """The bounds known for the names of one function; ``ports`` of the elements of its argument arrays."""

    ranges: dict[str, Range] = field(default_factory=dict)
    definitions: dict[str, c_ast.Node] = field(default_factory=dict)
    assigned: frozenset[str] = frozenset()
    ports: dict[str, Range] = field(default_factory=dict)

    # --- ranges of expressions

    def range(self, node: c_ast.Node) -> Range:
        """Range of an expression; ANY where nothing is known."""
        if isinstance(node, c_ast.Constant):
            return _literal(node)
        if isinstance(node, c_ast.ID):
            return self.ranges.get(node.name, POSITIVE_RANGE if node.name in POSITIVE else ANY)
        if isinstance(node, c_ast.ArrayRef):
            array = node.name
            positive = isinstance(array, c_ast.ID) and array.name in POSITIVE
            return self.ports.get(_write(node), POSITIVE_RANGE if positive else ANY)
        if isinstance(node, c_ast.Cast):
            return self.range(node.expr)
        if isinstance(node, c_ast.UnaryOp) and node.op in {"-", "+"}:
            inner = self.range(node.expr)
            return Range(-inner.high, -inner.low) if node.op == "-" else inner
        if isinstance(node, c_ast.BinaryOp):
            return self._binary(node)
        if isinstance(node, c_ast.FuncCall):
            return self._call(node)
        if isinstance(node, c_ast.TernaryOp):
            return self._ternary(node)
        return ANY

    def _binary(self, node: c_ast.BinaryOp) -> Range:
        if node.op in {"*", "/"}:
            return self._product(node)
        if node.op not in {"+", "-"}:
            return ANY
        a, b = self.range(node.left), self.range(node.right)
        if node.op == "-":
            b = Range(-b.high, -b.low)
        return Range(_sum(a.low, b.low, -math.inf), _sum(a.high, b.high, math.inf)).widened()

    def _product(self, node: c_ast.BinaryOp) -> Range:
        """Bounds operation by operation, as it is rounded; the sign of all factors together."""
        a, b = self.range(node.left), self.range(node.right)
        if node.op == "/":
            b = Range(_inverse(b.high), _inverse(b.low)) if b.avoids_zero else ANY
        result = _times(a, b).widened()
        return Range(max(result.low, 0.0), max(result.high, 0.0)) if self._not_negative(node) else result

    def _not_negative(self, node: c_ast.Node) -> bool:
        """Whether a product is not negative.

        Factors that occur an even number of times, above or below the line, do not matter; the others must not be
        negative, and below the line not zero, which has a sign.
        """
        above, below = self._factors(node)
        texts = [_write(factor) for factor in above + below]
        odd = [texts.count(text) % 2 == 1 for text in texts]
        return all(
            self.range(factor).low >= 0.0 if k < len(above) else self.range(factor).low > 0.0
            for k, factor in enumerate(above + below)
            if odd[k]
        )

    def _factors(self, node: c_ast.Node) -> tuple[list[c_ast.Node], list[c_ast.Node]]:
        """Numerators and denominators; a name that stands for a product of unknown sign is opened."""
        if isinstance(node, c_ast.BinaryOp) and node.op in {"*", "/"}:
            (above, below), (right_above, right_below) = self._factors(node.left), self._factors(node.right)
            if node.op == "/":
                right_above, right_below = right_below, right_above
            return above + right_above, below + right_below
        if isinstance(node, c_ast.ID) and node.name not in self.assigned and not self.range(node).avoids_zero:
            definition = self.definitions.get(node.name)
            if isinstance(definition, c_ast.BinaryOp) and definition.op in {"*", "/"}:
                return self._factors(definition)
        return [node], []

    def _call(self, node: c_ast.FuncCall) -> Range:
        name = node.name.name if isinstance(node.name, c_ast.ID) else ""
        arguments = node.args.exprs if node.args else []
        if name in SQRT and len(arguments) == 1:
            inner = self.range(arguments[0])
            return Range(math.sqrt(max(inner.low, 0.0)), math.sqrt(max(inner.high, 0.0))).widened()
        if name in {"larger", "smaller"} and len(arguments) == 2:
            return self._extreme(name == "larger", arguments[0], arguments[1])
        return ANY

    def _extreme(self, larger: bool, first: c_ast.Node, second: c_ast.Node) -> Range:
        """``(a > b) ? a : b`` or its mirror. Where a is not a number the answer is b."""
        a, b = self.range(first), self.range(second)
        choose = max if larger else min
        low, high = choose(a.low, b.low), choose(a.high, b.high)
        return Range(low, max(high, b.high)) if larger else Range(min(low, b.low), high)

    def _ternary(self, node: c_ast.TernaryOp) -> Range:
        cond = node.cond
        if isinstance(cond, c_ast.BinaryOp) and cond.op in _MIRRORED:
            texts = (_write(cond.left), _write(cond.right))
            if (_write(node.iftrue), _write(node.iffalse)) == texts:
                return self._extreme(cond.op in {">", ">="}, cond.left, cond.right)
        a, b = self.guarded(cond).range(node.iftrue), self.range(node.iffalse)
        return Range(min(a.low, b.low), max(a.high, b.high))

    # --- what a condition teaches

    def guarded(self, condition: c_ast.Node) -> Function:
        """The bounds known where the condition holds."""
        ranges = dict(self.ranges)
        for name, known in self._lessons(condition):
            before = ranges.get(name, ANY)
            ranges[name] = Range(max(before.low, known.low), min(before.high, known.high))
        return Function(ranges, self.definitions, self.assigned, self.ports)

    def _lessons(self, condition: c_ast.Node) -> Iterator[tuple[str, Range]]:
        if not isinstance(condition, c_ast.BinaryOp):
            return
        if condition.op == "&&":
            yield from self._lessons(condition.left)
            yield from self._lessons(condition.right)
        elif condition.op in _MIRRORED:
            yield from self._comparison(condition.left, condition.op, condition.right)
            yield from self._comparison(condition.right, _MIRRORED[condition.op], condition.left)

    def _comparison(self, name: c_ast.Node, op: str, other: c_ast.Node) -> Iterator[tuple[str, Range]]:
        if not isinstance(name, c_ast.ID) or name.name in self.assigned:
            return
        bound = self.range(other)
        if op in {">", ">="}:
            yield name.name, Range(max(bound.low, TINY) if op == ">" and bound.low == 0.0 else bound.low)
        else:
            high = min(bound.high, -TINY) if op == "<" and bound.high == 0.0 else bound.high
            yield name.name, Range(-math.inf, high)


def divisions(functions: list[c_ast.FuncDef], inputs: dict[str, Range] | None = None) -> list[Division]:
    """Every division, with the proved range of its divisor.

    ``functions`` are a file's, in its order. What one writes to ``A_out[k]`` another reads as ``A[k]``, provided that
    A is an array of the step's own, which only those functions touch. ``inputs`` says more of elements such as
    ``R[0]`` than that they are positive.
    """
    ports = dict(inputs or {})
    local = _handed_over(functions)
    found = []
    for function in functions:
        known = Function(assigned=frozenset(_assigned(function.body)), ports=ports)
        found += [Division(function.decl.name, *item) for item in _walk(function.body, known)]
        for name, written in _outputs(function.body, local):
            ports[name] = _join(ports.get(name), known.range(written))
    return found


def _handed_over(functions: list[c_ast.FuncDef]) -> set[str]:
    """Local arrays that are only ever handed to arguments of their own name, or that name and ``_out``."""
    arguments = {f.decl.name: [p.name for p in f.decl.type.args.params] for f in functions if f.decl.type.args}
    local, otherwise = set(), set()
    for node in (node for function in functions for node in _every(function.body)):
        if isinstance(node, c_ast.Decl) and isinstance(node.type, c_ast.ArrayDecl):
            local.add(node.name)
        if isinstance(node, c_ast.Assignment) and isinstance(node.lvalue, c_ast.ArrayRef):
            otherwise.add(_write(node.lvalue.name))
        if isinstance(node, c_ast.FuncCall) and node.args is not None:
            names = arguments.get(_write(node.name), [])
            for given, name in zip(node.args.exprs, [*names, *[""] * len(node.args.exprs)], strict=False):
                if isinstance(given, c_ast.ID) and name not in {given.name, f"{given.name}_out"}:
                    otherwise.add(given.name)
    return local - otherwise


def _outputs(body: c_ast.Node, local: set[str]) -> Iterator[tuple[str, c_ast.Node]]:
    """Elements ``A[k]`` and what ``A_out[k]`` is given."""
    for node in _every(body):
        if isinstance(node, c_ast.Assignment) and isinstance(node.lvalue, c_ast.ArrayRef):
            array, _, rest = _write(node.lvalue).partition("_out[")
            if array in local and rest:
                yield f"{array}[{rest}", node.rvalue


def _join(before: Range | None, now: Range) -> Range:
    return now if before is None else Range(min(before.low, now.low), max(before.high, now.high))


def _walk(node: c_ast.Node, known: Function) -> Iterator[tuple[int, str, Range]]:
    """Line, divisor and range of each division, in order of the text, learning each name's range on the way."""
    divisor = _divisor(node)
    if divisor is not None:
        yield node.coord.line if node.coord else 0, _write(divisor), known.range(divisor)
    for part, child in node.children():
        inside = known
        if isinstance(node, c_ast.If | c_ast.TernaryOp) and part == "iftrue":
            inside = known.guarded(node.cond)
        yield from _walk(child, inside)
    if isinstance(node, c_ast.Decl) and node.init is not None and node.name and node.name not in known.assigned:
        known.definitions[node.name] = node.init
        positive = node.name in POSITIVE
        known.ranges[node.name] = POSITIVE_RANGE if positive else known.range(node.init)


def _divisor(node: c_ast.Node) -> c_ast.Node | None:
    if isinstance(node, c_ast.BinaryOp) and node.op in {"/", "%"}:
        return node.right
    if isinstance(node, c_ast.Assignment) and node.op in {"/=", "%="}:
        return node.rvalue
    return None


def _every(node: c_ast.Node) -> Iterator[c_ast.Node]:
    yield node
    for _, child in node.children():
        yield from _every(child)


def _assigned(body: c_ast.Node) -> set[str]:
    """Names that change after their declaration, or whose address is taken."""
    names = set()
    for node in _every(body):
        target = None
        if isinstance(node, c_ast.Assignment):
            target = node.lvalue
        elif isinstance(node, c_ast.UnaryOp) and node.op in {"++", "--", "p++", "p--", "&"}:
            target = node.expr
        if isinstance(target, c_ast.ID):
            names.add(target.name)
    return names


def _literal(node: c_ast.Constant) -> Range:
    try:
        value = float(node.value.rstrip("fFlLuU")) if "x" not in node.value.lower() else _hexadecimal(node.value)
    except ValueError:
        return ANY
    with np.errstate(over="ignore"):
        stored = float(np.float32(value))
    return Range(stored, stored)


def _hexadecimal(text: str) -> float:
    return float.fromhex(text.rstrip("lLuU")) if "p" not in text.lower() else float.fromhex(text.rstrip("fFlL"))


def _sum(a: float, b: float, unknown: float) -> float:
    """a + b; infinities of both signs leave the bound unknown."""
    total = a + b
    return unknown if math.isnan(total) else total


def _times(a: Range, b: Range) -> Range:
    """A bound of zero times an infinite one is zero: the infinite one is never reached."""
    corners = [0.0 if 0.0 in (x, y) else x * y for x in (a.low, a.high) for y in (b.low, b.high)]
    return Range(min(corners), max(corners))


def _inverse(value: float) -> float:
    return 0.0 if math.isinf(value) else 1.0 / value
