"""The gain of each step of the fast form: the same filter built with one after another switched on.

>>> from model.drives.load import load_drive
>>> from model.machines.state_space import build
>>> earned = earnings(build(load_drive("paper_spmsm")), "ckf", "cubature")
>>> [item.ablation.name for item in earned][:2]
['literal form', 'even and odd parts, L D L^T']
>>> earned[-1].weight < earned[0].weight / 2
True
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

from codegen.fast.steps import EVERYTHING, Options, build_fast_filter
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
from model.filters.conditions import ACCEPTED
from model.filters.program import Call, If, Node, Repeat
from model.machines.state_space import StateSpaceModel
from model.quantities import Block


@dataclass(frozen=True)
class AblationStep:
    """A way to build a filter: the fast form with some of its options or, with none, the literal one."""

    name: str
    options: Options | None = EVERYTHING


#: From the paper's form to the shipped one, each with what the one before has.
ABLATION = (
    AblationStep("literal form", None),
    AblationStep("even and odd parts, L D L^T", Options(turning=False, pipelines=((),))),
    AblationStep("+ turning frame", Options(pipelines=((),))),
    AblationStep("+ shared reciprocals", Options(pipelines=((share_reciprocals, spend_reciprocals),))),
    AblationStep("+ pulled signs", Options(pipelines=((share_reciprocals, pull_signs, spend_reciprocals),))),
    AblationStep("+ shared products", Options(pipelines=without(collect))),
    AblationStep("+ collected sums (as shipped)"),
)


#: Operations that a step is reported with; ``small_angle`` is sinc and cosm1 of one angle.
OPERATIONS = ("add", "mul", "div", "sqrt", "sincos", "small_angle")


def weights_text() -> str:
    """The definition of a weight, in one sentence."""
    pair, turn = WEIGHTS["sin"] + WEIGHTS["cos"], WEIGHTS["sinc"] + WEIGHTS["cosm1"]
    return (
        "Operations of a step whose measurement is accepted, each iterate once, small angles by their polynomials. "
        f"Weights: add, mul and comparisons 1, div {WEIGHTS['div']}, sqrt {WEIGHTS['sqrt']}, sincos {pair}, "
        f"small_angle {turn}."
    )


@dataclass(frozen=True)
class Earned:
    """Cost of one step built as ``ablation`` says, its measurement accepted, each iterate once.

    ``operations``: as :meth:`codegen.ir.layout.Listing.operations`; ``weight``: in additions, see
    :data:`codegen.passes.WEIGHTS`.
    """

    ablation: AblationStep
    operations: Counter[str]
    weight: int


def build_ablation(
    model: StateSpaceModel, kind: str, gain: str, ablation: AblationStep
) -> tuple[FilterStep, dict[str, Listing]]:
    """The step and its listings by block name."""
    options = ablation.options
    step = build_fast_filter(model, kind, gain, options) if options else build_filter(model, kind, gain)
    pipelines = (options or EVERYTHING).pipelines
    return step, {block.name: lay_out(optimise(block, pipelines), model.constants) for block in step.blocks}


def earnings(model: StateSpaceModel, kind: str, gain: str) -> list[Earned]:
    """Every ablation's cost."""
    return [earned(ablation, *build_ablation(model, kind, gain, ablation)) for ablation in ABLATION]


def earned(ablation: AblationStep, step: FilterStep, listings: dict[str, Listing]) -> Earned:
    """The cost of a step that was built as ``ablation`` says."""
    path = [listings[block.name] for block in accepted_path(step.body)]
    operations = sum((listing.operations() for listing in path), Counter())
    weights = (weight(ls.graph, [node for nodes in ls.outputs.values() for node in nodes]) for ls in path)
    return Earned(ablation, operations, sum(weights))


def accepted_path(body: tuple[Node, ...]) -> Iterator[Block]:
    """The blocks that run when the measurement is accepted, a loop's once."""
    for node in body:
        if isinstance(node, Call):
            yield node.block
        elif isinstance(node, Repeat):
            yield from accepted_path(node.body)
        elif isinstance(node, If) and node.condition == ACCEPTED:
            yield from accepted_path(node.then)
