"""What a machine has to say: its states, its electrical equations, and the currents one measures."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import casadi as ca

from model.drive import Drive
from model.quantities import Constants, Quantity

#: An alpha-beta or d-q pair of symbolic scalars.
Pair = tuple[Any, Any]
#: Intermediate quantities worth a name in the generated code.
Named = dict[str, Any]


@dataclass(frozen=True)
class Parameters:
    """Motor data and sample time as symbolic scalars: numbers for generation, symbols for derivation."""

    R: Any
    L_d: Any
    L_q: Any
    psi_m: Any
    p: Any
    J: Any
    D: Any
    T: Any

    @classmethod
    def numeric(cls, drive: Drive) -> Parameters:
        """The drive's own numbers."""
        m = drive.motor
        return cls(
            R=ca.SX(m.stator_resistance),
            L_d=ca.SX(m.inductance_d),
            L_q=ca.SX(m.inductance_q),
            psi_m=ca.SX(m.magnet_flux),
            p=ca.SX(m.pole_pairs),
            J=ca.SX(m.inertia),
            D=ca.SX(m.friction),
            T=ca.SX(drive.model.sample_time),
        )

    @classmethod
    def symbolic(cls) -> Parameters:
        """One free symbol a parameter, named as the field does."""
        return cls(*(ca.SX.sym(field.name) for field in fields(cls)))


class Machine(ABC):
    """Electrical side of a PMSM in stator coordinates.

    A new machine gives its two electrical states, their derivative and the measured currents; forward
    Euler and a second-order step then follow. A machine may override either with a better closed form.
    """

    states: ClassVar[tuple[Quantity, ...]]
    #: What ``discretization = "exact"`` means for this machine, in one sentence for the report.
    exact_meaning: ClassVar[str] = "explicit midpoint rule, second order"

    def __init__(self, parameters: Parameters, constants: Constants) -> None:
        self.par = parameters
        self.constant = constants

    @abstractmethod
    def derivative(self, z: Pair, v: Pair, omega_e: Any, theta: Any) -> Pair:
        """dz/dt of the electrical states z; v in V, omega_e in electrical rad/s, theta in electrical rad."""

    @abstractmethod
    def currents(self, z: Pair, theta: Any) -> tuple[Pair, Named]:
        """Stator currents i_alpha, i_beta in A, and named intermediates."""

    @abstractmethod
    def electrical_state(self, i: Pair, theta: Any) -> Pair:
        """The electrical states that carry the currents i_alpha, i_beta (A): the inverse of :meth:`currents`."""

    def euler(self, z: Pair, v: Pair, omega_e: Any, theta: Any) -> tuple[Pair, Named]:
        """Forward Euler over one sample."""
        T = self.constant("SAMPLE_TIME", self.par.T, "sample time, s")
        dz = self.derivative(z, v, omega_e, theta)
        return (z[0] + T * dz[0], z[1] + T * dz[1]), {}

    def exact(self, z: Pair, v: Pair, omega_e: Any, theta: Any) -> tuple[Pair, Named]:
        """Second-order step over one sample, voltage and speed held."""
        half = self.constant("HALF_T", self.par.T / 2, "T / 2, s")
        theta_mid = theta + half * omega_e
        slope = self.derivative(z, v, omega_e, theta)
        z_mid = (z[0] + half * slope[0], z[1] + half * slope[1])
        slope_mid = self.derivative(z_mid, v, omega_e, theta_mid)
        return (z[0] + self.par.T * slope_mid[0], z[1] + self.par.T * slope_mid[1]), {"theta_mid": theta_mid}
