"""The lane forms for the host: many filters, controllers or motors side by side, with the bits of the scalar forms."""

from __future__ import annotations

from codegen.ir.covariance import CovarianceLayout
from codegen.ir.layout import Listing
from codegen.ir.trig import INSIDE, wrap_listing
from codegen.render.drive import foc_context, plant_context
from codegen.render.fill import render
from codegen.render.filter import ANGLE, Description, common_spread, covariance_comment, filter_constants, turn_context
from codegen.render.printers.lanes import LanesPrinter, lane_arrays
from codegen.render.trig import sin_cos_text, trig_note
from codegen.targets.numbers import FLOAT32, FLOAT64
from model.filters import FilterStep
from model.filters.program import Repeat, Restart, Turns

#: Filters in one struct: two vectors of 256 bits, one of 512.
LANES = 16


def render_lanes(about: Description, step: FilterStep, listings: dict[str, Listing]) -> tuple[str, str]:
    """Header and source; float32 alone, because float64 calls the platform's sine and cosine."""
    numbers = FLOAT32
    model = about.model
    layout = CovarianceLayout.of(step)
    operations = [listings[block.name].operations() for block in step.blocks]
    spread = common_spread(listings[block.name] for block in step.blocks)
    scalar = f"{about.drive.name}_{step.kind}"
    printer = LanesPrinter(numbers, len(model.states), f"{scalar}_lanes_t", step.constant_time)
    program = "\n".join(printer.format_step(step))
    common = {
        "p": f"{scalar}_lanes",
        "scalar": scalar,
        "title": about.title(step.kind),
        "drive": about.drive.name,
        "sha": about.drive.sha256,
        "real": numbers.real,
        "lanes": LANES,
        "n": len(model.states),
        "packed": layout.size,
        "covariance": step.covariance,
        "guarded": step.has(Restart),
        "constant_time": step.constant_time,
        "sane_limit": printer.format_literal(about.sane_limit),
        "per_sane_limit": printer.format_literal(1.0 / about.sane_limit),
        "one": printer.format_literal(1.0),
        "most_turns": max((len(node.block.outputs[0].entries) for node in step.all_of(Turns)), default=0),
        "layout": layout,
        "angle_columns": layout.row(ANGLE) + 1,
        "angle_row": layout.row_start(ANGLE),
    }
    header = render(
        "lanes.h.j2",
        **common,
        covariance_comment=covariance_comment(step),
        states_comment=", ".join(f"{state.name} {state.unit}" for state in model.states),
    )
    source = render(
        "lanes.c.j2",
        **common,
        constants=filter_constants(about, step, listings, printer),
        round=printer.format_literal(numbers.precision.rounding),
        below_pi=printer.format_literal(numbers.precision.below_pi),
        inside=printer.format_literal(INSIDE),
        pair=any(count["sincos"] for count in operations),
        trig_note=trig_note(numbers),
        sin_cos=inlined(sin_cos_text(printer)),
        turns=spread is not None,
        skips=printer.skips,
        **(turn_context(printer, spread) if spread is not None else {}),
        zero=printer.format_literal(0.0),
        wrap_angle=inlined(printer.format_helper(wrap_listing(numbers.precision))),
        looped=step.has(Repeat),
        blocks=[printer.format_block(listings[block.name]) for block in step.blocks],
        locals=[f"lanes {name}[{size}];" for name, size in lane_arrays(step.body).items()],
        program=program,
        functions=printer.functions,
    )
    return header, source


def render_foc_lanes(about: Description, step: FilterStep) -> tuple[str, str]:
    """Header and source of the controller around one filter, float32.

    Parameters
    ----------
    about : Description
    step : FilterStep
        That filter's.
    """
    n = len(about.model.states)
    context = foc_context(about, step.kind, LanesPrinter(FLOAT32, n))
    context |= {"sin_cos": inlined(context["sin_cos"]), "wrap_angle": inlined(context["wrap_angle"]), "lanes": LANES}
    context |= {"n": n, "packed": n * (n + 1) // 2, "covariance": step.covariance, "guarded": step.has(Restart)}
    return render("foc_lanes.h.j2", **context), render("foc_lanes.c.j2", **context)


def render_plant_lanes(about: Description) -> tuple[str, str]:
    """Header and source of the motor, float64.

    Parameters
    ----------
    about : Description
    """
    context = plant_context(about, LanesPrinter(FLOAT64, len(about.model.states)))
    context |= {"sin_cos": inlined(context["sin_cos"]), "lanes": LANES}
    return render("plant_lanes.h.j2", **context), render("plant_lanes.c.j2", **context)


def inlined(helper: str) -> str:
    """A function that becomes a part of the loop that calls it.

    Parameters
    ----------
    helper : str
        Its text.
    """
    return helper.replace("static ", "INLINE ", 1)
