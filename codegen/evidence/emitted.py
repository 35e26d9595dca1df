"""Reads emitted C as C: directives by a small preprocessor of our own, the rest by pycparser.

No compiler is needed, so counting works wherever generating does. The preprocessor knows what the emitted text
uses (includes of the folder, object- and function-like macros, conditionals) and takes the target's branches.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from pycparser import CParser, c_ast

from codegen.targets.find import default_target

_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_IDENTIFIER = re.compile(r"(?<![\w.])[A-Za-z_]\w*")
_DIRECTIVE = re.compile(r"\s*#\s*(\w+)\s*(.*)")
#: What declarations end with and nest by; a string or character is passed over whole.
_MARK = re.compile(r""""(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])*'|[{};]""")


class EmittedError(ValueError):
    """Emitted C that the reader does not understand: the generator wrote something new; one line says what."""


@lru_cache(maxsize=64)
def code_of(text: str) -> str:
    """The text without comments, blank lines and trailing blanks: what a compiler's output depends on.

    Parameters
    ----------
    text : str
        C, a whole file or a part of it.

    >>> code_of("int a; /* state */")
    'int a;'
    """
    lines = (line.rstrip() for line in _COMMENT.sub(" ", text).splitlines())
    return "\n".join(line for line in lines if line)


def parse_emitted(
    files: Mapping[str, str], name: str, macros: Mapping[str, str] | None = None
) -> tuple[c_ast.FileAST, tuple[str, ...]]:
    """Syntax tree of one emitted file, and what it was read from: itself and its includes within ``files``.

    Trees of several files share their nodes where they share declarations: they are for reading.

    Parameters
    ----------
    files : mapping of str to str
        Texts by path relative to the folder.
    name : str
        The file's path.
    macros : mapping of str to str, optional
        What the target's compiler, ``float.h`` and ``limits.h`` define; by default those of the default target.

    Raises
    ------
    EmittedError
        If this reader or pycparser does not understand the text.
    """
    preprocessor = _Preprocessor(files, default_target().macros if macros is None else macros)
    text = preprocessor.read(name)
    try:
        return _tree(text, name), tuple(sorted(preprocessor.included))
    except Exception as error:  # pycparser's ParseError has moved between its versions
        raise EmittedError(f"{name} cannot be read as C: {error}") from error


def _tree(text: str, name: str) -> c_ast.FileAST:
    """Declaration by declaration: files of a folder share headers, filters of a drive most of their functions."""
    found: list[Any] = []
    types: set[str] = set()
    try:
        for declaration in _declarations(text):
            used = sorted(types.intersection(_IDENTIFIER.findall(declaration)))
            nodes = _parsed(declaration, tuple(used))
            types.update(node.name for node in nodes if isinstance(node, c_ast.Typedef))
            found += nodes
    except Exception:  # the whole text is wrong too, and then the line is its own; or it was cut in a wrong place
        return CParser().parse(text, name)
    return c_ast.FileAST(found)


def _declarations(text: str) -> Iterator[str]:
    """The text, cut behind every declaration and every function's body."""
    begin = depth = 0
    is_function = False
    for mark in _MARK.finditer(text):
        if mark[0] == "{":
            if depth == 0:
                is_function = text[begin : mark.start()].rstrip().endswith(")")
            depth += 1
        elif mark[0] == "}":
            depth -= 1
        if depth == 0 and (mark[0] == ";" or (mark[0] == "}" and is_function)):
            yield text[begin : mark.end()].strip()
            begin = mark.end()
    if rest := text[begin:].strip():
        yield rest


@lru_cache(maxsize=512)
def _parsed(declaration: str, types: tuple[str, ...]) -> list[Any]:
    """The nodes of a declaration in which these names are those of types."""
    before = f"typedef int {', '.join(types)};\n" if types else ""
    nodes: list[Any] = CParser().parse(f"{before}{declaration}").ext
    return nodes[len(types) :]


@dataclass(frozen=True)
class _Macro:
    body: str
    parameters: tuple[str, ...] | None = None


class _Preprocessor:
    """One run over one file; macros and the stack of conditionals live here."""

    def __init__(self, files: Mapping[str, str], macros: Mapping[str, str]) -> None:
        self.files = files
        self.macros = {name: _Macro(body) for name, body in macros.items()}
        self.included: set[str] = set()

    def read(self, name: str) -> str:
        """The file's text with every directive carried out."""
        self.included.add(name)
        text = _COMMENT.sub(" ", self.files[name]).replace("\\\n", " ")
        output: list[str] = []
        chunk: list[str] = []  # expanded as a whole, since a macro's arguments may span lines
        active: list[tuple[bool, bool]] = []  # (this branch is taken, some branch of this #if was)
        for line in text.splitlines():
            directive = _DIRECTIVE.match(line)
            if directive is None:
                if all(taken for taken, _ in active):
                    chunk.append(line)
                continue
            output.append(self._expand("\n".join(chunk)))
            chunk = []
            word, rest = directive.groups()
            if not self._conditional(word, rest, active) and all(taken for taken, _ in active):
                output.append(self._carry_out(word, rest, name))
        output.append(self._expand("\n".join(chunk)))
        return "\n".join(output)

    def _conditional(self, word: str, rest: str, active: list[tuple[bool, bool]]) -> bool:
        """Follow #if ... #endif; False if ``word`` is another directive."""
        if word in {"if", "ifdef", "ifndef"}:
            alive = all(taken for taken, _ in active)
            true = alive and self._condition(word, rest)
            active.append((true, true))
        elif word in {"elif", "else"}:
            _, seen = active.pop()
            alive = all(taken for taken, _ in active)
            true = alive and not seen and (word == "else" or self._condition("if", rest))
            active.append((true, seen or true))
        elif word == "endif":
            active.pop()
        else:
            return False
        return True

    def _condition(self, word: str, rest: str) -> bool:
        if word != "if":
            return (rest.split()[0] in self.macros) == (word == "ifdef")
        text = re.sub(r"defined\s*(?:\(\s*(\w+)\s*\)|(\w+))", lambda m: str(int((m[1] or m[2]) in self.macros)), rest)
        text = _IDENTIFIER.sub("0", self._expand(text))
        text = re.sub(r"\b(0[xX][\da-fA-F]+|\d+)[uUlL]*", lambda m: str(int(m[1], 0)), text)
        text = text.replace("&&", " and ").replace("||", " or ")
        text = re.sub(r"!(?!=)", " not ", text)
        if not re.fullmatch(r"(?:[\d\s()<>=!+*/%-]|and|or|not)+", text):
            raise EmittedError(f"condition not understood: #if {rest}")
        return bool(eval(text, {"__builtins__": {}}))

    def _carry_out(self, word: str, rest: str, where: str) -> str:
        if word == "include":
            target = re.match(r'"([^"]+)"', rest)
            folder = where.rpartition("/")[0]
            path = f"{folder}/{target[1]}" if target and folder else target[1] if target else ""
            return self.read(path) if path in self.files and path not in self.included else ""
        if word == "define":
            name, parameters, body = re.fullmatch(r"(\w+)(\([^)]*\))?\s*(.*)", rest).groups()  # type: ignore[union-attr]
            split = None if parameters is None else tuple(p.strip() for p in parameters[1:-1].split(",") if p.strip())
            self.macros[name] = _Macro(body.strip(), split)
        elif word == "undef":
            self.macros.pop(rest.strip(), None)
        elif word == "error":
            raise EmittedError(f"{where}: the chip's branch ends in #error {rest}")
        return ""  # #pragma and the like place code, they do not compute

    def _expand(self, text: str, hidden: frozenset[str] = frozenset()) -> str:
        """Macros replaced, their bodies too; a macro is not expanded inside itself."""
        if self.macros.keys().isdisjoint(_IDENTIFIER.findall(text)):
            return text
        result, position = [], 0
        while match := _IDENTIFIER.search(text, position):
            name, end = match[0], match.end()
            macro = self.macros.get(name) if name not in hidden else None
            result.append(text[position : match.start()])
            arguments: list[str] = []
            if macro is not None and macro.parameters is not None:
                arguments, end = _arguments(text, end)
                macro = macro if end > match.end() else None
            if macro is None:
                result.append(name)
            else:
                values = {p: self._expand(a, hidden) for p, a in zip(macro.parameters or (), arguments, strict=True)}
                body = _IDENTIFIER.sub(lambda m, values=values: values.get(m[0], m[0]), macro.body)  # type: ignore[misc]
                result.append(self._expand(body, hidden | {name}))
            position = end
        return "".join([*result, text[position:]])


def _arguments(text: str, start: int) -> tuple[list[str], int]:
    """Arguments of a macro call whose name ends at ``start``, and where the call ends (``start`` if it is none)."""
    opening = re.compile(r"\s*\(").match(text, start)
    if opening is None:
        return [], start
    depth, begin, arguments = 1, opening.end(), []
    for k in range(opening.end(), len(text)):
        depth += {"(": 1, ")": -1}.get(text[k], 0)
        if (text[k] == "," and depth == 1) or depth == 0:
            arguments.append(text[begin:k].strip())
            begin = k + 1
        if depth == 0:
            return [a for a in arguments if a or len(arguments) > 1], k + 1
    raise EmittedError("a macro's arguments do not end")
