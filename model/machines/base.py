"""The interface of a machine: its states, its electrical equations, and the currents one measures."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import casadi as ca

from model.inverter import fading_current, lost_voltage, seeing_current
from model.quantities import Constants, Quantity
from model.schema import Drive

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
    V_d: Any = 0.0  # V, what the inverter takes from a leg
    I_0: Any = 1.0  # A, below which it takes less
    I_1: Any = 1.0  # A, below which that says little of V_d

    @classmethod
    def numeric(cls, drive: Drive) -> Parameters:
        """The drive's own numbers.

        Parameters
        ----------
        drive : Drive
            Its motor's data (ohm, H, Wb, kg m^2, N m s/rad) and sample time (s).
        """
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
            V_d=ca.SX(lost_voltage(drive)),
            I_0=ca.SX(fading_current(drive)),
            I_1=ca.SX(seeing_current(drive)),
        )

    @classmethod
    def symbolic(cls) -> Parameters:
        """One free symbol a parameter, named as the field does."""
        return cls(*(ca.SX.sym(field.name) for field in fields(cls)))


@dataclass(frozen=True)
class Rotor:
    """Where the rotor is: electrical angle in rad, with its sine and cosine."""

    theta: Any
    sin: Any
    cos: Any

    @classmethod
    def at(cls, theta: Any) -> Rotor:
        """Make the rotor at an electrical angle.

        Parameters
        ----------
        theta : object
            Electrical angle, rad.
        """
        return cls(theta, ca.sin(theta), ca.cos(theta))

    def to_stator(self, dq: Pair) -> Pair:
        """d-q to alpha-beta.

        Parameters
        ----------
        dq : Pair
            d-q.
        """
        return self.cos * dq[0] - self.sin * dq[1], self.sin * dq[0] + self.cos * dq[1]

    def to_rotor(self, ab: Pair) -> Pair:
        """alpha-beta to d-q.

        Parameters
        ----------
        ab : Pair
            alpha-beta.
        """
        return self.cos * ab[0] + self.sin * ab[1], self.cos * ab[1] - self.sin * ab[0]


@dataclass(frozen=True)
class Sampled:
    """One electrical sample: the next states, and what the interval's torque is of: states on a rotor's axes."""

    z: Pair
    torque_at: tuple[Pair, Rotor]
    named: Named


class Machine(ABC):
    """Electrical side of a PMSM in stator coordinates.

    A new machine gives its two electrical states, their derivative and the measured currents; forward
    Euler and a second-order step then follow. A machine may override either with a better closed form.
    """

    states: ClassVar[tuple[Quantity, ...]]
    #: Meaning of ``discretization = "exact"`` for this machine, one sentence for the report.
    exact_meaning: ClassVar[str] = "explicit midpoint rule, second order"

    def __init__(self, parameters: Parameters, constants: Constants, nominal: Parameters | None = None) -> None:
        """``nominal``: the motor's data where ``parameters`` holds states in their place (adaptive models)."""
        self.par = parameters
        self.nominal = nominal or parameters
        self.constant = constants

    @abstractmethod
    def derivative(self, z: Pair, v: Pair, omega_e: Any, rotor: Rotor) -> Pair:
        """dz/dt of the electrical states z; v in V, omega_e in electrical rad/s.

        Parameters
        ----------
        z : Pair
            Electrical states, as the machine carries them.
        v : Pair
            Stator voltages v_alpha, v_beta, V.
        omega_e : object
            Electrical speed, rad/s.
        rotor : Rotor
            Sine and cosine of the electrical angle.
        """

    @abstractmethod
    def currents(self, z: Pair, rotor: Rotor) -> tuple[Pair, Named]:
        """Stator currents i_alpha, i_beta in A, and named intermediates.

        Parameters
        ----------
        z : Pair
            Electrical states, as the machine carries them.
        rotor : Rotor
            Sine and cosine of the electrical angle.
        """

    @abstractmethod
    def torque(self, z: Pair, rotor: Rotor) -> Any:
        """Electromagnetic torque in N m.

        Parameters
        ----------
        z : Pair
            Electrical states, as the machine carries them.
        rotor : Rotor
            Sine and cosine of the electrical angle.
        """

    def rotor_torque(self, z_dq: Pair, rotor: Rotor) -> Any:
        """The same of states on the rotor's axes; worth a form of its own where no angle is left in it.

        Parameters
        ----------
        z_dq : Pair
            Electrical states on the rotor's axes.
        rotor : Rotor
            Sine and cosine of the electrical angle.
        """
        return self.torque(rotor.to_stator(z_dq), rotor)

    @abstractmethod
    def electrical_state(self, i: Pair, rotor: Rotor) -> Pair:
        """The electrical states that carry the currents i_alpha, i_beta (A): the inverse of :meth:`currents`.

        Parameters
        ----------
        i : Pair
            Stator currents i_alpha, i_beta, A.
        rotor : Rotor
            Sine and cosine of the electrical angle.
        """

    def named_state(self, i: Pair, rotor: Rotor) -> tuple[Pair, Named]:
        """The same, with what is named on the way to it.

        Parameters
        ----------
        i : Pair
            Stator currents i_alpha, i_beta, A.
        rotor : Rotor
            Sine and cosine of the electrical angle.
        """
        return self.electrical_state(i, rotor), {}

    def lacking(self, z: Pair, omega_e: Any, rotor: Rotor) -> dict[str, tuple[Pair, Any]]:
        """What a sample lacks where a datum of :meth:`currents` is wrong: of the states, and of the torque.

        Nothing where the currents are the states: there every datum acts in f.

        Parameters
        ----------
        z : Pair
            Electrical states, as the machine carries them.
        omega_e : object
            Electrical speed, rad/s.
        rotor : Rotor
            Sine and cosine of the electrical angle.

        Returns
        -------
        dict of str to tuple of Pair and object
            By the letter of :class:`Parameters`, per unit of the datum; N m the torque.
        """
        return {}

    def euler(self, z: Pair, v: Pair, omega_e: Any, theta: Any) -> Sampled:
        """Forward Euler over one sample.

        Parameters
        ----------
        z : Pair
            Electrical states, as the machine carries them.
        v : Pair
            Stator voltages v_alpha, v_beta, V.
        omega_e : object
            Electrical speed, rad/s.
        theta : object
            Electrical angle, rad.
        """
        T = self.constant("SAMPLE_TIME", self.par.T, "sample time, s")
        rotor = Rotor.at(theta)
        dz = self.derivative(z, v, omega_e, rotor)
        return Sampled((z[0] + T * dz[0], z[1] + T * dz[1]), (rotor.to_rotor(z), rotor), {})

    def exact(self, z: Pair, v: Pair, omega_e: Any, theta: Any) -> Sampled:
        """Second-order step over one sample, voltage and speed held.

        Parameters
        ----------
        z : Pair
            Electrical states, as the machine carries them.
        v : Pair
            Stator voltages v_alpha, v_beta, V.
        omega_e : object
            Electrical speed, rad/s.
        theta : object
            Electrical angle, rad.
        """
        half = self.constant("HALF_T", self.par.T / 2, "T / 2, s")
        T = self.constant("SAMPLE_TIME", self.par.T, "sample time, s")
        middle = self._middle(theta, omega_e)
        slope = self.derivative(z, v, omega_e, Rotor.at(theta))
        z_mid = (z[0] + half * slope[0], z[1] + half * slope[1])
        slope_mid = self.derivative(z_mid, v, omega_e, middle)
        z_next = (z[0] + T * slope_mid[0], z[1] + T * slope_mid[1])
        return Sampled(z_next, (middle.to_rotor(z_mid), middle), {"theta_mid": middle.theta})

    def excess_drop(self, i: Pair, v: Pair) -> Pair:
        """The voltage that remains of v when the resistance is a state: v - (R - R_0) i, R_0 the motor's.

        Decays are solved exactly at R_0; the deviation of R from it acts as a voltage.

        Parameters
        ----------
        i : Pair
            Stator currents i_alpha, i_beta, A.
        v : Pair
            Stator voltages v_alpha, v_beta, V.
        """
        dR = self.excess_resistance()
        return v if dR is None else (v[0] - dR * i[0], v[1] - dR * i[1])

    def excess_resistance(self) -> Any:
        """R - R_0, ohm, where the resistance is a state; None where it is the motor's."""
        if self.par.R is self.nominal.R:
            return None
        return self.par.R - self.constant("NOMINAL_R", self.nominal.R, "the motor's stator resistance, ohm")

    def _middle(self, theta: Any, omega_e: Any) -> Rotor:
        """The rotor in the middle of the interval."""
        return Rotor.at(theta + self.constant("HALF_T", self.par.T / 2, "T / 2, s") * omega_e)


def share_lost(z: Any) -> Any:
    """1 - exp(-z), of a decay over z time constants.

    Of a small z the difference would keep no digit. Elsewhere it is as good, and the shipped drives keep their bits.

    Parameters
    ----------
    z : SX
        Time over the time constant, such as T R / L.
    """
    if ca.SX(z).is_constant() and float(z) < 0.25:
        return ca.SX(-math.expm1(-float(z)))
    if not ca.SX(z).is_constant():
        return -ca.expm1(-z)
    return 1 - ca.exp(-z)


def midpoint(a: Pair, b: Pair) -> Pair:
    """Half way between two pairs.

    Parameters
    ----------
    a, b : Pair
        In one unit and on the same axes.
    """
    return 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])
