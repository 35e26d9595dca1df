"""Link text: the generated C and the generated NumPy state the same expressions, entry by entry.

The same float32 operations in the same order on the same constants give the same bits for every input, not only for
those that link D-E draws; nothing but the texts is needed to see it, and both are read by parsers that are not ours.
Flow around the blocks (guards, turns that are wide, lanes that are masked) is worded differently in the two
languages: that it does the same is link D-E's business.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

import numpy as np
from pycparser import c_ast

from codegen.evidence.emitted import parse_emitted
from runtime.estimator.folder import GeneratedFolder
from runtime.proof.result import Link, Row

#: An expression: (operation, operand, ...), down to names and float32 constants.
Tree = tuple[Any, ...]

#: C function -> the Python function that states the same, where they are not called alike.
ALIASES = {"sin_cos": "_sin_cos_f32", "wrap_angle": "_wrap_angle_f32"}

#: What each form has at least.
MUST = {"C": ("sin_cos", "time_update"), "lanes": ("sin_cos", "time_update"), "controller": ("sin_cos", "control")}

#: A function of small turns hands out z, then sines and cosines; the scalar C keeps the first to itself.
TURN_PORTS = 2

_CALLS = {"_larger": "larger", "_smaller": "smaller", "wrap": "wrap_angle", "sqrtf": "sqrt", "__builtin_sqrtf": "sqrt"}
_OPERATORS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}


@dataclass
class Function:
    """What a block names on its way, and what it hands out: by port, in order, and place."""

    entries: dict[str, Tree] = field(default_factory=dict)
    outputs: dict[tuple[int, int], Tree] = field(default_factory=dict)

    def differences(self, other: Function) -> Iterator[tuple[str, bool]]:
        """Each entry and output of either, in order, and whether the two state it differently."""
        for name in dict.fromkeys([*self.entries, *other.entries]):
            yield name, self.entries.get(name) != other.entries.get(name)
        for place in dict.fromkeys([*self.outputs, *other.outputs]):
            yield f"output {place[0]}[{place[1]}]", self.outputs.get(place) != other.outputs.get(place)

    def turns(self) -> Function:
        """Sines and cosines of small turns as outputs alone: the scalar C does not name them first."""
        entries = {name: tree for name, tree in self.entries.items() if not name.startswith(("sinc_", "cosm1_"))}
        turns = {place: tree for place, tree in self.outputs.items() if place[0] == TURN_PORTS - 1}
        named = {place: _put(tree, self.entries) if tree[0] == "name" else tree for place, tree in turns.items()}
        return Function(entries, named)


def link_text(folder: GeneratedFolder, kind: str, gain: str) -> Link:
    """Compare the filter, its lane form and the controller around it with the generated module.

    Parameters
    ----------
    folder
        The generated folder.
    kind, gain : str
        The filter.

    Raises
    ------
    codegen.evidence.emitted.EmittedError
        A text is no C, or uses what the reader does not know.
    """
    stem = f"{folder.drive}_{kind}"
    files = {"C": f"{stem}.c", "lanes": f"host/{stem}_lanes.c", "controller": f"{stem}_foc.c"}
    wanted = python_functions(folder.module, folder.text(f"{folder.drive}.py"))
    rows = []
    for form, file in files.items():
        found = c_functions(folder, file)
        for name in dict.fromkeys([*MUST[form], *(name for name, block in found.items() if block.outputs)]):
            rows.append(_row(form, name, wanted.get(ALIASES.get(name, name)), found.get(name)))
    return Link(
        "text", "C and NumPy state the same expressions", folder.drive, kind, gain, ", ".join(files), tuple(rows)
    )


def _row(form: str, name: str, wanted: Function | None, found: Function | None) -> Row:
    if wanted is None or found is None:
        return Row("13-34", f"{name}, {form}: in one language only", "each entry's expression", 1.0, 0.0, 1)
    if name.endswith("_turns"):
        wanted, found = wanted.turns(), found.turns()
    compared = list(wanted.differences(found))
    different = [entry for entry, differs in compared if differs]
    stage = f"{name}, {form}" + (f": {different[0]}" if different else "")
    return Row("13-34", stage, "each entry's expression", float(len(different)), 0.0, len(compared))


def _put(tree: Tree, values: Mapping[str, Tree]) -> Tree:
    """A tree with names replaced by what they stand for, where that is known."""
    if tree[0] == "name":
        return values.get(tree[1], tree)
    return tuple(_put(part, values) if isinstance(part, tuple) else part for part in tree)


def _number(value: float) -> Tree:
    return ("number", repr(float(np.float32(value))))  # as text, so that 0 is not -0


def _negative(operand: Tree) -> Tree:
    return _number(-float(operand[1])) if operand[0] == "number" else ("neg", operand)


def _operation(sign: str, left: Tree, right: Tree) -> Tree:
    """Two constants are no operation to compare: Python would carry it out in double."""
    return ("constants", sign, object()) if left[0] == right[0] == "number" else (sign, left, right)


# --- NumPy


def python_functions(module: ModuleType, text: str) -> dict[str, Function]:
    """Every function of the generated module that is a straight line."""
    constants = {k: _number(v) for k, v in vars(module).items() if isinstance(v, float)}
    read: dict[str, Function] = {}
    for definition in ast.parse(text).body:
        if isinstance(definition, ast.FunctionDef):
            function = _PythonReader(constants, read).read(definition)
            if function is not None:
                read[definition.name] = function
    return read


class _PythonReader:
    """Reads one function; None where it is more than a straight line."""

    def __init__(self, constants: Mapping[str, Tree], above: Mapping[str, Function]) -> None:
        self.constants, self.above = dict(constants), above

    def read(self, definition: ast.FunctionDef) -> Function | None:
        function = Function()
        for statement in definition.body:
            if isinstance(statement, ast.Assign):
                if not self._assign(statement, function):
                    return None
            elif isinstance(statement, ast.Return) and statement.value is not None:
                for port, values in enumerate(_ports(statement.value)):
                    function.outputs.update({(port, k): self.tree(v) for k, v in enumerate(values)})
            elif not (isinstance(statement, ast.Expr) or _keeps_stages(statement)):
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
                assert isinstance(name, ast.Name)
                function.entries[name.id] = self._small_turn(whole, k) or ("index", whole, k)
        else:
            return False
        return True

    def _small_turn(self, call: Tree, k: int) -> Tree | None:
        """The polynomial that small turns are computed by, if this is a call for one."""
        polynomial = self.above.get(f"_polynomial_{call[1]}_f32") if call[0] == "call" else None
        if polynomial is None:
            return None
        return _put(_put(polynomial.outputs[0, k], polynomial.entries), {"z": call[2]})

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
            case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name), args=args):
                return ("call", _CALLS.get(name, name), *map(self.tree, args))
            case ast.Subscript(value=value, slice=ast.Constant(value=k)):
                return ("index", self.tree(value), k)
        return ("other", ast.dump(node))


def _ports(value: ast.expr) -> list[list[ast.expr]]:
    """What a function returns: ports of entries; one port's stand alone."""
    if not isinstance(value, ast.Tuple):
        return [[value]]
    if all(isinstance(entry, ast.Tuple) for entry in value.elts):
        return [list(entry.elts) for entry in value.elts if isinstance(entry, ast.Tuple)]
    return [value.elts]


def _keeps_stages(statement: ast.stmt) -> bool:
    """``if stages is not None``: nothing is computed there."""
    return isinstance(statement, ast.If) and ast.unparse(statement.test) == "stages is not None"


# --- C


def c_functions(folder: GeneratedFolder, file: str) -> dict[str, Function]:
    """Every function of an emitted file, read as the chip's compiler would see it."""
    place, _, name = file.rpartition("/")
    stem = name.removesuffix(".c")
    code = folder.text(file).replace("__restrict", "")  # which pycparser does not know, and which computes nothing
    files = {name: code, f"{stem}.h": folder.text(f"{place}/{stem}.h" if place else f"{stem}.h")}
    for header in (f"{stem.removesuffix('_lanes').removesuffix('_foc')}.h", "pmsm_port.h"):
        files.setdefault(header, folder.text(header))
    tree, _ = parse_emitted(files, name)
    return {d.decl.name: _CReader(d).function for d in tree.ext if isinstance(d, c_ast.FuncDef)}


class _CReader:
    """Reads one function: declarations, and what is assigned to its outputs, in a loop over lanes or not."""

    def __init__(self, definition: Any) -> None:
        self.function = Function()
        self.pairs: dict[str, Tree] = {}
        parameters = definition.decl.type.args.params if definition.decl.type.args else []
        self.ports = [p.name for p in parameters if p.name and p.name.endswith("_out")]
        #: Turns that are wide are seen to by statements of their own; in any other block there is nothing else.
        self.flows = definition.decl.name.endswith("_turns")
        self.kept = TURN_PORTS - len(self.ports) if self.flows else 0
        self._statements(definition.body)

    def _statements(self, body: Any) -> None:
        for statement in body.block_items or ():
            if isinstance(statement, c_ast.For) and isinstance(statement.stmt, c_ast.Compound):
                self._statements(statement.stmt)
            elif isinstance(statement, c_ast.Decl) and statement.init is not None:
                self._declared(statement)
            elif (place := self._assigned(statement)) is not None:
                self.function.outputs[place] = self.tree(statement.rvalue)
            elif isinstance(statement, c_ast.Return) and isinstance(statement.expr, c_ast.FuncCall):
                self.function.outputs[0, 0] = self.tree(statement.expr)
            elif not (self.flows or isinstance(statement, c_ast.Decl | c_ast.Return)):
                self.function.entries[f"line {statement.coord.line}"] = ("other", str(statement))

    def _declared(self, declaration: Any) -> None:
        kind = getattr(getattr(declaration.type, "type", None), "names", ["?"])[0]
        tree = self.tree(declaration.init)
        if kind == "pmsm_pair":
            self.pairs[declaration.name] = tree
        elif kind == "float32":
            self.function.entries[declaration.name] = tree

    def _assigned(self, statement: Any) -> tuple[int, int] | None:
        """Port and place of the output that a statement assigns; None if it does something else."""
        if not (isinstance(statement, c_ast.Assignment) and statement.op == "="):
            return None
        tree = self.tree(statement.lvalue)
        if tree[0] == "index" and tree[1][0] == "name":
            owner = tree[1][1]
            if owner in self.ports:
                return self.kept + self.ports.index(owner), tree[2]
            return (0, tree[2]) if owner == "result" else None
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
            case c_ast.FuncCall(name=c_ast.ID(name=name), args=args):
                return ("call", _CALLS.get(name, name), *map(self.tree, args.exprs if args else ()))
            case c_ast.StructRef(name=pair, field=c_ast.ID(name="sine" | "cosine" as part)):
                return ("index", self.tree(pair), ("sine", "cosine").index(part))
            case c_ast.ArrayRef(name=c_ast.StructRef(name=entry, field=c_ast.ID(name="of"))):
                return self.tree(entry)
            case c_ast.ArrayRef(name=owner, subscript=c_ast.Constant(type="int", value=k)):
                return ("index", self.tree(owner), int(k))
        return ("other", str(node))
