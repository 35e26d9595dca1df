"""The report page: one HTML file that needs nothing else."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import jinja2
import sympy as sp
from markupsafe import Markup
from sympy.printing.mathml import MathMLPresentationPrinter

from codegen import __version__
from codegen.fast.ablation import OPERATIONS, weights_text
from codegen.folder import read_manifest
from codegen.render.equations import Readable, readable
from runtime.files import make_folder, write_text
from runtime.report.chapter import Chapter
from runtime.report.cost_figures import passes_figure
from runtime.report.drive_figures import run_figure, sweep_figure
from runtime.report.drive_tables import claims, sweep_cell
from runtime.report.figures import drift_figure, effect_figure, stage_figure, trajectory_figure
from runtime.report.firmware_table import remarks
from runtime.report.tables import COUNTS, stages_by_equation, whole_links

#: Templates of the pages.
ENVIRONMENT = jinja2.Environment(
    loader=jinja2.FileSystemLoader(Path(__file__).parent),
    autoescape=True,
    trim_blocks=True,
    lstrip_blocks=True,
    undefined=jinja2.StrictUndefined,
)


def write_page(path: Path, chapters: list[Chapter]) -> None:
    """Write the page for some drives, one chapter each."""
    make_folder(path.parent)
    text = ENVIRONMENT.get_template("page.html.j2").render(
        version=__version__,
        chapters=[_chapter(chapter) for chapter in chapters],
        passed=all(chapter.proof.passed and not chapter.firmware.failed for chapter in chapters),
        missing=any(chapter.firmware.missing for chapter in chapters),
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
        "H": [
            equation_line(equations, sp.Symbol(f"H_{i + 1}{j + 1}"), equations.H[i, j])
            for i in range(equations.H.rows)
            for j in range(equations.H.cols)
        ],
        "constants": equations.constants,
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
        "checks": chapter.firmware.checks,
        "remarks": remarks(chapter.firmware.checks),
        "figures": {
            "trajectory": Markup(trajectory_figure(evidence)),
            "stages": Markup(stage_figure(proof)),
            "drift": Markup(drift_figure(evidence, drive.model.sample_time, units)),
            "effects": Markup(effect_figure(evidence)) if evidence.effects else "",
            "passes": Markup(
                passes_figure(
                    [item.rung.name for item in earned],
                    {"operations, in additions": {drive.name: [item.weight for item in earned]}},
                )
            ),
            "runs": _run_figures(chapter),
            "sweep": Markup(sweep_figure(chapter.sweep)) if chapter.sweep else "",
        },
    }


def _run_figures(chapter: Chapter) -> list[tuple[str, Markup]]:
    """One figure a scenario, all filters together."""
    names = list(dict.fromkeys(run.scenario.name for run in chapter.runs))
    chosen = {name: [run for run in chapter.runs if run.scenario.name == name] for name in names}
    numbered = chapter.drive.name == "paper_spmsm"
    return [(name, Markup(run_figure(runs, numbered))) for name, runs in chosen.items()]


class _MathML(MathMLPresentationPrinter):  # type: ignore[misc]
    """SymPy's MathML with this project's names: constants as in the code, states in the field's letters."""

    def __init__(self, names: dict[Any, str]) -> None:
        super().__init__()
        self._names = names

    def _print_Symbol(self, symbol: Any, style: str = "plain") -> Any:
        name = self._names.get(symbol)
        if name is None or not name.isupper():
            stem, _, index = (name or symbol.name).partition("_")
            return self._indexed(stem, index) if index else super()._print_Symbol(symbol)
        text = self.dom.createElement("mtext")
        text.appendChild(self.dom.createTextNode(f"\u2009{name}\u2009"))
        return text

    def _indexed(self, stem: str, index: str) -> Any:
        """stem with an index, and a prime if the index ends with one."""
        primed = index.endswith("'")
        element = self.dom.createElement("msubsup" if primed else "msub")
        for tag, content in (
            ("mi", _letter(stem)),
            ("mi", _letters(index.rstrip("'"))),
            *([("mo", "′")] if primed else []),
        ):
            child = self.dom.createElement(tag)
            child.appendChild(self.dom.createTextNode(content))
            element.appendChild(child)
        return element


_GREEK = {"alpha": "α", "beta": "β", "psi": "ψ", "omega": "ω", "theta": "θ"}


def _letter(word: str) -> str:
    return _GREEK.get(word, word)


def _letters(index: str) -> str:
    """alpha_next -> α next."""
    return " ".join(_letter(word) for word in index.split("_"))


def equation_line(equations: Readable, left: Any, right: Any) -> Markup:
    """One equation as MathML."""
    printer = _MathML({symbol: _plain(latex) for symbol, latex in equations.symbols.items()})
    parts = [printer.doprint(side) for side in (left, right)]
    return Markup(f"<div><math><mrow>{parts[0]}<mo>=</mo>{parts[1]}</mrow></math></div>")


def _plain(latex: str) -> str:
    """A symbol's LaTeX as plain text with an underscore before its index."""
    text = re.sub(r"\\mathtt\{(.*)\}", r"\1", latex).replace(r"\_", "_").replace("\\", "")
    for word, letter in _GREEK.items():
        text = re.sub(rf"\b{word}\b|(?<=_){word}", letter, text)
    return text
