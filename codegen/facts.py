"""What manifest.json says of a generated folder, for programs: inputs, costs, certificate."""

from __future__ import annotations

from dataclasses import asdict
from importlib.metadata import version
from typing import Any

from codegen.evidence.budget import FACTORS, Account, cycles, share
from codegen.evidence.certificate import Figures
from codegen.evidence.ledger import Ledger
from codegen.evidence.measure import Record
from codegen.output.version import __version__
from codegen.render.drive import plant_data
from codegen.render.selftest import SelfTest
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
        "form": "literal" if any(step.covariance == "P" for step in steps.values()) else "fast",
        "input_sha256": drive.sha256,
        "versions": {"pmsm-ickf": __version__, "casadi": version("casadi"), "sympy": version("sympy")},
        "parameters": drive.stated,
        "states": [{"name": state.name, "unit": state.unit} for state in model.states],
    }


def facts(
    drive: Drive,
    model: StateSpaceModel,
    steps: dict[str, FilterStep],
    accounts: dict[str, Account],
    measured: dict[str, Record],
    figures: dict[str, Figures],
    tests: dict[str, SelfTest],
) -> dict[str, Any]:
    """All of the manifest but its files' hashes.

    Parameters
    ----------
    drive : Drive
    model : StateSpaceModel
    steps : dict of str to FilterStep
        By filter kind, as accounts and figures.
    accounts : dict of str to Account
    measured : dict of str to Record
        By the function's C name.
    figures : dict of str to Figures
    tests : dict of str to SelfTest
        By C name without the drive's.
    """
    return {
        **identity(drive, model, steps),
        "filters": {
            kind: {
                "gain": step.gain,
                "iteration": step.iteration_proof or ("bounded loop" if kind == "ickf" else "none"),
                **_cost_facts(accounts[kind].filter),
                "controller": _cost_facts(accounts[kind].controller),
                "interrupt": {
                    mode: {**_cost_facts(ledger), "share_of_sample": round(share(ledger.calls, drive), 4)}
                    for mode, ledger in accounts[kind].interrupts.items()
                },
                "certificate": _rounded(asdict(figures[kind].certificate)),
                "chip_model": {name: _rounded(item) for name, item in asdict(figures[kind].chip).items()},
                "selftest": {"vectors": tests[kind].vectors, "words": tests[kind].words},
            }
            for kind, step in steps.items()
        },
        "measured": measured,
        "plant": {"motor": plant_data(drive)},
    }


def _cost_facts(ledger: Ledger) -> dict[str, Any]:
    """Operations and cycles; ``estimated_cycles`` is the figure at k = 2.5."""
    return {
        "operations": ledger.calls,
        "operations_sincos_expanded": ledger.expanded,
        "estimated_cycles": cycles(ledger.calls, FACTORS[0]),
        "cycles": {f"{k:g}": cycles(ledger.calls, k) for k in FACTORS},
        "cycles_sincos_expanded": {f"{k:g}": cycles(ledger.expanded, k) for k in FACTORS},
        "state_words": ledger.words,
    }


def _rounded(certificate: dict[str, Any]) -> dict[str, Any]:
    """Two digits: what a certificate claims, and the same on every machine."""
    certificate["x"] = [float(f"{value:.1e}") for value in certificate["x"]]
    for name in ("P", "P_99"):
        certificate[name] = float(f"{certificate[name]:.1e}")
    return certificate
