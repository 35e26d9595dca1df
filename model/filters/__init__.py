"""Filters: one function each, from a state-space model to a symbolic step with named stages.

A step is a short program (:mod:`model.filters.program`) over blocks; a block is a list of stages, each
carrying the paper's equation number.
"""

from __future__ import annotations

from collections.abc import Callable

from model.filters.ckf import build_ckf
from model.filters.ekf import build_ekf
from model.filters.ickf import build_ickf
from model.filters.program import FilterStep
from model.filters.ukf import build_ukf
from model.machines.state_space import StateSpaceModel

FILTERS: dict[str, Callable[[StateSpaceModel, str], FilterStep]] = {
    "ckf": build_ckf,
    "ickf": build_ickf,
    "ekf": build_ekf,
    "ukf": build_ukf,
}


def build_filter(model: StateSpaceModel, kind: str, gain: str) -> FilterStep:
    """The symbolic step of a filter (``ekf``, ``ukf``, ``ckf``, ``ickf``); ``gain`` matters to the ICKF only.

    Parameters
    ----------
    model : StateSpaceModel
        The symbolic state space model.
    kind : str
        Filter kind, such as "ickf".
    gain : str
        "cubature" or "jacobian"; matters to the ICKF alone.
    """
    return FILTERS[kind](model, gain)


__all__ = ["FILTERS", "FilterStep", "build_filter"]
