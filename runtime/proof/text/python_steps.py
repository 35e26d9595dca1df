"""Carries out the statements of the generated Python on terms, as :mod:`runtime.proof.text.c_steps` does C's.

An array of lanes is one value, that of a lane which stands for all; ``np.any`` and ``np.all`` are truths over lanes.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import Any

from runtime.proof.text.python_nodes import FunctionName, Record, Scope, aliases, copied, keeps_stages, leaves, replaced
from runtime.proof.text.terms import OverLanes, Term, Terms

_SIGNS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.FloorDiv: "/", ast.BitOr: "|", ast.BitAnd: "&"}
_RELATIONS = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}


class PythonText:
    """The functions and constants of a generated module; ``arithmetic`` is the class that ``math`` is."""

    def __init__(
        self, terms: Terms, module: ModuleType, tree: ast.Module, blocks: Mapping[str, Any], arithmetic: str = "Float32"
    ) -> None:
        self.terms, self.blocks = terms, blocks
        self.functions = {d.name: d for d in tree.body if isinstance(d, ast.FunctionDef)}
        self.constants = {k: v for k, v in vars(module).items() if isinstance(v, int | float | tuple)}
        self.math = aliases(tree, arithmetic)
        #: Constants that were rounded to float32: NumPy does that where they meet an array, Python itself does not.
        self.rounded: set[Term] = set()
        self.elsewhere: dict[str, Callable[[list[Any]], Any]] = {}

    def call(self, name: str, arguments: list[Any]) -> Any:
        """Carry out a function; a block becomes one term an output.

        Parameters
        ----------
        name : str
            The name.
        arguments : list of Any
            Words of the command line; default: the process's own.
        """
        definition = self.functions.get(name)
        if definition is None or len(arguments) > len(definition.args.args):
            return self.terms.unknown(f"a call of {name}")
        if name in self.blocks:
            return self._block(name, arguments)
        if name == "_size":
            return self._size(definition, arguments)
        names = [argument.arg for argument in definition.args.args]
        scope = Scope(zip(names, arguments, strict=False))
        return _Run(self, scope).statements(definition.body)

    def _size(self, definition: ast.FunctionDef, arguments: list[Any]) -> Any:
        """|value|: as far as sizes are compared what C reads off the bits."""
        (value,) = arguments
        if ast.unparse(definition.body[-1]) != "return _larger(value, -value)":
            return self.terms.unknown("another _size")
        return self.terms.make("size", value, whole=True)

    def _block(self, name: str, arguments: list[Any]) -> Any:
        inputs = [self.terms.make("array", *a) for a in arguments if isinstance(a, list | tuple)]
        call = self.terms.make("call", name, *inputs)
        ports = [
            tuple(self.terms.make("out", call, port, k) for k in range(size))
            for port, size in enumerate(self.blocks[name])
        ]
        return tuple(ports) if len(ports) > 1 else ports[0]


class _Run:
    """One call: its variables, and the statements still to come."""

    def __init__(self, text: PythonText, scope: Scope) -> None:
        self.text, self.terms, self.scope = text, text.terms, scope

    # --- statements

    def statements(self, items: list[ast.stmt]) -> Any:
        """Carry out statements; the value that they return, if any."""
        for k, item in enumerate(items):
            if isinstance(item, ast.Return):
                return self.value(item.value) if item.value is not None else None
            if keeps_stages(item):
                continue
            if isinstance(item, ast.If) and any(isinstance(part, ast.Return) for part in ast.walk(item)):
                return self._branch(item, items[k + 1 :])
            self._statement(item)
        return None

    def _branch(self, item: ast.If, rest: list[ast.stmt]) -> Any:
        condition = self.truth(item.test)
        if isinstance(condition, Term) and condition.kind == "integer":
            return self.statements([*(item.body if condition.args[0] else item.orelse), *rest])
        before = copied(self.scope)
        one = self.statements([*item.body, *rest])
        after, self.scope = self.scope, before
        two = self.statements([*item.orelse, *rest])
        for name in {**after, **self.scope}:
            self.scope[name] = self._merged(condition, after.get(name), self.scope.get(name))
        return self._merged(condition, one, two) if one is not None or two is not None else None

    def _merged(self, condition: Term | OverLanes, one: Any, two: Any) -> Any:
        if isinstance(one, Term) and isinstance(two, Term):
            return self.terms.merge(condition, one, two)
        if isinstance(one, Record) and isinstance(two, Record):
            for name in one:
                one[name] = self._merged(condition, one[name], two.get(name))
            return one  # the object itself, which the caller knows
        if isinstance(one, list | tuple) and isinstance(two, list | tuple) and len(one) == len(two):
            return type(one)(self._merged(condition, a, b) for a, b in zip(one, two, strict=True))
        return one if one is two or one == two else self.terms.unknown("written in one branch only")

    def _statement(self, item: ast.stmt) -> None:
        match item:
            case ast.Assign(targets=[target], value=value):
                self._store(target, self.value(value))
            case ast.If():
                self._branch(item, [])
            case ast.For(target=target, iter=over, body=body, orelse=[]):
                for entry in self._entries(self.value(over)):
                    self._store(target, entry)
                    self.statements(body)
            case ast.While(test=ast.Constant(value=True), body=[*body, ast.If(test=test, body=[ast.Break()])]):
                self._repeat(body, test)
            case ast.Expr(value=ast.Constant()):
                pass  # a docstring
            case ast.Expr(value=ast.Call() as call):
                self.value(call)
            case _:
                self._spoil(f"a statement: {type(item).__name__}")

    def _spoil(self, why: str) -> None:
        for name in self.scope:
            self.scope[name] = self._changed(self.scope[name], lambda _: self.terms.unknown(why))

    def _entries(self, value: Any) -> list[Any]:
        return list(value) if isinstance(value, list | tuple) else [self.terms.unknown("a loop over")]

    def _store(self, target: ast.expr, value: Any) -> None:
        match target:
            case ast.Name(id=name):
                self.scope[name] = value
            case ast.Tuple(elts=targets):
                if isinstance(value, list | tuple) and len(value) == len(targets):
                    for part, entry in zip(targets, value, strict=True):
                        self._store(part, entry)
                else:
                    for part in targets:
                        self._store(part, self.terms.unknown("a part"))
            case ast.Attribute(value=owner, attr=name):
                record = self.value(owner)
                if isinstance(record, Record):
                    record[name] = value
            case ast.Subscript(value=ast.Name(id=name), slice=place):
                index = self.value(place)
                if isinstance(self.scope.get(name), list) and isinstance(index, Term) and index.kind == "integer":
                    self.scope[name][index.args[0]] = value
                else:
                    self.scope[name] = self.terms.unknown("an entry")
            case _:
                self._spoil("a target")

    def _repeat(self, body: list[ast.stmt], test: ast.expr) -> None:
        """``while True: ...; if not np.any(mask): break``, as C's do-while."""
        own, before = self.scope, copied(self.scope)
        _, start, after = self._passed(body, test, before, None, set())
        changed = {key for key in start if after.get(key) is not start[key]}
        truths = {key for key in changed if self.terms.is_truth(leaves(before)[key])}
        while True:
            again, start, after = self._passed(body, test, before, changed, truths)
            wrong = {key for key in truths if not self.terms.is_truth(after[key])}
            if not wrong:
                break
            truths -= wrong
        values = leaves(before)
        found = self.terms.loop(
            {key: (start[key], values[key]) for key in changed}, {key: after[key] for key in changed}, again
        )
        self.scope = replaced(before, found)
        for name, record in own.items():
            if isinstance(record, Record):  # the object itself, which the caller knows
                record.update(self.scope[name])
                self.scope[name] = record

    def _passed(
        self, body: list[ast.stmt], test: ast.expr, before: Scope, cells: set[Any] | None, truths: set[Any]
    ) -> tuple[Term | OverLanes, dict[Any, Term], dict[Any, Term]]:
        values = leaves(before)
        start = {
            key: self.terms.phi(key, key in truths, value.whole)
            for key, value in values.items()
            if cells is None or key in cells
        }
        self.scope = replaced(before, start)
        self.statements(body)
        ends = self.truth(test)
        again: Term | OverLanes = self.terms.unknown("a loop's end")
        if isinstance(ends, OverLanes) and ends.every:
            again = OverLanes(self.terms.opposite(ends.condition))
        after = leaves(self.scope)
        return again, start, {key: after.get(key, self.terms.unknown("lost")) for key in start}

    @staticmethod
    def _changed(value: Any, change: Callable[[Any], Any]) -> Any:
        if isinstance(value, Record):
            for name in value:
                value[name] = _Run._changed(value[name], change)
            return value
        if isinstance(value, list | tuple):
            return type(value)(_Run._changed(entry, change) for entry in value)
        return change(value)

    # --- values

    def value(self, node: ast.expr | None) -> Any:
        match node:
            case ast.Constant(value=bool(value)):
                return self.terms.integer(int(value))
            case ast.Constant(value=value):
                return self._constant(value)
            case ast.Name(id=name):
                if name in self.scope:
                    return self.scope[name]
                if name in self.text.constants:
                    return self._constant(self.text.constants[name])
                return self.terms.unknown(f"the name {name}")
            case ast.IfExp(test=test, body=one, orelse=two):
                condition = self.truth(test)
                if isinstance(condition, Term) and condition.kind == "integer":
                    return self.value(one if condition.args[0] else two)
                return self.terms.unknown("if ... else")
            case ast.Tuple(elts=parts) | ast.List(elts=parts):
                return self._sequence(parts, tuple if isinstance(node, ast.Tuple) else list)
            case ast.Attribute(value=ast.Name(id="math"), attr=name) if name in self.text.math:
                return FunctionName(self.text.math[name])
            case ast.Attribute(value=owner, attr=name):
                record = self.value(owner)
                return record[name] if isinstance(record, Record) and name in record else self.terms.unknown(name)
            case ast.Subscript(value=owner, slice=ast.Tuple(elts=[])):
                return self.value(owner)  # an array without dimensions is its scalar
            case ast.Subscript(value=owner, slice=place):
                return self._entry(self.value(owner), place)
            case ast.Call():
                return self._call(node)
            case ast.GeneratorExp() | ast.ListComp():
                return self._generated(node)
        return self._computed(node)

    def _constant(self, value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(self._constant(entry) for entry in value)
        if isinstance(value, float):
            number = self.terms.number(value)
            if float(number.args[0]) != value:
                self.text.rounded.add(number)
            return number
        return self.terms.integer(value) if isinstance(value, int) else value

    def _sequence(self, parts: list[ast.expr], kind: Any) -> Any:
        found: list[Any] = []
        for part in parts:
            if isinstance(part, ast.Starred):
                found += self._entries(self.value(part.value))
            else:
                found.append(self.value(part))
        return kind(found)

    def _entry(self, owner: Any, place: ast.expr) -> Any:
        if isinstance(place, ast.Slice):
            match owner, place:
                case ((list() | tuple()), ast.Slice(lower=ast.Constant(value=int(first)), upper=None, step=None)):
                    return owner[first:]
                case ((list() | tuple()), ast.Slice(lower=None, upper=ast.Constant(value=int(last)), step=None)):
                    return owner[:last]
            return self.terms.unknown("a slice")
        index = self.value(place)
        if isinstance(owner, list | tuple) and isinstance(index, Term) and index.kind == "integer":
            k = index.args[0]
            return owner[k] if -len(owner) <= k < len(owner) else self.terms.unknown("an index")
        return self.terms.unknown("an entry")

    def _generated(self, node: ast.GeneratorExp | ast.ListComp) -> Any:
        (loop,) = node.generators
        found = []
        for entry in self._entries(self.value(loop.iter)):
            self._store(loop.target, entry)
            found.append(self.value(node.elt))
        return found

    def _call(self, node: ast.Call) -> Any:
        match node:
            case ast.Call(func=ast.Name(id=name), keywords=[]) if name in self.text.functions:
                return self.text.call(name, [self.value(a) for a in node.args])
            case ast.Call(func=ast.Name(id=name), keywords=[]) if isinstance(self.scope.get(name), FunctionName):
                return self.text.call(self.scope[name], [self.value(a) for a in node.args])
            case ast.Call(func=ast.Name(id=name), keywords=[]) if name in self.text.elsewhere:
                return self.text.elsewhere[name]([self.value(a) for a in node.args])
            case ast.Call(func=ast.Attribute(value=ast.Name(id="math"), attr="dtype"), args=[inner]):
                value = self.value(inner)
                whole = isinstance(value, Term) and value.kind == "integer"
                if isinstance(value, Term) and value.kind == "number":
                    self.text.rounded.discard(value)
                return self.terms.number(value.args[0]) if whole else value
            case ast.Call(func=ast.Attribute(value=ast.Name(id="math"), attr=name)) if name in self.text.math:
                return self.text.call(self.text.math[name], [self.value(a) for a in node.args])
            case ast.Call(func=ast.Attribute(value=ast.Name(id="np"), attr=name)):
                return self._numpy(name, node.args)
            case ast.Call(func=ast.Name(id=name), keywords=[]):
                return self._builtin(name, [self.value(a) for a in node.args])
        return self.terms.unknown("a call")

    def _numpy(self, name: str, args: list[ast.expr]) -> Any:
        if name in {"zeros", "ones"}:  # of the shape of the lanes
            return self.terms.integer(int(name == "ones"))
        values = [self.value(a) for a in args]
        if not all(isinstance(value, Term) for value in values):
            return self.terms.unknown(f"np.{name}")
        if name == "logical_not" and len(values) == 1:
            return self.terms.opposite(values[0])
        if name == "where" and len(values) == 3:
            return self.terms.merge(values[0], values[1], values[2])
        if name in {"any", "all"} and len(values) == 1:
            return OverLanes(self.terms.truth(values[0]), every=name == "all")
        return self.terms.unknown(f"np.{name}")

    def _builtin(self, name: str, values: list[Any]) -> Any:
        numbers = [v.args[0] for v in values if isinstance(v, Term) and v.kind == "integer"]
        if name == "range" and len(numbers) == len(values):
            return [self.terms.integer(k) for k in range(*numbers)]
        if name in {"tuple", "list"} and len(values) == 1 and isinstance(values[0], list | tuple):
            return (tuple if name == "tuple" else list)(values[0])
        if name == "len" and isinstance(values[0], list | tuple):
            return self.terms.integer(len(values[0]))
        if name == "zip" and all(isinstance(v, list | tuple) for v in values):
            return list(zip(*values, strict=False))
        if name == "enumerate" and isinstance(values[0], list | tuple):
            return [(self.terms.integer(k), v) for k, v in enumerate(values[0])]
        return self.terms.unknown(f"a call of {name}")

    def _computed(self, node: Any) -> Any:
        match node:
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                value = self.value(operand)
                return self.terms.negative(value) if isinstance(value, Term) else self.terms.unknown("-")
            case ast.UnaryOp(op=ast.Invert(), operand=operand):
                value = self.value(operand)
                known = isinstance(value, Term) and self.terms.is_truth(value)
                return self.terms.opposite(value) if known else self.terms.unknown("~ of what is no truth")
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _SIGNS:
                return self._operation(_SIGNS[type(op)], self.value(left), self.value(right))
            case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in _RELATIONS:
                a, b = self.value(left), self.value(right)
                known = isinstance(a, Term) and isinstance(b, Term)
                return self.terms.compare(_RELATIONS[type(op)], a, b) if known else self.terms.unknown("a comparison")
        return self.terms.unknown(f"an expression: {type(node).__name__}")

    def _operation(self, sign: str, left: Any, right: Any) -> Any:
        if isinstance(left, Term) and isinstance(right, Term):
            if left.kind == right.kind == "number" and not self.text.rounded.isdisjoint({left, right}):
                return self.terms.unknown("a product of constants that are no float32")
            return self.terms.operation(sign, left, right)
        if sign == "*" and isinstance(left, list | tuple) and isinstance(right, Term) and right.kind == "integer":
            return left * right.args[0]
        return self.terms.unknown(sign)

    def truth(self, node: ast.expr) -> Term | OverLanes:
        """A condition of an ``if``, 0 or 1."""
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            value = self.truth(node.operand)
            if isinstance(value, OverLanes):
                return OverLanes(self.terms.opposite(value.condition), every=not value.every)
            return self.terms.opposite(value)
        value = self.value(node)
        if isinstance(value, OverLanes):
            return value
        return self.terms.truth(value) if isinstance(value, Term) and value.whole else self.terms.unknown("a condition")
