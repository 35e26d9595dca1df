"""Salient PMSM with stator flux linkages as states: the machine whose measurement is nonlinear."""

from __future__ import annotations

from typing import Any

import casadi as ca

from model.machines.base import Machine, Named, Pair, Rotor, Sampled, midpoint
from model.quantities import Quantity


class SalientFluxPMSM(Machine):
    """Salient PMSM in stator coordinates; states psi_alpha, psi_beta in Wb, currents measured.

    ``dpsi/dt = v - R i`` and ``i = R(theta) diag(1/L_d, 1/L_q) (R(-theta) psi - [psi_m, 0])``, with R(theta)
    the rotation by the electrical angle. With L_d = L_q this is the surface machine in other coordinates.
    """

    states = (
        Quantity("psi_alpha", r"\psi_\alpha", "Wb", "stator flux linkage, alpha axis"),
        Quantity("psi_beta", r"\psi_\beta", "Wb", "stator flux linkage, beta axis"),
    )
    exact_meaning = (
        "exponential midpoint rule, the best second-order counterpart: with the rotor frame held at the mid-interval "
        "angle theta + T omega_e / 2 the flux equation is linear, and its decay exp(-T R / L_d), exp(-T R / L_q) is "
        "solved exactly"
    )

    def derivative(self, z: Pair, v: Pair, omega_e: Any, rotor: Rotor) -> Pair:
        """Stator voltage equation, Wb/s."""
        i, _ = self.currents(z, rotor)
        return v[0] - self.par.R * i[0], v[1] - self.par.R * i[1]

    def currents(self, z: Pair, rotor: Rotor) -> tuple[Pair, Named]:
        """Currents in A from flux linkages in Wb."""
        par = self.par
        per_L_d = self.constant("INV_L_D", 1 / par.L_d, "1 / L_d, A/Wb")
        per_L_q = self.constant("INV_L_Q", 1 / par.L_q, "1 / L_q, A/Wb")
        psi_m = self.constant("PSI_M", par.psi_m, "magnet flux linkage, Wb")
        psi_d, psi_q = rotor.to_rotor(z)
        i_d, i_q = per_L_d * (psi_d - psi_m), per_L_q * psi_q
        return rotor.to_stator((i_d, i_q)), {"psi_d": psi_d, "psi_q": psi_q, "i_d": i_d, "i_q": i_q}

    def torque(self, z: Pair, rotor: Rotor) -> Any:
        """1.5 p (psi x i)."""
        gain = self.constant("GAIN_TORQUE", 1.5 * self.par.p, "1.5 p")
        i, _ = self.currents(z, rotor)
        return gain * (z[0] * i[1] - z[1] * i[0])

    def electrical_state(self, i: Pair, rotor: Rotor) -> Pair:
        """psi = R(theta) (diag(L_d, L_q) R(-theta) i + [psi_m, 0])."""
        i_d, i_q = rotor.to_rotor(i)
        return rotor.to_stator((self.par.L_d * i_d + self.par.psi_m, self.par.L_q * i_q))

    def euler(self, z: Pair, v: Pair, omega_e: Any, theta: Any) -> Sampled:
        """Forward Euler of the stator voltage equation."""
        T = self.constant("SAMPLE_TIME", self.par.T, "sample time, s")
        RT = self.constant("R_TIMES_T", self.par.R * self.par.T, "R T, ohm s")
        rotor = Rotor.at(theta)
        i, named = self.currents(z, rotor)
        drive = (T * v[0], T * v[1])
        z_next = (z[0] + drive[0] - RT * i[0], z[1] + drive[1] - RT * i[1])
        return Sampled(z_next, (z, rotor), {**named, "drive_alpha": drive[0], "drive_beta": drive[1]})

    def exact(self, z: Pair, v: Pair, omega_e: Any, theta: Any) -> Sampled:
        """Exponential midpoint: rotate to the mid-interval rotor frame, decay, rotate back."""
        par = self.par
        decay_d = self.constant("DECAY_D", ca.exp(-par.T * par.R / par.L_d), "exp(-T R / L_d)")
        decay_q = self.constant("DECAY_Q", ca.exp(-par.T * par.R / par.L_q), "exp(-T R / L_q)")
        gain_d = self.constant("GAIN_D", (1 - decay_d) * par.L_d / par.R, "(1 - exp(-T R / L_d)) L_d / R, s")
        gain_q = self.constant("GAIN_Q", (1 - decay_q) * par.L_q / par.R, "(1 - exp(-T R / L_q)) L_q / R, s")
        magnet = self.constant("MAGNET_D", (1 - decay_d) * par.psi_m, "(1 - exp(-T R / L_d)) psi_m, Wb")
        middle = self._middle(theta, omega_e)
        psi_d, psi_q = middle.to_rotor(z)
        v_d, v_q = middle.to_rotor(v)
        psi_d_next = decay_d * psi_d + gain_d * v_d + magnet
        psi_q_next = decay_q * psi_q + gain_q * v_q
        z_next = middle.to_stator((psi_d_next, psi_q_next))
        named = {"theta_mid": middle.theta, "psi_d_mid": psi_d, "psi_q_mid": psi_q, "v_d": v_d, "v_q": v_q}
        named |= {"psi_d_next": psi_d_next, "psi_q_next": psi_q_next}
        return Sampled(z_next, (midpoint(z, z_next), middle), named)
