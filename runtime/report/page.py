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
from codegen.equations import Readable, readable
from codegen.folder import read_manifest
from model.drive import Drive
from runtime.proof.result import Proof
from runtime.proof.verify import Evidence, generated_folder
from runtime.report.figures import drift_figure, effect_figure, stage_figure, trajectory_figure
from runtime.report.tables import stages_by_equation

_ENVIRONMENT = jinja2.Environment(
    loader=jinja2.FileSystemLoader(Path(__file__).parent),
    autoescape=True,
    trim_blocks=True,
    lstrip_blocks=True,
    undefined=jinja2.StrictUndefined,
)


def write_page(path: Path, chapters: list[tuple[Drive, Proof, Evidence]]) -> None:
    """Write the page for some drives, one chapter each."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = _ENVIRONMENT.get_template("page.html.j2").render(
        version=__version__,
        chapters=[_chapter(*chapter) for chapter in chapters],
        passed=all(proof.passed for _, proof, _ in chapters),
    )
    path.write_text(text, encoding="utf-8")


def _chapter(drive: Drive, proof: Proof, evidence: Evidence) -> dict[str, Any]:
    manifest = read_manifest(generated_folder(drive.name))
    units = {state["name"]: state["unit"] for state in manifest["states"]}
    equations = readable(drive)
    stages = stages_by_equation(proof.links)
    return {
        "drive": drive,
        "proof": proof,
        "manifest": manifest,
        "units": units,
        "f": [_line(equations, *line) for line in equations.f],
        "h": [_line(equations, *line) for line in equations.h],
        "H": _line(equations, sp.Symbol("H"), equations.H),
        "constants": equations.constants,
        "stages": stages,
        "variants": list(dict.fromkeys(variant for cells in stages.values() for variant in cells)),
        "failures": list(proof.failures()),
        "figures": {
            "trajectory": Markup(trajectory_figure(evidence)),
            "stages": Markup(stage_figure(proof)),
            "drift": Markup(drift_figure(evidence, drive.model.sample_time, units)),
            "effects": Markup(effect_figure(evidence)) if evidence.effects else "",
        },
    }


def _line(equations: Readable, left: Any, right: Any) -> Markup:
    """One equation as MathML."""
    printer = MathMLPresentationPrinter({"symbol_names": {s: _plain(latex) for s, latex in equations.symbols.items()}})
    parts = [printer.doprint(side) for side in (left, right)]
    return Markup(f"<math display='block'><mrow>{parts[0]}<mo>=</mo>{parts[1]}</mrow></math>")


def _plain(latex: str) -> str:
    """A symbol's LaTeX as text for a MathML identifier."""
    greek = {r"\alpha": "α", r"\beta": "β", r"\psi": "ψ", r"\omega": "ω", r"\theta": "θ"}
    text = re.sub(r"\\mathtt\{(.*)\}", r"\1", latex).replace(r"\_", "_")
    for name, letter in greek.items():
        text = text.replace(name, letter)
    return text
