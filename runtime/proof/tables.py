"""Rich tables of a proof, arranged by equation number."""

from __future__ import annotations

import re
from collections.abc import Iterable

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from runtime.proof.result import Link, Proof

#: Rows that count instead of measuring: any but zero is a failure.
COUNTS = ("same number of iterates", "same number of passes", "theta in [-pi, pi)")

AT_SPEED = "float32 against float64"
ON_CHIP = "the chip's arithmetic as modelled (not measured) against float32, running free"


def equation_order(equation: str) -> tuple[int, str]:
    """Sort key: by the first number in '13', '25, 34', 'dh/dx'.

    Parameters
    ----------
    equation : str
        Number of the paper's equation.
    """
    number = re.search(r"\d+", equation)
    return (int(number.group()) if number else 0, equation)


def stages_by_equation(links: Iterable[Link], name: str = "A-B") -> dict[tuple[str, str], dict[str, float]]:
    """Links of a name as (equation, stage) -> variant -> worst; iterates of one stage are taken together.

    Parameters
    ----------
    links : iterable of Link
        Links of a proof.
    name : str, optional
        The name.
    """
    table: dict[tuple[str, str], dict[str, float]] = {}
    for link in links:
        if link.name != name:
            continue
        for row in link.rows:
            stage = re.sub(r", j = \d+( \(idle\))?", lambda m: ", further iterates" if m.group(1) else "", row.stage)
            cell = table.setdefault((row.equation, stage), {})
            cell[link.variant] = max(cell.get(link.variant, 0.0), row.worst)
    return dict(sorted(table.items(), key=lambda item: (equation_order(item[0][0]), item[0][1])))


def proof_tables(proof: Proof) -> RenderableType:
    """Everything a proof says, as one renderable.

    Parameters
    ----------
    proof : Proof
        All links of a drive.
    """
    tables = [
        _unchecked(proof) if proof.unchecked else _derivation(proof),
        *(_stages(proof, name) for name in TITLES),
        _whole(proof),
        _bits(proof),
        _drift(proof, "C-D", AT_SPEED),
        _drift(proof, "D-chip", ON_CHIP),
    ]
    if proof.effects:
        tables.append(_effects(proof))
    parts: list[RenderableType] = []
    for table in tables:
        parts += [Text(str(table.caption), style="bold"), table, ""]
        table.caption = None
    parts += [Text(note, style="dim") for note in dict.fromkeys(proof.notes)]
    return Group(*parts)


def _mark(passed: bool) -> Text:
    return Text("ok", style="green") if passed else Text("FAILED", style="bold red")


def _table(title: str, *columns: str) -> Table:
    # The title travels as caption and is printed above: Rich would fold it to the table's width.
    table = Table(caption=title, header_style="", show_edge=False, pad_edge=False)
    for k, column in enumerate(columns):
        table.add_column(column, justify="left" if k == 0 else "right", no_wrap=k == 0)
    return table


def _derivation(proof: Proof) -> Table:
    links = [link for link in proof.links if link.name == "model"]
    if any(row.allowed for link in links for row in link.rows):
        title = (
            f"CasADi against the machine file's own reference, {links[0].data}, worst deviation on the entry's scale"
        )
        table, form = _table(f"{title} (allowed {links[0].rows[0].allowed:g})", "what", "numbers", "worst", ""), ".1e"
    else:
        title = "CasADi against SymPy's own derivation, symbolically"
        table, form = _table(title, "what", "entries", "differ", ""), ".0f"
    for link in links:
        for row in link.rows:
            table.add_row(row.stage, f"{row.compared:,}", f"{row.worst:{form}}", _mark(row.passed))
    return table


def _unchecked(proof: Proof) -> Table:
    table = _table("CasADi's f, h, F and H", "what", "")
    for what in proof.unchecked:
        claim, _, verdict = what.rpartition(", ")
        table.add_row(claim, Text(verdict, style="yellow"))
    return table


#: Links that are shown stage by stage.
TITLES = {
    "A-B": "A-B: reference against generated float64, literal form, worst deviation on the row's scale",
    "B-C": "B-C: literal against fast form, float64, worst deviation on the row's scale",
}


def _stages(proof: Proof, name: str) -> Table:
    """The table by equation number."""
    stages = stages_by_equation(proof.links, name)
    variants = list(dict.fromkeys(variant for cells in stages.values() for variant in cells))
    allowed = max(
        (row.allowed for link in proof.links if link.name == name for row in link.rows if row.allowed < 1e-6),
        default=0.0,
    )
    title = TITLES[name]
    if proof.unchecked and name == "A-B":
        title = title.replace("reference against", "reference filter, on CasADi's own f, h, H, against")
    table = _table(f"{title} (allowed {allowed:g})", "eq.", "stage")
    table.columns[1].justify = "left"
    for variant in variants:
        table.add_column(variant, justify="right")
    for (equation, stage), cells in stages.items():
        shown = [_deviation(cells.get(variant), stage, allowed) for variant in variants]
        table.add_row(equation, stage, *shown)
    return table


def _deviation(worst: float | None, stage: str, allowed: float) -> Text:
    if worst is None:
        return Text("")
    if stage in COUNTS:
        return Text("yes" if worst == 0 else f"no: {worst:g}", style="" if worst == 0 else "bold red")
    return Text(f"{worst:.1e}" if worst else "0", style="" if worst <= allowed else "bold red")


#: Links that are shown as a line each.
WHOLE = ("guard", "data", "controller", "supervisor", "modes", "text")


def whole_links(proof: Proof) -> list[tuple[Link, str]]:
    """Links of :data:`WHOLE`, each with its figure: of what is allowed, or how many differ where nothing may.

    Parameters
    ----------
    proof : Proof
        All links of a drive.
    """
    links = sorted((link for link in proof.links if link.name in WHOLE), key=lambda link: WHOLE.index(link.name))
    return [(link, _used(link)) for link in links]


def _used(link: Link) -> str:
    differ = sum(row.worst for row in link.rows if not row.allowed)
    if differ or not any(row.allowed for row in link.rows):
        return f"{differ:.0f} differ"
    return f"{100 * link.used:.2g} % of allowed"


def _whole(proof: Proof) -> Table:
    table = _table("guard, data, controller, supervisor, text", "link", "filter", "claim", "on", "numbers", "worst", "")
    for column in table.columns[1:4]:
        column.justify = "left"
    for link, used in whole_links(proof):
        table.add_row(link.name, link.variant, link.claim, link.data, f"{link.compared:,}", used, _mark(link.passed))
    return table


def _bits(proof: Proof) -> Table:
    table = _table("D-E: NumPy float32 against the generated C, bit for bit", "filter", "on", "numbers", "differ", "")
    table.columns[1].justify = "left"
    for link in proof.links:
        if link.name == "D-E":
            table.add_row(
                link.variant,
                link.data,
                f"{link.compared:,}",
                f"{sum(row.worst for row in link.rows):.0f}",
                _mark(link.passed),
            )
    return table


def _drift(proof: Proof, name: str, title: str) -> Table:
    links = [link for link in proof.links if link.name == name]
    titles = [f"{row.stage}, {row.meaning}" for row in links[0].rows] if links else []
    data = links[0].data if links else ""
    table = _table(f"{name}: {title}, {data}, worst deviation", "filter", *titles, "")
    for link in links:
        table.add_row(link.variant, *(f"{row.worst:.1e}" for row in link.rows), _mark(link.passed))
    if links:
        table.add_row("allowed", *(f"{row.allowed:.1e}" for row in links[0].rows), "", style="dim")
    return table


def _effects(proof: Proof) -> Table:
    table = _table(
        "ICKF against CKF along the trajectory (float64)",
        "gain",
        "largest difference",
        *proof.effects[0].by_state,
        "it is",
    )
    for effect in proof.effects:
        words = {"rounding": "rounding: iterating is proved idle", "real": "real"}.get(effect.verdict, "UNEXPLAINED")
        table.add_row(
            effect.gain, f"{effect.in_sigma:.2g} sigma", *(f"{v:.1e}" for v in effect.by_state.values()), words
        )
    return table
