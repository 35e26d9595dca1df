"""The command ``doctor``: what is there, what is skipped without the rest, and the line that brings it."""

from __future__ import annotations

import platform
import sys
from typing import Any

import typer
from rich.markup import escape

from runtime.commands.terminal import console, say
from runtime.commands.words import Json
from runtime.style.tables import columns_table
from runtime.system.errors import UserError
from runtime.system.files import write_facts
from runtime.system.needs import EXTRAS, PROGRAMS, extra_lacks, packaged_compiler, program_found


def doctor(json: Json = None) -> None:
    """Say which tools and extras are there, what is skipped without the others, and the line that brings them.

    Exit code 1: the C compiler does not work, or there is no place for what it makes: most commands need both.
    """
    problems = _compiles()
    programs = {program.name: program_found(program) for program in PROGRAMS}
    lacking = {extra: extra_lacks(extra) for extra in EXTRAS}
    if programs["cc"]:
        lacking["compiler"] = []  # one is enough
    _show(programs, lacking)
    say(f"Python {platform.python_version()}, {platform.system()} {platform.machine()}")
    if platform.system() != "Linux":
        say("The project's own tests run on Linux alone.")
    for line in (*_lines(programs, lacking), *problems):
        say(line)
    if json is not None:
        facts: dict[str, Any] = {"python": platform.python_version(), "system": platform.system()}
        facts |= {"programs": programs, "extras_lack": lacking, "problems": problems}
        write_facts(json, facts)
    if problems:
        raise typer.Exit(1)


def _compiles() -> list[str]:
    """What keeps a small program from being compiled, kept and loaded."""
    import ctypes

    from runtime.estimator.compiler import build_library

    try:
        library = build_library({"doctor.c": "int answer(void) { return 42; }\n"}, {})
        if ctypes.CDLL(str(library)).answer() != 42:
            return ["The C compiler makes programs that do not compute what they must."]
    except (UserError, OSError) as error:
        return [str(error)]
    return []


def _show(programs: dict[str, str | None], lacking: dict[str, list[str]]) -> None:
    table = columns_table("", "", "for", left=range(3))
    for program in PROGRAMS:
        found = programs[program.name]
        table.add_row(escape(program.name), escape(found) if found else "[yellow]missing[/yellow]", escape(program.use))
    for extra, use in EXTRAS.items():
        missing, unneeded = ", ".join(lacking[extra]), extra == "compiler" and packaged_compiler() is None
        state = f"[yellow]missing: {escape(missing)}[/yellow]" if missing else "not needed" if unneeded else "installed"
        table.add_row(f"extra {extra}", state, escape(use))
    console.print(table)


def _lines(programs: dict[str, str | None], lacking: dict[str, list[str]]) -> list[str]:
    """The lines that bring what is missing."""
    missing = [program for program in PROGRAMS if programs[program.name] is None]
    lines = []
    if sys.platform == "darwin":
        formulas = [program.brew for program in missing if program.brew]
        lines += [f"brew install {' '.join(formulas)}"] if formulas else []
        lines += [f"Homebrew has no {program.name}." for program in missing if not program.brew]
    elif missing:
        lines.append(f"apt-get install {' '.join(name for program in missing for name in program.debian)}")
    extras = [extra for extra, names in lacking.items() if names]
    if extras:
        lines.append(f"pip install 'pmsm-ickf[{','.join(extras)}]'")
    return lines
