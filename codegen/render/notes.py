"""The head comment of a generated C file: purpose, cost, and how far its numbers can be trusted."""

from __future__ import annotations

from collections.abc import Sequence

from codegen.evidence.budget import Account
from codegen.evidence.certificate import Certificate, ChipModel
from codegen.evidence.ledger import OPERATIONS, Ledger
from codegen.targets.description import Prices, Target
from model.filters import FilterStep
from model.quantities import Quantity

#: For what the float64 C is.
HOST_PURPOSE = "the host, for comparison: float64, the platform's sin and cos"

#: The meaning of another order of the states.
ROOT_NOTE = "a square root, and points, other than in the state's own order"


def filter_notes(
    step: FilterStep,
    target: Target | None,
    states: Sequence[Quantity],
    account: Account,
    certificate: Certificate,
    chip: ChipModel | None,
) -> list[str]:
    """Lines of a filter's head.

    Parameters
    ----------
    step : FilterStep
    target : Target or None
        None: float64 for the host, whose cost and rounding are not told.
    states : sequence of Quantity
        Their names and units.
    account : Account
        What the text costs.
    certificate : Certificate
        Float32 against float64 on the host.
    chip : ChipModel or None
        What the chip is expected to add; None: nothing.
    """
    notes = [f"For {target.purpose if target else HOST_PURPOSE}."]
    if step.constant_time:
        notes.append("Constant time: every step whose status is 0 takes the same path, whatever its numbers.")
    if target is not None:
        notes += cost_notes(account.filter, account.prices)
    if step.model.root_order and step.kind != "ekf":
        notes.append(f"P is factored in the order {', '.join(step.model.root_order)}: {ROOT_NOTE}.")
    if step.kind == "ickf":
        iteration = (
            "one pass: H is constant, iterating is provably idle"
            if step.iteration_proof
            else "N_max passes of one update"
            if step.constant_time
            else "loop over one update, at most N_max"
        )
        notes.append(f"Gain: {step.gain}. Iteration: {iteration}.")
    if target is not None:
        notes += [
            f"float32 against float64, one step, worst of {certificate.samples} draws from the operating box:",
            f"  {_deviation(states, certificate)}.",
        ]
    if target is not None and target.arithmetic is not None and chip is not None:
        notes += [
            f"On the chip its {target.arithmetic.differs} are expected to add",
            f"  {_deviation(states, chip.fpu32)}",
            f"  {target.arithmetic.caveat}",
        ]
    return notes


def cost_notes(ledger: Ledger, prices: Prices | None, title: str = "Cost at most") -> list[str]:
    """Operations, cycles and RAM, worst case.

    Parameters
    ----------
    ledger : Ledger
    prices : Prices or None
        None: nothing is said of cycles.
    title : str, optional
        How the first line begins.
    """
    ops = ledger.operations
    counts = ", ".join(f"{ops[name]} {name}" for name in OPERATIONS)
    if prices is None:
        return [f"{title}: {counts};", f"  {2 * ledger.words} bytes of state."]
    typical, bound = prices.factors[0], prices.factors[-1]
    return [
        f"{title}: {counts};",
        f"  estimated {prices.total(ops, typical)} cycles on {prices.on} (k = {typical:g}; "
        f"{prices.total(ops, bound)} at k = {bound:g}; from published cycles, not measured), "
        f"{ledger.words} words of state.",
    ]


def _deviation(states: Sequence[Quantity], certificate: Certificate) -> str:
    worst = ", ".join(
        f"{state.name} {error:.1e} {state.unit}" for state, error in zip(states, certificate.x, strict=True)
    )
    return f"{worst}, P {certificate.P:.1e} relative (99 %: {certificate.P_99:.1e})"
