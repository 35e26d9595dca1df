"""Reads blocks, functions that are straight lines, as expressions: entry by entry, down to float32 constants."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

import numpy as np
from pycparser import c_ast

from runtime.proof.text.python_nodes import aliases, keeps_stages

#: An expression: (operation, operand, ...), down to names and float32 constants.
Tree = tuple[Any, ...]

_CALLS = {"_larger": "larger", "_smaller": "smaller", "sqrtf": "sqrt", "__builtin_sqrtf": "sqrt"}
_OPERATORS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}


@dataclass
class Function:
    """The named values of a block, and its outputs: by port, in order, and place."""

    entries: dict[str, Tree] = field(default_factory=dict)
    outputs: dict[tuple[int, int], Tree] = field(default_factory=dict)

    @property
    def sizes(self) -> tuple[int, ...]:
        """How many values each port hands out."""
        ports = [port for port, _ in self.outputs]
        return tuple(ports.count(port) for port in range(max(ports, default=-1) + 1))

    def differences(self, other: Function) -> Iterator[tuple[str, bool]]:
        """Each entry and output of either, in order, and whether the two state it differently.

        Parameters
        ----------
        other : Function
        """
        for name in dict.fromkeys([*self.entries, *other.entries]):
            yield name, self.entries.get(name) != other.entries.get(name)
        for place in dict.fromkeys([*self.outputs, *other.outputs]):
            yield f"output {place[0]}[{place[1]}]", self.outputs.get(place) != other.outputs.get(place)


def _number(value: float) -> Tree:
    return ("number", repr(float(np.float32(value))))  # as text, so that 0 is not -0


def _negative(operand: Tree) -> Tree:
    return _number(-float(operand[1])) if operand[0] == "number" else ("neg", operand)


def _operation(sign: str, left: Tree, right: Tree) -> Tree:
    """Two constants are no operation to compare: Python would carry it out in double."""
    return ("constants", sign, object()) if left[0] == right[0] == "number" else (sign, left, right)


# --- NumPy


def python_functions(module: ModuleType, tree: ast.Module) -> dict[str, Function]:
    """Every function of the generated module that is a straight line; those of float32 under C's names.

    Parameters
    ----------
    module : module
        The generated module, executed: its constants are taken from it.
    tree : ast.Module
        The same, parsed.
    """
    constants = {k: _number(v) for k, v in vars(module).items() if isinstance(v, float)}
    called = {function: name for name, function in aliases(tree, "Float32").items()}
    read: dict[str, Function] = {}
    for definition in tree.body:
        if isinstance(definition, ast.FunctionDef):
            function = _PythonReader(constants, called).read(definition)
            if function is not None:
                name = called.get(definition.name, definition.name)
                read["wrap_angle" if name == "wrap" else name] = function
    return read


class _PythonReader:
    """Reads one function; None where it is more than a straight line."""

    def __init__(self, constants: Mapping[str, Tree], called: Mapping[str, str]) -> None:
        self.constants, self.called = dict(constants), called

    def read(self, definition: ast.FunctionDef) -> Function | None:
        function = Function()
        for statement in definition.body:
            if isinstance(statement, ast.Assign):
                if not self._assign(statement, function):
                    return None
            elif isinstance(statement, ast.Return) and statement.value is not None:
                for port, values in enumerate(_ports(statement.value)):
                    function.outputs.update({(port, k): self.tree(v) for k, v in enumerate(values)})
            elif not (_is_docstring(statement) or keeps_stages(statement)):
                return None
        return function

    def _assign(self, statement: ast.Assign, function: Function) -> bool:
        target, value = statement.targets[0], statement.value
        if isinstance(target, ast.Name):
            tree = self.tree(value)
            if tree[0] == "number":
                self.constants[target.id] = tree
            else:
                function.entries[target.id] = tree
        elif isinstance(target, ast.Tuple) and isinstance(value, ast.Name | ast.Call):
            whole = self.tree(value)
            for k, name in enumerate(target.elts):
                if not isinstance(name, ast.Name):
                    return False
                function.entries[name.id] = ("index", whole, k)
        else:
            return False
        return True

    def tree(self, node: ast.expr) -> Tree:
        match node:
            case ast.Constant(value=bool() | str() | None):
                return ("other", ast.dump(node))
            case ast.Constant(value=value):
                return _number(float(value))  # type: ignore[arg-type]
            case ast.Name(id=name):
                return self.constants.get(name, ("name", name))
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return _negative(self.tree(operand))
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
                return _operation(_OPERATORS[type(op)], self.tree(left), self.tree(right))
            case ast.Call(func=ast.Attribute(value=ast.Name(id="math"), attr="wrap"), args=args):
                return ("call", "wrap_angle", *map(self.tree, args))
            case ast.Subscript(
                value=ast.Call(
                    func=ast.Attribute(value=ast.Name(id="np"), attr="where"),
                    args=[ast.Compare(left=left, ops=[ast.LtE()], comparators=[right]), one, two],
                ),
                slice=ast.Tuple(elts=[]),
            ):
                return ("select", *map(self.tree, (left, right, one, two)))
            case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name), args=args):
                return ("call", _CALLS.get(name, name), *map(self.tree, args))
            case ast.Subscript(value=value, slice=ast.Constant(value=k)):
                return ("index", self.tree(value), k)
        return ("other", ast.dump(node))


def _ports(value: ast.expr) -> list[list[ast.expr]]:
    """The return value of a function: ports of entries; one port's stand alone."""
    if not isinstance(value, ast.Tuple):
        return [[value]]
    if all(isinstance(entry, ast.Tuple) for entry in value.elts):
        return [list(entry.elts) for entry in value.elts if isinstance(entry, ast.Tuple)]
    return [value.elts]


def _is_docstring(statement: ast.stmt) -> bool:
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)


# --- C


def c_functions(tree: Any) -> dict[str, Function]:
    """Every function of an emitted file that is a straight line, or one in a loop over lanes.

    Parameters
    ----------
    tree : FileAST
        An emitted file.
    """
    readers = {d.decl.name: _CReader(d) for d in tree.ext if isinstance(d, c_ast.FuncDef)}
    return {name: reader.function for name, reader in readers.items() if reader.straight and reader.function.outputs}


class _CReader:
    """Reads one function: first declarations, then what is assigned to its outputs."""

    def __init__(self, definition: Any) -> None:
        self.function = Function()
        self.pairs: dict[str, Tree] = {}
        #: It is no more than that; arrays that are read and written are read first.
        self.straight = True
        self.loops = 0
        parameters = definition.decl.type.args.params if definition.decl.type.args else []
        self.ports = [p.name for p in parameters if p.name and p.name.endswith("_out")]
        self._statements(definition.body.block_items or [])

    def _statements(self, items: list[Any]) -> None:
        for statement in items:
            if _is_lane_loop(statement) and not self.loops:
                self.loops += 1
                self._statements(statement.stmt.block_items or [])
            elif isinstance(statement, c_ast.Decl):
                self._declared(statement)
            elif (place := self._assigned(statement)) is not None and place not in self.function.outputs:
                self.function.outputs[place] = self.tree(statement.rvalue)
            elif isinstance(statement, c_ast.Return):
                self._returned(statement.expr)
            elif not (isinstance(statement, c_ast.Cast) and isinstance(statement.expr, c_ast.ID)):
                self.straight = False

    def _returned(self, value: Any) -> None:
        if isinstance(value, c_ast.FuncCall) or _is_select(value):
            tree = self.function.outputs[0, 0] = self.tree(value)
            self.straight &= tree[0] != "other"  # carried out where the flow is
        elif not (isinstance(value, c_ast.ID) and value.name == "result"):
            self.straight = False

    def _declared(self, declaration: Any) -> None:
        kind = getattr(getattr(declaration.type, "type", None), "names", ["?"])[0]
        if declaration.init is None:
            self.straight &= (kind, declaration.name) in {("pmsm_pair", "result"), ("int", "lane")}
            return
        self.straight &= not (self.ports and self.function.outputs)
        tree = self.tree(declaration.init)
        if kind == "pmsm_pair":
            self.pairs[declaration.name] = tree
        elif kind == "float32":
            self.function.entries[declaration.name] = tree
        else:
            self.straight = False

    def _assigned(self, statement: Any) -> tuple[int, int] | None:
        """Port and place of the output that a statement assigns; None if it does something else."""
        if not (isinstance(statement, c_ast.Assignment) and statement.op == "="):
            return None
        match statement.lvalue:
            case c_ast.StructRef(
                name=c_ast.ID(name="result"), type=".", field=c_ast.ID(name="sine" | "cosine" as part)
            ):
                return 0, ("sine", "cosine").index(part)
        tree = self.tree(statement.lvalue)
        if tree[0] == "index" and tree[1][0] == "name" and tree[1][1] in self.ports:
            return self.ports.index(tree[1][1]), tree[2]
        return None

    def tree(self, node: Any) -> Tree:
        match node:
            case c_ast.Constant(type="float", value=value):  # without its f it would be a double
                return _number(float(value.rstrip("fF")))
            case c_ast.ID(name=name):
                return self.pairs.get(name, ("name", name))
            case c_ast.UnaryOp(op="-", expr=operand):
                return _negative(self.tree(operand))
            case c_ast.BinaryOp(op="+" | "-" | "*" | "/" as op, left=left, right=right):
                return _operation(op, self.tree(left), self.tree(right))
            case c_ast.FuncCall(name=c_ast.ID(name="chosen"), args=c_ast.ExprList(exprs=[truth, one, two])):
                return self._chosen(truth, one, two)
            case c_ast.FuncCall(name=c_ast.ID(name=name), args=args):
                return ("call", _CALLS.get(name, name), *map(self.tree, args.exprs if args else ()))
            case c_ast.TernaryOp(cond=c_ast.BinaryOp(op="<=", left=left, right=right), iftrue=one, iffalse=two):
                return ("select", *map(self.tree, (left, right, one, two)))
            case c_ast.StructRef(name=pair, field=c_ast.ID(name="sine" | "cosine" as part)):
                return ("index", self.tree(pair), ("sine", "cosine").index(part))
            case c_ast.ArrayRef(
                name=c_ast.StructRef(name=entry, field=c_ast.ID(name="of")), subscript=c_ast.ID(name="lane")
            ):
                return self.tree(entry)
            case c_ast.ArrayRef(name=owner, subscript=c_ast.Constant(type="int", value=k)):
                return ("index", self.tree(owner), int(k))
        return ("other", str(node), object())

    def _chosen(self, truth: Any, one: Any, two: Any) -> Tree:
        """``chosen((a <= b) ? 1 : 0, c, d)``: which is which is carried out where the flow is."""
        match truth:
            case c_ast.TernaryOp(
                cond=c_ast.BinaryOp(op="<=", left=left, right=right),
                iftrue=c_ast.Constant(value="1"),
                iffalse=c_ast.Constant(value="0"),
            ):
                return ("select", *map(self.tree, (left, right, one, two)))
        return ("other", str(truth), object())


def _is_select(value: Any) -> bool:
    """``(a <= b) ? c : d`` of numbers by their names; ``? 1 : 0`` is a truth."""
    match value:
        case c_ast.TernaryOp(cond=c_ast.BinaryOp(op="<="), iftrue=c_ast.ID()):
            return True
    return False


def _is_lane_loop(statement: Any) -> bool:
    """``for (lane = 0; lane < 16; lane++)``."""
    match statement:
        case c_ast.For(
            init=c_ast.Assignment(op="=", lvalue=c_ast.ID(name="lane"), rvalue=c_ast.Constant(value="0")),
            cond=c_ast.BinaryOp(op="<", left=c_ast.ID(name="lane"), right=c_ast.Constant(value="16")),
            next=c_ast.UnaryOp(op="p++", expr=c_ast.ID(name="lane")),
            stmt=c_ast.Compound(),
        ):
            return True
    return False
