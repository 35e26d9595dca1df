"""Translation units of emitted C: their functions and types, and the size of those on the target."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pycparser import c_ast

from codegen.evidence.emitted import EmittedError
from codegen.targets.description import DataModel

Kind = str  # "float", "int", or the name of a struct


class Unit:
    """One translation unit: its functions and types; ``files`` are the texts it was read from."""

    def __init__(self, tree: c_ast.FileAST, files: tuple[str, ...], name: str, data: DataModel) -> None:
        self.name, self.files, self.data = name, files, data
        self.functions = {item.decl.name: item for item in tree.ext if isinstance(item, c_ast.FuncDef)}
        self.typedefs = {item.name: item.type for item in tree.ext if isinstance(item, c_ast.Typedef)}
        self.returns = {
            item.name: item.type.type
            for item in tree.ext
            if isinstance(item, c_ast.Decl) and isinstance(item.type, c_ast.FuncDecl)
        } | {name: item.decl.type.type for name, item in self.functions.items()}
        self._kinds_in: dict[str, dict[str, Kind]] = {}
        self._calls: dict[str, list[str]] = {}

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
            return str(names[0]) if isinstance(target.type, c_ast.Struct | c_ast.Union) else self.kind(target)
        return "float" if {"float", "double"} & set(names) else "int"

    def kinds_in(self, definition: c_ast.FuncDef) -> dict[str, Kind]:
        """Kinds of a function's parameters and locals by name; looked up once, for every count asks.

        Parameters
        ----------
        definition : FuncDef
            One of the unit's functions.
        """
        name = definition.decl.name
        if name not in self._kinds_in:
            self._kinds_in[name] = {
                node.name: self.kind(node.type)
                for node in walk(definition)
                if isinstance(node, c_ast.Decl) and not isinstance(node.type, c_ast.FuncDecl)
            }
        return self._kinds_in[name]

    def calls(self, definition: c_ast.FuncDef) -> list[str]:
        """Names of the functions that a function calls, sorted.

        Parameters
        ----------
        definition : FuncDef
            One of the unit's functions.
        """
        name = definition.decl.name
        if name not in self._calls:
            called = {node.name.name for node in walk(definition.body) if isinstance(node, c_ast.FuncCall)}
            self._calls[name] = sorted(called)
        return self._calls[name]

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

    def is_struct(self, kind: Kind) -> bool:
        """Whether a kind is a typedef'd struct.

        Parameters
        ----------
        kind : str
        """
        return kind in self.typedefs and isinstance(self.typedefs[kind].type, c_ast.Struct)

    def fields(self, struct: Kind) -> list[str]:
        """Names of a typedef'd struct's fields.

        Parameters
        ----------
        struct : str
        """
        return [field.name for field in self.typedefs[struct].type.decls]

    def words(self, struct: str) -> int:
        """16-bit words of a typedef'd type on the target, padding included.

        Parameters
        ----------
        struct : str
        """
        return self.data.words(self._layout(self.typedefs[struct])[0])

    def _layout(self, type_node: Any) -> tuple[int, int]:
        """(chars, alignment in chars) of a type."""
        if isinstance(type_node, c_ast.PtrDecl):
            return self.data.pointer, min(self.data.pointer, self.data.alignment)
        if isinstance(type_node, c_ast.ArrayDecl):
            chars, align = self._layout(type_node.type)
            length = constant(type_node.dim, {})
            if length is None:
                raise EmittedError(f"{self.name}: an array whose length cannot be read ({type_node.coord})")
            return chars * length, align
        if isinstance(type_node.type, c_ast.Struct):
            return self._struct_layout(type_node.type)
        names = [name for name in type_node.type.names if name not in {"unsigned", "signed"}] or ["int"]
        if names[0] in self.typedefs:
            return self._layout(self.typedefs[names[0]])
        chars = self.data.sizes[" ".join(names)]
        return chars, min(chars, self.data.alignment)

    def _struct_layout(self, struct: c_ast.Struct) -> tuple[int, int]:
        offset, widest = 0, 1
        for field in struct.decls:
            chars, align = self._layout(field.type)
            offset += -offset % align + chars
            widest = max(widest, align)
        return offset + -offset % widest, widest


def walk(node: Any) -> Iterator[Any]:
    """A node and all nodes below it, in their order in the text.

    Parameters
    ----------
    node : pycparser node
    """
    stack = [node]
    while stack:
        node = stack.pop()
        yield node
        stack += [child for _, child in reversed(node.children())]


def constant(node: Any, known: Mapping[str, int]) -> int | None:
    """A whole number: written as one, a parameter the call fixes, or a sum or product of such; else None.

    Parameters
    ----------
    node : pycparser node
        An expression.
    known : mapping of str to int
        Values of names.
    """
    if isinstance(node, c_ast.Constant) and node.type.endswith("int"):
        return int(node.value.rstrip("uUlL"), 0)
    if isinstance(node, c_ast.ID):
        return known.get(node.name)
    if isinstance(node, c_ast.BinaryOp) and node.op in {"+", "-", "*"}:
        left, right = (constant(side, known) for side in (node.left, node.right))
        if left is not None and right is not None:
            return {"+": left + right, "-": left - right, "*": left * right}[node.op]
    return None
