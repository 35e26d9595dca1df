"""What a design costs on its target, as cycles on paper, and the budget that its drive file gets."""

from __future__ import annotations

from dataclasses import replace

from codegen.evidence.budget import Account
from codegen.generate import Package, count
from codegen.targets.description import Prices
from codegen.targets.find import find_target
from runtime.design.rules import Choice, Design

#: Share of the sample time that filter and controller should take at most.
SHARE = 0.5
#: RAM is granted in so many words, 16 bits each.
WORDS = 32


def priced(design: Design, made: Package) -> Design:
    """The design with a budget, and a remark where the target is too slow for it or has no published prices.

    Parameters
    ----------
    design : Design
    made : Package
        Its generated code, whose operations are counted.
    """
    account = count(made.drive, made.files)[design.kind]
    target = find_target(made.drive.target_name)
    remarks = list(design.remarks)
    budget: dict[str, Choice] = {}
    if target.prices is None:
        remarks.append(f"for {target.title} nothing is published that prices a step. No budget of cycles is set.")
    else:
        budget, said = _cycles(account, target.prices, made.drive.model.sample_time, target.title)
        remarks += said
    words = -(-account.filter.words // WORDS) * WORDS
    budget["ram_words"] = Choice(words, f"16-bit words; the filter's struct takes {account.filter.words}")
    return replace(design, sections={**design.sections, "budget": budget}, remarks=remarks)


def _cycles(account: Account, prices: Prices, T: float, title: str) -> tuple[dict[str, Choice], list[str]]:
    """What filter and controller may take of a sample of T seconds, and what is to be said of it."""
    spent, period = prices.total(account.controller.operations, prices.factors[0]), T * prices.clock
    budget: dict[str, Choice] = {}
    remarks: list[str] = []
    if spent <= period:
        share = SHARE if spent <= SHARE * period else 1.0
        left = "half of T, the rest is yours" if share < 1.0 else f"all of T: {spent} are needed, little is left"
        budget["controller_cycles"] = Choice(
            max(100, min(1_000_000, int(share * period))), f"at {prices.clock / 1e6:g} MHz {left}"
        )
        if share == 1.0:
            remarks.append(f"filter and controller take {spent} of {period:.0f} cycles of a sample on the {title}.")
    else:
        remarks.append(
            f"filter and controller take {spent} cycles on the {title}, a sample has {period:.0f}: a faster processor, "
            f"or a sample of {spent / prices.clock * 1e6:.0f} us or more. No budget is set."
        )
    return budget, remarks
