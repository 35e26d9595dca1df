"""Carries out the statements of an emitted C function on terms: what it leaves in memory, in one lane.

Knows the C that is emitted and no more: whatever else is written becomes a term that equals nothing. Calls are carried
out too, down to the blocks, which are straight lines and are compared on their own. A loop over lanes is carried out
once, for a lane that stands for all; a choice that is made for all lanes together must mean the same to each.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from pycparser import c_ast, c_generator

from runtime.proof.text.c_call import Call
from runtime.proof.text.c_nodes import (
    LANE,
    Array,
    Memory,
    Pointer,
    Struct,
    Value,
    declared,
    enumerators,
)
from runtime.proof.text.terms import OverLanes, Term, Terms

_WRITER = c_generator.CGenerator()
#: The texts of a number's bits without its sign that are understood, the second where a subset of C compares no
#: unsigned numbers; whether these stand in the order of the sizes is no question of the text
#: (``tests/codegen/test_guard.py``).
_SIZES = {
    ("Uint32", "{ pmsm_word word; word.value = value; return word.bits << 1; }"),
    ("int32", "{ pmsm_word word; word.value = value; return (int32) (word.bits & 0x7FFFFFFFUL); }"),
}

__all__ = ["Array", "CText", "Pointer", "Struct", "Value"]


class CText:
    """The functions and structs of one translation unit."""

    def __init__(self, terms: Terms, tree: Any, blocks: Mapping[str, tuple[int, ...]]) -> None:
        self.terms = terms
        self.functions = {d.decl.name: d for d in tree.ext if isinstance(d, c_ast.FuncDef)}
        self.types = {d.name: d.type.type for d in tree.ext if isinstance(d, c_ast.Typedef)}
        #: Enumerators, which name states and places of the covariance words.
        self.numbers = {name: value for d in tree.ext for name, value in enumerators(d)}
        self.blocks = blocks
        #: Functions of other files, by name.
        self.elsewhere: dict[str, Callable[[CText, list[Value]], Value]] = {}
        self.memory: Memory = {}
        self.arrays: dict[int, Array] = {}
        self.lanes = False

    # --- memory

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
        array = Array(name, size, kind, self.lanes)
        self.arrays[array.id] = array
        return array

    def is_struct(self, kind: str) -> bool:
        """Whether a type is a struct whose fields are known; one number of every lane is none.

        Parameters
        ----------
        kind : str
            Its name.
        """
        return kind != "lanes" and isinstance(self.types.get(kind), c_ast.Struct)

    def new_struct(self, kind: str, prefix: str = "") -> Struct:
        """A struct whose fields are symbols of their names.

        Parameters
        ----------
        kind : str
            Filter kind, such as "ickf".
        prefix : str, optional
            Beginning of the names.
        """
        fields: Struct = {}
        for declaration in self.types[kind].decls:
            name, base, size = declaration.name, *declared(declaration.type)
            if self.is_struct(base):
                fields[name] = self.new_struct(base, f"{prefix}{name}.")
                continue
            array = self.new_array(prefix + name, size, base)
            for k in range(array.size):
                self.memory[array.id, k] = self.terms.symbol(prefix + name, k, array.whole)
            fields[name] = array
        return fields

    def new_input(self, name: str, size: int, kind: str) -> Pointer:
        """Make an array whose cells are symbols, and a pointer to it.

        Parameters
        ----------
        name : str
            The symbols', too.
        size : int
        kind : str
            "int", "float32", or "lanes" where a cell has one value a lane.
        """
        array = self.new_array(name, size, kind)
        for k in range(size):
            self.memory[array.id, k] = self.terms.symbol(name, k)
        return Pointer(array)

    def read(self, array: Array, place: int) -> Term | OverLanes:
        """Return a cell.

        Parameters
        ----------
        array : Array
        place : int
            From 0.
        """
        if (array.id, place) not in self.memory:
            return self.terms.unknown(f"{array.name}[{place}]")
        return self.memory[array.id, place]

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
        if not isinstance(value, Term | OverLanes) or not 0 <= place < array.size:
            value = self.terms.unknown(f"what is written to {array.name}[{place}]")
        if self.lanes and not (array.of_lanes or array.private):
            value = (
                self._gathered(array, place, value) if adds else self.terms.unknown(f"{array.name}: the last lane's")
            )
        self.memory[array.id, place] = value

    def _gathered(self, array: Array, place: int, value: Term | OverLanes) -> Term | OverLanes:
        """``any |= value`` in a loop over lanes."""
        old = self.read(array, place)
        if old is self.terms.zero and isinstance(value, Term):
            return OverLanes(self.terms.truth(value))
        return self.terms.unknown(f"{array.name} gathers more than one truth")

    # --- functions

    def call(self, name: str, arguments: list[Value]) -> Value:
        """Carry out a function; a block becomes one term an output.

        Parameters
        ----------
        name : str
            The name.
        arguments : list of Value
            Words of the command line; default: the process's own.
        """
        if name in self.elsewhere:
            return self.elsewhere[name](self, arguments)
        if name == "size_of":
            return self._size(arguments)
        definition = self.functions.get(name)
        if definition is None:
            return self.terms.unknown(f"a call of {name}")
        parameters = definition.decl.type.args.params
        if name in self.blocks:
            return self._block(name, [p.name for p in parameters], arguments)
        scope: dict[str, Any] = {}
        for parameter, argument in zip(parameters, arguments, strict=True):
            if isinstance(argument, Term | OverLanes) and parameter.name != LANE:
                array = self.new_array(parameter.name, None, declared(parameter.type)[0])
                array.private = True
                self.memory[array.id, 0] = argument
                scope[parameter.name] = array
            else:
                scope[parameter.name] = argument
        return Call(self, scope).statements(definition.body.block_items or [])

    def _size(self, arguments: list[Value]) -> Value:
        """Bits without the sign: the size of a number, as far as sizes are compared."""
        definition = self.functions.get("size_of")
        (value,) = arguments
        if definition is None or _result_and_body(definition) not in _SIZES:
            return self.terms.unknown("a size_of that reads other bits")
        return self.terms.make("size", value, whole=True)

    def _block(self, name: str, parameters: list[str], arguments: list[Value]) -> Value:
        inputs = [self.cells(a) for p, a in zip(parameters, arguments, strict=True) if not p.endswith("_out")]
        call = self.terms.make("call", name, *inputs)
        outputs = [a for p, a in zip(parameters, arguments, strict=True) if p.endswith("_out")]
        if len(outputs) != len(self.blocks[name]):
            return self.terms.unknown(f"the value of {name}")
        for port, (target, size) in enumerate(zip(outputs, self.blocks[name], strict=True)):
            assert isinstance(target, Pointer)
            for k in range(size):
                self.write(target.array, target.offset + k, self.terms.make("out", call, port, k))
        return None

    def cells(self, pointer: Value) -> Term:
        """All cells from a pointer on, as one term.

        Parameters
        ----------
        pointer : Value
            Anything but a pointer becomes a term that equals nothing.
        """
        if not isinstance(pointer, Pointer):
            return self.terms.unknown("a block's argument")
        found = [self.read(pointer.array, k) for k in range(pointer.offset, pointer.array.size)]
        return self.terms.make("array", *(c if isinstance(c, Term) else self.terms.unknown("lanes") for c in found))


def _result_and_body(definition: c_ast.FuncDef) -> tuple[str, str]:
    """The type that a function returns, and its body in one line."""
    return declared(definition.decl.type.type)[0], " ".join(_WRITER.visit(definition.body).split())
