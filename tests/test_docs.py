"""The documents are true: their shell lines run, their C compiles under the strict flags, their tables are complete."""

from __future__ import annotations

import importlib.util
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from model.schema import Drive
from runtime.estimator.folder import GENERATED
from tests.codegen.strict import STRICT

ROOT = GENERATED.parent
DOCS = ("ccs.md", "firmware.md", "regenerate.md")


def site_module(name: str) -> Any:
    """A module of docs/site, which is no package."""
    spec = importlib.util.spec_from_file_location(f"docs_site_{name}", ROOT / "docs" / "site" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def written() -> set[Path]:
    """Pages that are there in the site alone: docs/site writes them from the code."""
    pages = {**site_module("reference_pages").PAGES, **site_module("gallery_pages").PAGES}
    return {ROOT / "docs" / page for page in pages}


def _blocks(document: str, language: str) -> list[str]:
    text = (ROOT / "docs" / document).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)


@pytest.fixture
def desk(tmp_path: Path) -> Path:
    """A folder that looks like a check-out, with a pmsm-ickf of this one."""
    (tmp_path / "model").symlink_to(ROOT / "model")
    shutil.copytree(GENERATED, tmp_path / "generated")
    command = tmp_path / "pmsm-ickf"
    command.write_text(f'#!/bin/sh\nPYTHONPATH="{ROOT}" exec "{sys.executable}" -m runtime.cli "$@"\n')
    command.chmod(0o755)
    return tmp_path


@pytest.mark.parametrize("document", DOCS)
def test_what_is_written_there_works(document: str, desk: Path) -> None:
    """C blocks are saved under the name in their first comment; shell lines run in order; then all C must compile."""
    sources = {re.match(r"/\* (\w+\.c)", block).group(1): block for block in _blocks(document, "c")}  # type: ignore[union-attr]
    for name, text in sources.items():
        (desk / name).write_text(text)
    output = ""
    for block in _blocks(document, "sh"):
        done = subprocess.run(
            ["sh", "-ec", f'PATH="{desk}:$PATH"\n{block}'], cwd=desk, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        output += done.stdout
    drive = "my_motor" if (desk / "generated" / "my_motor").is_dir() else "paper_spmsm"
    for name in sources:
        command = ["gcc", *STRICT, "-O2", f"-Igenerated/{drive}", "-c", name, "-o", "x.o"]
        done = subprocess.run(command, cwd=desk, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    if document == "ccs.md":
        assert output.splitlines()[-1] == "0 0"


@pytest.mark.thorough
def test_own_machine_goes_through_the_whole_chain(desk: Path) -> None:
    """docs/own_machine.md: its shell lines, its figures, and a drive file that says what is in the page."""
    (desk / "docs").symlink_to(ROOT / "docs")
    text = (ROOT / "docs" / "own_machine.md").read_text(encoding="utf-8")
    (stated,) = _blocks("own_machine.md", "toml")
    assert stated in (ROOT / "docs" / "own_machine" / "my_motor.toml").read_text()
    (lines,) = _blocks("own_machine.md", "sh")
    first, rest = lines.split("\n", 1)
    lines = f"{first}\nsed -i 's/, \"ickf\"//' my_motor.toml\n{rest}"  # one is proved here; simulate takes both kinds
    assert "verify" in lines
    assert "simulate" in lines
    done = subprocess.run(
        [
            "sh",
            "-ec",
            f'PATH="{desk}:$PATH" COLUMNS=160\nexport COLUMNS\n{lines}pmsm-ickf generate my_motor.toml --check',
        ],
        cwd=desk,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(r"^my_motor: proved, [\d,]+ numbers compared$", done.stdout, flags=re.MULTILINE)
    for row in re.findall(r"^load_step .*$|^[fhFH] +│.*$", text, flags=re.MULTILINE):
        assert _columns(row)[:2] in [_columns(line)[:2] for line in done.stdout.splitlines()], row
    assert done.stdout.count("locked") == 4  # simulate takes both kinds


def _columns(row: str) -> list[str]:
    return [cell.strip() for cell in row.split("│")]


def test_status_table_has_every_bit() -> None:
    port = (GENERATED / "paper_spmsm" / "pmsm_port.h").read_text()
    bits = {(value, name) for name, value in re.findall(r"#define (PMSM_\w+) (0x[0-9A-Fa-f]+)\b", port)}
    table = (ROOT / "docs" / "firmware.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^\| (0x\w+) \| `(PMSM_\w+)`", table, flags=re.MULTILINE)) == bits


def test_every_generated_c_file_is_in_the_report(drive: Drive) -> None:
    report = (GENERATED / drive.name / "REPORT.md").read_text()
    for path in (GENERATED / drive.name).glob("*.c"):
        assert f"`{path.name}`" in report or f"`{path.stem}.h`, `.c`" in report


@pytest.mark.parametrize(
    "document", [*(f"docs/{file.name}" for file in (ROOT / "docs").glob("*.md")), *(f.name for f in ROOT.glob("*.md"))]
)
def test_links_lead_somewhere(document: str) -> None:
    path = ROOT / document
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", path.read_text(encoding="utf-8")):
        if "://" not in target:
            place = (path.parent / target).resolve()
            assert place.exists() or place in written(), target


def test_the_change_log_says_nothing_twice() -> None:
    """As two branches that grew the same entry leave it."""
    entries = re.findall(r"^- .{60}", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert len(entries) > 50
    assert {entry for entry in entries if entries.count(entry) > 1} == set()
