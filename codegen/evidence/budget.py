"""Cycles on paper, and the budgets a drive file sets: computed from published cycles, nothing here was measured.

The prices are the target's (:class:`codegen.targets.description.Prices`): k for an operation on numbers, with its loads
and its store; a figure for each other operation; and the interrupt. A target without prices has no cycles.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from codegen.evidence.ledger import Ledger, Program
from codegen.targets.description import Prices
from model.schema import Drive
from model.supervisor.table import MODES


class BudgetError(RuntimeError):
    """A step that costs more than the drive file allows; one line: which, how much, and what would help."""


def share(operations: Mapping[str, int], drive: Drive, prices: Prices) -> float:
    """Share of the sample time that a step takes, at the typical price.

    Parameters
    ----------
    operations : mapping of str to int
        Counts.
    drive : Drive
        Its sample time.
    prices : Prices
    """
    return prices.total(operations, prices.factors[0]) / (prices.clock * drive.model.sample_time)


@dataclass(frozen=True)
class Account:
    """The cost of one filter, alone, with the controller around it, and in a drive; counted in the emitted files."""

    program: Program
    name: str
    max_iterations: int

    @property
    def prices(self) -> Prices | None:
        """The target's; None where nothing is published."""
        return self.program.target.prices

    @cached_property
    def filter(self) -> Ledger:
        """The filter step at its own N_max."""
        return self.program.ledger(f"{self.name}_step", f"{self.name}_t", self.max_iterations)

    @cached_property
    def controller(self) -> Ledger:
        """Phase currents in, duty cycles out; the filter included."""
        return self.program.ledger(f"{self.name}_foc_step", f"{self.name}_foc_t", self.max_iterations)

    @cached_property
    def interrupts(self) -> dict[str, Ledger]:
        """The whole interrupt by the drive's mode, supervisor included: where the filter runs, at its worst."""
        step, struct = f"{self.name}_drive_step", f"{self.name}_drive_t"
        unit, _ = self.program.find(step)
        rivals = "rivals" in unit.fields(f"{self.name}_supervisor_t")
        found = {}
        for place, mode in enumerate(MODES):
            if mode.runs and (rivals or not mode.rivals):
                given = {"mode": place, "runs": mode.runs, "torque": mode.torque, "rivals": mode.rivals}
                found[mode.name] = self.program.ledger(step, struct, self.max_iterations, given)
        return found

    def most_iterations(self, prices: Prices, function: str, budget: int, k: float) -> int | None:
        """Largest N_max below the drive's whose cycles fit, if there is one.

        Parameters
        ----------
        prices : Prices
        function : str
            End of the function's C name: "_step" or "_foc_step".
        budget : int
            Cycles a step.
        k : float
            Cycles an operation on numbers is priced at.

        Returns
        -------
        int or None
            From 1 to the drive's less one; None if none of them fits.
        """
        fitting = [n for n in range(1, self.max_iterations) if self.at(prices, function, n, k) <= budget]
        return max(fitting, default=None)

    def at(self, prices: Prices, function: str, max_iterations: int, k: float) -> int:
        """Return the cycles of a function for another N_max and another price.

        Parameters
        ----------
        prices : Prices
        function : str
            End of the function's C name: "_step" or "_foc_step".
        max_iterations : int
            N_max.
        k : float
            Cycles an operation on numbers is priced at.
        """
        return prices.total(self.program.count(f"{self.name}{function}", max_iterations), k)


def late(drive: Drive, accounts: Mapping[str, Account]) -> dict[str, float]:
    """What takes longer than the sample time, at its worst and at the typical price, and its share of that time.

    Parameters
    ----------
    drive : Drive
    accounts : mapping of str to Account
        By filter kind.

    Returns
    -------
    dict of str to float
        By words such as "ickf and controller" and "ickf, STARTING"; empty where all fit, or nothing is published.
    """
    found: dict[str, float] = {}
    for kind, account in accounts.items():
        if account.prices is not None:
            ledgers = {kind: account.filter, f"{kind} and controller": account.controller}
            ledgers |= {f"{kind}, {mode}": ledger for mode, ledger in account.interrupts.items()}
            shares = {what: share(ledger.operations, drive, account.prices) for what, ledger in ledgers.items()}
            found |= {what: part for what, part in shares.items() if part > 1}
    return found


def check_budget(drive: Drive, accounts: Mapping[str, Account]) -> None:
    """Compare every filter with the drive's ``[budget]``; cycles only where the target has prices.

    Parameters
    ----------
    drive : Drive
        The drive.
    accounts : mapping of str to Account
        Operations and prices by filter kind.

    Raises
    ------
    BudgetError
        At the first budget that is exceeded, for the filter that exceeds it most.
    """
    budget = drive.budget
    for key, function in (("cycles", "_step"), ("controller_cycles", "_foc_step")):
        allowed, prices = getattr(budget, key), next(iter(accounts.values())).prices
        if allowed is not None and prices is not None:
            _check_cycles(drive, accounts, prices, (key, function, allowed))
    if budget.ram_words is not None:
        kind, account = max(accounts.items(), key=lambda item: item[1].filter.words)
        if account.filter.words > budget.ram_words:
            raise BudgetError(
                f"drive '{drive.name}': filter '{kind}' keeps {account.filter.words} 16-bit words of RAM, "
                f"budget.ram_words is {budget.ram_words}. "
                "What would help: fewer states, since the covariance grows with their square."
            )


def _check_cycles(drive: Drive, accounts: Mapping[str, Account], prices: Prices, limit: tuple[str, str, int]) -> None:
    key, function, allowed = limit
    k, n = drive.budget.k, drive.filter.max_iterations
    spent = {kind: account.at(prices, function, n, k) for kind, account in accounts.items()}
    kind = max(spent, key=lambda name: spent[name])
    if spent[kind] <= allowed:
        return
    helps = []
    fitting = accounts[kind].most_iterations(prices, function, allowed, k)
    if fitting is not None:
        helps.append(f"filter.max_iterations = {fitting} ({accounts[kind].at(prices, function, fitting, k)} cycles)")
    helps += [f"kinds without '{kind}' ('{name}': {cost} cycles)" for name, cost in spent.items() if cost <= allowed]
    if not helps:
        helps = ["a cheaper kind ('ekf' is the cheapest)", "fewer states", "a longer sample_time with a larger budget"]
    what = f"filter '{kind}'" if function == "_step" else f"the controller with filter '{kind}'"
    raise BudgetError(
        f"drive '{drive.name}': {what} takes {spent[kind]} cycles a step (k = {k:g}, N_max = {n}; computed from "
        f"published cycles), budget.{key} is {allowed}. What would help: {', or '.join(helps)}."
    )
