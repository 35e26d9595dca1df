"""Budgets: the formula, and an error that names the filter, the figure, the budget and what would help."""

from __future__ import annotations

import re

import pytest

from codegen.evidence.budget import BudgetError, check_budget, cycles
from codegen.generate import Package, generate
from model.schema import Budget, Drive
from tests.conftest import shipped_package, variant

pytestmark = pytest.mark.unit


@pytest.fixture
def flux() -> Package:
    return shipped_package("ipmsm_flux")


def limited(package: Package, **limits: float) -> Drive:
    return package.drive.model_copy(update={"budget": Budget(**limits)})


def test_the_formula_is_the_published_one() -> None:
    operations = {"add": 100, "mul": 60, "div": 2, "sqrt": 3, "sincos": 4, "compare": 9, "select": 9}
    assert [cycles(operations, k) for k in (2.5, 4, 5)] == [160 * k + 50 + 87 + 176 + 60 for k in (2.5, 4, 5)]


def test_shipped_budgets_hold_with_margin(drive: Drive) -> None:
    accounts = shipped_package(drive.name).accounts
    check_budget(drive, accounts)
    allowed = drive.budget.controller_cycles
    if allowed is not None:
        assert max(cycles(a.controller.calls, drive.budget.k) for a in accounts.values()) < 0.9 * allowed


def test_no_budget_allows_anything(flux: Package) -> None:
    check_budget(limited(flux), flux.accounts)


def test_the_dearest_filter_is_named_with_what_would_help(flux: Package) -> None:
    ckf, ickf = (cycles(flux.accounts[kind].filter.calls, 2.5) for kind in ("ckf", "ickf"))
    check_budget(limited(flux, cycles=max(ckf, ickf)), flux.accounts)
    with pytest.raises(BudgetError) as caught:
        check_budget(limited(flux, cycles=max(ckf, ickf) - 1), flux.accounts)
    text = str(caught.value)
    assert f"filter 'ickf' takes {ickf} cycles a step (k = 2.5, N_max = 6; computed from published cycles)" in text
    assert f"budget.cycles is {ickf - 1}" in text
    assert "filter.max_iterations = 5" in text
    assert f"kinds without 'ickf' ('ckf': {ckf} cycles)" in text
    assert "\n" not in text


@pytest.mark.slow
def test_the_offered_number_of_iterations_really_fits(flux: Package) -> None:
    with pytest.raises(BudgetError) as caught:
        check_budget(limited(flux, cycles=4500), flux.accounts)
    offered = re.search(r"filter\.max_iterations = (\d+) \((\d+) cycles\)", str(caught.value))
    assert offered is not None
    changed = variant(flux.drive, filter={"max_iterations": int(offered[1])})
    account = generate(changed, samples=5).accounts["ickf"]
    assert cycles(account.filter.calls, 2.5) == int(offered[2]) <= 4500


def test_k_and_the_controller_count(flux: Package) -> None:
    cost = cycles(flux.accounts["ickf"].controller.calls, 5)
    check_budget(limited(flux, controller_cycles=cost, k=5.0), flux.accounts)
    with pytest.raises(BudgetError, match=rf"the controller with filter 'ickf' takes {cost} cycles a step \(k = 5"):
        check_budget(limited(flux, controller_cycles=cost - 1, k=5.0), flux.accounts)


def test_nothing_that_fits_is_said(flux: Package) -> None:
    with pytest.raises(BudgetError, match="'ekf' is the cheapest"):
        check_budget(limited(flux, cycles=100), flux.accounts)


def test_ram(flux: Package) -> None:
    words = flux.accounts["ckf"].filter.words
    check_budget(limited(flux, ram_words=words), flux.accounts)
    with pytest.raises(BudgetError, match=rf"keeps {words} 16-bit words of RAM, budget.ram_words is {words - 1}"):
        check_budget(limited(flux, ram_words=words - 1), flux.accounts)
