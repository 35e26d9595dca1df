"""Where a step's operations go: the literal and the fast form part by part, beside the instructions of all of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

from codegen.fast.ablation import AblationStep, accepted_path, build_ablation
from codegen.ir.layout import Listing
from codegen.passes import WEIGHTS
from costs import ours
from costs.counting import figure, m4_instructions
from costs.step_tables import M4, Length, Progress, inputs_of
from costs.table import Row, Table, ratio
from model.drives.load import load_drive, shipped_drives

#: Operations that are one instruction of the M4's, whatever they take; the rest as where forms are compared.
ONE = {"div": 1, "sqrt": 1}
#: Parts of a step, by what their blocks' names hold; a time update is two, the second from its mean on (eq. 16).
POINTS, MOMENTS = "points through f, eq. 13-15", "mean, covariance, factor, eq. 16-18"
PARTS = {
    "inverter": "inverter",
    "measurement_update": "measurement, eq. 18-26",
    "iterate": "an iterate, eq. 28-31 and 33",
    "finish": "covariance after it, eq. 32",
}


def blocks_table(length: Length, progress: Progress, drives: Sequence[str] = ()) -> Table:
    """Operations of both forms by part of the step, and how many instructions make a step of them."""
    rows: list[Row] = []
    for name in drives or shipped_drives():
        problem = ours.Problem.of(load_drive(name))
        for kind in ("ckf", "ickf"):
            progress(f"{name}, {kind}: operations by part")
            literal, fast = (operations(problem, kind, form) for form in (ours.LITERAL, ours.SHIPPED))
            rows += [_row(f"{name}, {kind}: {part}", literal[part], fast[part]) for part in fast | literal]
            rows.append(_row(f"{name}, {kind}: operations", literal.total(), fast.total()))
            inputs = inputs_of(problem, length, kind)
            subjects = [ours.candidate(problem, kind, form)[0] for form in (ours.LITERAL, ours.SHIPPED)]
            whole = [figure(lambda form=form, inputs=inputs: m4_instructions(form, inputs)) for form in subjects]
            row: Row = {"part": f"{name}, {kind}: {M4}", "literal": whole[0], "fast": whole[1]}
            rows.append(row | {"fast / literal": ratio(whole[1], whole[0])})
    notes = [
        "Operations of a step whose measurement is accepted, an iterate once: add, mul, comparison, div, sqrt 1 each; "
        f"sine and cosine {WEIGHTS['sin']}, a small angle's two {WEIGHTS['sinc'] + WEIGHTS['cosm1']}.",
        "Instructions are those of the forms table: guards, loads, stores and further iterates are in them.",
    ]
    return Table("blocks", "Where the operations of a step go", rows, notes)


def operations(problem: ours.Problem, kind: str, form: AblationStep) -> Counter[str]:
    """Operations of one form by part."""
    step, listings = build_ablation(problem.model, kind, problem.drive.filter.gain, form)
    found: Counter[str] = Counter()
    for block in accepted_path(step.body):
        part = next((part for word, part in PARTS.items() if word in block.name), "")
        for equation, count in by_equation(listings[block.name]):
            found[part or (POINTS if equation and int(equation) < 16 else MOMENTS)] += count
    return found


def by_equation(listing: Listing) -> list[tuple[str, int]]:
    """Of each section of a block its equation's number, and the operations that no section before it does.

    What stands in an output's own line alone, and halves of pairs that are outputs, are the last section's.
    """
    done: set[int] = set()

    def cost(roots: Iterable[int]) -> int:
        total, stack = 0, list(roots)
        while stack:
            node = stack.pop()
            if node not in done:
                done.add(node)
                total += (WEIGHTS | ONE).get(listing.graph[node].op, 1)
                stack += listing.graph[node].args
        return total

    counted = [(s.equation, cost(statement.node for statement in s.statements)) for s in listing.sections]
    last = listing.sections[-1].equation if listing.sections else ""
    return [*counted, (last, cost(node for nodes in listing.outputs.values() for node in nodes))]


def _row(label: str, literal: float, fast: float) -> Row:
    of = ratio(float(fast), float(literal)) if literal else ""
    return {"part": label, "literal": float(literal), "fast": float(fast), "fast / literal": of}
