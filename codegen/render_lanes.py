"""The lane form of a filter for the host: many filters side by side, each with the bits of the scalar form."""

from __future__ import annotations

from codegen.layout import Listing
from codegen.printers.lanes import LanesPrinter, lane_arrays
from codegen.render import (
    COVARIANCE_COMMENTS,
    Description,
    filter_constants,
    has_loop,
    render,
    sin_cos_text,
    trig_note,
    turn_context,
)
from codegen.targets import F28335
from codegen.trig import wrap_listing
from model.filters import FilterStep

#: Filters in one struct: two vectors of 256 bits, one of 512.
LANES = 16


def render_lanes(about: Description, step: FilterStep, listings: dict[str, Listing]) -> tuple[str, str]:
    """Header and source; float32 alone, because float64 calls the platform's sine and cosine."""
    target = F28335
    model = about.model
    printer = LanesPrinter(target, len(model.states))
    operations = [listings[block.name].operations() for block in step.blocks]
    turns = any(count["small_angle"] for count in operations)
    scalar = f"{about.drive.name}_{step.kind}"
    common = {
        "p": f"{scalar}_lanes",
        "scalar": scalar,
        "title": about.title(step.kind),
        "drive": about.drive.name,
        "sha": about.drive.sha256,
        "real": target.real,
        "lanes": LANES,
        "n": len(model.states),
        "packed": len(model.states) * (len(model.states) + 1) // 2,
        "covariance": step.covariance,
    }
    header = render(
        "lanes.h.j2",
        **common,
        covariance_comment=COVARIANCE_COMMENTS[step.covariance],
        states_comment=", ".join(f"{state.name} {state.unit}" for state in model.states),
    )
    source = render(
        "lanes.c.j2",
        **common,
        constants=filter_constants(about, step, listings, printer),
        round=printer.format_literal(target.precision.rounding),
        below_pi=printer.format_literal(target.precision.below_pi),
        pair=any(count["sincos"] for count in operations),
        trig_note=trig_note(target),
        sin_cos=_inlined(sin_cos_text(printer)),
        turns=turns,
        **(turn_context(printer) if turns else {}),
        zero=printer.format_literal(0.0),
        wrap_angle=_inlined(printer.format_helper(wrap_listing(target.precision))),
        looped=has_loop(step.body),
        blocks=[printer.format_block(listings[block.name]) for block in step.blocks],
        locals=[f"lanes {name}[{size}];" for name, size in lane_arrays(step.body).items()],
        program="\n".join(printer.format_program(step.body)),
    )
    return header, source


def _inlined(helper: str) -> str:
    return helper.replace("static ", "INLINE ", 1)
