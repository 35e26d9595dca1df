"""Every command and snippet of the documents is read, those within a sentence, too; test_pages_run.py runs the lines.

A command line is parsed as the program would: names, options, ranges, numbers of arguments. A drive file's sections go
through the schema, Python is compiled with its imports made, C is compiled, and whatever else is called must exist.
"""

from __future__ import annotations

import ast
import importlib
import re
import shlex
import subprocess
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer

from model.drives.load import drive_path, parse_drive
from runtime.cli import app
from runtime.system.needs import PROGRAMS
from tests.codegen.strict import STRICT
from tests.test_docs import ROOT

PAGES = [*sorted((ROOT / "docs").rglob("*.md")), *(ROOT / name for name in ("README.md", "CONTRIBUTING.md"))]
#: Whole words of a line after which another command begins.
ENDS = {"&&", "||", ";", "|"}
#: Programs of a system that need no look.
SYSTEM = {"cp", "sed", "cat", "mex", "cmake", "./try", "./desk", ".", "gcc", "bash"}
#: What shells and people put in the place of a word.
PLACES = {"…", "..."}


def blocks(page: Path, language: str) -> list[str]:
    """The fenced blocks of a language."""
    text = page.read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)


def commands(page: Path) -> Iterator[list[str]]:
    """The command lines of a page, of its shell blocks and of code in a sentence; redirections are left out."""
    text = page.read_text(encoding="utf-8")
    lines = [line for block in blocks(page, "sh") for line in block.replace("\\\n", " ").splitlines()]
    prose = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    inline = re.findall(r"(?<!`)`((?:pmsm-ickf|python|pytest|make|pip|apt-get|bash) [^`]*)`", prose)
    named = [f"{words} --help" if re.fullmatch(r"pmsm-ickf [\w-]+", words) else words for words in inline]
    for line in [*lines, *named]:
        words: list[str] = []
        for word in [*shlex.split(line, comments=True), ";"]:
            if word not in ENDS:
                words.append(word)
                continue
            if "<" in words:
                words = words[: words.index("<")]
            if words:
                yield words
            words = []


def called(words: list[str]) -> str:
    """What is wrong with a command line, in a word; empty: nothing."""
    name, rest = words[0].removeprefix(".venv/bin/"), words[1:]
    if name == "pmsm-ickf":
        return parsed(rest)
    if name in {"python", "python3"}:
        if rest[0] == "-m":
            return "" if importlib.util.find_spec(rest[1]) else f"no module {rest[1]}"
        return "" if rest[0] == "-c" or (ROOT / rest[0]).is_file() else f"no file {rest[0]}"
    if name == "make":
        makefile = (ROOT / "Makefile").read_text()
        return "" if rest and re.search(rf"^{rest[0]}:", makefile, re.MULTILINE) else f"no target {rest}"
    if name in {"pip", "apt-get"}:
        return installable(name, rest)
    if name == "pytest":
        return "" if (ROOT / rest[0]).exists() else f"no file {rest[0]}"
    return "" if name in SYSTEM or name in {"pre-commit"} else f"unknown program {name}"


def parsed(words: list[str]) -> str:
    """What the command line itself says of these words, without running anything."""
    command = typer.main.get_command(app)
    if any(word in PLACES for word in words):
        return ""
    try:
        context = command.make_context("pmsm-ickf", list(words))
        while getattr(command, "commands", None):
            rest = [*context._protected_args, *context.args]
            if not rest:
                return ""
            name, command, rest = command.resolve_command(context, rest)
            context = command.make_context(name, rest, parent=context)
    except typer.Exit:
        return ""
    except Exception as error:
        return str(getattr(error, "message", error)) or type(error).__name__
    return ""


def installable(name: str, rest: list[str]) -> str:
    """Whether packages and extras are those that the project knows."""
    assert rest[0] == "install", rest
    if name == "apt-get":
        known = {package for program in PROGRAMS for package in program.debian} | {"python3", "python3-venv"}
        unknown = {word for word in rest[1:] if not word.startswith("-")} - known - {"libeigen3-dev"}
        return f"unknown packages {unknown}" if unknown else ""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    asked = {extra for word in rest for inside in re.findall(r"\[(.*)\]", word) for extra in inside.split(",")}
    return "" if asked and asked <= set(extras) else f"unknown extras {asked - set(extras)}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_is_one_that_would_be_taken(page: Path) -> None:
    wrong = {" ".join(words): said for words in commands(page) if (said := called(words))}
    assert wrong == {}


@pytest.mark.parametrize(
    "line",
    [
        *("pmsm-ickf simulat", "pmsm-ickf simulate --sped 3", "pmsm-ickf design", "pmsm-ickf study tune"),
        *(
            "pmsm-ickf simulate --delay 7",
            "pmsm-ickf simulate --dead-time 1",
            "python -m benchmarks.no_such",
            "make no",
        ),
        *("python benchmarks/no_such.py", "pip install '.[nosuch]'", "apt-get install nosuch", "nosuch"),
    ],
)
def test_a_command_that_is_none_is_seen(line: str) -> None:
    assert called(shlex.split(line)) != ""


def merged(base: dict[str, object], change: dict[str, object]) -> dict[str, object]:
    """A drive file with some sections' keys replaced."""
    return {**base, **{key: {**base.get(key, {}), **value} for key, value in change.items()}}  # type: ignore[dict-item]


#: Blocks that change the number of states, or name a file beside the drive file: run by tests of their own.
ELSEWHERE = ("adaptive =", "my_machine.py")


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, "toml")], ids=lambda page: page.name)
def test_toml_is_what_a_drive_or_facts_file_may_say(page: Path) -> None:
    from runtime.design.facts import parse_facts

    for text in blocks(page, "toml"):
        stated = tomllib.loads(text)
        if "rated" in stated and "sensor" in stated:
            parse_facts(stated, page.name)
        elif not any(word in text for word in ELSEWHERE):
            parse_drive(merged(tomllib.loads(drive_path("servo_24v").read_text()), stated), page.name)


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, "python")], ids=lambda page: page.name)
def test_python_imports_what_there_is(page: Path) -> None:
    for text in blocks(page, "python"):
        for node in ast.walk(ast.parse(text)):
            names = [(alias.name, None) for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                names = [(node.module or "", alias.name) for alias in node.names]
            for module, name in names:
                assert name is None or hasattr(importlib.import_module(module), name), f"{module}.{name}"


def surrounded(text: str) -> str:
    """A piece of C as a whole file: what are statements goes into a function."""
    lines = text.splitlines()
    outer = [line for line in lines if re.match(r"#include|static ", line)]
    inner = [line for line in lines if line not in outer]
    return "\n".join([*outer, "void piece(void);", "void piece(void)", "{", *inner, "}"])


#: What the device header declares of the registers that docs/board.md uses.
REGISTERS = """
typedef struct { struct { unsigned BRKDT, SWRESET, RXFFST, TXFFST; } bit; unsigned all; } reg_t;
extern struct { reg_t SCIRXST, SCICTL1, SCIFFRX, SCIRXBUF, SCIFFTX; Uint16 SCITXBUF; } SciaRegs;
extern struct { struct { Uint32 all; } TIM; } CpuTimer1Regs;
"""
HEADERS = ("paper_spmsm_ickf_drive.h", "pmsm_telemetry.h", "pmsm_commission.h")
#: What an application has, by the words around the pieces.
APPLICATION = """
extern float32 u[2], y[2], phase[2], command[2], duty[3], theta, omega, dc_link;
extern Uint32 sample;
extern int status, gates;
"""


@pytest.mark.parametrize(("page", "count"), [("board.md", 5), ("../README.md", 2)])
def test_pieces_of_c_compile(page: str, count: int, tmp_path: Path) -> None:
    """C in the middle of a function, or on registers: with the declarations that the text around it states."""
    pieces = blocks(ROOT / "docs" / page, "c")
    assert len(pieces) == count
    for k, text in enumerate(pieces):
        whole = declared(text.replace("my_motor", "paper_spmsm"))
        (tmp_path / f"piece{k}.c").write_text(whole)
        folder = ROOT / "generated" / "paper_spmsm"
        command = ["gcc", *STRICT, f"-I{folder}", f"-I{folder / 'board'}", "-c", f"piece{k}.c", "-o", "x.o"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{whole}\n{done.stderr}"


def declared(text: str) -> str:
    """A piece of C with what it takes from its surroundings."""
    head = '#include "pmsm_port.h"\n'
    if re.search(r"^(?:int|Uint32) \w+\(.*\)(?:;|$)", text, flags=re.MULTILINE):
        return f'{head}#include "pmsm_link.h"\n{REGISTERS}{text}'
    own = re.search(r"^static paper_spmsm_ickf_t filter", text, flags=re.MULTILINE)
    known = APPLICATION if own else f"{APPLICATION}extern paper_spmsm_ickf_t filter;\n"
    return head + "".join(f'#include "{name}"\n' for name in HEADERS) + known + surrounded(text)
