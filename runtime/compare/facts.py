"""Figures of each drive and filter, and everything a comparison says as plain data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from codegen.targets.find import find_target
from runtime.compare.differences import Row, constant_rows, equation_lines, file_rows, tuning_rows
from runtime.compare.subject import Subject
from runtime.drive.experiment import run_facts
from runtime.system.files import write_facts


@dataclass(frozen=True)
class Cost:
    """One filter's step.

    ``cycles``, ``interrupt`` (with the controller around it): computed, at the typical price and at the bound, by k;
    ``share``: per cent of the sample time that the filter takes at the typical price. Cycles are empty and the share is
    None where nothing is published for the target. Stack and text in bytes on the target's stand-in, None where they
    were not measured.
    """

    label: str
    kind: str
    operations: dict[str, int]
    cycles: dict[str, int]
    interrupt: dict[str, int]
    share: float | None
    ram_words: int
    stack: int | None
    text: int | None

    @property
    def typical(self) -> int | None:
        """Cycles at the typical price."""
        return next(iter(self.cycles.values()), None)

    @property
    def bound(self) -> int | None:
        """Cycles at the price that is a bound."""
        return next(reversed(self.cycles.values()), None)


def costs(subjects: Sequence[Subject]) -> list[Cost]:
    """Filter by filter, the drives below each other."""
    return [_cost(s, kind) for kind in kinds(subjects) for s in subjects if kind in s.folder.kinds]


def kinds(subjects: Sequence[Subject]) -> list[str]:
    """Filters that any of the drives ships."""
    return list(dict.fromkeys(kind for subject in subjects for kind in subject.folder.kinds))


def _cost(subject: Subject, kind: str) -> Cost:
    facts = subject.manifest["filters"][kind]
    measured = subject.manifest.get("measured", {}).get(f"{subject.folder.drive}_{kind}_step", {})
    prices = find_target(subject.drive.target_name).prices
    ks = [f"{k:g}" for k in (prices.factors[0], prices.factors[-1])] if prices else []
    cycles = {k: int(facts["cycles"][k]) for k in ks}
    return Cost(
        label=subject.label,
        kind=kind,
        operations=facts["operations"],
        cycles=cycles,
        interrupt={k: int(facts["controller"]["cycles"][k]) for k in ks},
        share=100 * cycles[ks[0]] / (prices.clock * subject.drive.model.sample_time) if prices else None,
        ram_words=facts["state_words"],
        stack=measured.get("stack_bytes"),
        text=measured.get("text_bytes"),
    )


def certificates(subjects: Sequence[Subject]) -> list[tuple[str, str, dict[str, float]]]:
    """Label, filter, and the worst float32 error of a step by state, and of P."""
    return [
        (s.label, kind, {**dict(zip(s.state_names, c["x"], strict=True)), "P, 99 %": c["P_99"], "P, worst": c["P"]})
        for kind in kinds(subjects)
        for s in subjects
        if kind in s.folder.kinds and (c := s.manifest["filters"][kind].get("certificate"))
    ]


def to_json(subjects: Sequence[Subject]) -> dict[str, Any]:
    """Everything, as plain data."""
    labels = [subject.label for subject in subjects]

    def rows(items: Sequence[Row]) -> dict[str, Any]:
        return {row.key: dict(zip(labels, row.values, strict=True)) for row in items if row.differs}

    lines = [
        {
            "function": line.function,
            "left": str(line.left),
            "variants": [
                {"right": str(right), "drives": [labels[k] for k in owners]} for right, owners in line.variants
            ],
        }
        for line in equation_lines(subjects)
        if line.differs
    ]
    found = costs(subjects)
    certified = certificates(subjects)
    return {
        "drives": labels,
        "differences": {
            "file": rows(file_rows(subjects)),
            "tuning": rows(tuning_rows(subjects)),
            "constants": rows(constant_rows(subjects)),
            "equations": lines,
        },
        "states": {s.label: list(s.state_names) for s in subjects},
        "sparsity": {s.label: {name: list(rows) for name, rows in s.patterns.items()} for s in subjects},
        "cost": {
            label: {
                c.kind: {
                    "operations": c.operations,
                    "cycles": c.cycles,
                    "cycles_with_controller": c.interrupt,
                    "percent_of_sample_time": c.share,
                    "ram_words": c.ram_words,
                    "stack_bytes_m4": c.stack,
                    "text_bytes_m4": c.text,
                }
                for c in found
                if c.label == label
            }
            for label in labels
        },
        "certificate": {label: {kind: values for name, kind, values in certified if name == label} for label in labels},
        "accuracy": {s.label: [run_facts(run) for run in s.runs] for s in subjects},
    }


def write_json(subjects: Sequence[Subject], path: Path) -> None:
    """:func:`to_json` into a file."""
    write_facts(path, to_json(subjects))
