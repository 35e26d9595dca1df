"""docs/worked_example.md: its shell lines, Python and C are run in order, and say what the page says."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

from tests.test_docs import ROOT, _blocks, desk  # noqa: F401

PAGE = "worked_example.md"


def test_the_facts_in_the_page_are_those_of_the_file() -> None:
    (stated,) = _blocks(PAGE, "toml")
    assert stated.strip() == (ROOT / "docs" / "worked_example" / "pump_facts.toml").read_text().strip()


@pytest.mark.thorough
def test_the_worked_example_works(desk) -> None:  # type: ignore[no-untyped-def]  # noqa: F811
    (desk / "docs").symlink_to(ROOT / "docs")
    for block in _blocks(PAGE, "c"):
        (desk / re.match(r"/\* (\w+\.c)", block)[1]).write_text(block)  # type: ignore[index]
    *shell, build = _blocks(PAGE, "sh")
    (python,) = _blocks(PAGE, "python")
    script = f'PATH="{desk}:$PATH" PYTHONPATH="{ROOT}" COLUMNS=160; export PATH PYTHONPATH COLUMNS\n{"".join(shell)}'
    script += (
        f"{sys.executable} -c '{python}'\n{build}gcc -std=c89 -Wall -Werror -Igenerated/pump -c pump.c -o pump.o\n"
    )
    done = subprocess.run(["sh", "-ec", script], cwd=desk, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(r"^pump: proved, [\d,]+ numbers compared$", done.stdout, flags=re.MULTILINE)
    assert "pump: holds at a tenth of rated speed and above" in done.stdout
    assert "'stator_resistance'" in done.stdout
    assert done.stdout.splitlines()[-1] == "0 0"
