"""What manifest.json says of a generated folder, for programs: inputs, costs, certificate."""

from __future__ import annotations

from dataclasses import asdict
from importlib.metadata import version
from typing import Any

from codegen.evidence.budget import Account, share
from codegen.evidence.certificate import ChipModel, Figures
from codegen.evidence.ledger import Ledger
from codegen.evidence.measure import Record
from codegen.output.version import __version__
from codegen.render.drive import plant_data
from codegen.render.filter import Description
from codegen.render.selftest import SelfTest
from codegen.targets.description import Prices
from model.filters import FilterStep
from model.machines.state_space import StateSpaceModel
from model.schema import Drive


def identity(drive: Drive, model: StateSpaceModel, steps: dict[str, FilterStep]) -> dict[str, Any]:
    """The inputs that a folder was generated from.

    Parameters
    ----------
    drive : Drive
    model : StateSpaceModel
    steps : dict of str to FilterStep
    """
    return {
        "drive": drive.name,
        "target": drive.target_name,
        "form": "literal" if any(step.covariance == "P" for step in steps.values()) else "fast",
        "input_sha256": drive.sha256,
        "versions": {"pmsm-ickf": __version__, "casadi": version("casadi"), "sympy": version("sympy")},
        "parameters": drive.stated,
        "states": [{"name": state.name, "unit": state.unit} for state in model.states],
    }


def facts(
    about: Description,
    steps: dict[str, FilterStep],
    accounts: dict[str, Account],
    measured: dict[str, Record],
    figures: dict[str, Figures],
    tests: dict[str, SelfTest],
) -> dict[str, Any]:
    """All of the manifest but its files' hashes.

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
        By C name without the drive's.
    """
    drive = about.drive
    return {
        **identity(drive, about.model, steps),
        "filters": {
            kind: {
                "gain": step.gain,
                "iteration": step.iteration_proof or ("bounded loop" if kind == "ickf" else "none"),
                **_cost_facts(accounts[kind].filter, accounts[kind].prices),
                "controller": _cost_facts(accounts[kind].controller, accounts[kind].prices),
                "interrupt": {
                    mode: _interrupt_facts(ledger, drive, accounts[kind].prices)
                    for mode, ledger in accounts[kind].interrupts.items()
                },
                "certificate": _rounded(asdict(figures[kind].certificate)),
                "chip_model": _chip_facts(figures[kind].chip),
                "selftest": {"vectors": tests[kind].vectors, "words": tests[kind].words},
            }
            for kind, step in steps.items()
        },
        "measured": measured,
        "plant": {"motor": plant_data(about)},
    }


def _cost_facts(ledger: Ledger, prices: Prices | None) -> dict[str, Any]:
    """Operations and cycles; ``estimated_cycles`` is the figure at the typical price. No prices, no cycles."""
    priced = {}
    if prices is not None:
        priced = {
            "estimated_cycles": prices.total(ledger.operations, prices.factors[0]),
            "cycles": {f"{k:g}": prices.total(ledger.operations, k) for k in prices.factors},
        }
    return {
        "operations": ledger.operations,
        **priced,
        "state_words": ledger.words,
    }


def _interrupt_facts(ledger: Ledger, drive: Drive, prices: Prices | None) -> dict[str, Any]:
    """The same of a whole interrupt, and its share of the sample time."""
    part = {"share_of_sample": round(share(ledger.operations, drive, prices), 4)} if prices is not None else {}
    return _cost_facts(ledger, prices) | part


def _chip_facts(chip: ChipModel | None) -> dict[str, Any] | None:
    """What the chip is expected to add; None where its arithmetic is IEEE's."""
    return {name: _rounded(item) for name, item in asdict(chip).items()} if chip is not None else None


def _rounded(certificate: dict[str, Any]) -> dict[str, Any]:
    """Two digits: what a certificate claims, and the same on every machine."""
    certificate["x"] = [float(f"{value:.1e}") for value in certificate["x"]]
    for name in ("P", "P_99"):
        certificate[name] = float(f"{certificate[name]:.1e}")
    return certificate
