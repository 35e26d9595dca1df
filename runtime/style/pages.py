"""The frame of all HTML pages, tables and equations (MathML) for them."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup
from rich.text import Text
from sympy.printing.mathml import MathMLPresentationPrinter

from codegen.output.version import __version__
from codegen.render.equations import Readable
from runtime.style.svg import with_shared_styles
from runtime.system.files import make_folder, write_text


class Page:
    """A page in the project's frame: head, style for light, dark and print, contents, and each style of figures once.

    Parameters
    ----------
    path : Path
        Its template, which extends ``frame.html.j2`` and may include what lies beside this module.
    """

    def __init__(self, path: Path) -> None:
        environment = jinja2.Environment(
            loader=jinja2.FileSystemLoader((path.parent, Path(__file__).parent)),
            autoescape=True,
            trim_blocks=True,
            lstrip_blocks=True,
            undefined=jinja2.StrictUndefined,
        )
        self._template = environment.get_template(path.name)

    def render(self, **keys: Any) -> str:
        """The page's text.

        Parameters
        ----------
        **keys : object
            What the template asks for, the version of this project aside.
        """
        return with_shared_styles(with_contents(self._template.render(version=__version__, **keys)))


def page_template(path: Path) -> Page:
    """A page's template."""
    return Page(path)


def with_contents(page: str) -> str:
    """A page whose chapters have names to link to, and a table of contents where the frame leaves room for it.

    A chapter that has sections is ``long``: on paper it begins a page, others follow one another.

    Parameters
    ----------
    page : str
        HTML with chapters ``<h2>`` and sections ``<h3>``; those that have an id keep it.
    """
    entries: list[tuple[str, str, str]] = []
    names: set[str] = set(re.findall(r'<h[23] id="([^"]*)"', page))

    def named(found: re.Match[str]) -> str:
        level, own, text = found.groups()
        name = own
        if not own:
            chapter = next((entry[1] for entry in reversed(entries) if entry[0] == "2" and level == "3"), "")
            stem = f"{chapter}-{_slug(text)}" if chapter else _slug(text)
            name = next(
                n for n in itertools.chain([stem], map(f"{stem}-{{}}".format, itertools.count(2))) if n not in names
            )
        names.add(name)
        entries.append((level, name, re.sub("<[^>]*>", "", text)))
        return f'<h{level} id="{name}">{text}</h{level}>'

    text = re.sub(r'<h([23])(?: id="([^"]*)")?>(.*?)</h\1>', named, page)
    for before, after in itertools.pairwise(entries):
        if (before[0], after[0]) == ("2", "3"):
            text = text.replace(f'<h2 id="{before[1]}">', f'<h2 id="{before[1]}" class="long">', 1)
    return text.replace("<!-- contents -->", _contents(entries), 1)


def _slug(text: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", re.sub("<[^>]*>|&[^;]*;", "", text).lower()).strip("-")


def _contents(entries: Sequence[tuple[str, str, str]]) -> str:
    """A paragraph a chapter, its sections behind it."""
    parts: list[list[str]] = []
    for level, name, text in entries:
        link = f'<a href="#{name}">{text if level == "2" else text.partition(":")[0]}</a>'
        if level == "2" or not parts:
            parts.append([f"<b>{link}</b>"])
        else:
            parts[-1].append(link)
    paragraphs = "".join(f"<p>{first}{' · '.join(rest)}</p>\n" for first, *rest in parts)
    return f'<nav class="contents" aria-label="Contents">\n{paragraphs}</nav>' if len(entries) > 1 else ""


def table_markup(table: Any) -> Markup:
    """A table of the terminal as HTML, with what stands below it.

    Parameters
    ----------
    table : rich.table.Table
    """
    sides = ["" if column.justify == "right" else Markup(' class="text"') for column in table.columns]
    parts = [Markup('<div class="scroll"><table>')]
    if table.show_header:
        heads = _row("th", sides, [column.header for column in table.columns])
        parts.append(Markup("<thead>{}</thead>").format(heads))
    parts += [_row("td", sides, row) for row in zip(*(column.cells for column in table.columns), strict=True)]
    parts.append(Markup("</table></div>"))
    if table.caption:
        parts.append(Markup('<p class="dim">{}</p>').format(_plain_text(table.caption)))
    return Markup("").join(parts)


def _row(tag: str, sides: Sequence[Any], cells: Sequence[Any]) -> Markup:
    made = (
        Markup("<{0}{1}>{2}</{0}>").format(tag, side, _plain_text(cell))
        for side, cell in zip(sides, cells, strict=True)
    )
    return Markup("<tr>{}</tr>\n").format(Markup("").join(made))


def _plain_text(cell: Any) -> str:
    """A cell's words without the terminal's marks."""
    return Text.from_markup(cell).plain if isinstance(cell, str) else str(cell)


def write_page(path: Path, title: str, command: str, parts: Iterable[tuple[str, Iterable[Markup | str]]]) -> None:
    """Write a page of some parts: heading, and below it paragraphs, tables and figures.

    Parameters
    ----------
    path : Path
        Its folder is made if it is missing.
    title, command : str
    parts : iterable of (str, iterable of Markup or str)
        What is no Markup becomes a paragraph.
    """
    made = [
        (head, [b if isinstance(b, Markup) else Markup("<p>{}</p>").format(b) for b in body]) for head, body in parts
    ]
    make_folder(path.parent)
    write_text(path, Page(Path(__file__).with_name("parts.html.j2")).render(title=title, command=command, parts=made))


class _MathML(MathMLPresentationPrinter):  # type: ignore[misc]
    """SymPy's MathML with this project's names: constants as in the code, states in the field's letters."""

    def __init__(self, equations: Readable) -> None:
        super().__init__()
        self._names = {symbol: _plain(latex) for symbol, latex in equations.symbols.items()}
        self._constants = {symbol for symbol, latex in equations.symbols.items() if latex.startswith(r"\mathtt")}

    def _print_Symbol(self, symbol: Any, style: str = "plain") -> Any:
        name = self._names.get(symbol)
        if symbol not in self._constants:
            stem, _, index = (name or symbol.name).partition("_")
            if index:
                return self._indexed(stem, index)
            letter = self.dom.createElement("mi")
            letter.appendChild(self.dom.createTextNode(_letter(stem).replace("'", "′")))
            return letter
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


def matrix_markup(equations: Readable, left: Any, matrix: Any) -> Markup:
    """A matrix, all its entries, as MathML."""
    printer = _MathML(equations)
    rows = "".join(
        f"<mtr>{''.join(f'<mtd>{printer.doprint(matrix[i, j])}</mtd>' for j in range(matrix.cols))}</mtr>"
        for i in range(matrix.rows)
    )
    body = f"<mrow><mo>[</mo><mtable>{rows}</mtable><mo>]</mo></mrow>"
    return Markup(f"<div><math><mrow>{printer.doprint(left)}<mo>=</mo>{body}</mrow></math></div>")


def symbol_markup(equations: Readable, symbol: Any) -> Markup:
    """One letter as MathML."""
    return Markup(f"<math>{_MathML(equations).doprint(symbol)}</math>")


def equation_line(equations: Readable, left: Any, right: Any) -> Markup:
    """One equation as MathML."""
    printer = _MathML(equations)
    parts = [printer.doprint(side) for side in (left, right)]
    return Markup(f"<div><math><mrow>{parts[0]}<mo>=</mo>{parts[1]}</mrow></math></div>")


def _plain(latex: str) -> str:
    """A symbol's LaTeX as plain text with an underscore before its index."""
    text = re.sub(r"\\mathtt\{(.*)\}", r"\1", latex).replace(r"\_", "_").replace("\\", "")
    for word, letter in _GREEK.items():
        text = re.sub(rf"\b{word}\b|(?<=_){word}", letter, text)
    return text
