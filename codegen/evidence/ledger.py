"""The ledger: what a step costs, counted in the emitted C itself.

Operations are counted on pycparser's tree of the very text that goes to the chip: calls are followed, that of the
emitted ``sin_cos`` like any other; a branch costs its dearer side (operation by operation, so the sum bounds either), a
loop its bound. Of a branch that asks a field whose value is given, such as the mode of a drive, the side that is taken
counts. Arithmetic of whole numbers, and copies of single numbers, are not counted.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from pycparser import c_ast

from codegen.evidence.emitted import EmittedError, parse_emitted
from codegen.evidence.units import Kind, Unit, constant
from codegen.targets.description import Target
from codegen.targets.find import default_target

#: In the order tables show them. ``add``: additions, subtractions and negations; ``compare``, ``select``: of float32;
#: ``branch``: an ``if``, each time a loop asks whether to go on, a selection of whole numbers or with a side that
#: computes, each ``&&`` and ``||``; ``call``: of a function of the text. A compiler may do without some of these.
OPERATIONS = ("add", "mul", "div", "sqrt", "compare", "select", "branch", "call")
#: Calls of sin_cos: told, and not priced, as its arithmetic is among the others.
SINCOS = "sincos"
#: 16-bit words of structs that are copied; a table has them only where there are any.
COPIED = "copied"
#: How many of the divisions are of 1: a port header may have them for less.
RECIPROCAL = "reciprocal"
SIN_COS = "sin_cos"
TOLD = (*OPERATIONS, SINCOS)
N_MAX = "max_iterations"

_LIBRARY = {"sqrtf": "sqrt"}
#: Instructions for sine and cosine, where a target has them.
SINE = "sine"
_ARITHMETIC = {"+": "add", "-": "add", "*": "mul", "/": "div"}
_COMPARISONS = frozenset({"<", ">", "<=", ">=", "==", "!="})
#: Nodes that stand for themselves: most of a tree, and nothing in them computes.
_LEAVES = (c_ast.ID, c_ast.Constant)

Count = Counter[str]
#: Of a function that was counted: the fields it asked for with what was given of them, and the count.
Known = tuple[dict[str, int | None], Count]


@dataclass(frozen=True)
class Ledger:
    """Worst case of one function: ``operations`` by the names of :data:`TOLD`, and of what is seldom there.

    ``words``: 16-bit words of its state struct on the target.
    """

    operations: dict[str, int]
    words: int


class Program:
    """Emitted C files, parsed.

    Parameters
    ----------
    files : mapping
        File texts by name, headers included.
    sources : str
        Which of them to compile; a call out of one finds the function in another.
    target : Target, optional
        Whose macros and data model are taken; by default those of the default target.

    Raises
    ------
    EmittedError
        If the text holds what the ledger cannot count.
    """

    def __init__(self, files: Mapping[str, str], *sources: str, target: Target | None = None) -> None:
        self.target = target or default_target()
        native = self.target.native
        #: Functions that are not of the text, by what they do.
        self.library = _LIBRARY | (dict(native.calls) if native else {})
        self.units = [Unit(*parse_emitted(files, name, self.target.macros), name, self.target.data) for name in sources]
        #: Functions that were counted, by N_max and what was left aside; then by file, name and parameters.
        self.known: dict[tuple[int, frozenset[str]], dict[tuple[Any, ...], list[Known]]] = {}

    def ledger(
        self, function: str, struct: str, max_iterations: int, given: Mapping[str, int] = MappingProxyType({})
    ) -> Ledger:
        """Counts of ``function`` and the size of the typedef ``struct``.

        Parameters
        ----------
        function : str
            C name.
        struct : str
            C name of a typedef in the function's file.
        max_iterations : int
            N_max.
        given : mapping of str to int, optional
            Values of fields, whichever struct they are in.
        """
        unit, _ = self.find(function)
        return Ledger(_table(self.count(function, max_iterations, given)), unit.words(struct))

    def count(
        self,
        function: str,
        max_iterations: int,
        given: Mapping[str, int] = MappingProxyType({}),
        aside: frozenset[str] = frozenset(),
    ) -> Count:
        """Operations of one call, every loop over N_max taken ``max_iterations`` times.

        Parameters
        ----------
        function : str
        max_iterations : int
        given : mapping of str to int, optional
            Values of fields when it is called, whichever struct they are in; they are taken to keep them.
        aside : frozenset of str, optional
            Functions of which the calls count and not the bodies.
        """
        unit, definition = self.find(function)
        return Counter(_Counting(self, max_iterations, given, aside).function(unit, definition, {}))

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
        for name in unit.calls(definition):
            if name not in self.library:
                yield self.find(name, unit)


class _Counting:
    """One count: how far loops go, what is given, and what is not followed.

    What a function asks of what is given is noted: another count in which these answers are the same takes its result.
    """

    def __init__(self, program: Program, max_iterations: int, given: Mapping[str, int], aside: frozenset[str]) -> None:
        self.program, self.max_iterations, self.given, self.aside = program, max_iterations, given, aside
        self.known = program.known.setdefault((max_iterations, aside), {})
        #: Of each function under way, the outermost first: the fields it has asked for.
        self.asked: list[dict[str, int | None]] = [{}]

    def function(self, unit: Unit, definition: c_ast.FuncDef, constants: dict[str, int]) -> Count:
        """Count a function's body; ``constants``: parameters whose whole value the call fixes."""
        known = self.known.setdefault((unit.name, definition.decl.name, tuple(sorted(constants.items()))), [])
        for asked, found in known:
            if all(self.given.get(field) == value for field, value in asked.items()):
                self.asked[-1] |= asked
                return found
        self.asked.append({})
        count = _Body(self, unit, unit.kinds_in(definition), constants).count(definition.body)
        known.append((self.asked.pop(), count))
        self.asked[-1] |= known[-1][0]
        return count

    def value(self, field: str) -> int | None:
        """What is given of a field; None if nothing is."""
        value = self.asked[-1][field] = self.given.get(field)
        return value


class _Body:
    """Counts statements and expressions of one function."""

    def __init__(self, counting: _Counting, unit: Unit, kinds: dict[str, Kind], constants: dict[str, int]) -> None:
        self.counting, self.unit, self.kinds, self.constants = counting, unit, kinds, constants

    def count(self, node: Any) -> Count:
        """Operations of a node; one small method per node that computes, the others pass on their children's."""
        if node is None or isinstance(node, _LEAVES):
            return Counter()
        method = getattr(self, f"_count_{type(node).__name__}", None)
        if method is not None:
            found: Count = method(node)
            return found
        if isinstance(node, c_ast.Switch | c_ast.Goto | c_ast.Label):
            raise self._error(node, f"{type(node).__name__.lower()} is not counted")
        return self._children(node)

    def _children(self, node: Any) -> Count:
        """The sum over a node's children; ``update``, for ``+`` looks each time for what is not above 0."""
        total: Count = Counter()
        for _, child in node.children():
            if not isinstance(child, _LEAVES):
                total.update(self.count(child))
        return total

    # --- expressions

    def _count_Decl(self, node: Any) -> Count:
        return self.count(node.init)

    def _count_BinaryOp(self, node: Any) -> Count:
        if node.op in {"&&", "||"}:
            return Counter({"branch": 1}) + self._children(node)
        name = "compare" if node.op in _COMPARISONS else _ARITHMETIC.get(node.op)
        computes = name and not _folded(node) and "float" in (self._kind(node.left), self._kind(node.right))
        own = Counter({name: 1} if name and computes else {})
        if own["div"] and isinstance(node.left, c_ast.Constant) and float(node.left.value.rstrip("f")) == 1.0:
            own[RECIPROCAL] = 1
        return own + self._children(node)

    def _count_UnaryOp(self, node: Any) -> Count:
        computes = node.op in {"-", "++", "--", "p++", "p--"} and not _folded(node)
        own = Counter({"add": 1} if computes and self._kind(node.expr) == "float" else {})
        return own + self._children(node)

    def _count_Assignment(self, node: Any) -> Count:
        own: Count = Counter()
        if node.op != "=" and self._kind(node.lvalue) == "float":
            own[_ARITHMETIC[node.op[0]]] += 1
        if node.op == "=" and self.unit.is_struct(self._kind(node.lvalue)):
            own[COPIED] += self.unit.words(self._kind(node.lvalue))
        return own + self._children(node)

    def _count_TernaryOp(self, node: Any) -> Count:
        sides = self.count(node.iftrue) | self.count(node.iffalse)
        own = Counter({"branch" if sides or self._kind(node) != "float" else "select": 1})
        return own + self.count(node.cond) + sides

    def _count_FuncCall(self, node: Any) -> Count:
        name = node.name.name
        total = self.count(node.args)
        if name in self.counting.program.library:
            return total + Counter({self.counting.program.library[name]: 1})
        total += Counter({"call": 1} | ({SINCOS: 1} if name == SIN_COS else {}))
        if name in self.counting.aside:
            return total
        unit, definition = self.counting.program.find(name, self.unit)
        parameters = definition.decl.type.args.params if definition.decl.type.args else []
        fixed = {}
        for parameter, argument in zip(parameters, node.args.exprs if node.args else [], strict=False):
            value = constant(argument, self.constants)
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
                return total + self._asked(item.cond) + (self.count(item.iftrue) | self.count(rest))
            total += self.count(item)
        return total

    def _count_If(self, node: Any) -> Count:
        holds = _decided(node.cond, self.counting.value)
        if holds is not None:
            return self._asked(node.cond) + self.count(node.iftrue if holds else node.iffalse)
        return self._asked(node.cond) + (self.count(node.iftrue) | self.count(node.iffalse))

    def _count_DoWhile(self, node: Any) -> Count:
        return self._loop(node, self.count(node.stmt) + self._asked(node.cond))

    def _count_While(self, node: Any) -> Count:
        return self._asked(node.cond) + self._loop(node, self.count(node.stmt) + self._asked(node.cond))

    def _count_For(self, node: Any) -> Count:
        once = self.count(node.stmt) + self._asked(node.cond) + self.count(node.next)
        return self.count(node.init) + self._asked(node.cond) + self._loop(node, once)

    def _asked(self, condition: Any) -> Count:
        """A condition that decides where to go on; what ``&&`` and ``||`` in it add is counted where they stand."""
        return self.count(condition) + Counter({"branch": 1})

    def _loop(self, node: Any, once: Count) -> Count:
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
            limit = constant(condition.right, self.constants)
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
            return "float" if name in self.counting.program.library else self.unit.kind(self.unit.returns[name])
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
    seldom = {name: count[name] for name in (SINE, COPIED, RECIPROCAL) if count[name]}
    return {name: count[name] for name in TOLD} | seldom


def _decided(condition: Any, given: Callable[[str], int | None]) -> bool | None:
    """Whether a condition holds, as far as a field that is compared with a whole number, and given, says."""
    if not isinstance(condition, c_ast.BinaryOp):
        return None
    if condition.op == "&&":
        sides = {_decided(side, given) for side in (condition.left, condition.right)}
        return False if False in sides else None if None in sides else True
    value = given(condition.left.field.name) if isinstance(condition.left, c_ast.StructRef) else None
    other = constant(condition.right, {})
    if value is None or other is None or condition.op not in {"==", "!="}:
        return None
    return (value == other) is (condition.op == "==")


def _folded(node: Any) -> bool:
    """Whether the compiler computes it: constants only."""
    if isinstance(node, c_ast.UnaryOp):
        return _folded(node.expr)
    if isinstance(node, c_ast.BinaryOp):
        return _folded(node.left) and _folded(node.right)
    return isinstance(node, c_ast.Constant)
