"""Templates around the filter filled in: the whole controller for the chip, the plant for the host."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from codegen.layout import Listing, lay_out
from codegen.printers.c import CPrinter
from codegen.printers.python import PythonPrinter
from codegen.render import Description, render, sin_cos_text, trig_note, with_ramfuncs
from codegen.targets import F28335, HOST64
from model.controller import (
    SENSED_MAX,
    Gains,
    believed_block,
    clarke_block,
    command_limits,
    control_block,
    design,
    first_command,
)
from model.plant import STATES, outputs_block, plant_block
from model.quantities import Constant, Constants


def control_listing(about: Description) -> tuple[Listing, list[Constant]]:
    """The controller's block, laid out, and its named constants."""
    constants = Constants(named=True)
    block = control_block(about.drive, constants)
    found = list(constants.items.values())
    return lay_out(block, found), found


def believed_listing(about: Description) -> Listing:
    """The currents at the filter's state, laid out."""
    return lay_out(believed_block(about.model), about.model.constants)


def controller_context(about: Description, printer: CPrinter | PythonPrinter) -> dict[str, Any]:
    """What both languages say about the controller."""
    listing, constants = control_listing(about)
    return {
        "clarke": printer.format_block(lay_out(clarke_block(), [])),
        "believed": printer.format_block(believed_listing(about)),
        "control_text": printer.format_block(listing),
        "control_constants": [*constants, *about.model.constants],
        "command_max": [printer.format_literal(value) for value in command_limits(about.drive)],
        "command_first": [printer.format_literal(value) for value in first_command(about.drive)],
        "sensed_max": printer.format_literal(SENSED_MAX),
        "gains": tuple(Gains.names()),
        "gain_values": [printer.format_literal(value) for value in design(about.drive).values],
        "advance_delayed": printer.format_literal(design(about.drive, delay=1).advance),
    }


def render_foc(about: Description, kind: str, notes: Sequence[str]) -> tuple[str, str]:
    """Header and source of the controller around one filter, float32 for the chip."""
    printer = CPrinter(F28335)
    context = controller_context(about, printer)
    listing, constants = control_listing(about)
    listings = (listing, believed_listing(about))
    used = {part.graph[node].name for part in listings for node in part.live if part.graph[node].op == "const"}
    every = {c.name: c for c in (*constants, *about.model.constants)}
    common = {
        "p": f"{about.drive.name}_{kind}",
        "drive": about.drive.name,
        "sha": about.drive.sha256,
        "sample_time": about.sample_time,
        "gains": context["gains"],
    }
    header = render("foc.h.j2", **common)
    source = render(
        "foc.c.j2",
        **{**context, **common},
        control=about.drive.control,
        notes=notes,
        constants=[
            {"name": c.name, "text": printer.format_literal(c.value), "formula": c.formula}
            for c in every.values()
            if c.name in used
        ],
        round=printer.format_literal(F28335.precision.rounding),
        trig_note=trig_note(F28335),
        sin_cos=sin_cos_text(printer),
    )
    return header, with_ramfuncs(source, cold={f"{common['p']}_foc_init"})


#: The example turns the inverter off after 2 ms without a usable input, and sends numbers 50 times a second.
BLIND_TIME, TELEMETRY_RATE = 2e-3, 50.0


def default_kind(kinds: Iterable[str]) -> str:
    """The filter that is meant where none is named: ickf where there is one."""
    kinds = list(kinds)
    return "ickf" if "ickf" in kinds else kinds[0]


def render_example(about: Description, kind: str) -> str:
    """The example interrupt around one filter."""
    T = about.drive.model.sample_time
    source = render(
        "example_isr.c.j2",
        p=f"{about.drive.name}_{kind}",
        drive=about.drive.name,
        sha=about.drive.sha256,
        sample_time_us=f"{T * 1e6:g}",
        pole_pairs=CPrinter(F28335).format_literal(float(about.drive.motor.pole_pairs)),
        max_rejected=max(1, round(BLIND_TIME / T)),
        telemetry_every=max(1, round(1 / (TELEMETRY_RATE * T))),
    )
    return with_ramfuncs(source, cold={"motor_setup"})


def render_plant(about: Description) -> tuple[str, str]:
    """Header and source of the motor for simulation, float64."""
    printer = CPrinter(HOST64)
    common = {"drive": about.drive.name, "sha": about.drive.sha256, "n": len(STATES)}
    header = render("plant.h.j2", **common, states=", ".join(STATES))
    source = render(
        "plant.c.j2",
        **common,
        substep=printer.format_block(lay_out(plant_block(about.drive), [])),
        outputs=printer.format_block(lay_out(outputs_block(about.drive), [])),
    )
    return header, source
