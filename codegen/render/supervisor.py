"""The supervisor's files: the machine for the chip, and the drive around filter, controller and machine."""

from __future__ import annotations

from typing import Any

from codegen.ir.covariance import CovarianceLayout
from codegen.ir.layout import Listing, lay_out
from codegen.ir.trig import SINGLE, wrap_listing
from codegen.render.filter import Description, named_constants, render, with_ramfuncs
from codegen.render.printers.c import CPrinter
from codegen.render.printers.modes import ModesC, ModesPython
from codegen.render.printers.python import PythonPrinter
from model.filters import FilterStep
from model.loop.controller import Gains
from model.supervisor import Supervisor, supervisor
from model.supervisor.blocks import constants


def machine_of(about: Description) -> Supervisor:
    """The drive's machine.

    Parameters
    ----------
    about : Description
    """
    return supervisor(about.drive, about.model)


def _listings(about: Description, machine: Supervisor) -> list[Listing]:
    return [lay_out(block, constants(about.drive)) for block in machine.blocks]


def _limits(machine: Supervisor, printer: CPrinter | PythonPrinter) -> list[dict[str, str]]:
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
    machine = machine_of(about)
    printer = ModesPython(machine, CovarianceLayout.of(step))
    listings = _listings(about, machine)
    return {
        "machine": machine,
        "limits": _limits(machine, printer),
        "supervisor_listings": listings,
        "supervisor_blocks": [printer.format_block(listing) for listing in listings],
        "actions": [printer.format_action(action) for action in machine.actions],
        "watch": printer.format_watch(),
        "table": "\n".join(printer.format_table()),
        "told": "\n".join(printer.format_told()),
    }


def render_supervisor(about: Description, step: FilterStep) -> dict[str, str]:
    """Header and source of supervisor and drive around one filter, by the ends of their names.

    Parameters
    ----------
    about : Description
    step : FilterStep
        The filter's.
    """
    machine, prefix = machine_of(about), f"{about.drive.name}_{step.kind}"
    printer = ModesC(machine, CovarianceLayout.of(step), prefix)
    listings = _listings(about, machine)
    common = {
        "p": prefix,
        "drive": about.drive.name,
        "sha": about.drive.sha256,
        "sample_time": about.sample_time,
        "machine": machine,
    }
    source = render(
        "supervisor.c.j2",
        **common,
        limits=_limits(machine, printer),
        constants=[
            {"name": name, "text": printer.format_literal(value), "formula": formula}
            for name, value, formula in named_constants(about, listings)
        ],
        round=printer.format_literal(SINGLE.rounding),
        below_pi=printer.format_literal(SINGLE.below_pi),
        wrap_angle=printer.format_helper(wrap_listing(SINGLE)),
        blocks=[printer.format_block(listing) for listing in listings],
        actions=[printer.format_action(action) for action in machine.actions],
        watch=printer.format_watch(),
        table="\n".join(printer.format_table()),
        told="\n".join(printer.format_told()),
    )
    drive = render("drive.c.j2", **common, max_current=Gains.names().index("max_current"))
    return {
        "supervisor.h": render("supervisor.h.j2", **common),
        "supervisor.c": with_ramfuncs(source, cold={f"{prefix}_supervisor_init", f"{prefix}_supervisor_refuse"}),
        "drive.h": render("drive.h.j2", **common),
        "drive.c": with_ramfuncs(drive, cold={f"{prefix}_drive_init"}),
    }
