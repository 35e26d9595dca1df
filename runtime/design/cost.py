"""What a design costs on the F28335, as cycles on paper, and the budget that its drive file gets."""

from __future__ import annotations

from dataclasses import replace

from codegen.evidence.budget import CLOCK, FACTORS, cycles
from codegen.generate import Package, count
from runtime.design.rules import Choice, Design

#: Share of the sample time that filter and controller should take at most.
SHARE = 0.5
#: RAM is granted in so many words, 16 bits each.
WORDS = 32


def priced(design: Design, made: Package) -> Design:
    """The design with a budget, and a remark where the F28335 is too slow for it.

    Parameters
    ----------
    design : Design
    made : Package
        Its generated code, whose operations are counted.
    """
    account = count(made.drive, made.files)[design.kind]
    spent, period = cycles(account.controller.calls, FACTORS[0]), made.drive.model.sample_time * CLOCK
    remarks = list(design.remarks)
    budget = {}
    if spent <= period:
        share = SHARE if spent <= SHARE * period else 1.0
        left = "half of T, the rest is yours" if share < 1.0 else f"all of T: {spent} are needed, little is left"
        budget["controller_cycles"] = Choice(max(100, min(1_000_000, int(share * period))), f"at 150 MHz {left}")
        if share == 1.0:
            remarks.append(f"filter and controller take {spent} of {period:.0f} cycles of a sample on the F28335.")
    else:
        remarks.append(
            f"filter and controller take {spent} cycles on the F28335, a sample has {period:.0f}: a faster processor, "
            f"or a sample of {spent / CLOCK * 1e6:.0f} us or more. No budget is set."
        )
    words = -(-account.filter.words // WORDS) * WORDS
    budget["ram_words"] = Choice(words, f"16-bit words; the filter's struct takes {account.filter.words}")
    return replace(design, sections={**design.sections, "budget": budget}, remarks=remarks)
