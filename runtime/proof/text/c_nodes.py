"""The common parts of the readers of C: cells of memory, and pieces of pycparser's syntax tree."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any, Protocol

from pycparser import c_ast

from runtime.proof.text.terms import OverLanes, Term, Terms

#: Lanes of a lane form; the variable that counts them.
LANES, LANE = 16, "lane"

_count = itertools.count()


class Array:
    """Cells of memory: an array, a struct's field or a variable. ``of_lanes``: a cell has one value a lane."""

    def __init__(self, name: str, size: int | None, kind: str, private: bool) -> None:
        flags = kind == "int" and size == LANES
        self.name, self.whole, self.of_lanes = name, kind in {"int", "int32", "Uint32"}, kind == "lanes" or flags
        self.is_array, self.size = size is not None, 1 if flags else size or 1
        #: It lives inside the loop over lanes, and may be written there without further ado.
        self.private = private
        self.id = next(_count)


class Pointer:
    """A place in an array."""

    def __init__(self, array: Array, offset: int = 0) -> None:
        self.array, self.offset = array, offset


Struct = dict[str, Any]
Value = Term | OverLanes | Pointer | Struct | None
Memory = dict[tuple[int, int], Term | OverLanes]


class Unit(Protocol):
    """The context of a call in its translation unit: memory, and the functions it may call."""

    terms: Terms
    memory: Memory
    arrays: dict[int, Array]
    lanes: bool
    numbers: dict[str, int]

    def read(self, array: Array, place: int) -> Term | OverLanes:
        """Return a cell.

        Parameters
        ----------
        array : Array
        place : int
            From 0.
        """

    def write(self, array: Array, place: int, value: Value, adds: bool = False) -> None:
        """Write a cell.

        Parameters
        ----------
        array : Array
        place : int
            From 0.
        value : Value
        adds : bool, optional
            ``|=``: true where it was already, or the value is.
        """

    def call(self, name: str, arguments: list[Value]) -> Value:
        """Carry out a function.

        Parameters
        ----------
        name : str
            The name.
        arguments : list of Value
            Words of the command line; default: the process's own.
        """

    def new_array(self, name: str, size: int | None, kind: str) -> Array:
        """Make cells of memory.

        Parameters
        ----------
        name : str
        size : int or None
            None: a variable, one cell.
        kind : str
            "int", "float32", or "lanes" where a cell has one value a lane.
        """

    def is_struct(self, kind: str) -> bool:
        """Whether a type is a struct.

        Parameters
        ----------
        kind : str
            Its name.
        """

    def new_struct(self, kind: str, prefix: str = "") -> Struct:
        """Make the cells of a struct.

        Parameters
        ----------
        kind : str
            Its type.
        prefix : str, optional
            Beginning of the names.
        """


def items(statement: Any) -> list[Any]:
    """Return the statements of a block, or the one statement.

    Parameters
    ----------
    statement : object
        What is printed on a line.
    """
    if statement is None:
        return []
    return statement.block_items or [] if isinstance(statement, c_ast.Compound) else [statement]


def returns(node: Any) -> bool:
    """Whether a statement returns, or one within it.

    Parameters
    ----------
    node : pycparser node
        A statement.
    """
    return isinstance(node, c_ast.Return) or any(returns(child) for _, child in node.children())


def enumerators(declaration: Any) -> Iterator[tuple[str, int]]:
    """Names and values of an enumeration; every value is told or one more than the last.

    Parameters
    ----------
    declaration : pycparser node
        Of anything else than an enumeration nothing is told.
    """
    kind = getattr(declaration, "type", None)
    if isinstance(kind, c_ast.Enum) and kind.values is not None:
        following = 0
        for entry in kind.values.enumerators:
            following = int(entry.value.value, 0) if entry.value is not None else following
            yield entry.name, following
            following += 1


def length(node: Any) -> int:
    """Of an array: a number, or a product of numbers; 0 where none is told.

    Parameters
    ----------
    node : pycparser node or None
        What stands in the brackets.
    """
    if isinstance(node, c_ast.BinaryOp) and node.op == "*":
        return length(node.left) * length(node.right)
    return int(node.value) if isinstance(node, c_ast.Constant) else 0


def declared(kind: Any) -> tuple[str, int | None]:
    """Name of the base type, and length of an array (0 where none is told; None: no array).

    Parameters
    ----------
    kind : object
        Filter kind, such as "ickf".
    """
    size: int | None = None
    while not hasattr(kind, "names"):
        if isinstance(kind, c_ast.ArrayDecl):
            size = length(kind.dim)
        if isinstance(kind, c_ast.Struct):
            return "struct", size
        kind = kind.type
    return kind.names[0], size
