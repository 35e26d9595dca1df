"""The operation graph: what CasADi's instruction tape says, every operation once.

Nodes are hash-consed, so common subexpressions are shared by construction; addition and multiplication
are matched in either order (both give the same bits), and printed in the order first met.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple, Protocol, TypeVar

import casadi as ca

COMMUTATIVE = frozenset({"add", "mul"})

#: Operations on constants alone are done here, once: in Python two literals would meet in double, in C in float.
_FOLD: dict[str, Callable[..., float]] = {
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "div": operator.truediv,
    "neg": operator.neg,
    "sqrt": math.sqrt,
}


#: Characters of an identifier that C89 promises to tell apart (MISRA C:2012, 5.2).
SIGNIFICANT = 31


class Node(NamedTuple):
    """One operation. ``name`` is set for inputs and named constants, ``value`` and ``formula`` for constants."""

    op: str
    args: tuple[int, ...] = ()
    name: str = ""
    value: float = 0.0
    formula: str = ""


class Graph:
    """A growing list of nodes; a node's index is its identity.

    >>> g = Graph()
    >>> a, b = g.input("a"), g.input("b")
    >>> g.op("add", a, b) == g.op("add", b, a)
    True
    """

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        #: Results of passes on this graph, by roots and passes: they are asked more than once (:mod:`codegen.passes`).
        self.rewritten: dict[tuple[Any, ...], tuple[Graph, dict[int, int]]] = {}
        #: Constants that were folded: value to operation and operands, of which :func:`codegen.ir.constants.with_names`
        #: makes names. Nodes stay without them, lest passes take one for another.
        self.folds: dict[float, tuple[str, tuple[Node, ...]]] = {}
        #: Names and formulas of numbers that no named constant makes, the weights of points.
        self.told: dict[float, tuple[str, str]] = {}
        self._index: dict[tuple[Any, ...], int] = {}
        self._constants: dict[int, float] = {}
        #: What roots depend on, by roots: nodes never change, and several passes begin at one graph.
        self._reachable: dict[tuple[int, ...], tuple[int, ...]] = {}

    def __getitem__(self, index: int) -> Node:
        return self.nodes[index]

    def _add(self, key: tuple[Any, ...], *node: Any) -> int:
        index = self._index.get(key)
        if index is None:
            index = self._index[key] = len(self.nodes)
            self.nodes.append(Node(*node))
        return index

    def input(self, name: str) -> int:
        """A scalar that enters the block.

        Parameters
        ----------
        name : str
            One name is one node.

        Returns
        -------
        int
            The node.
        """
        return self._add(("input", name), "input", (), name)

    def const(self, value: float, name: str = "", formula: str = "") -> int:
        """A number; one with a name keeps it in print, ``formula`` beside it.

        Parameters
        ----------
        value : float
        name : str, optional
            Identifier in the generated code.
        formula : str, optional
            What the number is made of.

        Returns
        -------
        int
            The node.
        """
        index = self._add(("const", name, repr(value)), "const", (), name, value, formula)
        self._constants[index] = value
        return index

    def op(self, op: str, *args: int) -> int:
        """An operation; the few rewrites here change no bit of its result, and constants are folded in double.

        Parameters
        ----------
        op : str
            Such as "add".
        *args : int
            The operands' nodes.

        Returns
        -------
        int
            The node.
        """
        constants = self._constants
        for arg in args:
            if arg in constants:
                simplified = self._rewrite(op, args)
                if simplified is not None:
                    return simplified
                break
        key = (op, args[1], args[0]) if op in COMMUTATIVE and args[0] > args[1] else (op, *args)
        index = self._index.get(key)
        if index is None:
            index = self._index[key] = len(self.nodes)
            self.nodes.append(Node(op, args))
        return index

    def named(self, known: dict[float, tuple[str, str]]) -> Graph:
        """A graph of the same nodes in which these numbers have a name and a formula, if they had none.

        Parameters
        ----------
        known : dict of float to (str, str)
            Name and formula by number.
        """
        new = Graph()
        new.told = self.told
        new.folds, new._index, new._constants = self.folds, dict(self._index), dict(self._constants)
        for node in self.nodes:
            nameless = node.op == "const" and not node.name
            name, formula = known.get(node.value, ("", "")) if nameless else (node.name, node.formula)
            new.nodes.append(node._replace(name=name, formula=formula or node.formula))
        return new

    def adopt(self, node: Node, args: list[int]) -> int:
        """A node of another graph, its arguments given in this one.

        Parameters
        ----------
        node : Node
        args : list of int
            Its operands' nodes in this graph.

        Returns
        -------
        int
            The node in this graph.
        """
        if node.op == "input":
            return self.input(node.name)
        return self.const(node.value, node.name, node.formula) if node.op == "const" else self.op(node.op, *args)

    def _rewrite(self, op: str, args: tuple[int, ...]) -> int | None:
        constants = [self._constants.get(arg) for arg in args]
        if op in _FOLD and None not in constants:
            value = _FOLD[op](*constants)
            self.folds.setdefault(value, (op, tuple(self[arg] for arg in args)))
            return self.const(value)
        if op == "mul" and 1.0 in constants:
            return args[1 - constants.index(1.0)]
        if op == "div" and constants[1] is not None and math.frexp(constants[1])[0] == 0.5:
            return self.op("mul", args[0], self.const(1.0 / constants[1]))  # a power of two: exact either way
        return None

    def is_two_pi(self, value: int) -> bool:
        """See :class:`Algebra`.

        Parameters
        ----------
        value : int
            A node.
        """
        return self.nodes[value].op == "const" and abs(self.nodes[value].value - 2 * math.pi) < 1e-12

    def reachable(self, roots: Iterable[int]) -> list[int]:
        """All nodes the roots depend on, arguments before users.

        Parameters
        ----------
        roots : iterable of int
            Nodes.
        """
        known = tuple(roots)
        if known not in self._reachable:
            self._reachable[known] = self._collected(known)
        return list(self._reachable[known])

    def _collected(self, roots: tuple[int, ...]) -> tuple[int, ...]:
        nodes, seen = self.nodes, dict[int, None]()
        stack = list(roots)[::-1]
        while stack:
            index = stack.pop()
            if index < 0:  # ~index: its arguments are done
                seen[~index] = None
            elif index not in seen:
                args = nodes[index].args
                if args:
                    stack.append(~index)
                    stack += args[::-1]
                else:
                    seen[index] = None
        return tuple(seen)


_BINARY = {
    ca.OP_ADD: "add",
    ca.OP_SUB: "sub",
    ca.OP_MUL: "mul",
    ca.OP_DIV: "div",
    ca.OP_FMIN: "min",
    ca.OP_FMAX: "max",
}
_UNARY = {
    ca.OP_NEG: "neg",
    ca.OP_SQRT: "sqrt",
    ca.OP_SIN: "sin",
    ca.OP_COS: "cos",
}


class UnsupportedOperationError(ValueError):
    """The tape holds an operation no printer knows; the message names it."""


Value = TypeVar("Value")


class Algebra(Protocol[Value]):
    """An algebra to replay a tape in: a :class:`Graph`, or the even/odd numbers of :mod:`codegen.fast.split`."""

    def const(self, value: float) -> Value:
        """A number.

        Parameters
        ----------
        value : float
        """

    def op(self, op: str, *args: Value) -> Value:
        """An operation.

        Parameters
        ----------
        op : str
            Such as "add"; the names that a :class:`Graph` has.
        *args : Value
            The operands.
        """

    def is_two_pi(self, value: Value) -> bool:
        """Whether a value is the constant 2 pi: the one remainder that means wrapping an angle.

        Parameters
        ----------
        value : Value
        """


def read_tape(graph: Algebra[Value], function: Any, inputs: list[list[Value]]) -> list[list[Value]]:
    """Replay a CasADi SX Function in an algebra, usually a :class:`Graph`.

    Parameters
    ----------
    graph : Algebra
    function : casadi.Function
        An SX function; every output dense or sparse, read by nonzero.
    inputs : list of list
        For each input of the function, the value (in a Graph: the node) of each of its entries.

    Returns
    -------
    list of list
        For each output, the value of each nonzero.

    Raises
    ------
    UnsupportedOperationError
        The tape holds an operation that no printer knows.
    """
    work: dict[int, Value] = {}
    zero = graph.const(0.0)
    outputs = [[zero] * function.nnz_out(k) for k in range(function.n_out())]
    for k in range(function.n_instructions()):
        op = function.instruction_id(k)
        source, target = function.instruction_input(k), function.instruction_output(k)
        if op == ca.OP_INPUT:
            work[target[0]] = inputs[source[0]][source[1]]
        elif op == ca.OP_OUTPUT:
            outputs[target[0]][target[1]] = work[source[0]]
        elif op == ca.OP_CONST:
            work[target[0]] = graph.const(float(function.instruction_constant(k)))
        else:
            work[target[0]] = _replay(graph, op, [work[s] for s in source])
    return outputs


def _replay(graph: Algebra[Value], op: int, args: list[Value]) -> Value:
    if op in _BINARY:
        return graph.op(_BINARY[op], args[0], args[1])
    if op in _UNARY:
        return graph.op(_UNARY[op], args[0])
    if op == ca.OP_SQ:
        return graph.op("mul", args[0], args[0])
    if op == ca.OP_TWICE:
        return graph.op("mul", graph.const(2.0), args[0])
    if op == ca.OP_INV:
        return graph.op("div", graph.const(1.0), args[0])
    if op == ca.OP_REMAINDER and graph.is_two_pi(args[1]):
        return graph.op("wrap", args[0])
    names = {getattr(ca, name): name for name in dir(ca) if name.startswith("OP_")}
    raise UnsupportedOperationError(
        f"no printer for CasADi operation {names.get(op, op)}; "
        "known: + - * / fmin fmax sqrt sin cos, x**2, and remainder(x, 2 pi) for wrapping an angle"
    )
