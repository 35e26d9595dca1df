"""Surface-mounted PMSM: L_d = L_q = L, current states, eq. 1 and 7."""

from __future__ import annotations

from typing import Any

import casadi as ca

from model.machines.base import Machine, Named, Pair, Rotor, Sampled, midpoint, share_lost
from model.quantities import Quantity


class SurfacePMSM(Machine):
    """Non-salient PMSM in stator coordinates (eq. 1); states i_alpha, i_beta in A, which are also measured."""

    states = (
        Quantity("i_alpha", r"i_\alpha", "A", "stator current, alpha axis"),
        Quantity("i_beta", r"i_\beta", "A", "stator current, beta axis"),
    )
    exact_meaning = (
        "exact decay exp(-T R / L) of the currents; back-EMF held at the mid-interval angle theta + T omega_e / 2"
    )

    def derivative(self, z: Pair, v: Pair, omega_e: Any, rotor: Rotor) -> Pair:
        """Eq. 1, A/s.

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
        par = self.par
        e_alpha = -par.psi_m * omega_e * rotor.sin  # back-EMF, V
        e_beta = par.psi_m * omega_e * rotor.cos
        return (v[0] - par.R * z[0] - e_alpha) / par.L_d, (v[1] - par.R * z[1] - e_beta) / par.L_d

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
        """Return 1.5 p psi_m i_q, N m (eq. 1).

        Parameters
        ----------
        z : Pair
            Electrical states, as the machine carries them.
        rotor : Rotor
            Sine and cosine of the electrical angle.
        """
        return self.rotor_torque(rotor.to_rotor(z), rotor)

    def rotor_torque(self, z_dq: Pair, rotor: Rotor) -> Any:
        """1.5 p psi i_q (eq. 1).

        Parameters
        ----------
        z_dq : Pair
            Electrical states on the rotor's axes.
        rotor : Rotor
            Sine and cosine of the electrical angle.
        """
        gain = self.constant("GAIN_TORQUE", 1.5 * self.par.p * self.par.psi_m, "1.5 p psi_m, N m/A")
        if gain.is_symbolic() or gain.is_constant():
            return gain * z_dq[1]
        # psi_m is a state or an input of the simulated motor
        return self.constant("TORQUE_PER_FLUX", 1.5 * self.par.p, "1.5 p") * self.par.psi_m * z_dq[1]

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

    def euler(self, z: Pair, v: Pair, omega_e: Any, theta: Any) -> Sampled:
        """Eq. 7, rows 1 and 2.

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
        decay = self.constant("DECAY_I", 1 - par.T * par.R / par.L_d, "1 - T R / L")
        emf = self.constant("GAIN_E", par.T * par.psi_m / par.L_d, "T psi_m / L, A s/rad")
        gain = self.constant("GAIN_V", par.T / par.L_d, "T / L, A/V")
        rotor = Rotor.at(theta)
        z_next, named = _advance(z, v, omega_e, rotor, (decay, emf, gain))
        return Sampled(z_next, (rotor.to_rotor(z), rotor), named)

    def exact(self, z: Pair, v: Pair, omega_e: Any, theta: Any) -> Sampled:
        """The linear part of eq. 1 solved exactly over T, the back-EMF taken at the mid-interval angle.

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
        T, L, R = par.T, par.L_d, self.nominal.R
        decay = self.constant("DECAY_I", ca.exp(-T * R / L), "exp(-T R / L)")
        gain = self.constant("GAIN_V", share_lost(T * R / L) / R, "(1 - exp(-T R / L)) / R, A/V")
        emf = self.constant("GAIN_E", gain * par.psi_m, "psi_m (1 - exp(-T R / L)) / R, A s/rad")
        middle = self._middle(theta, omega_e)
        z_next, named = _advance(z, self.excess_drop(z, v), omega_e, middle, (decay, emf, gain))
        named = {"theta_mid": middle.theta, **named, **self._with_resistance(decay, gain)}
        return Sampled(z_next, (middle.to_rotor(midpoint(z, z_next)), middle), named)

    def _with_resistance(self, decay: Any, gain: Any) -> Named:
        """What the decay of the currents becomes where the resistance is a state: names for what passes make of it."""
        excess = self.excess_resistance()
        if excess is None:
            return {}
        decay_off = gain * excess
        return {"decay_off": decay_off, "decay_now": decay - decay_off, "one_plus_decay_now": 1 + decay - decay_off}


def _advance(z: Pair, v: Pair, omega_e: Any, rotor: Rotor, c: tuple[Any, Any, Any]) -> tuple[Pair, Named]:
    decay, emf, gain = c
    emf_step = emf * omega_e  # back-EMF's share of the current's change, A
    drive_alpha, drive_beta = gain * v[0], gain * v[1]  # the voltage's share, A
    i_alpha = decay * z[0] + emf_step * rotor.sin + drive_alpha
    i_beta = decay * z[1] - emf_step * rotor.cos + drive_beta
    return (i_alpha, i_beta), {"emf_step": emf_step, "drive_alpha": drive_alpha, "drive_beta": drive_beta}
