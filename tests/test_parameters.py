"""Public functions of some packages say what their arguments are: a numpydoc section Parameters in each docstring."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

#: The packages in which every public function with an argument has the section.
COMPLETE = (
    "model",
    "codegen/evidence",
    "codegen/ir",
    "codegen/passes",
    "runtime/estimator",
    "runtime/replay",
)


def undescribed(source: str) -> Iterator[str]:
    """Public functions and methods that have an argument besides self and no section Parameters, by name."""
    tree = ast.parse(source)
    public = [node for node in tree.body if isinstance(node, ast.ClassDef) and not node.name.startswith("_")]
    for holder in (tree, *public):
        for node in holder.body:
            if not isinstance(node, ast.FunctionDef) or node.name.startswith("_"):
                continue
            given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs, node.args.vararg, node.args.kwarg]
            names = {argument.arg for argument in given if argument} - {"self", "cls"}
            if names and "\nParameters\n---" not in (ast.get_docstring(node) or ""):
                yield node.name


@pytest.mark.parametrize("package", COMPLETE)
def test_arguments_are_described(package: str) -> None:
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    assert [(path.name, name) for path in files for name in undescribed(path.read_text(encoding="utf-8"))] == []


def test_a_function_that_does_not_say_is_seen() -> None:
    described = 'def said(x):\n    """Do.\n\n    Parameters\n    ----------\n    x : float\n    """\n'
    bare = 'def bare(x):\n    """Do."""\n'
    method = 'class Thing:\n    def turn(self, angle):\n        """Turn."""\n    def size(self):\n        """Size."""\n'
    assert list(undescribed(described + bare + method)) == ["bare", "turn"]
