"""What was identified, on one page."""

from __future__ import annotations

from pathlib import Path

from runtime.identify.identify import Identified
from runtime.identify.redesign import Compared
from runtime.identify.tables import INTERRUPTED, estimates_table, filters_table, notes_words, steps_words, summary
from runtime.style.pages import table_markup, write_page
from runtime.style.svg import themed

#: What a figure shows and how it is read, above it.
INNOVATIONS = (
    "Measured current less what the filter expected, in its standard deviations. With data that fit, 95 % of the curve "
    "lies in the grey band."
)
LIKELIHOOD = (
    "How well each value of a datum explains the recordings, the others moved along; the top is what was found. "
    "A narrow curve is a datum that the recordings show well. A guess beyond the axis is not drawn."
)


def write_identified(found: Identified, compared: Compared | None, folder: Path) -> Path:
    """Write index.html beside the figures of that folder; its path.

    Parameters
    ----------
    found : Identified
    compared : Compared, optional
        The filter before and after; None where the search was interrupted.
    folder : Path
        Where :func:`runtime.identify.figures.write_figures` wrote.
    """

    def figure(name: str) -> str:
        return themed((folder / name).read_text(encoding="utf-8"))

    said = [*notes_words(found), *steps_words(found), *found.result.words]
    end = [INTERRUPTED] if found.found.interrupted else []
    parts = [
        ("Motor data", [*end, table_markup(estimates_table(found)), summary(found), *said]),
        ("Innovations", [INNOVATIONS, figure("innovations.svg")]),
        ("Likelihood", [LIKELIHOOD, figure("likelihood.svg")]),
    ]
    if compared is not None:
        parts.insert(1, ("The filter before and after", [table_markup(filters_table(compared))]))
    page = folder / "index.html"
    write_page(page, f"Motor data of {found.problem.subject.name}", "identify", parts)
    return page
