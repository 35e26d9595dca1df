"""The Python module of a drive, from its template."""

from __future__ import annotations

from typing import Any

from codegen.ir.covariance import CovarianceLayout
from codegen.ir.layout import Listing
from codegen.ir.small_angle import LEFT_COSM1, LEFT_SINC, LIMIT, UNKNOWN, small_angle_listing
from codegen.ir.trig import DOUBLE, SINGLE, sin_cos_listing, wrap_listing
from codegen.render.fill import render
from codegen.render.filter import ANGLE, Description, named_constants, tuning
from codegen.render.printers.python import PythonPrinter
from model.filters import FilterStep
from model.filters.program import Restart, Seldom
from model.schema import Drive


def render_module(
    about: Description, steps: dict[str, FilterStep], listings: dict[str, Listing], around: dict[str, Any]
) -> str:
    """The Python module of a drive, all its kinds, and what is around them.

    Parameters
    ----------
    about : Description
    steps : dict of str to FilterStep
    listings : dict of str to Listing
        Of their blocks.
    around : dict of str to Any
        Template context of controller (:mod:`codegen.render.drive`) and supervisor (:mod:`codegen.render.supervisor`).
    """
    drive, model = about.drive, about.model
    printer = PythonPrinter(drive.constant_time)
    (covariance,) = {step.covariance for step in steps.values()}
    printer.covariance = covariance
    layout = CovarianceLayout.of(next(iter(steps.values())))
    spreads = sorted(set().union(*(listing.spreads for listing in listings.values())))
    helpers = [
        printer.format_helper(sin_cos_listing(), "f32"),
        printer.format_helper(wrap_listing(SINGLE), "f32"),
        printer.format_helper(wrap_listing(DOUBLE), "f64"),
    ]
    guarded = all(step.has(Restart) for step in steps.values())
    seldom = {node for step in steps.values() for node in step.all_of(Seldom)}
    assert len(seldom) <= 1, "all filters of a module look at their result in the same way"
    return render(
        "module.py.j2",
        title=f"{drive.name}: {', '.join(steps)} of a {about.machine}, {len(model.states)} states, {about.sample_time}",
        drive=drive.name,
        sha=drive.sha256,
        states=tuple(state.name for state in model.states),
        units=tuple(state.unit for state in model.states),
        angle=model.angle,
        layout=layout,
        angle_columns=layout.row(ANGLE) + 1,
        angle_row=layout.row_start(ANGLE),
        kinds=tuple(steps),
        gain=drive.filter.gain,
        sample_time=repr(drive.model.sample_time),
        defaults={key: repr(value) for key, value in tuning(about, guarded).items()},
        constants=_constants(about, listings, around),
        helpers=helpers,
        **_turns(drive, spreads),
        guarded=guarded,
        seldom=["\n".join(printer.format_seldom(node)) for node in seldom],
        sane_limit=repr(about.sane_limit),
        per_sane_limit=repr(1.0 / about.sane_limit),
        small_angle="\n\n\n".join(_python_small_angle(printer, n) for n in spreads),
        covariance=covariance,
        packing=render("packing.py.j2", covariance=covariance),
        **around,
        blocks=[printer.format_block(listing) for listing in listings.values()],
        steps=[{"kind": kind, "program": "\n".join(printer.format_step(step))} for kind, step in steps.items()],
    )


def _turns(drive: Drive, spreads: list[float]) -> dict[str, Any]:
    """What the module says of the angles that columns turn by; ``left``: sinc and cosm1 of one that was given up."""
    return {
        "constant_time": drive.constant_time,
        "spreads": [f"{n:g}" for n in spreads],
        "unknown": {f"{n:g}": repr(UNKNOWN / n) for n in spreads},
        "small": {f"{n:g}": repr(LIMIT / n) for n in spreads},
        "left": (repr(LEFT_SINC), repr(LEFT_COSM1)),
    }


def _constants(about: Description, listings: dict[str, Listing], around: dict[str, Any]) -> list[dict[str, str]]:
    """The named constants of all blocks, each once."""
    inner, outer = [*listings.values(), *around["control_listings"]], around["supervisor_listings"]
    found = [
        *named_constants(about, inner, staged=True),
        *named_constants(about, [*outer, *around["drive_listings"]], staged=True),
        *((c.name, c.value, c.formula) for c in around["control_constants"]),
    ]
    once = {name: (name, value, formula) for name, value, formula in found}
    return [{"name": name, "value": repr(value), "formula": formula} for name, value, formula in once.values()]


def _python_small_angle(printer: PythonPrinter, n: float) -> str:
    """The polynomials of small and of wide turns, in both precisions; in constant time those of wide ones alone."""
    return "\n\n\n".join(
        printer.format_helper(small_angle_listing(precision, n, wide), tag)
        for tag, precision in (("f32", SINGLE), ("f64", DOUBLE))
        for wide in ((True,) if printer.constant_time else (False, True))
    )
