"""Cubature Kalman filter, eq. 11-26."""

from __future__ import annotations

from model.filters.conditions import ACCEPTED
from model.filters.cubature import coast
from model.filters.inverter import inverter_calls
from model.filters.program import Call, FilterStep, Guard, If, wrap_angle
from model.filters.sigma_point import measurement_update, time_update
from model.machines.state_space import StateSpaceModel


def build_ckf(model: StateSpaceModel, gain: str = "cubature") -> FilterStep:
    """The CKF's step; ``gain`` is accepted for the registry's sake and changes nothing (eq. 22-24 are the gain).

    Parameters
    ----------
    model : StateSpaceModel
        The symbolic state space model.
    gain : str, optional
        "cubature" or "jacobian"; matters to the ICKF alone.
    """
    update = If(ACCEPTED, (Call(measurement_update(model)),), (Call(coast(model)),))
    predict = (*inverter_calls(model), Call(time_update(model)))
    return FilterStep("ckf", "cubature", model, (Guard(), *predict, update, wrap_angle(model)))
