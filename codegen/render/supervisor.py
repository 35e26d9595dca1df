"""The supervisor's files: the machine for the chip, and the drive around filter, controller and machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from codegen.ir.covariance import CovarianceLayout, place, state_place
from codegen.ir.layout import Listing, lay_out
from codegen.ir.trig import INSIDE, SINGLE, wrap_listing
from codegen.render.diagram import render_diagram
from codegen.render.fill import render
from codegen.render.filter import ANGLE, Description, named_constants, tuning, with_sections
from codegen.render.printers.c import CPrinter
from codegen.render.printers.modes import ModesC, ModesPython
from codegen.render.printers.python import PythonPrinter
from codegen.render.transitions import stay_texts
from codegen.render.trig import sin_cos_text, trig_note
from model.alignment import aligns
from model.filters import FilterStep
from model.filters.program import Restart
from model.inverter import OF_LEGS, TRANSFORM, takes_voltage
from model.loop.controller import Gains, align_block, clarke_block
from model.loop.injection import injected_voltage, injection_block, injection_constants
from model.loop.link_limits import limit_block, limit_constants
from model.loop.observability import angle_block, least_speed, most_variance
from model.loop.resistance import learning_block, learning_constants
from model.quantities import Constants
from model.supervisor import Supervisor, supervisor
from model.supervisor.blocks import constants
from model.supervisor.limits import start_share


def machine_of(about: Description, step: FilterStep) -> Supervisor:
    """The drive's machine.

    Parameters
    ----------
    about : Description
    step : FilterStep
        The filter's: the literal form does not tell how well it expects the currents.
    """
    guarded = step.has(Restart)
    return about.once(f"machine {guarded}", lambda: supervisor(about.drive, about.model, guarded))


def draw_supervisor(about: Description, steps: Mapping[str, FilterStep]) -> str:
    """The picture of the drive's machine, as SVG.

    Parameters
    ----------
    about : Description
    steps : mapping of str to FilterStep
        By filter kind; they have one machine.
    """
    machine = machine_of(about, next(iter(steps.values())))
    return render_diagram(machine, about.drive.name, stay_texts(machine, about.drive.model.sample_time))


def drive_listings(about: Description, layout: CovarianceLayout) -> list[Listing]:
    """What the DC link allows, how well the angle is known; where the rotor is not round what is added to the voltages.

    Parameters
    ----------
    about : Description
    layout : CovarianceLayout
        Where the filter has its covariance.
    """
    allowed = [lay_out(limit_block(about.drive), limit_constants(about.drive)), _angle_listing(layout)]
    if aligns(about.drive):
        constants = Constants(named=True)
        block = align_block(about.drive, constants)
        transform = OF_LEGS if takes_voltage(about.drive) else TRANSFORM
        allowed.append(lay_out(block, [*constants.items.values(), *transform]))
    if not injected_voltage(about.drive):
        return allowed
    learning = lay_out(
        learning_block(about.drive, about.model), (*about.model.constants, *learning_constants(about.drive))
    )
    return [*allowed, learning, lay_out(injection_block(about.drive), injection_constants(about.drive))]


def _angle_listing(layout: CovarianceLayout) -> Listing:
    """The variance of the angle: of P an entry, of L D L^T the squares of a row."""
    factored, angle = layout.field == "LD", layout.row(ANGLE)
    row = [place(angle, k) for k in range(angle)] if factored else []
    pivots = [*(place(k, k) for k in range(len(row))), layout.variance(ANGLE)]
    words = [
        f"P_{i}{j}" if not factored else f"D_{i}" if i == j else f"L_{i}{j}"
        for i in range(len(layout.states))
        for j in range(i + 1)
    ]
    return lay_out(angle_block(words, row, pivots), ())


def supervisor_listings(about: Description, machine: Supervisor) -> list[Listing]:
    """The blocks of the machine, laid out.

    Parameters
    ----------
    about : Description
    machine : Supervisor
    """
    return [lay_out(block, constants(about.drive)) for block in machine.blocks]


def filter_fields(about: Description, step: FilterStep) -> list[str]:
    """The fields of a filter in the Python module: tuning, estimate, and what the last step did.

    Parameters
    ----------
    about : Description
    step : FilterStep
        The filter's.
    """
    guarded = step.has(Restart)
    monitored = ["nis", "repairs"] if guarded else []
    return [*tuning(about, guarded), "x", step.covariance, "u_held", "iterations", *monitored]


def limit_texts(machine: Supervisor, printer: CPrinter | PythonPrinter) -> list[dict[str, str]]:
    """The machine's limits as they are spelled.

    Parameters
    ----------
    machine : Supervisor
    printer : CPrinter or PythonPrinter
        Of the language.
    """
    return [
        {
            "name": limit.name,
            "text": str(limit.value) if isinstance(limit.value, int) else printer.format_literal(limit.value),
            "meaning": limit.meaning,
        }
        for limit in machine.limits
    ]


def module_context(about: Description, step: FilterStep) -> dict[str, Any]:
    """Template context of the machine in the Python module.

    Parameters
    ----------
    about : Description
    step : FilterStep
        Any of the module's: where the covariance lives is the same for all.
    """
    machine = machine_of(about, step)
    layout = CovarianceLayout.of(step)
    printer = ModesPython(machine, layout)
    listings, around = supervisor_listings(about, machine), drive_listings(about, layout)
    return {
        "machine": machine,
        "injected": [repr(value) for value in _amplitudes(about)],
        "around": [printer.format_block(listing) for listing in around],
        "drive_listings": around,
        **seen_context(about, printer),
        "rivals": machine.rivals,
        "asked": "asked" if machine.rivals else "command",
        "aligns": machine.aligns,
        "filter_fields": filter_fields(about, step),
        "start_share": printer.format_literal(start_share(about.drive)),
        "limits": limit_texts(machine, printer),
        "supervisor_listings": listings,
        "supervisor_blocks": [printer.format_block(listing) for listing in listings],
        "actions": [printer.format_action(action) for action in machine.actions],
        "watch": printer.format_watch(),
        "table": "\n".join(printer.format_table()),
        "told": "\n".join(printer.format_told()),
    }


def render_supervisor(about: Description, step: FilterStep, notes: Sequence[str]) -> dict[str, str]:
    """Header and source of supervisor and drive around one filter, by the ends of their names.

    Parameters
    ----------
    about : Description
    step : FilterStep
        The filter's.
    notes : sequence of str
        Lines of the drive's head: what a whole interrupt costs.
    """
    machine, prefix = machine_of(about, step), f"{about.drive.name}_{step.kind}"
    printer = ModesC(machine, CovarianceLayout.of(step), prefix, about.target.numbers)
    common = {
        "p": prefix,
        "drive": about.drive.name,
        "sha": about.drive.sha256,
        "sample_time": about.sample_time,
        "injected": [printer.format_literal(value) for value in _amplitudes(about)],
        "machine": machine,
        "rivals": machine.rivals,
        "aligns": machine.aligns,
        "start_share": printer.format_literal(start_share(about.drive)),
        "sin_cos": sin_cos_text(printer),
        "trig_note": trig_note(printer.numbers),
        "round": printer.format_literal(SINGLE.rounding),
        "below_pi": printer.format_literal(SINGLE.below_pi),
        "inside": printer.format_literal(INSIDE),
        "wrap_angle": printer.format_helper(wrap_listing(SINGLE)),
    }
    source = render("supervisor.c.j2", **common, **_machine_text(about, printer))
    drive = render("drive.c.j2", **common, notes=notes, **_drive_text(about, printer, CovarianceLayout.of(step)))
    return {
        "supervisor.h": render("supervisor.h.j2", **common),
        "supervisor.c": with_sections(
            about.target.sections, source, cold={f"{prefix}_supervisor_init", f"{prefix}_supervisor_refuse"}
        ),
        "drive.h": render("drive.h.j2", **common),
        "drive.c": with_sections(about.target.sections, drive, cold={f"{prefix}_drive_init"}),
    }


def _amplitudes(about: Description) -> list[float]:
    """The square wave's amplitude without and with a sample of delay, V; none for a round rotor."""
    found = [injected_voltage(about.drive, delay) for delay in (0, 1)]
    return found if all(found) else []


def seen_context(about: Description, printer: CPrinter | PythonPrinter) -> dict[str, str]:
    """From where on the angle is seen; of a salient machine at any speed.

    Parameters
    ----------
    about : Description
    printer : CPrinter or PythonPrinter
        Of the language.
    """
    slowest = least_speed(about.drive)
    return {
        "most_variance": printer.format_literal(most_variance()),
        "least_speed_squared": printer.format_literal(slowest**2) if slowest else "",
    }


def _constants(about: Description, listings: list[Listing], printer: ModesC) -> list[tuple[str, str, str]]:
    named = named_constants(about, listings)
    return [(name, printer.format_literal(value), formula) for name, value, formula in named]


def _machine_text(about: Description, printer: ModesC) -> dict[str, Any]:
    """What the supervisor's source says of its machine."""
    machine, listings = printer.machine, supervisor_listings(about, printer.machine)
    return {
        "limits": limit_texts(machine, printer),
        "constants": _constants(about, listings, printer),
        "pair": any(listing.operations()["sincos"] for listing in listings),
        "blocks": [printer.format_block(listing) for listing in listings],
        "actions": [printer.format_action(action) for action in machine.actions],
        "watch": printer.format_watch(),
        "table": "\n".join(printer.format_table()),
        "told": "\n".join(printer.format_told()),
    }


def _drive_text(about: Description, printer: ModesC, layout: CovarianceLayout) -> dict[str, Any]:
    """What the drive's source says of controller, rival, DC link, angle and square wave."""
    machine = printer.machine
    clarke, around = lay_out(clarke_block(), TRANSFORM), drive_listings(about, layout)
    return {
        "max_current": Gains.names().index("max_current"),
        "clarke": printer.format_block(clarke),
        "constants": _constants(about, [*([clarke] if machine.rivals or machine.aligns else []), *around], printer),
        "around": [printer.format_block(listing) for listing in around],
        "covariance": layout.field,
        "asked": "asked" if printer.machine.rivals else "command",
        **seen_context(about, printer),
        "omega": state_place(printer.prefix, "omega"),
        "theta": state_place(printer.prefix, ANGLE),
    }
