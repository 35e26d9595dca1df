"""Machines: one class with its equations each. ``MACHINES`` maps a drive file's word to the class."""

from __future__ import annotations

from model.machines.base import Machine
from model.machines.salient_flux import SalientFluxPMSM
from model.machines.surface import SurfacePMSM

MACHINES: dict[str, type[Machine]] = {
    "surface": SurfacePMSM,
    "salient_flux": SalientFluxPMSM,
}

__all__ = ["MACHINES", "Machine", "SalientFluxPMSM", "SurfacePMSM"]
