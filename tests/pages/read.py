"""The lines of the pages, and how one is run: in a folder that looks like a check-out, by a shell."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
#: What a check-out has beside the packages, as a page's words name it.
CHECKOUT = ("model", "codegen", "runtime", "generated", "docs", "benchmarks", "Makefile", "pyproject.toml", "README.md")


@dataclass(frozen=True)
class Line:
    """A line of a shell block without its comment, or a whole block of Python, and where it begins."""

    number: int
    language: str
    words: str


def lines(page: str) -> Iterator[Line]:
    """What of a page is run, in its order; a backslash at the end of a line joins the next one to it.

    Parameters
    ----------
    page : str
        Its path from the root.
    """
    text = (ROOT / page).read_text(encoding="utf-8")
    for block in re.finditer(r"^```(sh|python)\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL):
        number = text.count("\n", 0, block.start(2)) + 1
        if block[1] == "python":
            yield Line(number, "python", block[2])
            continue
        for whole in block[2].replace("\\\n", "\0").splitlines():
            yield Line(number, "sh", re.sub(r"\s+# .*$", "", whole.replace("\0", " ")).strip())
            number += 1 + whole.count("\0")


def pages() -> list[str]:
    """Every page of the documents with a shell line or Python, by its path from the root."""
    paths = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
    return sorted(name for path in paths if any(lines(name := str(path.relative_to(ROOT)))))


def make_desk(desk: Path) -> None:
    """Make a folder look like a check-out whose environment is set up and active.

    ``generated`` is a folder of its own, since lines write into it; a shipped drive is found in the package.
    """
    for name in CHECKOUT:
        if name != "generated":
            (desk / name).symlink_to(ROOT / name)
    (desk / "generated").mkdir()
    for path in (ROOT / "generated").iterdir():
        (desk / "generated" / path.name).symlink_to(path)
    programs = desk / ".venv" / "bin"
    programs.mkdir(parents=True)
    for name, words in {"pmsm-ickf": "-m runtime.cli", "python": ""}.items():
        (programs / name).write_text(f'#!/bin/sh\nPYTHONPATH="{ROOT}" exec "{sys.executable}" {words} "$@"\n')
        (programs / name).chmod(0o755)
    for name in (".ready", ".ready-dev"):  # what make takes for "set up", as long as it is younger than these programs
        (desk / ".venv" / name).touch()


def run(words: str, desk: Path, language: str = "sh", answers: str = "") -> subprocess.CompletedProcess[str]:
    """Run a line in a desk, as somebody who sits at it would.

    Parameters
    ----------
    words : str
    desk : Path
    language : str, optional
        "sh" or "python".
    answers : str, optional
        What its standard input holds.
    """
    command = ["sh", "-ec", words] if language == "sh" else [str(desk / ".venv" / "bin" / "python"), "-c", words]
    environment = {**os.environ, "PATH": f"{desk / '.venv' / 'bin'}:{os.environ['PATH']}", "COLUMNS": "160"}
    return subprocess.run(
        command, cwd=desk, env=environment, input=answers, capture_output=True, text=True, check=False
    )
