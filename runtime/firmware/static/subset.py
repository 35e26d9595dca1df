"""Gate: the rules of a target's subset of C, over the text as the target's own compiler would read it.

The CLA's are those of SPRU514, chapter 10: C alone, no library of C, no recursion, no pointers to functions, no
variable that is initialised but constants, no type of 64 bits, and of whole numbers no division, remainder or unsigned
comparison. Its compiler is not run; what it would say beyond these rules is not known here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from pycparser import c_ast

from codegen.evidence.emitted import EmittedError, parse_emitted
from codegen.output.folder import MANIFEST, read_manifest
from codegen.targets.description import Target
from codegen.targets.find import find_target
from model.schema import DEFAULT_TARGET
from runtime.firmware.static.check import Check
from runtime.firmware.static.tool import is_example

HOW = "read as C, as its compiler preprocesses; that compiler is not run"
LONG = frozenset({"double", "long long", "long double"})


def subset_checks(folder: Path) -> list[Check]:
    """One check, where the folder's target has a subset."""
    target = target_of(folder)
    if not target.subset:
        return []
    files = {path.name: path.read_text(encoding="utf-8") for path in sorted(folder.glob("*.[ch]"))}
    sources = [name for name in files if name.endswith(".c") and "selftest" not in name and not is_example(Path(name))]
    found = [line for name in sources for line in complaints(files, name, target)]
    good = bool(sources) and not found
    figure = f"{len(found)} found in {len(sources)} files"
    name = f"subset of C, {target.core}"
    return [Check(name, folder.name, "passed" if good else "failed", figure, HOW, tuple(found))]


def target_of(folder: Path) -> Target:
    """The target that a folder was generated for; without a manifest the default one."""
    named = read_manifest(folder) if (folder / MANIFEST).is_file() else {}
    return find_target(named.get("target", DEFAULT_TARGET))


def complaints(files: dict[str, str], name: str, target: Target) -> list[str]:
    """What a file does that its target's subset of C has not.

    Parameters
    ----------
    files : dict of str to str
        Texts by path.
    name : str
        The file.
    target : Target
    """
    try:
        tree, _ = parse_emitted(files, name, target.macros)
    except EmittedError as error:
        return [str(error)]
    return [f"{name}: {line}" for rule in RULES[target.subset] for line in rule(tree, target)]


def _every(node: Any) -> Iterator[Any]:
    yield node
    for _, child in node.children():
        yield from _every(child)


def _functions(tree: c_ast.FileAST) -> list[c_ast.FuncDef]:
    return [item for item in tree.ext if isinstance(item, c_ast.FuncDef)]


def _calls(node: Any) -> Iterator[c_ast.FuncCall]:
    yield from (item for item in _every(node) if isinstance(item, c_ast.FuncCall))


def _named_calls(tree: c_ast.FileAST, target: Target) -> Iterator[str]:
    """Only functions that are declared in the text, or that the description names."""
    known = {item.decl.name for item in _functions(tree)} | set(target.native.calls if target.native else ())
    known |= {item.name for item in tree.ext if isinstance(item, c_ast.Decl) and isinstance(item.type, c_ast.FuncDecl)}
    for call in _calls(tree):
        if not isinstance(call.name, c_ast.ID):
            yield "a call through a pointer"
        elif call.name.name not in known:
            yield f"a call of '{call.name.name}', which is of a library"


def _recursion(tree: c_ast.FileAST, target: Target) -> Iterator[str]:
    calls = {
        item.decl.name: {call.name.name for call in _calls(item) if isinstance(call.name, c_ast.ID)}
        for item in _functions(tree)
    }
    for start in calls:
        reached: set[str] = set()
        front = set(calls[start])
        while front:
            reached |= front
            front = {name for one in front for name in calls.get(one, ())} - reached
        if start in reached:
            yield f"'{start}' calls itself"


def _pointers_to_functions(tree: c_ast.FileAST, target: Target) -> Iterator[str]:
    for node in _every(tree):
        if isinstance(node, c_ast.PtrDecl) and isinstance(node.type, c_ast.FuncDecl):
            yield "a pointer to a function"


def _variables(tree: c_ast.FileAST, target: Target) -> Iterator[str]:
    """Nothing is initialised before the program runs but what is const."""
    for item in tree.ext:
        if isinstance(item, c_ast.Decl) and item.init is not None and "const" not in _qualifiers(item):
            yield f"'{item.name}' is initialised and not const"
    for function in _functions(tree):
        for node in _every(function.body):
            if isinstance(node, c_ast.Decl) and "static" in node.storage and "const" not in _qualifiers(node):
                yield f"'{node.name}' is a static variable of a function"


def _types(tree: c_ast.FileAST, target: Target) -> Iterator[str]:
    for node in _every(tree):
        if isinstance(node, c_ast.IdentifierType):
            words = " ".join(word for word in node.names if word not in {"signed", "unsigned", "int"}) or "int"
            if words in LONG:
                yield f"the type {words}"


def _whole_numbers(tree: c_ast.FileAST, target: Target) -> Iterator[str]:
    """Division, remainder and unsigned comparisons in functions; numbers are divided by the target's macro."""
    unsigned = {
        node.name
        for node in _every(tree)
        if isinstance(node, c_ast.Decl) and {"unsigned", "Uint16", "Uint32"} & _type_words(node)
    }
    for node in (item for function in _functions(tree) for item in _every(function)):
        if not isinstance(node, c_ast.BinaryOp):
            continue
        if node.op in {"/", "%"}:
            yield f"the operator {node.op}"
        if node.op in {"<", ">", "<=", ">="} and any(_is_unsigned(side, unsigned) for side in (node.left, node.right)):
            yield "an unsigned comparison"


def _qualifiers(node: c_ast.Decl) -> set[str]:
    """Of the declaration, and of an array's elements."""
    return set(node.quals) | {word for item in _every(node.type) for word in getattr(item, "quals", None) or ()}


def _type_words(node: c_ast.Decl) -> set[str]:
    return {word for item in _every(node.type) if isinstance(item, c_ast.IdentifierType) for word in item.names}


def _is_unsigned(node: Any, unsigned: set[str]) -> bool:
    if isinstance(node, c_ast.Constant):
        return str(node.type).startswith("unsigned")
    return isinstance(node, c_ast.ID) and node.name in unsigned


Rule = Callable[[c_ast.FileAST, Target], Iterator[str]]
#: Rules by the description's word.
RULES: dict[str, tuple[Rule, ...]] = {
    "cla": (_named_calls, _recursion, _pointers_to_functions, _variables, _types, _whole_numbers),
}
