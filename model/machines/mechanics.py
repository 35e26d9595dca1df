"""The mechanical side: how speed, angle and load move from one sample to the next."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar

import casadi as ca

from model.machines.base import Named, Parameters, share_lost
from model.quantities import Constants, Quantity

OMEGA = Quantity("omega", r"\omega", "rad/s", "mechanical speed")
THETA = Quantity("theta", r"\theta", "rad", "electrical rotor angle")
LOAD_TORQUE = Quantity("load_torque", "T_L", "N m", "load torque")

Next = tuple[list[Any], Named]
Torque = Callable[[], Any]


class Mechanics(ABC):
    """States that begin with omega (mechanical rad/s) and theta (electrical rad)."""

    states: ClassVar[tuple[Quantity, ...]]

    def __init__(self, parameters: Parameters, constants: Constants) -> None:
        self.par = parameters
        self.constant = constants

    def electrical_speed(self, omega: Any) -> Any:
        """omega_e = p omega, electrical rad/s.

        Parameters
        ----------
        omega : object
            Mechanical speed, rad/s.
        """
        return self.constant("POLE_PAIRS", self.par.p, "p") * omega

    @abstractmethod
    def euler(self, x: list[Any], omega_e: Any, torque: Torque) -> Next:
        """Forward Euler; ``torque()`` is the electromagnetic torque of the interval in N m.

        Parameters
        ----------
        x : list of Any
            State, in the model's order.
        omega_e : object
            Electrical speed, rad/s.
        torque : Torque
            Gives the electromagnetic torque of the interval, N m.
        """

    @abstractmethod
    def exact(self, x: list[Any], omega_e: Any, torque: Torque) -> Next:
        """At least second order.

        Parameters
        ----------
        x : list of Any
            State, in the model's order.
        omega_e : object
            Electrical speed, rad/s.
        torque : Torque
            Gives the electromagnetic torque of the interval, N m.
        """

    def _decay(self, exact: bool) -> Any:
        par = self.par
        if exact:
            return self.constant("DECAY_OMEGA", ca.exp(-par.T * par.D / par.J), "exp(-T D / J)")
        return self.constant("DECAY_OMEGA", 1 - par.T * par.D / par.J, "1 - T D / J")

    def _settling(self) -> tuple[Any, str]:
        """The integral of exp(-t D / J) over a sample, s, and its formula; T where there is no friction."""
        par = self.par
        z = par.T * par.D / par.J
        return (par.T, "T") if z.is_zero() else (par.T * (share_lost(z) / z), "(1 - exp(-T D / J)) J / D")


class ConstantSpeed(Mechanics):
    """Rows 3 and 4 of eq. 7: the speed decays with friction, torque is left to the process noise."""

    states = (OMEGA, THETA)

    def euler(self, x: list[Any], omega_e: Any, torque: Torque) -> Next:
        """Eq. 7, rows 3 and 4.

        Parameters
        ----------
        x : list of Any
            State, in the model's order.
        omega_e : object
            Electrical speed, rad/s.
        torque : Torque
            Gives the electromagnetic torque of the interval, N m.
        """
        T = self.constant("SAMPLE_TIME", self.par.T, "sample time, s")
        return [self._decay(exact=False) * x[0], x[1] + T * omega_e], {}

    def exact(self, x: list[Any], omega_e: Any, torque: Torque) -> Next:
        """The speed's decay and the angle that it makes, both solved exactly.

        Parameters
        ----------
        x : list of Any
            State, in the model's order.
        omega_e : object
            Electrical speed, rad/s.
        torque : Torque
            Gives the electromagnetic torque of the interval, N m.
        """
        decay = self._decay(exact=True)
        settling, text = self._settling()
        return [decay * x[0], x[1] + self.constant("ADVANCE", settling, f"{text}, s") * omega_e], {}


class LoadTorque(Mechanics):
    """Row 3 of eq. 1 with the load torque as a state that wanders: J domega/dt = T_e - T_L - D omega."""

    states = (OMEGA, THETA, LOAD_TORQUE)

    def euler(self, x: list[Any], omega_e: Any, torque: Torque) -> Next:
        """Advance speed, angle and load torque by forward Euler.

        Parameters
        ----------
        x : list of Any
            State, in the model's order.
        omega_e : object
            Electrical speed, rad/s.
        torque : Torque
            Gives the electromagnetic torque of the interval, N m.
        """
        T = self.constant("SAMPLE_TIME", self.par.T, "sample time, s")
        gain = self.constant("GAIN_OMEGA", self.par.T / self.par.J, "T / J, rad/s per N m")
        T_e = torque()
        return [self._decay(exact=False) * x[0] + gain * (T_e - x[2]), x[1] + T * omega_e, x[2]], {"torque": T_e}

    def exact(self, x: list[Any], omega_e: Any, torque: Torque) -> Next:
        """The speed solved exactly under a torque that is held; the angle moves with its mean of before and after.

        That mean is of second order in T D / J.

        Parameters
        ----------
        x : list of Any
            State, in the model's order.
        omega_e : object
            Electrical speed, rad/s.
        torque : Torque
            Gives the electromagnetic torque of the interval, N m.
        """
        decay = self._decay(exact=True)
        settling, text = self._settling()
        text = "T / J" if text == "T" else "(1 - exp(-T D / J)) / D"
        gain = self.constant("GAIN_OMEGA", settling / self.par.J, f"{text}, rad/s per N m")
        half = self.constant("HALF_T", self.par.T / 2, "T / 2, s")
        T_e = torque()
        omega = decay * x[0] + gain * (T_e - x[2])
        return [omega, x[1] + half * omega_e + half * self.electrical_speed(omega), x[2]], {"torque": T_e}


MECHANICS: dict[str, type[Mechanics]] = {"constant_speed": ConstantSpeed, "load_torque": LoadTorque}
