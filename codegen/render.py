"""Templates filled in: one C pair a filter and target, one Python module a drive."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2

from codegen import __version__
from codegen.layout import Listing
from codegen.printers.c import INDENT, STRUCT_FIELDS, CPrinter
from codegen.printers.python import PythonPrinter
from codegen.small_angle import DOUBLINGS, LIMIT, WIDEST, coefficients, small_angle_bound, small_angle_listing
from codegen.targets import Target
from codegen.trig import DOUBLE, SINGLE, sin_cos_bound, sin_cos_listing, wrap_listing
from model.drive import Drive
from model.filters import FilterStep
from model.filters.program import Copy, IfAccepted, Node, Repeat
from model.state_space import StateSpaceModel

_ENVIRONMENT = jinja2.Environment(
    loader=jinja2.FileSystemLoader(Path(__file__).parent / "templates"),
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
    undefined=jinja2.StrictUndefined,
)

FILTER_TITLES = {
    "ckf": "cubature Kalman filter",
    "ickf": "iterated cubature Kalman filter",
    "ekf": "extended Kalman filter",
    "ukf": "unscented Kalman filter",
}
COVARIANCE_COMMENTS = {
    "P": "covariance of x: lower triangle, row by row: P00, P10, P11, P20, ...",
    "LD": "covariance of x as L D L^T, L with unit diagonal: D0, L10, D1, L20, L21, D2, ...",
}
MACHINE_TITLES = {"surface": "surface PMSM, current states", "salient_flux": "salient PMSM, flux-linkage states"}


@dataclass(frozen=True)
class Description:
    """What every template wants to say about a drive."""

    drive: Drive
    model: StateSpaceModel
    initial_state: tuple[float, ...]

    @property
    def machine(self) -> str:
        return MACHINE_TITLES.get(self.drive.model.machine, self.drive.model.machine)

    @property
    def sample_time(self) -> str:
        return f"T = {self.drive.model.sample_time * 1e6:g} us"

    def title(self, kind: str) -> str:
        return f"{FILTER_TITLES[kind]}, {self.machine}, {len(self.model.states)} states, {self.sample_time}"


def render(template: str, **context: Any) -> str:
    """Fill a template of this package; an unknown name in it is an error."""
    return _ENVIRONMENT.get_template(template).render(version=__version__, **context)


def render_port() -> str:
    return render("port.h.j2")


def render_filter(
    about: Description,
    step: FilterStep,
    listings: dict[str, Listing],
    target: Target,
    notes: Sequence[str],
) -> tuple[str, str]:
    """Header and source of one filter for one target; ``notes`` are the lines at the source's head."""
    drive, model = about.drive, about.model
    printer = CPrinter(target)
    n = len(model.states)
    looped = has_loop(step.body)
    turns = any(listings[block.name].operations()["small_angle"] for block in step.blocks)
    pair = turns or any(listings[block.name].operations()["sincos"] for block in step.blocks)
    common = {
        "p": f"{drive.name}_{step.kind}{target.tag}",
        "title": about.title(step.kind),
        "drive": drive.name,
        "sha": drive.sha256,
        "real": target.real,
        "n": n,
        "packed": n * (n + 1) // 2,
        "libm": target.libm,
        "covariance": step.covariance,
    }
    header = render(
        "filter.h.j2",
        **common,
        covariance_comment=COVARIANCE_COMMENTS[step.covariance],
        states_comment=", ".join(f"{state.name} {state.unit}" for state in model.states),
        unused="" if looped else "; unused here: " + ("iterating is idle" if step.iteration_proof else "no iteration"),
    )
    source = render(
        "filter.c.j2",
        **common,
        generated_trig=target.generated_trig,
        notes=notes,
        constants=filter_constants(about, step, listings, printer),
        round=printer.format_literal(target.precision.rounding),
        below_pi=printer.format_literal(target.precision.below_pi),
        pair=pair,
        pair_type=printer.pair,
        trig_note=trig_note(target),
        sin_cos=sin_cos_text(printer),
        turns=turns,
        **(turn_context(printer) if turns else {}),
        wrap_angle=printer.format_helper(wrap_listing(target.precision)),
        copies=looped,
        blocks=[printer.format_block(listings[block.name]) for block in step.blocks],
        defaults=[f"f->{name} = {text};" for name, text in _c_defaults(about, printer)],
        zero=printer.format_literal(0.0),
        locals=_locals(step, target),
        program="\n".join(printer.format_program(step.body)),
    )
    if target.generated_trig:
        source = with_ramfuncs(source, cold={f"{common['p']}_init", f"{common['p']}_reset"})
    return header, source


_DEFINITION = re.compile(r"^(?:\w+ )+(\w+)\([^;{]*\)\n\{", re.MULTILINE)


def with_ramfuncs(source: str, cold: set[str]) -> str:
    """Pragmas that place every function of the file but the ``cold`` ones in RAM.

    They stand before the first include: a pragma that follows a declaration may be ignored (SPRU514).
    """
    functions = [name for name in dict.fromkeys(_DEFINITION.findall(source)) if name not in cold]
    head, include, tail = source.partition("#include")
    return f"{head}{render('ramfunc.j2', functions=functions)}\n{include}{tail}"


def trig_note(target: Target) -> list[str]:
    if not target.generated_trig:
        return ["Sine and cosine of the platform."]
    bound = sin_cos_bound()
    return [
        "Sine and cosine as arithmetic: no branch, the same bits on every IEEE machine.",
        f"Error for |x| <= {bound.limit:g} rad: proved {bound.proved:.1e}, "
        f"worst of {bound.samples} arguments {bound.seen:.1e}.",
    ]


def small_angle_note(target: Target) -> list[str]:
    """What is known of sinc and cosm1."""
    lines = [
        "How far a column of L turns an angle, from z = d^2: sin(d) / d = 1 + SINC_1 z + ..., "
        "cos(d) - 1 = COSM1_1 z + ...",
        f"for d up to {LIMIT**0.5:.2g} rad.",
    ]
    if target.generated_trig:
        bound = small_angle_bound()
        lines.append(f"Error proved: sinc {bound.sinc:.1e}, cosm1 {bound.cosm1:.1e} of z / 2.")
    return lines


def turn_context(printer: CPrinter) -> dict[str, Any]:
    """What ``widen.j2`` prints: small angles, and those that are not."""
    return {
        "small_angle_note": small_angle_note(printer.target),
        "turn_constants": [
            {"name": f"{prefix}_{k}", "text": printer.format_literal(value)}
            for prefix, part in zip(("SINC", "COSM1"), coefficients(printer.target.precision), strict=True)
            for k, value in enumerate(part, start=1)
        ],
        "small_turn": printer.format_literal(LIMIT),
        "widest_turn": printer.format_literal(WIDEST),
        "doublings": DOUBLINGS,
        "quarter": printer.format_literal(0.25),
        "one": printer.format_literal(1.0),
        "two": printer.format_literal(2.0),
        "sinc_text": printer.format_turn("SINC", "part"),
        "cosm1_text": printer.format_turn("COSM1", "part"),
    }


def sin_cos_text(printer: CPrinter) -> str:
    if printer.target.generated_trig:
        return printer.format_helper(sin_cos_listing())
    lines = [f"static {printer.pair} sin_cos(float64 x)", "{", f"{INDENT}{printer.pair} result;"]
    return "\n".join(
        [*lines, f"{INDENT}result.sine = sin(x);", f"{INDENT}result.cosine = cos(x);", f"{INDENT}return result;", "}"]
    )


def filter_constants(
    about: Description, step: FilterStep, listings: dict[str, Listing], printer: CPrinter
) -> list[dict[str, str]]:
    """The named constants this filter uses."""
    used = named_constants(about, [listings[block.name] for block in step.blocks])
    return [{"name": name, "text": printer.format_literal(value), "formula": formula} for name, value, formula in used]


def named_constants(about: Description, listings: list[Listing]) -> list[tuple[str, float, str]]:
    """Name, value and formula of the constants that blocks use: the model's in its order, then products of them."""
    found = {
        node.name: (node.name, node.value, node.formula)
        for listing in listings
        for node in (listing.graph[index] for index in sorted(listing.live))
        if node.op == "const" and node.name
    }
    own = [c.name for c in about.model.constants if c.name in found]
    return [found.pop(name) for name in own] + list(found.values())


def _tuning(about: Description) -> dict[str, Any]:
    drive = about.drive
    return {
        "Q": tuple(drive.filter.process_noise),
        "R": tuple(drive.filter.measurement_noise),
        "x_0": about.initial_state,
        "P_0": tuple(drive.filter.initial_covariance),
        "u_max": drive.operating_box.voltage,
        "y_max": drive.operating_box.current,
        "tolerance": drive.filter.tolerance,
        "max_iterations": drive.filter.max_iterations,
    }


def _c_defaults(about: Description, printer: CPrinter) -> list[tuple[str, str]]:
    lines: list[tuple[str, str]] = []
    for name, value in _tuning(about).items():
        if isinstance(value, tuple):
            lines += [(f"{name}[{k}]", printer.format_literal(item)) for k, item in enumerate(value)]
        else:
            lines.append((name, str(value) if isinstance(value, int) else printer.format_literal(value)))
    return lines


def _locals(step: FilterStep, target: Target) -> list[str]:
    """Arrays of the step that do not live in the struct."""
    sizes: dict[str, int] = {}
    for block in step.blocks:
        sizes |= {port.name: len(port.entries) for port in block.outputs if port.name not in STRUCT_FIELDS}
    return [f"{target.real} {name}[{size}];" for name, size in sizes.items()]


def has_loop(body: tuple[Node, ...]) -> bool:
    return any(
        isinstance(node, Repeat | Copy) or (isinstance(node, IfAccepted) and has_loop(node.then)) for node in body
    )


def render_module(
    about: Description, steps: dict[str, FilterStep], listings: dict[str, Listing], controller: dict[str, Any]
) -> str:
    """The Python module of a drive, all its kinds, and the controller (see :mod:`codegen.render_drive`)."""
    drive, model = about.drive, about.model
    printer = PythonPrinter()
    (covariance,) = {step.covariance for step in steps.values()}
    turns = any(listing.operations()["small_angle"] for listing in listings.values())
    helpers = [
        printer.format_helper(sin_cos_listing(), "f32"),
        printer.format_helper(wrap_listing(SINGLE), "f32"),
        printer.format_helper(wrap_listing(DOUBLE), "f64"),
    ]
    return render(
        "module.py.j2",
        title=f"{drive.name}: {', '.join(steps)} of a {about.machine}, {len(model.states)} states, {about.sample_time}",
        drive=drive.name,
        sha=drive.sha256,
        states=tuple(state.name for state in model.states),
        units=tuple(state.unit for state in model.states),
        angle=model.angle,
        kinds=tuple(steps),
        gain=drive.filter.gain,
        sample_time=repr(drive.model.sample_time),
        defaults={key: repr(value) for key, value in _tuning(about).items()},
        constants=[
            {"name": name, "value": repr(value), "formula": formula}
            for name, value, formula in {
                c[0]: c
                for c in (
                    *named_constants(about, list(listings.values())),
                    *((c.name, c.value, c.formula) for c in controller["control_constants"]),
                )
            }.values()
        ],
        helpers=helpers,
        turns=turns,
        small_angle=_python_small_angle(printer) if turns else "",
        covariance=covariance,
        packing=render("packing.py.j2", covariance=covariance),
        **controller,
        blocks=[printer.format_block(listing) for listing in listings.values()],
        steps=[
            {"kind": kind, "loops": has_loop(step.body), "program": "\n".join(printer.format_program(step.body))}
            for kind, step in steps.items()
        ],
    )


def _python_small_angle(printer: PythonPrinter) -> str:
    """Both precisions of small_angle: the polynomials, and beyond the limit the doubled angle."""
    return "\n\n".join(
        render(
            "small_angle.py.j2",
            tag=tag,
            limit=LIMIT,
            widest=WIDEST,
            doublings=DOUBLINGS,
            polynomials=printer.format_helper(small_angle_listing(precision), tag).replace("def _", "def _polynomial_"),
        )
        for tag, precision in (("f32", SINGLE), ("f64", DOUBLE))
    )
