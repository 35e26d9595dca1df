"""The mechanical side: how speed and angle move from one sample to the next."""

from __future__ import annotations

from typing import Any, ClassVar

import casadi as ca

from model.machines.base import Named, Parameters
from model.quantities import Constants, Quantity


class ConstantSpeed:
    """Rows 3 and 4 of eq. 7: the speed decays with friction, torque is left to the process noise.

    States omega (mechanical rad/s) and theta (electrical rad).
    """

    states: ClassVar[tuple[Quantity, ...]] = (
        Quantity("omega", r"\omega", "rad/s", "mechanical speed"),
        Quantity("theta", r"\theta", "rad", "electrical rotor angle"),
    )

    def __init__(self, parameters: Parameters, constants: Constants) -> None:
        self.par = parameters
        self.constant = constants

    def electrical_speed(self, omega: Any) -> Any:
        """omega_e = p omega, electrical rad/s."""
        return self.constant("POLE_PAIRS", self.par.p, "p") * omega

    def euler(self, omega: Any, theta: Any, omega_e: Any) -> tuple[tuple[Any, ...], Named]:
        """Eq. 7, rows 3 and 4."""
        decay = self.constant("DECAY_OMEGA", 1 - self.par.T * self.par.D / self.par.J, "1 - T D / J")
        T = self.constant("SAMPLE_TIME", self.par.T, "sample time, s")
        return (decay * omega, theta + T * omega_e), {}

    def exact(self, omega: Any, theta: Any, omega_e: Any) -> tuple[tuple[Any, ...], Named]:
        """Exact decay of the speed; the angle moves with the mean of the speed before and after."""
        decay = self.constant("DECAY_OMEGA", ca.exp(-self.par.T * self.par.D / self.par.J), "exp(-T D / J)")
        mean = self.constant("ADVANCE", self.par.T * (1 + decay) / 2, "T (1 + exp(-T D / J)) / 2, s")
        return (decay * omega, theta + mean * omega_e), {}


MECHANICS: dict[str, type[ConstantSpeed]] = {"constant_speed": ConstantSpeed}
