"""A folder generated in memory with figures of which no two are alike, and its report's tables, for tests."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import count
from typing import Any

import pytest

import codegen.generate as pipeline
from codegen.evidence.certificate import Certificate, ChipModel, Figures
from model.drives.load import load_drive
from model.schema import Drive

DRIVES = ("ipmsm_flux", "paper_spmsm")
PRICES = {"div": 25, "sqrt": 29, "branch": 7, "call": 12}
KS = (2.5, 4, 5)
OPERATIONS = ["add", "mul", "div", "sqrt", "compare", "select", "branch", "call", "sincos"]
CLOCK = 150e6


def price(operations: Mapping[str, float], k: float) -> int:
    """The published formula, 60 cycles for the interrupt with it."""
    cheap = sum(operations[name] for name in ("add", "mul", "compare", "select"))
    return round(k * cheap + sum(PRICES[name] * operations[name] for name in PRICES) + 60)


@dataclass(frozen=True)
class Made:
    """A folder in memory, the figures it was given, and its report's tables."""

    drive: Drive
    files: dict[str, str]
    figures: dict[str, Figures]
    measured: dict[str, dict[str, Any]]

    @property
    def facts(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self.files["manifest.json"])
        return found

    @property
    def report(self) -> str:
        return self.files["REPORT.md"]

    @property
    def tables(self) -> list[list[list[str]]]:
        """Rows of cells, heads first."""
        found: list[list[list[str]]] = []
        before = ""
        for line in self.report.splitlines():
            if line.startswith("|"):
                if not before.startswith("|") and not (before == "" and found and _is_rule(line)):
                    found.append([])
                cells = [cell.strip() for cell in line.strip("|").split("|")]
                if not _is_rule(line):
                    found[-1].append(cells)
            before = line
        return found

    def table(self, *head: str) -> dict[str, list[str]]:
        """The table whose head begins with these cells: rows by their first cell."""
        for rows in self.tables:
            if rows and rows[0][: len(head)] == list(head):
                return {row[0]: row[1:] for row in rows}
        raise AssertionError(f"no table with the head {head}")

    def words(self, name: str) -> str:
        """A file's text without comment marks and line ends."""
        return " ".join(re.sub(r"^ \*|/\*|\*/", " ", self.files[name], flags=re.MULTILINE).split())


def _is_rule(line: str) -> bool:
    return set(line) <= set("|-")


def _figures(kinds: Iterator[str] | list[str], states: int) -> dict[str, Figures]:
    """Certificates of which no two numbers are alike in two digits."""
    number = count(11)

    def certificate(samples: int) -> Certificate:
        values = [next(number) * 10.0 ** -(3 + k % 4) for k in range(states + 2)]
        return Certificate(samples, tuple(values[:-2]), values[-2], values[-1], next(number), next(number))

    return {kind: Figures(certificate(2345), ChipModel(certificate(2345), certificate(2345))) for kind in kinds}


@lru_cache(maxsize=2)
def make(name: str) -> Made:
    """Of a shipped drive, once a process."""
    drive = load_drive(name)
    measured: dict[str, dict[str, Any]] = {}

    def measurer(files: Mapping[str, str], program: Any, function: str) -> dict[str, Any]:
        k = len(measured)
        record = {"stack_bytes": 111 + 10 * k, "text_bytes": 5003 + 100 * k, "compiler": "arm-none-eabi-gcc 9.8.7"}
        return dict(measured.setdefault(function, {"source_sha256": "0" * 64, **record}))

    figures = _figures(list(drive.filter.kinds), len(drive.filter.process_noise))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pipeline, "certify_module", lambda *given: figures)
        files = pipeline.generate(drive, measurer=measurer).files  # type: ignore[arg-type]
    return Made(drive, files, figures, measured)


def subjects(made: Made) -> Iterator[tuple[str, str, dict[str, Any], str]]:
    """Row of the report, C function, what the manifest says, the struct's name."""
    for kind in made.drive.filter.kinds:
        facts, stem = made.facts["filters"][kind], f"{made.drive.name}_{kind}"
        yield kind, f"{stem}_step", facts, f"{stem}_t"
        yield f"{kind} and controller", f"{stem}_foc_step", facts["controller"], f"{stem}_foc_t"
