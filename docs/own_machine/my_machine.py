"""A surface PMSM whose magnets are not sinusoidal: fifth and seventh harmonic in the flux they link with a phase."""

import numpy as np

from model.machines import Machine
from model.quantities import Quantity
from runtime.proof.motors import motor_data

FIFTH, SEVENTH = 0.03, 0.01  # of the fundamental, psi_m


class HarmonicPMSM(Machine):
    """Surface PMSM with a fifth and a seventh harmonic, flux-linkage states."""

    states = (
        Quantity("psi_alpha", r"\psi_\alpha", "Wb", "stator flux linkage, alpha axis"),
        Quantity("psi_beta", r"\psi_\beta", "Wb", "stator flux linkage, beta axis"),
    )

    def derivative(self, z, v, omega_e, rotor):
        i, _ = self.currents(z, rotor)
        return v[0] - self.par.R * i[0], v[1] - self.par.R * i[1]

    def currents(self, z, rotor):
        m = self.magnet(rotor)
        i = (z[0] - m[0]) / self.par.L_d, (z[1] - m[1]) / self.par.L_d
        return i, {"magnet_alpha": m[0], "magnet_beta": m[1]}  # names for the generated code

    def electrical_state(self, i, rotor):
        m = self.magnet(rotor)
        return self.par.L_d * i[0] + m[0], self.par.L_d * i[1] + m[1]

    def torque(self, z, rotor):
        i_d, i_q = rotor.to_rotor(self.currents(z, rotor)[0])
        c6, s6 = sixth(rotor)
        k_d = -(5 * FIFTH + 7 * SEVENTH) * s6  # d magnet / d theta, seen from the rotor, of psi_m
        k_q = 1 - (5 * FIFTH - 7 * SEVENTH) * c6
        return 1.5 * self.par.p * self.par.psi_m * (k_d * i_d + k_q * i_q)

    def magnet(self, rotor):
        """What the magnets link with the stator, Wb: from the rotor both harmonics are seen as a sixth."""
        c6, s6 = sixth(rotor)
        d, q = 1 + (FIFTH + SEVENTH) * c6, (SEVENTH - FIFTH) * s6
        return rotor.to_stator((self.par.psi_m * d, self.par.psi_m * q))


def sixth(rotor):
    """Cosine and sine of 6 theta from those of theta: products are cheaper on the chip than another sine."""
    c2, s2 = rotor.cos**2 - rotor.sin**2, 2 * rotor.sin * rotor.cos
    return (4 * c2**2 - 3) * c2, (3 - 4 * s2**2) * s2


# --- the same motor a second time, in NumPy and in stator coordinates: what `verify` checks the class against


def reference(parameters):
    return Reference(motor_data(parameters))


class Reference:
    """x = [psi_alpha, psi_beta, omega, theta, T_L]; midpoint rule (discretization = "exact")."""

    def __init__(self, data):
        self.d = data

    def f(self, x, u):
        d, middle = self.d, x[3] + self.d.T * self.d.p * x[2] / 2
        psi_mid = x[:2] + d.T / 2 * (u - d.R * self.current(x[:2], x[3]))
        i_mid = self.current(psi_mid, middle)
        slope = d.psi * np.array(
            [
                -np.sin(middle) - 5 * FIFTH * np.sin(5 * middle) - 7 * SEVENTH * np.sin(7 * middle),
                np.cos(middle) - 5 * FIFTH * np.cos(5 * middle) + 7 * SEVENTH * np.cos(7 * middle),
            ]
        )
        T_e = 1.5 * d.p * (slope @ i_mid)
        return np.array([*(x[:2] + d.T * (u - d.R * i_mid)), *d.mechanics(x, T_e)])

    def h(self, x):
        return self.current(x[:2], x[3])

    def current(self, psi, th):
        magnet = self.d.psi * np.array(
            [
                np.cos(th) + FIFTH * np.cos(5 * th) + SEVENTH * np.cos(7 * th),
                np.sin(th) - FIFTH * np.sin(5 * th) + SEVENTH * np.sin(7 * th),
            ]
        )
        return (psi - magnet) / self.d.L_d
