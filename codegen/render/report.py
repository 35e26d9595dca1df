"""REPORT.md of a generated folder: equations, states, iteration, modes, budget, certificate."""

from __future__ import annotations

from typing import Any

from codegen.evidence.budget import Account, late
from codegen.evidence.certificate import Figures
from codegen.evidence.ledger import RECIPROCAL, TOLD, Ledger
from codegen.evidence.measure import Record
from codegen.ir.trig import sin_cos_bound
from codegen.render.fill import render
from codegen.render.filter import FILTER_TITLES, Description
from codegen.render.selftest import SelfTest
from codegen.render.supervisor import machine_of
from codegen.render.transitions import modes_context
from codegen.targets.description import Prices
from model.filters import FilterStep


def render_report(
    about: Description,
    steps: dict[str, FilterStep],
    accounts: dict[str, Account],
    measured: dict[str, Record],
    figures: dict[str, Figures],
    tests: dict[str, SelfTest],
) -> str:
    """The readable side of the manifest.

    Parameters
    ----------
    about : Description
    steps : dict of str to FilterStep
        By filter kind, as accounts and figures.
    accounts : dict of str to Account
    measured : dict of str to Record
        By the function's C name.
    figures : dict of str to Figures
    tests : dict of str to SelfTest
        By the C name's end, such as "ickf_foc".
    """
    from codegen.render.equations import readable, sparsity  # SymPy takes longer to load than all else together

    drive, model = about.drive, about.model
    eq = readable(drive)
    return render(
        "report.md.j2",
        about=about,
        target=about.target,
        stand_in=about.target.stand_in,
        drive=drive,
        states=[
            {"q": state, "x_0": f"{x0:g}", "P_0": f"{p:g}", "Q": f"{q:g}"}
            for state, x0, p, q in zip(
                model.states,
                about.initial_state,
                drive.filter.initial_covariance,
                drive.filter.process_noise,
                strict=True,
            )
        ],
        discretization=model.exact_meaning if drive.model.discretization == "exact" else "forward Euler (eq. 7)",
        inverter=[(eq.latex(left), eq.latex(right)) for left, right in eq.inverter],
        f=[(eq.latex(left), eq.latex(right)) for left, right in eq.f],
        h=[(eq.latex(left), eq.latex(right)) for left, right in eq.h],
        H=eq.latex(eq.H),
        G=[(eq.latex(left), eq.latex(right)) for left, right in eq.G],
        constants=eq.constants,
        sparsity=sparsity(model),
        steps=steps,
        supervisor=modes_context(machine_of(about, next(iter(steps.values()))), drive.model.sample_time),
        budget=_budget(about, accounts, measured),
        figures=figures,
        tests=tests,
        titles=FILTER_TITLES,
        trig=sin_cos_bound(),
    )


def _budget(about: Description, accounts: dict[str, Account], measured: dict[str, Record]) -> dict[str, Any]:
    """Rows of the Budget section: one a filter, and one for the controller around it."""
    prices = about.target.prices
    periods = {**prices.periods, **_period(about, prices)} if prices else {}
    rows = []
    for kind, account in accounts.items():
        for subject, ledger, function in (
            (kind, account.filter, f"{account.name}_step"),
            (f"{kind} and controller", account.controller, f"{account.name}_foc_step"),
        ):
            rows.append(_row(subject, ledger, measured[function], prices, periods))
    missing = sorted({row["not_measured"] for row in rows if row["not_measured"]})
    compilers = sorted({record["compiler"] for record in measured.values() if "compiler" in record})
    return {
        "interrupts": _interrupts(about, accounts, measured),
        "reciprocals": _reciprocals(accounts, prices),
        "rivals": any("STARTING" in account.interrupts for account in accounts.values()),
        "operations": TOLD,
        "prices": prices,
        "clock": f"{prices.clock / 1e6:g} MHz" if prices else "",
        "periods": periods,
        "rows": rows,
        "late": [f"{what} ({100 * part:.0f} %)" for what, part in late(about.drive, accounts).items()],
        "missing": missing,
        "compilers": compilers,
        "limits": {key: value for key, value in about.drive.budget.model_dump().items() if value is not None},
    }


def _reciprocals(accounts: dict[str, Account], prices: Prices | None) -> list[tuple[str, int, int]]:
    """By filter: its reciprocals, and the cycles of its step with each in line; none where that has no price."""
    if prices is None or not prices.reciprocal:
        return []
    saved = prices.cycles["div"] - prices.reciprocal
    counted = {kind: account.filter.operations for kind, account in accounts.items()}
    return [
        (kind, count[RECIPROCAL], prices.total(count, prices.factors[0]) - saved * count[RECIPROCAL])
        for kind, count in counted.items()
        if count.get(RECIPROCAL)
    ]


def _period(about: Description, prices: Prices) -> dict[str, int]:
    """Cycles of the drive's own sample time."""
    return {about.sample_time: round(prices.clock * about.drive.model.sample_time)}


def _interrupts(about: Description, accounts: dict[str, Account], measured: dict[str, Record]) -> list[dict[str, Any]]:
    """Rows of the whole interrupt: a filter and a mode each."""
    prices = about.target.prices
    period = _period(about, prices) if prices else {}
    return [
        _row(f"{kind}, {mode}", ledger, measured[f"{account.name}_drive_step"], prices, period)
        for kind, account in accounts.items()
        for mode, ledger in account.interrupts.items()
    ]


def _row(
    subject: str, ledger: Ledger, record: Record, prices: Prices | None, periods: dict[str, int]
) -> dict[str, Any]:
    cycles = [prices.total(ledger.operations, k) for k in prices.factors] if prices else []
    return {
        "subject": subject,
        "ledger": ledger,
        "cycles": cycles,
        "shares": [[round(100 * value / period) for value in cycles] for period in periods.values()],
        "stack": record.get("stack_bytes", "not measured"),
        "text": record.get("text_bytes", "not measured"),
        "not_measured": record.get("not_measured"),
    }
