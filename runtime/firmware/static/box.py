"""The states a proof starts from: an interval for each word of the filter's struct, and for its inputs.

Covariances are boxed in one of two forms. ``P``: the words are P's lower triangle. ``LD``: they are the factors of
P = L D L^T, D on the diagonal, L below it. Then P > 0 is an interval's business: D > 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from codegen.fast.guards import sane_limit
from model.machines import MACHINES

#: Variances in the box reach this times P_0 (or Q, where that is more). Intervals forget how the entries of a
#: covariance belong together, and quotients of them grow: beyond this the proof of a four-state filter overflows.
MARGIN = 2.0

#: Inputs reach this times what the step accepts, so that the proof covers rejected inputs too.
BEYOND = 2.0

#: The largest float32 below pi, where wrapping ends.
BELOW_PI = float(np.nextafter(np.float32(math.pi), np.float32(0)))


@dataclass(frozen=True)
class Interval:
    """All float32 in [low, high]."""

    low: float
    high: float

    @classmethod
    def within(cls, size: float) -> Interval:
        """Make the interval -size .. size."""
        return cls(-size, size)


@dataclass(frozen=True)
class Box:
    """Intervals by C place: ``f.x[0]``, ``f.LD[3]``, ``u[1]``; ``f`` is the struct, u and y the inputs."""

    places: dict[str, Interval]

    def replaced(self, **changes: Interval) -> Box:
        """Return the box with some of its intervals replaced."""
        return Box({**self.places, **changes})


def known_machine(manifest: dict[str, Any]) -> bool:
    """Whether this module can bound the machine's states and its measurement Jacobian; not one of the user's own."""
    return manifest["parameters"]["model"]["machine"] in MACHINES


def filter_box(manifest: dict[str, Any], field: str) -> Box:
    """The box of a generated folder's drive, from what its manifest says of the drive.

    States: the operating box. Variances: up to :data:`MARGIN` times P_0. Inputs: :data:`BEYOND` what is accepted.
    """
    parameters = manifest["parameters"]
    names = [state["name"] for state in manifest["states"]]
    box = parameters["operating_box"]
    places = {f"f.x[{k}]": _state(name, parameters) for k, name in enumerate(names)}
    places |= {f"f.{field}[{k}]": interval for k, interval in enumerate(_covariance(names, parameters, field))}
    if field == "LD":
        limit = sane_limit(parameters["filter"]["initial_covariance"], parameters["filter"]["process_noise"])
        places["f.nis"] = Interval(0.0, 4.0 * limit)  # beyond it the step restarts
    for k in range(2):
        places[f"f.u_held[{k}]"] = Interval.within(box["voltage"])
        places[f"u[{k}]"] = Interval.within(BEYOND * box["voltage"])
        places[f"y[{k}]"] = Interval.within(BEYOND * box["current"])
    return Box(places)


def _state(name: str, parameters: dict[str, Any]) -> Interval:
    motor, box = parameters["motor"], parameters["operating_box"]
    if name == "theta":
        return Interval.within(BELOW_PI)
    if name.startswith("psi"):
        return Interval.within(_flux(parameters))
    if name in motor:  # an adaptive state: a motor's value, at most doubled
        return Interval(0.0, 2.0 * motor[name])
    if name == "dead_time_voltage":  # a leg loses at most what a leg has
        return Interval.within(parameters["control"]["dc_link"])
    sizes = {"i_alpha": "current", "i_beta": "current", "omega": "speed", "load_torque": "load_torque"}
    return Interval.within(box[sizes[name]])


def _flux(parameters: dict[str, Any]) -> float:
    """Largest flux linkage in the operating box, Wb."""
    motor, current = parameters["motor"], parameters["operating_box"]["current"]
    return float(motor["magnet_flux"] + max(motor["inductance_d"], motor["inductance_q"]) * current)


def _covariance(names: list[str], parameters: dict[str, Any], field: str) -> list[Interval]:
    """One interval a word of the lower triangle, row by row; of factors in the order in which P is factored."""
    tuning = parameters["filter"]
    order = [names.index(name) for name in (tuning.get("root_order") if field == "LD" else None) or names]
    Q, P_0 = tuning["process_noise"], tuning["initial_covariance"]
    top = [MARGIN * max(q, p) for q, p in zip(Q, P_0, strict=True)]
    least = [_least_pivot(name, q, parameters) for name, q in zip(names, Q, strict=True)]
    words = []
    for k, i in enumerate(order):
        for j in order[:k]:
            # |P_ij| <= sqrt(P_ii P_jj);  |L_ij| <= sqrt(P_ii / D_j), since P_ii is a sum that holds L_ij^2 D_j
            size = math.sqrt(top[i] * top[j]) if field == "P" else math.sqrt(top[i] / least[j])
            words.append(Interval.within(size))
        words.append(Interval(least[i], top[i]))
    return words


def _least_pivot(name: str, q: float, parameters: dict[str, Any]) -> float:
    """The lower bound of D_j, and so of P_jj, after a measurement.

    P_pred >= Q, so 1 / D_j <= (P^-1)_jj <= 1 / Q_j + (H^T R^-1 H)_jj. H is bounded over the operating box.
    """
    motor, r = parameters["motor"], min(parameters["filter"]["measurement_noise"])
    if name in {"i_alpha", "i_beta"}:
        slope = 1.0
    elif parameters["model"]["machine"] == "surface":
        slope = 0.0
    else:  # flux states: i = R(theta) diag(1/L_d, 1/L_q) (R(-theta) psi - (psi_m, 0))
        inverse = 1.0 / min(motor["inductance_d"], motor["inductance_q"])
        per_angle = inverse * (2.0 * _flux(parameters) + motor["magnet_flux"])
        slope = {"psi_alpha": inverse, "psi_beta": inverse, "theta": per_angle, "magnet_flux": inverse}.get(name, 0.0)
    return float(1.0 / (1.0 / q + 2.0 * slope * slope / r))
