"""Gate: read as C, the firmware uses nothing banned, calls nothing unknown, and divides by nothing unguarded."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pycparser import c_ast, c_parser

from runtime.firmware.static.check import Check
from runtime.firmware.static.divisions import SQRT, divisions
from runtime.firmware.static.tool import firmware_sources, is_bench, is_example, missing, run

#: Words of a type that may occur. No char and no double, whose widths differ; ``long`` is 32 bits on the chip.
TYPE_WORDS = frozenset({"float", "int", "short", "long", "unsigned", "signed", "void"})

#: Constants that may occur: not double (a literal without suffix), not text, not 64 bits.
CONSTANTS = frozenset({"float", "int", "unsigned int", "long int", "unsigned long int"})


@dataclass(frozen=True)
class Source:
    """One file, preprocessed and parsed. ``file`` is its name; nodes from headers have another in their ``coord``."""

    path: Path
    tree: c_ast.FileAST

    def functions(self) -> list[c_ast.FuncDef]:
        """The functions that are defined in the file."""
        return [item for item in self.tree.ext if isinstance(item, c_ast.FuncDef)]


class NotCError(Exception):
    """A file that the preprocessor or the parser refuses; the message is one line."""


def parse(path: Path, folder: Path | None = None) -> Source:
    """The file as its compiler sees it, with line numbers; headers are beside it or in ``folder``.

    Raises
    ------
    NotCError
        If it does not preprocess or parse.
    """
    include = f"-I{(folder or path.parent).resolve()}"
    code, text = run(["gcc", "-E", "-std=c89", include, path.name], cwd=path.parent)
    if code:
        raise NotCError(f"{path.name}: {text.strip().splitlines()[-1]}")
    try:
        tree = c_parser.CParser().parse(text, path.name)
    except Exception as error:  # pycparser's own class moved between its versions
        raise NotCError(f"{error}") from None
    return Source(path, tree)


def ban_checks(folder: Path) -> list[Check]:
    """Two checks: banned constructs, and divisions."""
    names = ("banned constructs", "divisions guarded")
    for name in names:
        absent = missing(name, folder.name, "gcc")
        if absent:
            return [Check(n, folder.name, absent.state, "", absent.how, absent.detail) for n in names]
    sources, broken = [], []
    for path in firmware_sources(folder):
        try:
            sources.append(parse(path, folder))
        except NotCError as error:
            broken.append(str(error))
    found = [*broken, *(line for source in sources for line in _bans(source, sources)), *_recursion(sources)]
    every = [(source, division) for source in sources if _runs(source) for division in divisions(source.functions())]
    unguarded = [
        f"{source.path.name}:{d.line}: {d.function} divides by {d.divisor}"
        for source, d in every
        if not d.range.avoids_zero
    ]
    good = bool(sources)
    return [
        Check(
            names[0],
            folder.name,
            "failed" if found or not good else "passed",
            f"{len(found)} found in {len(sources)} files",
            "read as C: types, literals, calls, recursion, globals",
            tuple(found),
        ),
        Check(
            names[1],
            folder.name,
            "failed" if unguarded or broken or not good else "passed",
            f"{len(unguarded)} of {len(every)} unguarded",
            "proved by ranges of one function; inputs documented positive are taken so",
            (*broken, *unguarded),
        ),
    ]


# --- bans


def _bans(source: Source, sources: list[Source]) -> Iterator[str]:
    aliases = {item.name: _words(item.type) for item in source.tree.ext if isinstance(item, c_ast.Typedef)}
    known = {function.decl.name for other in sources for function in other.functions()}
    own = {function.decl.name for function in source.functions()}
    public = {name for name in known if name in own or _declared(source, name)}
    open_ended = is_example(source.path) or is_bench(source.path)
    if open_ended:  # what these call of the application's is declared in them or in their headers
        public |= {item.name for item in source.tree.ext if isinstance(item, c_ast.Decl)}
    for item in source.tree.ext:
        if isinstance(item, c_ast.Typedef) or not _here(item, source):
            continue
        if _variable(item) and not open_ended:
            yield f"{_place(source, item)}: global variable {item.name}"
        for node in _every(item):
            complaint = _complaint(node, aliases, public, open_ended)
            if complaint:
                yield f"{_place(source, node)}: {complaint}"


def _complaint(node: c_ast.Node, aliases: dict[str, list[str]], known: set[str], pointers: bool) -> str | None:
    """Why a node is banned, or None; calls through ``pointers`` may be allowed."""
    if isinstance(node, c_ast.IdentifierType):
        words = _resolve(node.names, aliases)
        if not set(words) <= TYPE_WORDS or words.count("long") > 1:
            return f"type {' '.join(node.names)}"
    elif isinstance(node, c_ast.Constant):
        kind = node.type
        if kind not in CONSTANTS:
            return f"constant {node.value} is a {kind}"
    elif isinstance(node, c_ast.UnaryOp) and node.op in {"sizeof", "_Alignof"}:
        return str(node.op)
    elif isinstance(node, c_ast.Goto | c_ast.Label):
        return "goto"
    elif isinstance(node, c_ast.FuncCall):
        if not isinstance(node.name, c_ast.ID):
            return None if pointers else "call through a pointer"
        if node.name.name not in known and node.name.name not in SQRT:
            return f"call of {node.name.name}"
    return None


def _runs(source: Source) -> bool:
    """Filter or controller. A self-test divides recorded numbers, to see what the chip makes of them."""
    return not (source.path.stem.endswith("_selftest") or is_example(source.path) or is_bench(source.path))


def _variable(item: c_ast.Node) -> bool:
    """A file-level object that is not constant."""
    if not isinstance(item, c_ast.Decl) or isinstance(item.type, c_ast.FuncDecl):
        return False
    return "const" not in item.quals


def _resolve(names: list[str], aliases: dict[str, list[str]]) -> list[str]:
    """Words of the type behind the project's names; a struct is made of its members, looked at where it is written."""
    words: list[str] = []
    for name in names:
        words += _resolve(aliases[name], aliases) if name in aliases else [name]
    return words


def _words(node: c_ast.Node) -> list[str]:
    while not isinstance(node, c_ast.IdentifierType):
        if isinstance(node, c_ast.Struct | c_ast.Union | c_ast.Enum):
            return []
        node = node.type
    return list(node.names)


def _declared(source: Source, name: str) -> bool:
    return any(isinstance(item, c_ast.Decl) and item.name == name for item in source.tree.ext)


def _here(node: c_ast.Node, source: Source) -> bool:
    """Written in this file, not in a header (the port header measures its types with sizeof, on purpose)."""
    return bool(node.coord) and Path(str(node.coord.file)).name == source.path.name


def _place(source: Source, node: c_ast.Node) -> str:
    return f"{source.path.name}:{node.coord.line if node.coord else '?'}"


def _every(node: c_ast.Node) -> Iterator[c_ast.Node]:
    yield node
    for _, child in node.children():
        yield from _every(child)


# --- recursion


def _recursion(sources: list[Source]) -> Iterator[str]:
    """Functions that can reach themselves; statics of the same name in two files are different functions."""
    calls: dict[str, set[str]] = {}
    places: dict[str, str] = {}
    for source in sources:
        own = {f.decl.name for f in source.functions() if "static" in f.decl.storage}
        for function in source.functions():
            here = _qualified(source, function.decl.name, own)
            called = {n.name.name for n in _every(function) if isinstance(n, c_ast.FuncCall) and _named(n)}
            places[here] = _place(source, function)
            calls[here] = {_qualified(source, name, own) for name in called}
    for start in calls:
        reached: set[str] = set()
        front = set(calls[start])
        while front:
            reached |= front
            front = {name for one in front for name in calls.get(one, ())} - reached
        if start in reached:
            yield f"{places[start]}: {start.rpartition(' ')[2]} calls itself"


def _named(call: c_ast.FuncCall) -> bool:
    return isinstance(call.name, c_ast.ID)


def _qualified(source: Source, name: str, statics: set[str]) -> str:
    return f"{source.path.name}: {name}" if name in statics else name
