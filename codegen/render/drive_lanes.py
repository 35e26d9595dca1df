"""The lane form of the whole drive, for the host: supervisor, controller and filter of many drives side by side."""

from __future__ import annotations

from typing import Any

from codegen.ir.covariance import CovarianceLayout, state_place
from codegen.ir.layout import lay_out
from codegen.ir.trig import INSIDE, SINGLE, wrap_listing
from codegen.render.fill import render
from codegen.render.filter import ANGLE, Description, named_constants, tuning
from codegen.render.lanes import LANES, inlined
from codegen.render.printers.c import INDENT
from codegen.render.printers.lanes import LanesPrinter
from codegen.render.printers.mode_lanes import ModesLanes
from codegen.render.supervisor import (
    drive_listings,
    filter_fields,
    limit_texts,
    machine_of,
    seen_context,
    supervisor_listings,
)
from codegen.render.trig import sin_cos_text, trig_note
from codegen.targets.numbers import FLOAT32
from model.filters import FilterStep
from model.filters.program import Restart
from model.inverter import TRANSFORM
from model.loop.controller import Gains, clarke_block
from model.loop.injection import injected_voltage

#: A field of a struct: its name, its length (0: one number), and whether it is an integer.
Row = tuple[str, int, bool]
#: Integers among a filter's fields.
WHOLE = ("max_iterations", "iterations", "repairs")


def render_drive_lanes(about: Description, step: FilterStep) -> tuple[str, str]:
    """Header and source of the whole drive around one filter, float32.

    Parameters
    ----------
    about : Description
    step : FilterStep
        The filter's.
    """
    p, machine, layout = f"{about.drive.name}_{step.kind}", machine_of(about, step), CovarianceLayout.of(step)
    modes, printer = ModesLanes(machine, layout, p, FLOAT32), LanesPrinter(FLOAT32, len(about.model.states))
    own, around = supervisor_listings(about, machine), drive_listings(about, layout)
    clarke = [lay_out(clarke_block(), TRANSFORM)] if machine.rivals else []
    listings, amplitude = [*own, *clarke, *around], injected_voltage(about.drive)
    common: dict[str, Any] = {
        "p": p,
        "drive": about.drive.name,
        "sha": about.drive.sha256,
        "sample_time": about.sample_time,
        "lanes": LANES,
        "machine": machine,
        "rivals": machine.rivals,
        "injected": bool(amplitude),
    }
    source = render(
        "drive_lanes.c.j2",
        **common,
        limits=limit_texts(machine, modes),
        constants=[
            {"name": name, "text": modes.format_literal(value), "formula": formula}
            for name, value, formula in named_constants(about, listings)
        ],
        asked="asked" if machine.rivals else "command",
        inside=modes.format_literal(INSIDE),
        max_current=Gains.names().index("max_current"),
        covariance=layout.field,
        omega=state_place(p, "omega"),
        theta=state_place(p, ANGLE),
        round=modes.format_literal(SINGLE.rounding),
        below_pi=modes.format_literal(SINGLE.below_pi),
        trig_note=trig_note(FLOAT32),
        sin_cos=inlined(sin_cos_text(modes)) if any(one.operations()["sincos"] for one in listings) else "",
        wrap_angle=inlined(modes.format_helper(wrap_listing(SINGLE))),
        blocks=[modes.format_block(listing) for listing in own],
        around=[printer.format_block(listing) for listing in (*clarke, *around)],
        actions=[modes.format_action(action) for action in machine.actions],
        watch=modes.format_watch(),
        guards="\n".join(modes.format_guards()),
        cases="\n".join(modes.format_cases()),
        told="\n".join(modes.format_told()),
        variances=layout.variances,
        n=len(layout.states),
        packed=layout.size,
        guarded=step.has(Restart),
        **seen_context(about, modes),
        **_copies(about, step, layout, [(f.name, f.size, f.whole) for f in machine.fields if not f.filter]),
    )
    return render("drive_lanes.h.j2", **common), source


def _copies(about: Description, step: FilterStep, layout: CovarianceLayout, supervisor: list[Row]) -> dict[str, Any]:
    """How a lane is filled from scalar structs, and read into them."""
    gains = len(tuple(Gains.names(about.drive)))
    pairs = ("command_max", "command_held", "v_acting", "v_queued", "sensed")
    control: list[Row] = [("gain", gains, False), ("integrator", 4, False), *((name, 2, False) for name in pairs)]
    control += [("sensored", 0, True), ("delay", 0, True)]
    sizes = {name: len(value) for name, value in tuning(about, step.has(Restart)).items() if isinstance(value, tuple)}
    sizes |= {"x": len(layout.states), layout.field: layout.size, "u_held": 2}
    own: list[Row] = [(name, sizes.get(name, 0), name in WHOLE) for name in filter_fields(about, step)]
    found = {}
    for name, rows in (("filter", own), ("control", control), ("supervisor", supervisor)):
        found[f"put_{name}"] = "\n".join(line for row in rows for line in _copy(row, into_lanes=True))
        found[f"get_{name}"] = "\n".join(line for row in rows for line in _copy(row, into_lanes=False))
    return found


def _copy(row: Row, into_lanes: bool) -> list[str]:
    """A field of ``own``, a scalar struct, into a lane of ``all``, or from there."""
    name, size, whole = row
    one = f"own->{name}[k]" if size else f"own->{name}"
    many = f"all->{name}[lane]" if whole else f"all->{name}[{'k' if size else 0}].of[lane]"
    text = f"{many} = {one};" if into_lanes else f"{one} = {many};"
    if not size:
        return [INDENT + text]
    return [f"{INDENT}for (k = 0; k < {size}; k++) {{", f"{INDENT * 2}{text}", f"{INDENT}}}"]
