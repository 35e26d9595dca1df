"""Salient PMSM with stator currents as states: L(theta) inverted in closed form, in the rotor's frame."""

from __future__ import annotations

from typing import Any

import casadi as ca

from model.machines.base import Machine, Named, Pair, Rotor, Sampled, midpoint, share_lost
from model.quantities import Quantity


class SalientPMSM(Machine):
    """Salient PMSM in stator coordinates; states i_alpha, i_beta in A, which are also measured.

    The stator inductance turns with the rotor: with ``L(theta) = R(theta) diag(L_d, L_q) R(-theta)``::

        L(theta) di/dt = v - R i - omega_e (dL/dtheta) i - e,    e = omega_e psi_m (-sin theta, cos theta)

    In the frame of the rotor both sides are diagonal but for ``dL/dtheta``, which swaps the axes: a current on one
    axis induces ``omega_e (L_d - L_q) i`` on the other. With L_d = L_q this is the surface machine, row by row.
    """

    states = (
        Quantity("i_alpha", r"i_\alpha", "A", "stator current, alpha axis"),
        Quantity("i_beta", r"i_\beta", "A", "stator current, beta axis"),
    )
    exact_meaning = (
        "exponential midpoint rule: with the rotor frame held at the mid-interval angle theta + T omega_e / 2 the "
        "currents decay with exp(-T R / L_d) and exp(-T R / L_q); back-EMF and the saliency's coupling of the axes are "
        "taken in the middle of the interval"
    )

    def derivative(self, z: Pair, v: Pair, omega_e: Any, rotor: Rotor) -> Pair:
        """Stator voltage equation solved for di/dt, A/s.

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
        i, (v_d, v_q) = rotor.to_rotor(z), rotor.to_rotor(v)
        e_d, e_q = self._induced(i, omega_e)
        R = self.constant("STATOR_RESISTANCE", self.par.R, "R, ohm")
        by_L_d = self.constant("INV_L_D", 1 / self.par.L_d, "1 / L_d, A/Wb")
        by_L_q = self.constant("INV_L_Q", 1 / self.par.L_q, "1 / L_q, A/Wb")
        return rotor.to_stator((by_L_d * (v_d - R * i[0] - e_d), by_L_q * (v_q - R * i[1] - e_q)))

    def currents(self, z: Pair, rotor: Rotor) -> tuple[Pair, Named]:
        """Eq. 5: the states themselves.

        Parameters
        ----------
        z : Pair
            Electrical states, as the machine carries them.
        rotor : Rotor
            Sine and cosine of the electrical angle.
        """
        return z, {}

    def torque(self, z: Pair, rotor: Rotor) -> Any:
        """Return 1.5 p (psi_m + (L_d - L_q) i_d) i_q, N m.

        Parameters
        ----------
        z : Pair
            Electrical states, as the machine carries them.
        rotor : Rotor
            Sine and cosine of the electrical angle.
        """
        return self.rotor_torque(rotor.to_rotor(z), rotor)

    def rotor_torque(self, z_dq: Pair, rotor: Rotor) -> Any:
        """1.5 p (psi_m + (L_d - L_q) i_d) i_q.

        Parameters
        ----------
        z_dq : Pair
            Electrical states on the rotor's axes.
        rotor : Rotor
            Sine and cosine of the electrical angle.
        """
        gain = self.constant("GAIN_TORQUE", 1.5 * self.par.p, "1.5 p")
        i_d, i_q = z_dq
        return gain * ((self._magnet() + self._saliency() * i_d) * i_q)

    def electrical_state(self, i: Pair, rotor: Rotor) -> Pair:
        """Return the currents themselves: they are the states.

        Parameters
        ----------
        i : Pair
            Stator currents i_alpha, i_beta, A.
        rotor : Rotor
            Sine and cosine of the electrical angle.
        """
        return i

    def exact(self, z: Pair, v: Pair, omega_e: Any, theta: Any) -> Sampled:
        """Exponential midpoint; the coupling of the axes by the currents half a sample on.

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
        par = self.par
        T = par.T
        middle = self._middle(theta, omega_e)
        i, (v_d, v_q) = middle.to_rotor(z), middle.to_rotor(v)
        emf = self.excess_drop(i, (v_d, v_q - omega_e * self._magnet()))
        speed = self._saliency() * omega_e  # V/A
        i_d_mid = self._relax("HALF_D", i[0], emf[0] - speed * i[1], T / 2, par.L_d, "T / 2", "L_d")
        i_q_mid = self._relax("HALF_Q", i[1], emf[1] - speed * i[0], T / 2, par.L_q, "T / 2", "L_q")
        i_d = self._relax("D", i[0], emf[0] - speed * i_q_mid, T, par.L_d, "T", "L_d")
        i_q = self._relax("Q", i[1], emf[1] - speed * i_d_mid, T, par.L_q, "T", "L_q")
        z_next = middle.to_stator((i_d, i_q))
        named = {"theta_mid": middle.theta, "i_d_now": i[0], "i_q_now": i[1], "v_d": v_d, "v_q": v_q}
        named |= {"coupling": speed, "i_d_mid": i_d_mid, "i_q_mid": i_q_mid, "i_d_next": i_d, "i_q_next": i_q}
        return Sampled(z_next, (midpoint(i, (i_d, i_q)), middle), named)

    def _relax(self, axis: str, i: Any, v: Any, t: Any, L: Any, t_text: str, L_text: str) -> Any:
        """The current after t under L di/dt = v - R i."""
        R = self.nominal.R
        decay = self.constant(f"DECAY_{axis}", ca.exp(-t * R / L), f"exp(-{t_text} R / {L_text})")
        gain = self.constant(f"GAIN_{axis}", share_lost(t * R / L) / R, f"(1 - exp(-{t_text} R / {L_text})) / R, A/V")
        return decay * i + gain * v

    def _induced(self, i: Pair, omega_e: Any) -> Pair:
        """Voltages of the turning rotor on the d and q axis, V."""
        coupling = self._saliency()
        return omega_e * coupling * i[1], omega_e * (coupling * i[0] + self._magnet())

    def _saliency(self) -> Any:
        return self.constant("SALIENCY", self.par.L_d - self.par.L_q, "L_d - L_q, H")

    def _magnet(self) -> Any:
        return self.constant("PSI_M", self.par.psi_m, "magnet flux linkage, Wb")
