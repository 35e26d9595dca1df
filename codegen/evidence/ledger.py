"""The ledger: what a step costs, counted in the emitted C itself.

Operations are counted on pycparser's tree of the very text that goes to the chip: calls are followed, a branch
costs its dearer side (operation by operation, so the sum bounds either), a loop its bound. ``sin_cos`` is counted
both as one call (fastRTS publishes its cycles) and as the arithmetic that is emitted.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from pycparser import c_ast

from codegen.evidence.emitted import EmittedError, parse_emitted

#: In the order tables show them; ``add`` is additions, subtractions and negations.
OPERATIONS = ("add", "mul", "div", "sqrt", "sincos", "compare", "select")
SIN_COS = "sin_cos"
N_MAX = "max_iterations"

_LIBRARY = {"sqrtf": "sqrt"}
_ARITHMETIC = {"+": "add", "-": "add", "*": "mul", "/": "div"}
_COMPARISONS = frozenset({"<", ">", "<=", ">=", "==", "!="})

#: 16-bit words of the C28x's types, COFF data model (SPRU514, table 6-1); a pointer has 2.
_WORDS = {"char": 1, "short": 1, "int": 1, "long": 2, "float": 2, "double": 2, "long long": 4, "long double": 4}
_POINTER_WORDS = 2

Kind = str  # "float", "int", or the name of a struct
Count = Counter[str]


@dataclass(frozen=True)
class Ledger:
    """Worst case of one function. ``calls``: sin_cos as a call; ``expanded``: as the arithmetic it is emitted as.

    ``words``: 16-bit words of its state struct on the C28x.
    """

    calls: dict[str, int]
    expanded: dict[str, int]
    words: int


class Program:
    """Emitted C files, parsed.

    Parameters
    ----------
    files : mapping
        File texts by name, headers included.
    sources : str
        Which of them to compile; a call out of one finds the function in another.

    Raises
    ------
    EmittedError
        If the text holds what the ledger cannot count.
    """

    def __init__(self, files: Mapping[str, str], *sources: str) -> None:
        self.units = [Unit(*parse_emitted(files, name), name) for name in sources]

    def ledger(self, function: str, struct: str, max_iterations: int) -> Ledger:
        """Counts of ``function`` and the size of the typedef ``struct``.

        Parameters
        ----------
        function : str
            C name.
        struct : str
            C name of a typedef in the function's file.
        max_iterations : int
            N_max.
        """
        called, expanded = (self.count(function, max_iterations, expand) for expand in (False, True))
        unit, _ = self.find(function)
        return Ledger(_table(called), _table(expanded), unit.words(struct))

    def count(self, function: str, max_iterations: int, expand_sin_cos: bool = False) -> Count:
        """Operations of one call, every loop over N_max taken ``max_iterations`` times.

        Parameters
        ----------
        function : str
        max_iterations : int
        expand_sin_cos : bool, optional
            Count the arithmetic of ``sin_cos``, not its call.
        """
        unit, definition = self.find(function)
        return _Counting(self, max_iterations, expand_sin_cos).function(unit, definition, {})

    def find(self, function: str, caller: Unit | None = None) -> tuple[Unit, c_ast.FuncDef]:
        """The function as ``caller`` sees it: its own file's, else one that is not static.

        Parameters
        ----------
        function : str
        caller : Unit, optional
        """
        for unit in self.units:
            definition = unit.functions.get(function)
            if definition is not None and (caller in {None, unit} or "static" not in definition.decl.storage):
                return unit, definition
        raise EmittedError(f"no cost known for a call of '{function}'")

    def callees(self, unit: Unit, definition: c_ast.FuncDef) -> Iterator[tuple[Unit, c_ast.FuncDef]]:
        """Functions that ``definition`` calls, library functions left out.

        Parameters
        ----------
        unit : Unit
        definition : FuncDef
        """
        for name in sorted({node.name.name for node in _walk(definition.body) if isinstance(node, c_ast.FuncCall)}):
            if name not in _LIBRARY:
                yield self.find(name, unit)


class Unit:
    """One translation unit: its functions and types; ``files`` are the texts it was read from."""

    def __init__(self, tree: c_ast.FileAST, files: tuple[str, ...], name: str) -> None:
        self.name, self.files = name, files
        self.functions = {item.decl.name: item for item in tree.ext if isinstance(item, c_ast.FuncDef)}
        self.typedefs = {item.name: item.type for item in tree.ext if isinstance(item, c_ast.Typedef)}
        self.returns = {
            item.name: item.type.type
            for item in tree.ext
            if isinstance(item, c_ast.Decl) and isinstance(item.type, c_ast.FuncDecl)
        } | {name: item.decl.type.type for name, item in self.functions.items()}

    def kind(self, type_node: Any) -> Kind:
        """The scalar type behind a type: arrays and pointers stand for their elements.

        Parameters
        ----------
        type_node : pycparser node
        """
        while isinstance(type_node, c_ast.ArrayDecl | c_ast.PtrDecl):
            type_node = type_node.type
        names = type_node.type.names if isinstance(type_node.type, c_ast.IdentifierType) else []
        if not names:
            return str(type_node.declname)
        if len(names) == 1 and names[0] in self.typedefs:
            target = self.typedefs[names[0]]
            return str(names[0]) if isinstance(target.type, c_ast.Struct) else self.kind(target)
        return "float" if {"float", "double"} & set(names) else "int"

    def field(self, struct: Kind, name: str) -> Any:
        """Type of a field of a typedef'd struct.

        Parameters
        ----------
        struct, name : str
        """
        for field in self.typedefs[struct].type.decls:
            if field.name == name:
                return field.type
        raise EmittedError(f"{self.name}: struct {struct} has no field {name}")

    def words(self, struct: str) -> int:
        """16-bit words of a typedef'd type on the C28x, padding included (32-bit fields lie on even addresses).

        Parameters
        ----------
        struct : str
        """
        return self._layout(self.typedefs[struct])[0]

    def _layout(self, type_node: Any) -> tuple[int, int]:
        """(words, alignment) of a type."""
        if isinstance(type_node, c_ast.PtrDecl):
            return _POINTER_WORDS, _POINTER_WORDS
        if isinstance(type_node, c_ast.ArrayDecl):
            words, align = self._layout(type_node.type)
            length = _constant(type_node.dim, {})
            if length is None:
                raise EmittedError(f"{self.name}: an array whose length cannot be read ({type_node.coord})")
            return words * length, align
        if isinstance(type_node.type, c_ast.Struct):
            return self._struct_layout(type_node.type)
        names = [name for name in type_node.type.names if name not in {"unsigned", "signed"}] or ["int"]
        if names[0] in self.typedefs:
            return self._layout(self.typedefs[names[0]])
        words = _WORDS[" ".join(names)]
        return words, min(words, 2)

    def _struct_layout(self, struct: c_ast.Struct) -> tuple[int, int]:
        offset, widest = 0, 1
        for field in struct.decls:
            words, align = self._layout(field.type)
            offset += -offset % align + words
            widest = max(widest, align)
        return offset + -offset % widest, widest


class _Counting:
    """One count: how far loops go, and what sin_cos is."""

    def __init__(self, program: Program, max_iterations: int, expand_sin_cos: bool) -> None:
        self.program, self.max_iterations, self.expand_sin_cos = program, max_iterations, expand_sin_cos
        self.known: dict[tuple[str, str, tuple[tuple[str, int], ...]], Count] = {}

    def function(self, unit: Unit, definition: c_ast.FuncDef, constants: dict[str, int]) -> Count:
        """Count a function's body; ``constants``: parameters whose whole value the call fixes."""
        key = (unit.name, definition.decl.name, tuple(sorted(constants.items())))
        if key not in self.known:
            kinds = {
                node.name: unit.kind(node.type)
                for node in _walk(definition)
                if isinstance(node, c_ast.Decl) and not isinstance(node.type, c_ast.FuncDecl)
            }
            self.known[key] = _Body(self, unit, kinds, constants).count(definition.body)
        return self.known[key]


class _Body:
    """Counts statements and expressions of one function."""

    def __init__(self, counting: _Counting, unit: Unit, kinds: dict[str, Kind], constants: dict[str, int]) -> None:
        self.counting, self.unit, self.kinds, self.constants = counting, unit, kinds, constants

    def count(self, node: Any) -> Count:
        """Operations of a node; one small method per node that computes, the others pass on their children's."""
        if node is None:
            return Counter()
        method = getattr(self, f"_count_{type(node).__name__}", None)
        if method is not None:
            return Counter(method(node))
        if isinstance(node, c_ast.Switch | c_ast.Goto | c_ast.Label):
            raise self._error(node, f"{type(node).__name__.lower()} is not counted")
        return self._children(node)

    def _children(self, node: Any) -> Count:
        total: Count = Counter()
        for _, child in node.children():
            total += self.count(child)
        return total

    # --- expressions

    def _count_Decl(self, node: Any) -> Count:
        return self.count(node.init)

    def _count_BinaryOp(self, node: Any) -> Count:
        name = "compare" if node.op in _COMPARISONS else _ARITHMETIC.get(node.op)  # && and || are neither
        computes = name and not _folded(node) and "float" in (self._kind(node.left), self._kind(node.right))
        return Counter({name: 1} if name and computes else {}) + self._children(node)

    def _count_UnaryOp(self, node: Any) -> Count:
        computes = node.op in {"-", "++", "--", "p++", "p--"} and not _folded(node)
        own = Counter({"add": 1} if computes and self._kind(node.expr) == "float" else {})
        return own + self._children(node)

    def _count_Assignment(self, node: Any) -> Count:
        own: Count = Counter()
        if node.op != "=" and self._kind(node.lvalue) == "float":
            own[_ARITHMETIC[node.op[0]]] += 1
        return own + self._children(node)

    def _count_TernaryOp(self, node: Any) -> Count:
        own = Counter({"select": 1} if self._kind(node) == "float" else {})
        return own + self.count(node.cond) + (self.count(node.iftrue) | self.count(node.iffalse))

    def _count_FuncCall(self, node: Any) -> Count:
        name = node.name.name
        total = self.count(node.args)
        if name in _LIBRARY:
            return total + Counter({_LIBRARY[name]: 1})
        if name == SIN_COS and not self.counting.expand_sin_cos:
            return total + Counter({"sincos": 1})
        unit, definition = self.counting.program.find(name, self.unit)
        parameters = definition.decl.type.args.params if definition.decl.type.args else []
        fixed = {}
        for parameter, argument in zip(parameters, node.args.exprs if node.args else [], strict=False):
            value = _constant(argument, self.constants)
            if value is not None:
                fixed[parameter.name] = value
        return total + self.counting.function(unit, definition, fixed)

    # --- statements

    def _count_Compound(self, node: Any) -> Count:
        """Statements one after another; behind an ``if`` that returns, its way or the rest, the dearer of both."""
        total: Count = Counter()
        items = list(node.block_items or [])
        for k, item in enumerate(items):
            if isinstance(item, c_ast.If) and item.iffalse is None and _returns(item.iftrue):
                rest = c_ast.Compound(items[k + 1 :])
                return total + self.count(item.cond) + (self.count(item.iftrue) | self.count(rest))
            total += self.count(item)
        return total

    def _count_If(self, node: Any) -> Count:
        return self.count(node.cond) + (self.count(node.iftrue) | self.count(node.iffalse))

    def _count_DoWhile(self, node: Any) -> Count:
        return self._loop(node, self.count(node.stmt) + self.count(node.cond))

    def _count_While(self, node: Any) -> Count:
        return self.count(node.cond) + self._loop(node, self.count(node.stmt) + self.count(node.cond))

    def _count_For(self, node: Any) -> Count:
        once = self.count(node.stmt) + self.count(node.cond) + self.count(node.next)
        return self.count(node.init) + self.count(node.cond) + self._loop(node, once)

    def _loop(self, node: Any, once: Count) -> Count:
        if not once:
            return Counter()
        bound = self._bound(node.cond)
        if bound is None:
            raise self._error(node, "a loop without a bound that can be read")
        return Counter({name: bound * number for name, number in once.items()})

    def _bound(self, condition: Any) -> int | None:
        """Passes that ``counter < bound`` allows a counter that starts at 0; of several conditions the strictest."""
        if isinstance(condition, c_ast.BinaryOp) and condition.op == "&&":
            bounds = [self._bound(side) for side in (condition.left, condition.right)]
            return min((bound for bound in bounds if bound is not None), default=None)
        if not isinstance(condition, c_ast.BinaryOp) or condition.op not in {"<", "<="}:
            return None
        if isinstance(condition.right, c_ast.StructRef) and condition.right.field.name == N_MAX:
            limit: int | None = self.counting.max_iterations
        else:
            limit = _constant(condition.right, self.constants)
        return None if limit is None else limit + (condition.op == "<=")

    # --- types

    def _kind(self, node: Any) -> Kind:
        """Float, int or struct: what an expression yields."""
        if isinstance(node, c_ast.Constant):
            return "float" if node.type in {"float", "double"} else "int"
        if isinstance(node, c_ast.ID):
            return self.kinds.get(node.name, "int")
        if isinstance(node, c_ast.ArrayRef):
            return self._kind(node.name)
        if isinstance(node, c_ast.StructRef):
            return self.unit.kind(self.unit.field(self._kind(node.name), node.field.name))
        if isinstance(node, c_ast.FuncCall):
            name = node.name.name
            return "float" if name in _LIBRARY else self.unit.kind(self.unit.returns[name])
        if isinstance(node, c_ast.Cast):
            return self.unit.kind(node.to_type.type)
        if isinstance(node, c_ast.UnaryOp):
            return "int" if node.op in {"!", "sizeof"} else self._kind(node.expr)
        if isinstance(node, c_ast.Assignment):
            return self._kind(node.lvalue)
        if isinstance(node, c_ast.TernaryOp):
            return "float" if "float" in (self._kind(node.iftrue), self._kind(node.iffalse)) else "int"
        if isinstance(node, c_ast.BinaryOp) and node.op in _ARITHMETIC:
            return "float" if "float" in (self._kind(node.left), self._kind(node.right)) else "int"
        return "int"

    def _error(self, node: Any, what: str) -> EmittedError:
        return EmittedError(f"{self.unit.name}: {what} ({node.coord})")


def _returns(node: Any) -> bool:
    """A statement that ends the function."""
    if isinstance(node, c_ast.Compound):
        return bool(node.block_items) and _returns(node.block_items[-1])
    return isinstance(node, c_ast.Return)


def _table(count: Count) -> dict[str, int]:
    return {name: count[name] for name in OPERATIONS}


def _walk(node: Any) -> Iterator[Any]:
    yield node
    for _, child in node.children():
        yield from _walk(child)


def _folded(node: Any) -> bool:
    """Whether the compiler computes it: constants only."""
    if isinstance(node, c_ast.UnaryOp):
        return _folded(node.expr)
    if isinstance(node, c_ast.BinaryOp):
        return _folded(node.left) and _folded(node.right)
    return isinstance(node, c_ast.Constant)


def _constant(node: Any, known: Mapping[str, int]) -> int | None:
    """A whole number: written as one, a parameter the call fixes, or a sum or product of such; else None."""
    if isinstance(node, c_ast.Constant) and node.type.endswith("int"):
        return int(node.value.rstrip("uUlL"), 0)
    if isinstance(node, c_ast.ID):
        return known.get(node.name)
    if isinstance(node, c_ast.BinaryOp) and node.op in {"+", "-", "*"}:
        left, right = (_constant(side, known) for side in (node.left, node.right))
        if left is not None and right is not None:
            return {"+": left + right, "-": left - right, "*": left * right}[node.op]
    return None
