"""The common parts of HTML pages: their templates' surroundings, and equations as MathML."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup
from sympy.printing.mathml import MathMLPresentationPrinter

from codegen.render.equations import Readable


def page_template(path: Path) -> jinja2.Template:
    """A page's template, which may include those that lie beside this module."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader((path.parent, Path(__file__).parent)),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    return environment.get_template(path.name)


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
