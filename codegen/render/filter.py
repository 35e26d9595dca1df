"""Templates filled in: one C pair a filter and target, and what all of a drive share."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeVar

from codegen.fast.guards import NIS_MAX, NIS_WEIGHT, sane_limit
from codegen.ir.covariance import CovarianceLayout, state_place, variance_place
from codegen.ir.layout import Listing
from codegen.ir.small_angle import LEFT_COSM1, LEFT_SINC, LIMIT, UNKNOWN, coefficients, small_angle_bound
from codegen.ir.trig import INSIDE, wrap_listing
from codegen.render.fill import render
from codegen.render.printers.c import INDENT, STRUCT_FIELDS, CPrinter
from codegen.render.printers.expression import wrap_line
from codegen.render.trig import sin_cos_text, trig_note
from codegen.targets.description import Sections, Target
from codegen.targets.find import find_target
from codegen.targets.numbers import NumberFormat
from model.filters import FilterStep
from model.filters.program import Call, Repeat, Restart, Seldom, Turns
from model.machines.own import kept_as, read_word, title
from model.machines.state_space import StateSpaceModel
from model.schema import Drive
from model.supervisor.table import MODES, REASONS

Made = TypeVar("Made")

#: The state that lives on a circle.
ANGLE = "theta"

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
MACHINE_TITLES = {
    "surface": "surface PMSM, current states",
    "salient": "salient PMSM, current states",
    "salient_flux": "salient PMSM, flux-linkage states",
}


@dataclass(frozen=True)
class Description:
    """The facts about a drive that every template uses."""

    drive: Drive
    model: StateSpaceModel
    initial_state: tuple[float, ...]
    _made: dict[str, Any] = field(init=False, default_factory=dict, repr=False, compare=False)

    def once(self, what: str, make: Callable[[], Made]) -> Made:
        """What the texts of several kinds and languages are made of, and no one of them changes: made for the first.

        Parameters
        ----------
        what : str
            One word a thing.
        make : callable
        """
        if what not in self._made:
            self._made[what] = make()
        made: Made = self._made[what]
        return made

    @cached_property
    def target(self) -> Target:
        """The processor that C is generated for."""
        return find_target(self.drive.target_name)

    @property
    def machine(self) -> str:
        """The machine in words."""
        return MACHINE_TITLES.get(self.drive.model.machine) or title(type(self.model.machine))

    @property
    def machine_file(self) -> dict[str, str]:
        """The machine file of one's own, as the folder keeps it: path and text."""
        word = read_word(self.drive.model.machine)
        return {kept_as(word): self.drive.machine_text} if word else {}

    @property
    def sample_time(self) -> str:
        """The sample time in words, microseconds."""
        return f"T = {self.drive.model.sample_time * 1e6:g} us"

    @property
    def sane_limit(self) -> float:
        """Where the step restarts: a state, variance or mean beyond it."""
        return sane_limit(self.drive.filter.initial_covariance, self.drive.filter.process_noise)

    def title(self, kind: str) -> str:
        """Return a filter's title: kind, machine, number of states, sample time.

        Parameters
        ----------
        kind : str
            Filter kind, such as "ickf".
        """
        return f"{FILTER_TITLES[kind]}, {self.machine}, {len(self.model.states)} states, {self.sample_time}"


def render_port(target: Target) -> str:
    """Render the port header, which is the same for every drive.

    Parameters
    ----------
    target : Target
    """
    modes = [mode for mode in MODES if not mode.aligns]  # who aligns names its own in its supervisor's header
    reasons = [reason for reason in REASONS if reason.name != "NOT_ALIGNED"]
    return render("port.h.j2", target=target, compiler=target.compiler, modes=modes, reasons=reasons)


def covariance_comment(step: FilterStep) -> str:
    """The comment on the words of the covariance."""
    text = COVARIANCE_COMMENTS[step.covariance]
    layout = CovarianceLayout.of(step)
    return text if layout.natural else f"{text}; states in the order {', '.join(step.model.root_order)}"


def render_filter(
    about: Description,
    step: FilterStep,
    listings: dict[str, Listing],
    numbers: NumberFormat,
    notes: Sequence[str],
) -> tuple[str, str]:
    """Header and source of one filter in one number format; ``notes`` are the lines at the source's head."""
    model = about.model
    printer = CPrinter(numbers, step.constant_time)
    layout = CovarianceLayout.of(step)
    looped = step.has(Repeat)
    spread = common_spread(listings[block.name] for block in step.blocks)
    turns = spread is not None
    pair = turns or any(listings[block.name].operations()["sincos"] for block in step.blocks)
    common = _words(about, step, layout, listings, printer)
    header = render(
        "filter.h.j2",
        **common,
        covariance_comment=covariance_comment(step),
        states_comment=", ".join(f"{state.name} {state.unit}" for state in model.states),
        state_places=[(state_place(common["p"], name), k) for k, name in enumerate(layout.states)],
        variance_places=[(variance_place(common["p"], layout, name), layout.variance(name)) for name in layout.states],
        nan_rejects="none" if numbers.generated_trig else "all",  # by bits it is above all, by squares above nothing
        unused="" if looped else "; unused here: " + ("iterating is idle" if step.iteration_proof else "no iteration"),
    )
    source = render(
        "filter.c.j2",
        **common,
        generated_trig=numbers.generated_trig,
        signed=bool(about.target.subset),
        notes=notes,
        constants=filter_constants(about, step, listings, printer),
        round=printer.format_literal(numbers.precision.rounding),
        below_pi=printer.format_literal(numbers.precision.below_pi),
        inside=printer.format_literal(INSIDE),
        pair=pair,
        pair_type=printer.pair,
        trig_note=trig_note(numbers),
        sin_cos=sin_cos_text(printer),
        turns=turns,
        **(turn_context(printer, spread) if spread is not None else {}),
        wrap_angle=printer.format_helper(wrap_listing(numbers.precision)),
        copies=looped,
        blocks=[printer.format_block(listings[block.name]) for block in step.blocks],
        defaults=[f"f->{name} = {text};" for name, text in _c_defaults(about, printer, step.has(Restart))],
        zero=printer.format_literal(0.0),
        locals=_locals(step, numbers),
        program="\n".join(printer.format_step(step)),
        seldom=["\n".join(printer.format_seldom(node)) for node in step.all_of(Seldom)],
    )
    if numbers.generated_trig:
        source = with_sections(about.target.sections, source, cold={f"{common['p']}_init", f"{common['p']}_reset"})
    return header, source


def _words(
    about: Description, step: FilterStep, layout: CovarianceLayout, listings: dict[str, Listing], printer: CPrinter
) -> dict[str, Any]:
    """Template context that header and source of a filter share."""
    drive, numbers, n = about.drive, printer.numbers, len(about.model.states)
    return {
        "constant_time": step.constant_time,
        "p": f"{drive.name}_{step.kind}{numbers.tag}",
        "title": about.title(step.kind),
        "drive": drive.name,
        "sha": drive.sha256,
        "real": numbers.real,
        "n": n,
        "packed": layout.size,
        "layout": layout,
        "libm": library_calls([listings[block.name] for block in step.blocks], numbers),
        "covariance": step.covariance,
        "guarded": step.has(Restart),
        "sane_limit": printer.format_literal(about.sane_limit),
        "per_sane_limit": printer.format_literal(1.0 / about.sane_limit),
        "one": printer.format_literal(1.0),
        "angle_columns": layout.row(ANGLE) + 1,
        "angle_row": layout.row_start(ANGLE),
    }


_DEFINITION = re.compile(r"^(?:\w+ )+(\w+)\([^;{]*\)\n\{", re.MULTILINE)


def with_sections(sections: Sections, source: str, cold: set[str]) -> str:
    """The file with every function but the ``cold`` ones in fast memory.

    Pragmas stand before the first include: one that follows a declaration may be ignored (SPRU514).

    Parameters
    ----------
    sections : Sections
        How the target does it.
    source : str
        Text of a C file.
    cold : set of str
        Functions that stay in flash.
    """
    hot = [name for name in dict.fromkeys(_DEFINITION.findall(source)) if name not in cold]
    if sections.style == "attribute":
        return _DEFINITION.sub(lambda found: f"PMSM_RAM_CODE {found[0]}" if found[1] in hot else found[0], source)
    if sections.style == "none":
        return source
    head, include, tail = source.partition("#include")
    return f"{head}{render('ramfunc.j2', sections=sections, functions=hot)}\n{include}{tail}"


def library_calls(listings: Sequence[Listing], numbers: NumberFormat) -> str:
    """The functions of libm that the step calls, in words.

    Parameters
    ----------
    listings : sequence of Listing
        The step's blocks.
    numbers : NumberFormat
    """
    count = sum((listing.operations() for listing in listings), Counter())
    names = [numbers.libm] if count["sqrt"] else []
    names += ["sin", "cos"] if count["sincos"] and not numbers.generated_trig else []
    return f"of libm only {' and '.join(names)}" if names else "nothing of libm"


def common_spread(listings: Iterable[Listing]) -> float | None:
    """The n of all small angles z = d^2 / n of a filter; None where it has none.

    Parameters
    ----------
    listings : iterable of Listing
        The filter's blocks.
    """
    spreads = set().union(*(listing.spreads for listing in listings))
    assert len(spreads) <= 1, "one filter, one rule, one n"
    return next(iter(spreads), None)


def small_angle_note(printer: CPrinter, n: float) -> list[str]:
    """The comment on sinc and cosm1: their definition and error.

    Parameters
    ----------
    printer : CPrinter
    n : float
        d^2 over z.
    """
    lines = [
        f"How far a column of L turns an angle, from z = d^2 / {n:g}: sin(d) / d = 1 + SINC_1 z + ..., "
        "cos(d) - 1 = COSM1_1 z + ...",
        "for d up to pi: one polynomial for every angle, so that no step asks how wide one is."
        if printer.constant_time
        else f"for d up to {LIMIT**0.5:.2g} rad; WIDE_ ones for d up to pi.",
    ]
    if printer.numbers.generated_trig and printer.constant_time:
        wide = small_angle_bound(n, wide=True)
        lines.append(f"Error proved: sinc {wide.sinc:.1e}, cosm1 {wide.cosm1:.1e} of d^2 / 2.")
    elif printer.numbers.generated_trig:
        bound, wide = small_angle_bound(n), small_angle_bound(n, wide=True)
        lines.append(
            f"Error proved: sinc {bound.sinc:.1e}, cosm1 {bound.cosm1:.1e} of d^2 / 2; "
            f"wide {wide.sinc:.1e}, {wide.cosm1:.1e}."
        )
    return lines


def turn_context(printer: CPrinter, n: float) -> dict[str, Any]:
    """Template context of ``widen.j2`` or ``give_up_angle.j2``: small angles z = d^2 / n, and those that are not."""
    wide = coefficients(printer.numbers.precision, n, wide=True)
    tag = "" if printer.constant_time else "WIDE_"
    named = {f"{tag}SINC": wide[0], f"{tag}COSM1": wide[1]}
    if not printer.constant_time:
        named = dict(zip(("SINC", "COSM1"), coefficients(printer.numbers.precision, n), strict=True)) | named
    return {
        "small_angle_note": small_angle_note(printer, n),
        "spread": f"{n:g}",
        "turn_constants": [
            {"name": f"{prefix}_{k}", "text": printer.format_literal(value)}
            for prefix, part in named.items()
            for k, value in enumerate(part, start=1)
        ],
        "left_sinc": printer.format_literal(LEFT_SINC),
        "left_cosm1": printer.format_literal(LEFT_COSM1),
        "small_turn": printer.format_literal(LIMIT / n),
        "unknown_turn": printer.format_literal(UNKNOWN / n),
        "half": printer.format_literal(0.5),
        "wide_turns": [
            wrap_line(f"turn[{place}] = {printer.format_turn(prefix, 'part')};", INDENT * 2, INDENT)
            for place, prefix in (("2 * k", f"{tag}SINC"), ("(2 * k) + 1", f"{tag}COSM1"))
        ],
    }


def filter_constants(
    about: Description, step: FilterStep, listings: dict[str, Listing], printer: CPrinter
) -> list[dict[str, str]]:
    """The named constants this filter uses."""
    used = named_constants(about, [listings[block.name] for block in step.blocks])
    return [{"name": name, "text": printer.format_literal(value), "formula": formula} for name, value, formula in used]


def named_constants(about: Description, listings: list[Listing], staged: bool = False) -> list[tuple[str, float, str]]:
    """Name, value and formula of the constants that blocks use: the model's in its order, then products of them.

    Parameters
    ----------
    about : Description
    listings : list of Listing
        The blocks.
    staged : bool, optional
        The text tells its stages too, some of which are constants that no output needs.
    """
    found: dict[str, tuple[str, float, str]] = {}
    for listing in listings:
        told = {entry for entries in listing.stages.values() for entry in entries} if staged else set[int]()
        for node in (listing.graph[index] for index in sorted(listing.live | told)):
            if node.op == "const" and node.name:
                known = found.setdefault(node.name, (node.name, node.value, node.formula))
                assert math.isclose(known[1], node.value, rel_tol=1e-14), f"two constants named {node.name}"
    own = [c.name for c in about.model.constants if c.name in found]
    return [found.pop(name) for name in own] + list(found.values())


def tuning(about: Description, guarded: bool) -> dict[str, Any]:
    """Return the tuning that the struct holds, by field."""
    drive = about.drive
    monitor = {"nis_max": NIS_MAX, "nis_weight": NIS_WEIGHT} if guarded else {}
    return {
        "Q": tuple(drive.filter.process_noise),
        "R": tuple(drive.filter.measurement_noise),
        "x_0": about.initial_state,
        "P_0": tuple(drive.filter.initial_covariance),
        "u_max": drive.operating_box.voltage,
        "y_max": drive.operating_box.current,
        **monitor,
        "tolerance": drive.filter.tolerance,
        "max_iterations": drive.filter.max_iterations,
    }


def _c_defaults(about: Description, printer: CPrinter, guarded: bool) -> list[tuple[str, str]]:
    lines: list[tuple[str, str]] = []
    for name, value in tuning(about, guarded).items():
        if isinstance(value, tuple):
            lines += [(f"{name}[{k}]", printer.format_literal(item)) for k, item in enumerate(value)]
        else:
            lines.append((name, str(value) if isinstance(value, int) else printer.format_literal(value)))
    return lines


def _locals(step: FilterStep, numbers: NumberFormat) -> list[str]:
    """Arrays of the step that do not live in the struct."""
    sizes: dict[str, int] = {}
    for node in step.nodes:
        ports = node.block.outputs if isinstance(node, Call) else ()
        outputs = ports[1:] if isinstance(node, Turns) else ports  # the squares stay inside
        sizes |= {port.name: len(port.entries) for port in outputs if port.name not in STRUCT_FIELDS}
    return [f"{numbers.real} {name}[{size}];" for name, size in sizes.items()]
