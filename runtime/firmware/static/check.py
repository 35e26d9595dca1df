"""The result of a gate: one line of a table, and a verdict that cannot be mistaken for another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Check:
    """One gate on one piece of generated C.

    ``how`` words the evidence honestly: ``"measured on a stand-in"``, ``"computed from published cycles"``,
    ``"proved"``, ``"argued"``. ``"not run"`` is a state of its own: a missing tool is never a pass. So is
    ``"not proved"``: a prover that could exclude an error neither way; no pass, and no failure.
    """

    name: str
    subject: str
    state: Literal["passed", "failed", "not run", "not proved"]
    figure: str
    how: str
    detail: tuple[str, ...] = ()
