"""Templates around the filter filled in: the whole controller for the chip, the plant for the host."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from codegen.ir.constants import is_round
from codegen.ir.covariance import state_place
from codegen.ir.layout import Listing, lay_out
from codegen.ir.trig import DOUBLE, INSIDE, wrap_listing
from codegen.render.fill import render
from codegen.render.filter import ANGLE, Description, named_constants, with_sections
from codegen.render.printers.c import CPrinter
from codegen.render.printers.python import PythonPrinter
from codegen.render.supervisor import machine_of
from codegen.render.trig import sin_cos_arithmetic, sin_cos_text, trig_note
from codegen.targets.numbers import FLOAT32, FLOAT64
from model.filters import FilterStep
from model.inverter import OF_LEGS, STATE, TRANSFORM
from model.loop.controller import (
    SENSED_MAX,
    Gains,
    believed_block,
    clarke_block,
    command_limits,
    control_block,
    design,
    first_command,
)
from model.loop.plant import MOTOR, RUNGE_KUTTA, STATES, outputs_block, phasor_block, plant_block, rest_block
from model.quantities import Constant, ConstantError, Constants, united
from model.schema import Drive, DriveError


def control_listing(about: Description) -> tuple[Listing, list[Constant]]:
    """The controller's block, laid out, and its named constants.

    Parameters
    ----------
    about : Description
    """

    def made() -> tuple[Listing, list[Constant]]:
        constants = Constants(named=True)
        block = control_block(about.drive, constants)
        found = list(constants.items.values())
        return lay_out(block, [*found, *_transform(about)]), found

    return about.once("controller", made)


def _transform(about: Description) -> tuple[Constant, ...]:
    """Numbers of the transforms that the controller's text may hold."""
    return OF_LEGS if about.model.lost else TRANSFORM


def control_constants(about: Description, constants: list[Constant]) -> list[Constant]:
    """The controller's constants and the model's, which share a file; DriveError where they share a name.

    Parameters
    ----------
    about : Description
    constants : list of Constant
        The controller's.
    """
    try:
        return united(constants, about.model.constants, _transform(about))
    except ConstantError as error:
        raise DriveError(f"drive '{about.drive.name}': controller and machine share a name: {error}.") from None


def believed_listing(about: Description) -> Listing:
    """The currents at the filter's state, laid out.

    Parameters
    ----------
    about : Description
    """
    return about.once("believed", lambda: lay_out(believed_block(about.model), about.model.constants))


def controller_context(about: Description, printer: CPrinter | PythonPrinter) -> dict[str, Any]:
    """Template context of the controller that both languages share.

    Parameters
    ----------
    about : Description
    printer : CPrinter or PythonPrinter
        Of the language.
    """
    listing, constants = control_listing(about)
    names = [state.name for state in about.model.states]
    return {
        "clarke": printer.format_block(lay_out(clarke_block(), TRANSFORM)),
        "believed": printer.format_block(believed_listing(about)),
        "control_text": printer.format_block(listing),
        "control_constants": control_constants(about, constants),
        "control_listings": [listing, believed_listing(about), lay_out(clarke_block(), TRANSFORM)],
        "command_max": [printer.format_literal(value) for value in command_limits(about.drive)],
        "command_first": [printer.format_literal(value) for value in first_command(about.drive)],
        "sensed_max": printer.format_literal(SENSED_MAX),
        "omega": names.index("omega"),
        "theta": names.index(ANGLE),
        "gains": tuple(Gains.names(about.drive)),
        "estimated": names.index(STATE) if STATE in names else None,
        "gain_values": [printer.format_literal(value) for value in design(about.drive).values],
        "advance_delayed": printer.format_literal(design(about.drive, delay=1).advance),
    }


def foc_context(about: Description, kind: str, printer: CPrinter) -> dict[str, Any]:
    """Template context of the controller's scalar and lane form, float32.

    Parameters
    ----------
    about : Description
    kind : str
        Filter kind, such as "ickf".
    printer : CPrinter
        Of the scalar or the lane form.
    """
    context = controller_context(about, printer)
    p = f"{about.drive.name}_{kind}"
    return {
        **context,
        "p": p,
        "omega_place": state_place(p, "omega"),
        "theta_place": state_place(p, ANGLE),
        "estimated_place": state_place(p, STATE),
        "drive": about.drive.name,
        "sha": about.drive.sha256,
        "sample_time": about.sample_time,
        "constants": [
            {"name": name, "text": printer.format_literal(value), "formula": formula}
            for name, value, formula in named_constants(about, context["control_listings"])
        ],
        "round": printer.format_literal(printer.numbers.precision.rounding),
        "below_pi": printer.format_literal(printer.numbers.precision.below_pi),
        "inside": printer.format_literal(INSIDE),
        "wrap_angle": printer.format_helper(wrap_listing(printer.numbers.precision)),
        "trig_note": trig_note(printer.numbers),
        "sin_cos": sin_cos_text(printer),
    }


def render_foc(about: Description, kind: str, notes: Sequence[str]) -> tuple[str, str]:
    """Header and source of the controller around one filter, float32 for the chip.

    Parameters
    ----------
    about : Description
    kind : str
        Filter kind, such as "ickf".
    notes : sequence of str
        Lines of the source's head.
    """
    context = foc_context(about, kind, CPrinter(about.target.numbers))
    source = render("foc.c.j2", **context, control=about.drive.control, notes=notes)
    return render("foc.h.j2", **context), with_sections(
        about.target.sections, source, cold={f"{context['p']}_foc_init"}
    )


#: The example sends numbers so many times a second.
TELEMETRY_RATE = 50.0


def default_kind(kinds: Iterable[str]) -> str:
    """The filter that is meant where none is named: ickf where there is one.

    Parameters
    ----------
    kinds : iterable of str
        One or more; without ickf the first is meant.
    """
    kinds = list(kinds)
    return "ickf" if "ickf" in kinds else kinds[0]


def render_example(about: Description, step: FilterStep) -> str:
    """Render the example interrupt around one filter.

    Parameters
    ----------
    about : Description
    step : FilterStep
        The filter; places in its struct are told by the names of its header.
    """
    drive, p = about.drive, f"{about.drive.name}_{step.kind}"
    T = drive.model.sample_time
    source = render(
        "example_isr.c.j2",
        example=about.target.example,
        compiler=about.target.compiler,
        p=p,
        drive=drive.name,
        sha=drive.sha256,
        sample_time_us=f"{T * 1e6:g}",
        telemetry_every=max(1, round(1 / (TELEMETRY_RATE * T))),
        pole_pairs=CPrinter(FLOAT32).format_literal(float(drive.motor.pole_pairs)),
        omega=state_place(p, "omega"),
        theta=state_place(p, ANGLE),
        rivals=machine_of(about, step).rivals,
        aligns=machine_of(about, step).aligns,
    )
    return with_sections(about.target.sections, source, cold={"motor_setup"})


def plant_listings(drive: Drive) -> dict[str, Listing]:
    """The motor's blocks, laid out, by what the templates call them.

    Parameters
    ----------
    drive : Drive
    """
    blocks = {
        "rest": rest_block(drive),
        "phasor": phasor_block(),
        "substep": plant_block(drive),
        "outputs": outputs_block(drive),
    }
    return {name: lay_out(block, plant_constants(drive), any_angle=True) for name, block in blocks.items()}


def plant_constants(drive: Drive) -> list[Constant]:
    """The numbers of the motor's equations that want a name: those of many pole pairs are no round ones.

    Parameters
    ----------
    drive : Drive
    """
    p = drive.motor.pole_pairs
    of_p = [
        Constant("POLE_PAIRS", float(p), "p", None),
        Constant("TORQUE_PER_FLUX", 1.5 * p, "1.5 p", None),
    ]
    return [RUNGE_KUTTA, *(constant for constant in of_p if not is_round(constant.value))]


def plant_data(about: Description) -> list[str]:
    """Which of the motor's data its equations read: a surface machine has one inductance.

    Parameters
    ----------
    about : Description

    Returns
    -------
    list of str
        Those of :data:`model.loop.plant.MOTOR` that are read, in its order.
    """
    listings = about.once("plant", lambda: plant_listings(about.drive))
    found = {name for listing in listings.values() for _, name in listing.used_inputs.get("motor", [])}
    return [name for name in MOTOR if name in found]


def plant_context(about: Description, printer: CPrinter) -> dict[str, Any]:
    """Template context of the motor's scalar and lane form, float64.

    Parameters
    ----------
    about : Description
    printer : CPrinter
        Of the scalar or the lane form.
    """
    listings = about.once("plant", lambda: plant_listings(about.drive))
    return {
        "drive": about.drive.name,
        "sha": about.drive.sha256,
        "n": len(STATES),
        "m": len(MOTOR),
        "states": ", ".join(STATES),
        "motor": ", ".join(MOTOR),
        "round": printer.format_literal(DOUBLE.rounding),
        "constants": [(c.name, printer.format_literal(c.value), c.formula) for c in plant_constants(about.drive)],
        "pair": printer.pair,
        "sin_cos": sin_cos_arithmetic(printer, DOUBLE),
        **{name: printer.format_block(listing) for name, listing in listings.items()},
    }


def render_plant(about: Description) -> tuple[str, str]:
    """Header and source of the motor for simulation, float64.

    Parameters
    ----------
    about : Description
    """
    context = plant_context(about, CPrinter(FLOAT64))
    return render("plant.h.j2", **context), render("plant.c.j2", **context)
