"""Salient PMSM with stator flux linkages as states: the machine whose measurement is nonlinear."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

from model.machines.base import Machine, Named, Pair, Rotor, Sampled, midpoint, share_lost
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
        "exponential midpoint rule: with the rotor frame held at the mid-interval angle theta + T omega_e / 2 the flux "
        "equation is linear, and its decay exp(-T R / L_d), exp(-T R / L_q) is solved exactly; the magnet, which turns "
        "by T omega_e meanwhile, moves the q axis to second order in T R / L"
    )

    def derivative(self, z: Pair, v: Pair, omega_e: Any, rotor: Rotor) -> Pair:
        """Stator voltage equation, Wb/s.

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
        i, _ = self.currents(z, rotor)
        return v[0] - self.par.R * i[0], v[1] - self.par.R * i[1]

    def currents(self, z: Pair, rotor: Rotor) -> tuple[Pair, Named]:
        """Currents in A from flux linkages in Wb: those of a round rotor of L_q, and what the d axis has beyond it.

        Parameters
        ----------
        z : Pair
            Electrical states, as the machine carries them.
        rotor : Rotor
            Sine and cosine of the electrical angle.
        """
        psi_m = self.constant("PSI_M", self.par.psi_m, "magnet flux linkage, Wb")
        per_L_q = self.constant("INV_L_Q", 1 / self.par.L_q, "1 / L_q, A/Wb")
        psi_d, _ = rotor.to_rotor(z)
        per_L_d = self.constant("INV_L_D", 1 / self.par.L_d, "1 / L_d, A/Wb")
        i_salient = self._saliency() * psi_d - per_L_d * psi_m
        i = per_L_q * z[0] + rotor.cos * i_salient, per_L_q * z[1] + rotor.sin * i_salient
        return i, {"psi_d": psi_d, "i_salient": i_salient}

    def torque(self, z: Pair, rotor: Rotor) -> Any:
        """Return 1.5 p (psi_alpha i_beta - psi_beta i_alpha), N m.

        Parameters
        ----------
        z : Pair
            Electrical states, as the machine carries them.
        rotor : Rotor
            Sine and cosine of the electrical angle.
        """
        return self.rotor_torque(rotor.to_rotor(z), rotor)

    def rotor_torque(self, z_dq: Pair, rotor: Rotor) -> Any:
        """1.5 p (psi x i) = 1.5 p (psi_m / L_d - (1 / L_d - 1 / L_q) psi_d) psi_q.

        Parameters
        ----------
        z_dq : Pair
            Electrical states on the rotor's axes.
        rotor : Rotor
            Sine and cosine of the electrical angle.
        """
        gain = self.constant("GAIN_TORQUE", 1.5 * self.par.p, "1.5 p")
        psi_m = self.constant("PSI_M", self.par.psi_m, "magnet flux linkage, Wb")
        per_L_d = self.constant("INV_L_D", 1 / self.par.L_d, "1 / L_d, A/Wb")
        return ((gain * per_L_d) * psi_m - (gain * self._saliency()) * z_dq[0]) * z_dq[1]

    def electrical_state(self, i: Pair, rotor: Rotor) -> Pair:
        """psi = R(theta) (diag(L_d, L_q) R(-theta) i + [psi_m, 0]).

        Parameters
        ----------
        i : Pair
            Stator currents i_alpha, i_beta, A.
        rotor : Rotor
            Sine and cosine of the electrical angle.
        """
        return self.named_state(i, rotor)[0]

    def named_state(self, i: Pair, rotor: Rotor) -> tuple[Pair, Named]:
        """The same; psi_d and psi_q are named.

        Parameters
        ----------
        i : Pair
            Stator currents i_alpha, i_beta, A.
        rotor : Rotor
            Sine and cosine of the electrical angle.
        """
        i_d, i_q = rotor.to_rotor(i)
        psi_d, psi_q = self.par.L_d * i_d + self.par.psi_m, self.par.L_q * i_q
        return rotor.to_stator((psi_d, psi_q)), {"psi_d": psi_d, "psi_q": psi_q}

    def lacking(self, z: Pair, omega_e: Any, rotor: Rotor) -> dict[str, tuple[Pair, Any]]:
        """The voltage and the torque of flux linkages that wrong inductances and a wrong magnet have wrong.

        Of psi they make wrong currents, in this sample and in all to come. What carries the true currents by the stated
        data is psi - dp dpsi/dp, currents given, and that turns with the rotor: in a sample
        -T omega_e J (dpsi/dp) dp more than f says, with the torque 1.5 p (dpsi/dp x i) dp.

        Parameters
        ----------
        z : Pair
            Electrical states, as the machine carries them.
        omega_e : object
            Electrical speed, rad/s.
        rotor : Rotor
            Sine and cosine of the electrical angle.
        """
        i, _ = self.currents(z, rotor)
        i_d, i_q = rotor.to_rotor(i)
        turned = self.constant("SAMPLE_TIME", self.par.T, "sample time, s") * omega_e
        gain = self.constant("GAIN_TORQUE", 1.5 * self.par.p, "1.5 p")
        per_datum = {
            "L_d": (rotor.cos * i_d, rotor.sin * i_d),
            "L_q": (-rotor.sin * i_q, rotor.cos * i_q),
            "psi_m": (rotor.cos, rotor.sin),
        }
        return {
            letter: ((turned * b, -turned * a), gain * (a * i[1] - b * i[0])) for letter, (a, b) in per_datum.items()
        }

    def euler(self, z: Pair, v: Pair, omega_e: Any, theta: Any) -> Sampled:
        """Forward Euler of the stator voltage equation.

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
        RT = self.constant("R_TIMES_T", self.par.R * T, "R T, ohm s")
        rotor = Rotor.at(theta)
        i, named = self.currents(z, rotor)
        named["psi_q"] = rotor.to_rotor(z)[1]
        drive = (T * v[0], T * v[1])
        z_next = (z[0] + drive[0] - RT * i[0], z[1] + drive[1] - RT * i[1])
        return Sampled(
            z_next,
            ((named["psi_d"], named["psi_q"]), rotor),
            {**named, "drive_alpha": drive[0], "drive_beta": drive[1]},
        )

    def exact(self, z: Pair, v: Pair, omega_e: Any, theta: Any) -> Sampled:
        """Exponential midpoint: rotate to the mid-interval rotor frame, relax, rotate back.

        In that frame the magnet turns from angle -T omega_e / 2 to +T omega_e / 2 while the currents decay, so its
        flux psi_m (0, T omega_e / 2) leaves a share 1 + a - 2 (1 - a) / z on the q axis, z = T R / L_q, a = exp(-z):
        about z^2 / 6, small unless the sample is long against the winding's time constant.

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
        par, R = self.par, self.nominal.R
        middle = self._middle(theta, omega_e)
        psi_d, psi_q = middle.to_rotor(z)
        v_d, v_q = middle.to_rotor(v)
        psi_m = self.constant("PSI_M", par.psi_m, "magnet flux linkage, Wb")
        half_turn = self.constant(
            "MAGNET_TURN", par.T / 2 * _left(par.T * R / par.L_q), "(1 + a - 2 (1 - a) / z) T / 2, s"
        )
        psi_d_next = psi_d + self._change("D", psi_d - psi_m, v_d, par.L_d)
        psi_q_next = psi_q + self._change("Q", psi_q, v_q, par.L_q) + half_turn * (psi_m * omega_e)
        z_next = middle.to_stator((psi_d_next, psi_q_next))
        named = {"theta_mid": middle.theta, "psi_d_mid": psi_d, "psi_q_mid": psi_q, "v_d": v_d, "v_q": v_q}
        named |= {"psi_d_next": psi_d_next, "psi_q_next": psi_q_next}
        return Sampled(z_next, (midpoint((psi_d, psi_q), (psi_d_next, psi_q_next)), middle), named)

    def _change(self, axis: str, chi: Any, v: Any, L: Any) -> Any:
        """The sample's increment of an axis' flux linkage: its winding's share chi = L i relaxes towards L v / R.

        Where R is a state, v - R i acts through the gain of the motor's own R.
        """
        T, R = self.par.T, self.nominal.R
        loss = share_lost(T * R / L)
        gain = self.constant(
            f"GAIN_{axis}", loss * L / R, f"(1 - exp(-T R / L_{axis.lower()})) L_{axis.lower()} / R, s"
        )
        if self.par.R is not R:
            per_ohm = self.constant(f"LOSS_{axis}", loss / R, f"(1 - exp(-T R / L_{axis.lower()})) / R, 1 / ohm")
            return gain * v - (per_ohm * self.par.R) * chi
        return gain * v - self.constant(f"LOSS_{axis}", loss, f"1 - exp(-T R / L_{axis.lower()})") * chi

    def _saliency(self) -> Any:
        # Where the two are nearly equal they cancel, to the rounding of 1 / L_q, to which this is added.
        return self.constant("SALIENCY", 1 / self.par.L_d - 1 / self.par.L_q, "1 / L_d - 1 / L_q, A/Wb")


def _left(z: Any) -> Any:
    """1 + a - 2 (1 - a) / z with a = exp(-z): about z^2 / 6, which is summed up where the terms would cancel to it."""
    if ca.SX(z).is_constant() and float(z) < 1:
        return ca.SX(math.fsum((-float(z)) ** k * (k - 1) / math.factorial(k + 1) for k in range(2, 20)))
    return 1 + ca.exp(-z) - 2 * share_lost(z) / z
