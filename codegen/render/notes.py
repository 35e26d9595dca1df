"""The head comment of a generated C file: purpose, cost, and how far its numbers can be trusted."""

from __future__ import annotations

from collections.abc import Sequence

from codegen.evidence.budget import Account, cycles
from codegen.evidence.certificate import Certificate, ChipModel
from codegen.evidence.ledger import Ledger
from codegen.render.printers.targets import Target
from model.filters import FilterStep
from model.quantities import Quantity

#: The meaning of another order of the states.
ROOT_NOTE = "a square root, and points, other than in the state's own order"


def filter_notes(
    step: FilterStep,
    target: Target,
    states: Sequence[Quantity],
    account: Account | None,
    certificate: Certificate,
    chip: ChipModel,
) -> list[str]:
    """Lines of a filter's head; ``account`` is None while the text is still to be counted, and for the host.

    Parameters
    ----------
    step : FilterStep
    target : Target
    states : sequence of Quantity
        Their names and units.
    account : Account or None
        What the text costs.
    certificate : Certificate
        Float32 against float64 on the host.
    chip : ChipModel
        What the chip is expected to add.
    """
    notes = [f"For {target.purpose}."]
    if account is not None:
        notes += cost_notes(account.filter)
    if step.model.root_order and step.kind != "ekf":
        notes.append(f"P is factored in the order {', '.join(step.model.root_order)}: {ROOT_NOTE}.")
    if step.kind == "ickf":
        iteration = (
            "one pass: H is constant, iterating is provably idle"
            if step.iteration_proof
            else "loop over one update, at most N_max"
        )
        notes.append(f"Gain: {step.gain}. Iteration: {iteration}.")
    if target.generated_trig:
        notes += [
            f"float32 against float64, one step, worst of {certificate.samples} draws from the operating box:",
            f"  {_deviation(states, certificate)}.",
            "On the chip its division, root and flush to zero are expected to add",
            f"  {_deviation(states, chip.fpu32)}",
            "  (modelled, not measured; seeds after an emulator's tables, unverified on silicon).",
        ]
    return notes


def cost_notes(ledger: Ledger, title: str = "Cost at most") -> list[str]:
    """Operations, cycles and RAM, worst case.

    Parameters
    ----------
    ledger : Ledger
    title : str, optional
        How the first line begins.
    """
    ops = ledger.calls
    return [
        f"{title}: {ops['add']} add, {ops['mul']} mul, {ops['div']} div, {ops['sqrt']} sqrt, {ops['sincos']} sincos;",
        f"  estimated {cycles(ops, 2.5)} cycles on C28x + FPU32 (k = 2.5; {cycles(ops, 5)} at k = 5; "
        f"from published cycles, not measured), {ledger.words} words of state.",
    ]


def _deviation(states: Sequence[Quantity], certificate: Certificate) -> str:
    worst = ", ".join(
        f"{state.name} {error:.1e} {state.unit}" for state, error in zip(states, certificate.x, strict=True)
    )
    return f"{worst}, P {certificate.P:.1e} relative (99 %: {certificate.P_99:.1e})"
