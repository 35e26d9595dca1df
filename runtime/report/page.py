"""The report page: one HTML file that needs nothing else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import sympy as sp
from markupsafe import Markup

from codegen.fast.ablation import OPERATIONS, weights_text
from codegen.output.folder import read_manifest
from codegen.render.equations import readable
from model.machines.state_space import build
from runtime.drive.figures import run_figure, sweep_figure
from runtime.drive.tables import claims, sweep_cell
from runtime.firmware.tables import remarks
from runtime.proof.figures import drift_figure, effect_figure, stage_figure, trajectory_figure
from runtime.proof.tables import COUNTS, stages_by_equation, whole_links
from runtime.report.chapter import Chapter
from runtime.report.cost_figures import passes_figure
from runtime.report.first import first_screen
from runtime.report.symbols import constant_unit, symbols
from runtime.style.pages import equation_line, matrix_markup, page_template, symbol_markup
from runtime.style.svg import themed
from runtime.system.files import make_folder, write_text
from runtime.system.verdicts import all_hold


def write_page(path: Path, chapters: list[Chapter]) -> None:
    """Write the page for some drives, one chapter each."""
    make_folder(path.parent)
    text = page_template(Path(__file__).with_name("page.html.j2")).render(
        first=first_screen(chapters),
        chapters=[_chapter(chapter) for chapter in chapters],
        passed=all_hold(c.proof.passed and not (c.firmware and c.firmware.failed) for c in chapters),
        missing=any(not c.firmware or c.firmware.missing for c in chapters),
        unchecked=any(chapter.proof.unchecked for chapter in chapters),
        sweep_cell=sweep_cell,
    )
    write_text(path, text)


def _chapter(chapter: Chapter) -> dict[str, Any]:
    drive, proof, evidence = chapter.drive, chapter.proof, chapter.evidence
    manifest = read_manifest(chapter.folder)
    units = {state["name"]: state["unit"] for state in manifest["states"]}
    equations = readable(drive)
    stages = stages_by_equation(proof.links)
    fast = stages_by_equation(proof.links, "B-C")
    kind = drive.filter.kinds[0]
    earned = chapter.earned
    return {
        "drive": drive,
        "proof": proof,
        "manifest": manifest,
        "units": units,
        "f": [equation_line(equations, *line) for line in equations.f],
        "h": [equation_line(equations, *line) for line in equations.h],
        "H": matrix_markup(equations, sp.Symbol("H"), equations.H),
        "inverter": [equation_line(equations, *line) for line in equations.inverter],
        "symbols": [
            {"math": symbol_markup(equations, s.symbol), "unit": s.unit, "meaning": s.meaning}
            for s in symbols(equations, build(drive).states)
        ],
        "constants": [(k, constant_unit(k, equations.constants)) for k in equations.constants],
        "stages": stages,
        "fast": fast,
        "whole": whole_links(proof),
        "earned": earned,
        "earned_kind": kind,
        "operations": OPERATIONS,
        "weights": weights_text(),
        "counts": COUNTS,
        "variants": list(dict.fromkeys(variant for cells in stages.values() for variant in cells)),
        "failures": list(proof.failures()),
        "runs": [(run, run.figures()) for run in chapter.runs],
        "hard": [(run, run.figures()) for run in chapter.hard],
        "claims": claims(chapter.runs) if drive.name == "paper_spmsm" else [],
        "sweep": chapter.sweep,
        "checks": chapter.firmware.checks if chapter.firmware else (),
        "kept": chapter.proof.kept or bool(chapter.firmware and chapter.firmware.kept),
        "remarks": remarks(chapter.firmware.checks if chapter.firmware else ()),
        "figures": {
            "trajectory": themed(trajectory_figure(evidence)),
            "stages": themed(stage_figure(proof)),
            "drift": themed(drift_figure(evidence, drive.model.sample_time, units)),
            "effects": themed(effect_figure(evidence)) if any(map(np.any, evidence.effects.values())) else "",
            "passes": themed(
                passes_figure(
                    [item.ablation.name for item in earned],
                    {"operations, in additions": {drive.name: [item.weight for item in earned]}},
                )
            )
            if earned
            else "",
            "modes": themed((chapter.folder / "supervisor.svg").read_text(encoding="utf-8")),
            "runs": _run_figures(chapter),
            "sweep": themed(sweep_figure(chapter.sweep)) if chapter.sweep else "",
        },
    }


def _run_figures(chapter: Chapter) -> list[tuple[str, Markup]]:
    """One figure a scenario, all filters together."""
    names = list(dict.fromkeys(run.scenario.name for run in chapter.runs))
    chosen = {name: [run for run in chapter.runs if run.scenario.name == name] for name in names}
    numbered = chapter.drive.name == "paper_spmsm"
    return [(name, themed(run_figure(runs, numbered))) for name, runs in chosen.items()]
