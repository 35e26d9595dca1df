"""Budgets: the formula, and an error that names the filter, the figure, the budget and what would help."""

from __future__ import annotations

import pytest

from codegen.evidence.budget import Account, BudgetError, check_budget, late
from codegen.generate import count, generate_bare
from codegen.targets.find import default_target
from model.drives.load import load_drive
from model.schema import Budget, Drive
from tests.conftest import shipped_accounts, variant

pytestmark = pytest.mark.unit


PRICES = default_target().prices
assert PRICES is not None
cycles = PRICES.total
FLUX = load_drive("ipmsm_flux")


@pytest.fixture
def flux() -> dict[str, Account]:
    return shipped_accounts("ipmsm_flux")


def limited(**limits: float) -> Drive:
    return FLUX.model_copy(update={"budget": Budget(**limits)})


def refusal(drive: Drive, accounts: dict[str, Account]) -> str:
    """What is said of a budget that is exceeded; nothing where all keep it."""
    try:
        check_budget(drive, accounts)
    except BudgetError as error:
        return str(error)
    return ""


def test_the_formula_is_the_published_one() -> None:
    operations = {"add": 100, "mul": 60, "div": 2, "sqrt": 3, "compare": 9, "select": 7, "branch": 8, "call": 5}
    told = {"sincos": 4}  # their arithmetic is among the rest
    expected = [176 * k + 50 + 87 + 56 + 60 + 60 for k in (2.5, 4, 5)]
    assert [cycles(operations | told, k) for k in (2.5, 4, 5)] == expected


def test_shipped_budgets_hold_with_margin(drive: Drive) -> None:
    accounts = shipped_accounts(drive.name)
    assert refusal(drive, accounts) == ""
    allowed = drive.budget.controller_cycles
    if allowed is not None:
        assert max(cycles(a.controller.operations, drive.budget.k) for a in accounts.values()) < 0.9 * allowed


def test_no_budget_allows_anything(flux: dict[str, Account]) -> None:
    assert refusal(limited(), flux) == ""


def test_the_dearest_filter_is_named_with_what_would_help(flux: dict[str, Account]) -> None:
    ckf, ickf = (cycles(flux[kind].filter.operations, 2.5) for kind in ("ckf", "ickf"))
    assert refusal(limited(cycles=max(ckf, ickf)), flux) == ""
    with pytest.raises(BudgetError) as caught:
        check_budget(limited(cycles=max(ckf, ickf) - 1), flux)
    text = str(caught.value)
    assert f"filter 'ickf' takes {ickf} cycles a step (k = 2.5, N_max = 6; computed from published cycles)" in text
    assert f"budget.cycles is {ickf - 1}" in text
    assert "filter.max_iterations = 5" in text
    assert f"kinds without 'ickf' ('ckf': {ckf} cycles)" in text
    assert "\n" not in text


@pytest.mark.slow
def test_the_offered_number_of_iterations_really_fits(flux: dict[str, Account]) -> None:
    """Three are offered where three take all that is allowed, and generated they take it."""
    three = variant(FLUX, filter={"max_iterations": 3})
    allowed = cycles(count(three, generate_bare(three).files)["ickf"].filter.operations, 2.5)
    assert f"filter.max_iterations = 3 ({allowed} cycles)" in refusal(limited(cycles=allowed), flux)
    assert "filter.max_iterations = 2 (" in refusal(limited(cycles=allowed - 1), flux)


def test_k_and_the_controller_count(flux: dict[str, Account]) -> None:
    cost = cycles(flux["ickf"].controller.operations, 5)
    assert refusal(limited(controller_cycles=cost, k=5.0), flux) == ""
    with pytest.raises(BudgetError, match=rf"the controller with filter 'ickf' takes {cost} cycles a step \(k = 5"):
        check_budget(limited(controller_cycles=cost - 1, k=5.0), flux)


def test_nothing_that_fits_is_said(flux: dict[str, Account]) -> None:
    with pytest.raises(BudgetError, match="'ekf' is the cheapest"):
        check_budget(limited(cycles=100), flux)


def test_ram(flux: dict[str, Account]) -> None:
    words = flux["ckf"].filter.words
    assert refusal(limited(ram_words=words), flux) == ""
    with pytest.raises(BudgetError, match=rf"keeps {words} 16-bit words of RAM, budget.ram_words is {words - 1}"):
        check_budget(limited(ram_words=words - 1), flux)


def test_what_takes_longer_than_the_sample_time_is_found(flux: dict[str, Account]) -> None:
    """At the typical price; just as long is in time."""
    longest = cycles(flux["ickf"].interrupts["STARTING"].operations, 2.5)
    for more, expected in ((0, set()), (1, {"ickf, STARTING"})):
        period = (longest - more) / 150e6
        found = late(variant(FLUX, model={"sample_time": period}), flux)
        assert set(found) == expected
        assert all(found[what] == pytest.approx(longest / (longest - more)) for what in expected)
    everything = late(variant(FLUX, model={"sample_time": 1e-6}), flux)
    assert [*everything][:3] == ["ckf", "ckf and controller", "ckf, CATCHING"]
    assert everything["ckf"] == pytest.approx(cycles(flux["ckf"].filter.operations, 2.5) / 150)
