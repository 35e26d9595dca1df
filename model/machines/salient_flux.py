"""Salient PMSM with stator flux linkages as states: the machine whose measurement is nonlinear."""

from __future__ import annotations

from typing import Any

import casadi as ca

from model.machines.base import Machine, Named, Pair
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

    def derivative(self, z: Pair, v: Pair, omega_e: Any, theta: Any) -> Pair:
        """Stator voltage equation, Wb/s."""
        i, _ = self.currents(z, theta)
        return v[0] - self.par.R * i[0], v[1] - self.par.R * i[1]

    def currents(self, z: Pair, theta: Any) -> tuple[Pair, Named]:
        """Currents in A from flux linkages in Wb."""
        par = self.par
        per_L_d = self.constant("INV_L_D", 1 / par.L_d, "1 / L_d, A/Wb")
        per_L_q = self.constant("INV_L_Q", 1 / par.L_q, "1 / L_q, A/Wb")
        psi_m = self.constant("PSI_M", par.psi_m, "magnet flux linkage, Wb")
        sin, cos = ca.sin(theta), ca.cos(theta)
        psi_d, psi_q = _rotate_back(z, sin, cos)
        i_d, i_q = per_L_d * (psi_d - psi_m), per_L_q * psi_q
        named = {"psi_d": psi_d, "psi_q": psi_q, "i_d": i_d, "i_q": i_q}
        return _rotate((i_d, i_q), sin, cos), named

    def electrical_state(self, i: Pair, theta: Any) -> Pair:
        """psi = R(theta) (diag(L_d, L_q) R(-theta) i + [psi_m, 0])."""
        sin, cos = ca.sin(theta), ca.cos(theta)
        i_d, i_q = _rotate_back(i, sin, cos)
        return _rotate((self.par.L_d * i_d + self.par.psi_m, self.par.L_q * i_q), sin, cos)

    def euler(self, z: Pair, v: Pair, omega_e: Any, theta: Any) -> tuple[Pair, Named]:
        """Forward Euler of the stator voltage equation."""
        T = self.constant("SAMPLE_TIME", self.par.T, "sample time, s")
        RT = self.constant("R_TIMES_T", self.par.R * self.par.T, "R T, ohm s")
        i, named = self.currents(z, theta)
        drive = (T * v[0], T * v[1])
        z_next = tuple(z[k] + drive[k] - RT * i[k] for k in range(2))
        return (z_next[0], z_next[1]), {**named, "drive_alpha": drive[0], "drive_beta": drive[1]}

    def exact(self, z: Pair, v: Pair, omega_e: Any, theta: Any) -> tuple[Pair, Named]:
        """Exponential midpoint: rotate to the mid-interval rotor frame, decay, rotate back."""
        par = self.par
        decay_d = self.constant("DECAY_D", ca.exp(-par.T * par.R / par.L_d), "exp(-T R / L_d)")
        decay_q = self.constant("DECAY_Q", ca.exp(-par.T * par.R / par.L_q), "exp(-T R / L_q)")
        gain_d = self.constant("GAIN_D", (1 - decay_d) * par.L_d / par.R, "(1 - exp(-T R / L_d)) L_d / R, s")
        gain_q = self.constant("GAIN_Q", (1 - decay_q) * par.L_q / par.R, "(1 - exp(-T R / L_q)) L_q / R, s")
        magnet = self.constant("MAGNET_D", (1 - decay_d) * par.psi_m, "(1 - exp(-T R / L_d)) psi_m, Wb")
        half = self.constant("HALF_T", par.T / 2, "T / 2, s")
        theta_mid = theta + half * omega_e
        sin, cos = ca.sin(theta_mid), ca.cos(theta_mid)
        psi_d, psi_q = _rotate_back(z, sin, cos)
        v_d, v_q = _rotate_back(v, sin, cos)
        psi_d_next = decay_d * psi_d + gain_d * v_d + magnet
        psi_q_next = decay_q * psi_q + gain_q * v_q
        named = {"theta_mid": theta_mid, "psi_d_mid": psi_d, "psi_q_mid": psi_q, "v_d": v_d, "v_q": v_q}
        named |= {"psi_d_next": psi_d_next, "psi_q_next": psi_q_next}
        return _rotate((psi_d_next, psi_q_next), sin, cos), named


def _rotate(dq: Pair, sin: Any, cos: Any) -> Pair:
    return cos * dq[0] - sin * dq[1], sin * dq[0] + cos * dq[1]


def _rotate_back(ab: Pair, sin: Any, cos: Any) -> Pair:
    return cos * ab[0] + sin * ab[1], cos * ab[1] - sin * ab[0]
