"""Unscented Kalman filter after Julier and Uhlmann (1997): the cubature points and one in the centre."""

from __future__ import annotations

from model.filters.conditions import ACCEPTED
from model.filters.cubature import Rule, coast
from model.filters.inverter import inverter_calls
from model.filters.program import Call, FilterStep, Guard, If, wrap_angle
from model.filters.sigma_point import measurement_update, time_update
from model.machines.state_space import StateSpaceModel

#: kappa = 1: all weights are positive, so that P stays positive definite in float32 too.
UNSCENTED = Rule("ukf", kappa=1.0)


def build_ukf(model: StateSpaceModel, gain: str = "cubature") -> FilterStep:
    """The UKF's step; points are drawn anew for the measurement. ``gain`` changes nothing.

    Parameters
    ----------
    model : StateSpaceModel
        The symbolic state space model.
    gain : str, optional
        "cubature" or "jacobian"; matters to the ICKF alone.
    """
    update = If(ACCEPTED, (Call(measurement_update(model, UNSCENTED)),), (Call(coast(model)),))
    predict = (*inverter_calls(model), Call(time_update(model, UNSCENTED)))
    return FilterStep("ukf", "cubature", model, (Guard(), *predict, update, wrap_angle(model)))
