"""A study on one page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from markupsafe import Markup

from runtime.study.run import Study
from runtime.study.tables import groups_table, paired_table
from runtime.style.pages import table_markup, write_page
from runtime.style.svg import themed

#: What a figure shows and how it is read, by the end of its name.
WORDS = {
    "errors": (
        "errors",
        "How each figure is distributed over the runs that locked: the wider, the more of them; ticks at 5, 50 and "
        "95 %. The axes are logarithmic, but for the lock time.",
    ),
    "success_over_theta": (
        "success over the angle at the start",
        "Share of the runs that locked. The band is its 95 % interval: a wide one has few runs.",
    ),
    "map": (
        "success and error over two variables",
        "The two variables over which success differs most from cell to cell, or the error where success does not; "
        "all others are drawn at random in every cell. A cell without colour has no run, on the right none that "
        "locked.",
    ),
}


def write_study(study: Study, figures: Sequence[Path]) -> Path:
    """Write index.html into the study's folder; its path.

    Parameters
    ----------
    study : Study
        With runs.
    figures : sequence of Path
        As :func:`runtime.study.figures.write_figures` wrote them.
    """
    parts: list[tuple[str, list[Markup | str]]] = [("How often, and how well", [table_markup(groups_table(study))])]
    paired = paired_table(study)
    if paired is not None:
        parts.append(("Filters on the same runs", [table_markup(paired)]))
    for path in figures:
        end = next(end for end in WORDS if path.stem.endswith(f"_{end}"))
        title, words = WORDS[end]
        drive = path.stem.removesuffix(f"_{end}")
        parts.append((f"{drive}: {title}", [words, themed(path.read_text(encoding="utf-8"))]))
    names = ", ".join(dict.fromkeys(group.drive for group in study.groups))
    page = study.folder / "index.html"
    write_page(page, f"Runs drawn at random: {names}", "study", parts)
    return page
