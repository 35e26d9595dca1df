"""The common parts of the reader of Python: the objects and scopes of a call, and pieces of the syntax tree."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from typing import Any

from runtime.proof.text.terms import Term


class Record(dict[str, Any]):
    """An object with attributes: the filter, the controller."""


class FunctionName(str):
    """A function that is handed on."""


class Scope(dict[str, Any]):
    """Variables of a call."""


def aliases(tree: ast.Module, arithmetic: str) -> dict[str, str]:
    """Attribute -> function, of a class that names functions of the module.

    Parameters
    ----------
    tree : ast.Module
    arithmetic : str
        The class, such as "Float32".
    """
    found: dict[str, str] = {}
    for definition in tree.body:
        if isinstance(definition, ast.ClassDef) and definition.name == arithmetic:
            for line in definition.body:
                match line:
                    case ast.Assign(targets=[ast.Name(id=name)], value=ast.Call(args=[ast.Name(id=function)])):
                        found[name] = function
    return found


def keeps_stages(statement: ast.stmt) -> bool:
    """``if stages is not None: stages[...] = ...``: nothing is computed there.

    Parameters
    ----------
    statement : ast.stmt
        What is printed on a line.
    """
    return (
        isinstance(statement, ast.If)
        and ast.unparse(statement.test) == "stages is not None"
        and not statement.orelse
        and all(ast.unparse(line).startswith("stages") for line in statement.body)
    )


def copied(value: Any) -> Any:
    """Return a copy of a scope or record, lists and records in it copied too.

    Parameters
    ----------
    value : object
    """
    if isinstance(value, Record | Scope):
        return type(value)({name: copied(entry) for name, entry in value.items()})
    return [copied(entry) for entry in value] if isinstance(value, list) else value


def leaves(scope: Any) -> dict[Any, Term]:
    """Every value below, by variable (of a record: with its attribute) and place.

    Parameters
    ----------
    scope : Scope or Record
    """
    found: dict[Any, Term] = {}
    for name, value in scope.items():
        if isinstance(value, Record):
            found |= {(f"{name}.{field}", k): entry for (field, k), entry in leaves(value).items()}
        elif isinstance(value, list | tuple):
            found |= {(name, k): entry for k, entry in enumerate(value) if isinstance(entry, Term)}
        elif isinstance(value, Term):
            found[name, 0] = value
    return found


def replaced(scope: Any, values: Mapping[Any, Term]) -> Any:
    """The same scope or record with other values, by variable and place as :func:`leaves` tells them.

    Parameters
    ----------
    scope : Scope or Record
    values : mapping of (str, int) to Term
        What is missing here stays.
    """

    def entry_of(name: str, value: Any) -> Any:
        if isinstance(value, Record):
            start = f"{name}."
            own = {(key.removeprefix(start), k): v for (key, k), v in values.items() if key.startswith(start)}
            return replaced(value, own)
        if isinstance(value, list | tuple):
            return type(value)(values.get((name, k), entry) for k, entry in enumerate(value))
        return values.get((name, 0), value)

    return type(scope)({name: entry_of(name, value) for name, value in scope.items()})
