"""What each step of the fast form earns: the same filter built with one after another switched on.

>>> from model.drives.load import load_drive
>>> from model.machines.state_space import build
>>> earned = earnings(build(load_drive("paper_spmsm")), "ckf", "cubature")
>>> [item.rung.name for item in earned][:2]
['literal form', 'even and odd parts, L D L^T']
>>> earned[-1].weight < earned[0].weight / 2
True
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

from codegen.fast.steps import EVERYTHING, Means, build_fast_filter
from codegen.ir.layout import Listing, lay_out
from codegen.passes import (
    WEIGHTS,
    collect,
    optimise,
    pull_signs,
    share_reciprocals,
    spend_reciprocals,
    weight,
    without,
)
from model.filters import FilterStep, build_filter
from model.filters.program import Call, IfAccepted, Node, Repeat
from model.machines.state_space import StateSpaceModel
from model.quantities import Block


@dataclass(frozen=True)
class Rung:
    """A way to build a filter: the fast form with some of its means or, with none, the literal one."""

    name: str
    means: Means | None = EVERYTHING


#: From the paper's form to the shipped one, each with what the one before has.
RUNGS = (
    Rung("literal form", None),
    Rung("even and odd parts, L D L^T", Means(turning=False, pipelines=((),))),
    Rung("+ turning frame", Means(pipelines=((),))),
    Rung("+ shared reciprocals", Means(pipelines=((share_reciprocals, spend_reciprocals),))),
    Rung("+ pulled signs", Means(pipelines=((share_reciprocals, pull_signs, spend_reciprocals),))),
    Rung("+ shared products", Means(pipelines=without(collect))),
    Rung("+ collected sums (as shipped)"),
)


#: Operations that a step is reported with; ``small_angle`` is sinc and cosm1 of one angle.
OPERATIONS = ("add", "mul", "div", "sqrt", "sincos", "small_angle")


def weights_text() -> str:
    """What a weight is, in one sentence."""
    pair, turn = WEIGHTS["sin"] + WEIGHTS["cos"], WEIGHTS["sinc"] + WEIGHTS["cosm1"]
    return (
        "Operations of a step whose measurement is accepted, each iterate once, small angles by their polynomials. "
        f"Weights: add, mul and comparisons 1, div {WEIGHTS['div']}, sqrt {WEIGHTS['sqrt']}, sincos {pair}, "
        f"small_angle {turn}."
    )


@dataclass(frozen=True)
class Earned:
    """Cost of one step built as ``rung`` says, its measurement accepted, each iterate once.

    ``operations``: as :meth:`codegen.ir.layout.Listing.operations`; ``weight``: in additions, see
    :data:`codegen.passes.WEIGHTS`.
    """

    rung: Rung
    operations: Counter[str]
    weight: int


def build_rung(model: StateSpaceModel, kind: str, gain: str, rung: Rung) -> tuple[FilterStep, dict[str, Listing]]:
    """The step and its listings by block name."""
    means = rung.means
    step = build_fast_filter(model, kind, gain, means) if means else build_filter(model, kind, gain)
    pipelines = (means or EVERYTHING).pipelines
    return step, {block.name: lay_out(optimise(block, pipelines), model.constants) for block in step.blocks}


def earnings(model: StateSpaceModel, kind: str, gain: str) -> list[Earned]:
    """Every rung's cost."""
    return [earned(rung, *build_rung(model, kind, gain, rung)) for rung in RUNGS]


def earned(rung: Rung, step: FilterStep, listings: dict[str, Listing]) -> Earned:
    """The cost of a step that was built as ``rung`` says."""
    path = [listings[block.name] for block in accepted_path(step.body)]
    operations = sum((listing.operations() for listing in path), Counter())
    weights = (weight(ls.graph, [node for nodes in ls.outputs.values() for node in nodes]) for ls in path)
    return Earned(rung, operations, sum(weights))


def accepted_path(body: tuple[Node, ...]) -> Iterator[Block]:
    """The blocks that run when the measurement is accepted, a loop's once."""
    for node in body:
        if isinstance(node, Call):
            yield node.block
        elif isinstance(node, Repeat):
            yield from accepted_path(node.body)
        elif isinstance(node, IfAccepted):
            yield from accepted_path(node.then)
