"""A study on one page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from runtime.study.run import Study
from runtime.study.tables import groups_table, paired_table
from runtime.style.pages import table_markup, write_page
from runtime.style.svg import themed


def write_study(study: Study, figures: Sequence[Path]) -> Path:
    """Write index.html into the study's folder; its path.

    Parameters
    ----------
    study : Study
        With runs.
    figures : sequence of Path
        As :func:`runtime.study.figures.write_figures` wrote them.
    """
    drawn = [themed(path.read_text(encoding="utf-8")) for path in figures]
    parts = [("How often, and how well", [table_markup(groups_table(study))])]
    paired = paired_table(study)
    if paired is not None:
        parts.append(("Filters on the same runs", [table_markup(paired)]))
    parts += [(path.stem.replace("_", " "), [picture]) for path, picture in zip(figures, drawn, strict=True)]
    names = ", ".join(dict.fromkeys(group.drive for group in study.groups))
    page = study.folder / "index.html"
    write_page(page, f"Runs drawn at random: {names}", "study", parts)
    return page
