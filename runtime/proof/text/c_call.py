"""Carries out one call of an emitted C function; see :mod:`runtime.proof.text.c_steps`."""

from __future__ import annotations

from typing import Any, cast

from pycparser import c_ast

from runtime.proof.text.c_nodes import (
    LANE,
    LANES,
    Array,
    Memory,
    Pointer,
    Unit,
    Value,
    declared,
    items,
    returns,
)
from runtime.proof.text.terms import OverLanes, Term


class Call:
    """One call: its variables, and the statements still to come."""

    def __init__(self, text: Unit, scope: dict[str, Any]) -> None:
        self.text, self.terms, self.scope = text, text.terms, scope

    # --- statements

    def statements(self, items: list[Any]) -> Value:
        """Carry out statements; the value that they return, if any.

        Parameters
        ----------
        items : list of pycparser node
        """
        for k, item in enumerate(items):
            rest = items[k + 1 :]
            if isinstance(item, c_ast.Return):
                return self.value(item.expr) if item.expr is not None else None
            if isinstance(item, c_ast.If) and returns(item):
                return self._branch(item, rest)
            self._statement(item)
        return None

    def _branch(self, item: Any, rest: list[Any]) -> Value:
        """An ``if``, and what follows it: once behind each branch where one of them returns, else nothing."""
        condition = self.truth(item.cond)
        if isinstance(condition, Term) and condition.kind == "integer":
            return self.statements([*items(item.iftrue if condition.args[0] else item.iffalse), *rest])
        before = dict(self.text.memory)
        one = self.statements([*items(item.iftrue), *rest])
        after, self.text.memory = self.text.memory, before
        two = self.statements([*items(item.iffalse), *rest])
        merged = {
            key: self._merged(condition, after.get(key), self.text.memory.get(key))
            for key in after.keys() | self.text.memory.keys()
        }
        self.text.memory = merged
        return None if one is None and two is None else self._merged(condition, one, two)

    def _merged(self, condition: Term | OverLanes, one: Value, two: Value) -> Term | OverLanes:
        if one is two and isinstance(one, Term | OverLanes):
            return one
        if isinstance(one, Term) and isinstance(two, Term):
            return self.terms.merge(condition, one, two)
        return self.terms.unknown("written in one branch only")

    def _statement(self, item: Any) -> None:
        match item:
            case c_ast.Decl():
                self._declare(item)
            case c_ast.If():
                self._branch(item, [])
            case c_ast.For():
                self._for(item)
            case c_ast.DoWhile():
                self._repeat(item)
            case c_ast.Compound():
                self.statements(item.block_items or [])
            case c_ast.Assignment():
                self._assign(item)
            case c_ast.UnaryOp(op="p++", expr=target):
                array, place = self.place(target)
                self.text.write(array, place, self._plus(self.text.read(array, place)))
            case c_ast.FuncCall():
                self.value(item)
            case c_ast.Cast(expr=c_ast.FuncCall() as call):
                self.value(call)  # (void)f(x): what it returns is not wanted
            case c_ast.Cast(expr=c_ast.ID()):
                pass  # (void)x: says to the compiler that it is not used
            case _:
                self._spoil(f"a statement: {type(item).__name__}")

    def _spoil(self, why: str) -> None:
        """A statement that is not understood may have written anything."""
        for key in self.text.memory:
            self.text.memory[key] = self.terms.unknown(why)

    def _plus(self, value: Any) -> Term:
        return self.terms.operation("+", value, self.terms.one) if isinstance(value, Term) else self.terms.unknown("++")

    def _struct(self, node: Any) -> Any:
        """The struct that ``*f``, ``s->rival`` or a name stands for; None: it is none."""
        if isinstance(node, c_ast.UnaryOp) and node.op == "*":
            node = node.expr
        if not isinstance(node, c_ast.ID | c_ast.StructRef):
            return None
        found = self.value_of_field(node) if isinstance(node, c_ast.StructRef) else self.scope.get(node.name)
        return found if isinstance(found, dict) else None

    def _copy_struct(self, target: Any, source: Any) -> None:
        for name, cells in target.items():
            if isinstance(cells, dict):
                self._copy_struct(cells, source[name])
                continue
            for k in range(cells.size):
                self.text.memory[cells.id, k] = self.text.read(source[name], k)

    def _declare_struct(self, item: Any, kind: str) -> None:
        made = self.scope[item.name] = self.text.new_struct(kind, f"{item.name}.")
        source = self._struct(item.init) if item.init is not None else None
        if source is not None:
            self._copy_struct(made, source)
            return
        for name, cells in made.items():
            for k in range(getattr(cells, "size", 0)):
                self.text.memory[cells.id, k] = self.terms.unknown(f"{item.name}.{name}[{k}] before it is written")

    def _declare(self, item: Any) -> None:
        kind, size = declared(item.type)
        if size is None and self.text.is_struct(kind):
            self._declare_struct(item, kind)
            return
        array = self.text.new_array(item.name, size, kind)
        self.scope[item.name] = array
        if isinstance(item.init, c_ast.InitList):
            array.of_lanes = False
            for k, entry in enumerate(item.init.exprs):
                self.text.memory[array.id, k] = cast(Term, self.value(entry))
        elif item.init is None:
            for k in range(array.size):
                self.text.memory[array.id, k] = self.terms.unknown(f"{item.name}[{k}] before it is written")
        else:
            value = self.value(item.init)
            if not isinstance(value, Term | OverLanes) or (isinstance(value, Term) and value.whole != array.whole):
                value = self.terms.unknown(f"what {item.name} is")
            self.text.memory[array.id, 0] = value

    def _for(self, item: Any) -> None:
        """A loop over lanes once, for one; any other, whose bounds are numbers, pass by pass."""
        variable, first, last = self._bounds(item)
        if variable is None:
            self._spoil("a loop without fixed bounds")
        elif variable == LANE:
            if (first, last) != (0, LANES) or self.text.lanes:
                self._spoil("a loop over some lanes")
                return
            outer, self.text.lanes = self.scope.get(LANE), True
            self.scope[LANE] = LANE
            self.statements(items(item.stmt))
            self.scope[LANE], self.text.lanes = outer, False
        else:
            for k in range(first, last):
                self.scope[variable] = self.terms.integer(k)
                self.statements(items(item.stmt))

    def _bounds(self, item: Any) -> tuple[str | None, int, int]:
        """Of ``for (k = first; k < last; k++)``."""
        match item:
            case c_ast.For(
                init=c_ast.Assignment(op="=", lvalue=c_ast.ID(name=a), rvalue=first),
                cond=c_ast.BinaryOp(op="<", left=c_ast.ID(name=b), right=last),
                next=c_ast.UnaryOp(op="p++", expr=c_ast.ID(name=c)),
            ) if a == b == c:
                ends = [self.value(first), self.value(last)]
                if all(isinstance(end, Term) and end.kind == "integer" for end in ends):
                    return a, *(int(cast(Term, end).args[0]) for end in ends)
        return None, 0, 0

    def _repeat(self, item: Any) -> None:
        """``do ... while``: twice on what stands for any pass, first to see what it changes."""
        text, before = self.text, dict(self.text.memory)
        cells = {key: text.arrays[key[0]] for key, value in before.items() if isinstance(value, Term)}
        after, _, start = self._passed(item, before, cells, set())
        cells = {key: array for key, array in cells.items() if after[key] is not start[key]}
        truths = {key for key in cells if self._is_truth(before[key])}
        while True:
            after, again, start = self._passed(item, before, cells, truths)
            wrong = {key for key in truths if not self._is_truth(after[key])}
            if not wrong:
                break
            truths -= wrong
        named = {key: (array.name.split(".")[-1], key[1]) for key, array in cells.items()}
        found = self.terms.loop(
            {named[key]: (start[key], cast(Term, before[key])) for key in cells},
            {named[key]: self._known(after[key]) for key in cells},
            again,
        )
        text.memory = before | {key: found[named[key]] for key in cells}

    def _is_truth(self, value: Any) -> bool:
        return isinstance(value, Term) and self.terms.is_truth(value)

    def _known(self, value: Any) -> Term:
        return value if isinstance(value, Term) else self.terms.unknown("over lanes")

    def _passed(
        self, item: Any, before: Memory, cells: dict[tuple[int, int], Array], truths: set[tuple[int, int]]
    ) -> tuple[Memory, Term | OverLanes, dict[tuple[int, int], Term]]:
        """One pass in which ``cells`` hold what stands for any value: their values after it, whether it goes on."""
        start = {
            key: self.terms.phi((array.name.split(".")[-1], key[1]), key in truths, array.whole)
            for key, array in cells.items()
        }
        self.text.memory = {**before, **start}
        self.statements(items(item.stmt))
        again = self.truth(item.cond)
        return {key: self.text.memory[key] for key in cells}, again, start

    # --- assignments

    def _assign(self, item: Any) -> None:
        structs = self._struct(item.lvalue), self._struct(item.rvalue)
        if all(struct is not None for struct in structs) and item.op == "=":
            self._copy_struct(*structs)
            return
        array, place = self.place(item.lvalue)
        value = self.value(item.rvalue)
        if item.op in {"|=", "+="}:
            if isinstance(value, OverLanes) or (self.text.lanes and not (array.of_lanes or array.private)):
                self.text.write(array, place, value, adds=item.op == "|=")
                return
            old = self.text.read(array, place)
            known = isinstance(old, Term) and isinstance(value, Term)
            value = self.terms.operation(item.op[0], old, value) if known else self.terms.unknown(item.op)  # type: ignore[arg-type]
        elif item.op != "=":
            value = self.terms.unknown(f"the operator {item.op}")
        if isinstance(value, Term) and value.whole != array.whole and value.kind != "unknown":
            value = self.terms.unknown(f"{array.name} of another type")
        self.text.write(array, place, value)

    def place(self, node: Any) -> tuple[Array, int]:
        """Array and place that an expression names.

        Parameters
        ----------
        node : pycparser node
            An expression; of one that names no cell the place is in an array of which nothing is known.
        """
        match node:
            case c_ast.ArrayRef(name=c_ast.StructRef(name=cell, field=c_ast.ID(name="of")), subscript=c_ast.ID(name=n)):
                if self.scope.get(n) == LANE:
                    return self.place(cell)
            case c_ast.ArrayRef(name=owner, subscript=subscript):
                pointer = self.value(owner)
                if isinstance(pointer, Pointer):
                    index = LANE if self._is_lane(subscript) else self.value(subscript)
                    if index == LANE and pointer.array.of_lanes and pointer.array.size == 1 and pointer.array.whole:
                        return pointer.array, 0
                    if isinstance(index, Term) and index.kind == "integer":
                        return pointer.array, pointer.offset + int(index.args[0])
            case c_ast.ID(name=name) if isinstance(self.scope.get(name), Array):
                return self.scope[name], 0
            case c_ast.StructRef():
                found = self.value_of_field(node)
                if isinstance(found, Array):
                    return found, 0
        return self.text.new_array("nothing known", None, "?"), 0

    def _is_lane(self, node: Any) -> bool:
        return isinstance(node, c_ast.ID) and self.scope.get(node.name) == LANE

    def value_of_field(self, node: Any) -> Any:
        """Return a field of a struct.

        Parameters
        ----------
        node : StructRef
        """
        owner = self.value_of_field(node.name) if isinstance(node.name, c_ast.StructRef) else self.value(node.name)
        return owner.get(node.field.name) if isinstance(owner, dict) else None

    # --- values

    def value(self, node: Any) -> Value:
        """Return the value of an expression.

        Parameters
        ----------
        node : pycparser node
        """
        match node:
            case c_ast.Constant(type="int", value=digits):
                return self.terms.integer(int(digits, 0))
            case c_ast.Constant(type="float", value=digits):  # without its f it would be a double
                return self.terms.number(float(digits.rstrip("fF")))
            case c_ast.ID(name=name):
                return self._named(name)
            case c_ast.StructRef():
                return self._whole(self.value_of_field(node))
            case c_ast.ArrayRef(name=c_ast.ID() as owner, subscript=c_ast.ID() as index) if self._chooses(index):
                return self._chosen(self.value(owner), self.value(index))
            case c_ast.ArrayRef():
                array, place = self.place(node)
                return self.text.read(array, place)
            case c_ast.UnaryOp(op="&", expr=c_ast.ArrayRef() as cell):
                return Pointer(*self.place(cell))
            case c_ast.UnaryOp(op="&", expr=c_ast.StructRef() as field):
                found = self.value_of_field(field)
                return found if isinstance(found, dict) else self._whole(found)
            case c_ast.FuncCall(name=c_ast.ID(name=name), args=args):
                return self.text.call(name, [self.argument(a) for a in (args.exprs if args else [])])
        return self._computed(node)

    def _chooses(self, index: Any) -> bool:
        found = self.scope.get(index.name)
        return isinstance(found, Array) and not found.is_array and self._is_truth(self.text.read(found, 0))

    def _chosen(self, owner: Value, truth: Value) -> Value:
        """The second of two cells where a truth holds, else the first."""
        if not isinstance(owner, Pointer) or not isinstance(truth, Term):
            return self.terms.unknown("an array by a truth")
        no, yes = (self.text.read(owner.array, owner.offset + k) for k in (0, 1))
        return self._merged(truth, yes, no)

    def argument(self, node: Any) -> Value:
        """Return an argument of a call: a value, or a pointer to where it lives.

        Parameters
        ----------
        node : pycparser node
        """
        return cast(Any, LANE) if self._is_lane(node) else self.value(node)

    def _named(self, name: str) -> Value:
        found = self.scope.get(name)
        if isinstance(found, Array):
            return self._whole(found)
        if name == "NULL":
            return None
        if name in self.text.numbers and name not in self.scope:
            return self.terms.integer(self.text.numbers[name])
        return self.terms.unknown(f"the name {name}") if found is None and name not in self.scope else found

    def _whole(self, array: Any) -> Value:
        """An array's pointer, a variable's value."""
        if not isinstance(array, Array):
            return array if isinstance(array, dict) else self.terms.unknown("a field")
        return Pointer(array) if array.is_array else self.text.read(array, 0)

    def _computed(self, node: Any) -> Value:
        match node:
            case c_ast.UnaryOp(op="-", expr=operand):
                value = self.value(operand)
                return self.terms.negative(value) if isinstance(value, Term) else self.terms.unknown("-")
            case c_ast.BinaryOp(op="+" | "-" | "*" | "/" | "|" | "&" as sign, left=left, right=right):
                a, b = self.value(left), self.value(right)
                known = isinstance(a, Term) and isinstance(b, Term)
                return self.terms.operation(sign, a, b) if known else self.terms.unknown(sign)  # type: ignore[arg-type]
            case c_ast.TernaryOp(cond=cond, iftrue=one, iffalse=two):
                condition, a, b = self.truth(cond), self.value(one), self.value(two)
                known = isinstance(condition, Term) and isinstance(a, Term) and isinstance(b, Term)
                return self.terms.select(condition, a, b) if known else self.terms.unknown("?:")  # type: ignore[arg-type]
            case c_ast.BinaryOp() | c_ast.UnaryOp(op="!"):
                return self.truth(node)
        return self.terms.unknown(f"an expression: {type(node).__name__}")

    def truth(self, node: Any) -> Term | OverLanes:
        """A condition, 0 or 1.

        Parameters
        ----------
        node : pycparser node
        """
        match node:
            case c_ast.UnaryOp(op="!", expr=operand):
                value = self.truth(operand)
                return self.terms.opposite(value) if isinstance(value, Term) else self.terms.unknown("!")
            case c_ast.BinaryOp(op="&&" | "||" as sign, left=left, right=right):
                a, b = self.truth(left), self.truth(right)
                if isinstance(a, Term) and isinstance(b, Term):
                    return self.terms.both(a, b) if sign == "&&" else self.terms.either(a, b)
                return self.terms.unknown(sign)
            case c_ast.BinaryOp(op="<" | "<=" | ">" | ">=" | "==" | "!=" as sign, left=left, right=right):
                return self._comparison(sign, self.value(left), self.value(right))
        found = self.value(node)
        return self.terms.truth(found) if isinstance(found, Term) and found.whole else self.terms.unknown("a condition")

    def _comparison(self, sign: str, left: Value, right: Value) -> Term | OverLanes:
        if isinstance(left, Term) and isinstance(right, Term):
            return self.terms.compare(sign, left, right)
        if right is None and sign == "==":  # a pointer that may be NULL
            return self.terms.integer(left is None)
        if isinstance(left, OverLanes) and sign == "!=" and right is self.terms.zero:
            return left
        return self.terms.unknown(sign)
