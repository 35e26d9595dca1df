"""Wrong equations: machines, mechanics, slow states, discretisation."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

MACHINES = "model/machines/"
EQUATIONS = "pytest tests/model/test_equations.py tests/model/test_machines.py -k"
DRAWN = "pytest tests/model/test_accepted_motors.py -k"
ORDER = f"{EQUATIONS} 'second_order or generic_one or surface or power or order'"

PAPER, TORQUE = ("model paper_spmsm", "A-B paper_spmsm"), ("model spmsm_load_torque", "A-B spmsm_load_torque")
BOTH_SIGNS = (f"{DRAWN} 'constant or coenergy'",)
SALIENT, FLUX = ("A-B ipmsm",), ("model ipmsm_flux", "A-B ipmsm_flux")
ADAPTIVE = ("model ipmsm_adaptive", "A-B ipmsm_adaptive")


def _of(file: str, *rows: tuple[str, str, str, tuple[str, ...]]) -> tuple[Mutant, ...]:
    return tuple(Mutant("model", f"{file}: {name}", checks, file, old, new) for name, old, new, checks in rows)


SURFACE = _of(
    MACHINES + "surface.py",
    ("back-EMF reversed", "decay * z[0] + emf_step * rotor.sin", "decay * z[0] - emf_step * rotor.sin", PAPER),
    ("sine for cosine", "decay * z[1] - emf_step * rotor.cos", "decay * z[1] - emf_step * rotor.sin", PAPER),
    (
        "axes swapped",
        "drive_alpha, drive_beta = gain * v[0], gain * v[1]",
        "drive_alpha, drive_beta = gain * v[1], gain * v[0]",
        PAPER,
    ),
    ("voltage dropped", "- emf_step * rotor.cos + drive_beta", "- emf_step * rotor.cos", PAPER),
    ("wrong axis decays", "i_beta = decay * z[1]", "i_beta = decay * z[0]", PAPER),
    ("gain without L", 'self.constant("GAIN_V", par.T / par.L_d,', 'self.constant("GAIN_V", par.T / par.R,', PAPER),
    ("1 + T R / L", '"DECAY_I", 1 - par.T * par.R / par.L_d', '"DECAY_I", 1 + par.T * par.R / par.L_d', PAPER),
    ("psi_m lost", "par.T * par.psi_m / par.L_d", "par.T / par.L_d", PAPER),
    ("factor 1.5 lost", "1.5 * self.par.p * self.par.psi_m", "self.par.p * self.par.psi_m", TORQUE),
    ("torque without pole pairs", "1.5 * self.par.p * self.par.psi_m", "1.5 * self.par.psi_m", TORQUE),
    ("torque of i_d", "return gain * z_dq[1]", "return gain * z_dq[0]", TORQUE),
    ("decay of 2 T", "ca.exp(-T * R / L)", "ca.exp(-2 * T * R / L)", TORQUE),
    ("back-EMF at the beginning", "middle = self._middle(theta, omega_e)", "middle = Rotor.at(theta)", TORQUE),
    ("torque at the end", "middle.to_rotor(midpoint(z, z_next))", "middle.to_rotor(z_next)", TORQUE),
    (
        "gain at R of the state",
        'share_lost(T * R / L) / R, "(1',
        'share_lost(T * R / L) / par.R, "(1',
        ("pytest tests/model/test_machines.py -k 'adaptive_resistance'",),
    ),
    ("derivative: sign of e_beta", "e_beta = par.psi_m", "e_beta = -par.psi_m", (ORDER,)),
    (
        "derivative: resistance's drop added",
        "(v[1] - par.R * z[1] - e_beta)",
        "(v[1] + par.R * z[1] - e_beta)",
        (ORDER,),
    ),
)

SALIENT_MUTANTS = _of(
    MACHINES + "salient.py",
    ("coupling's sign on d", "emf[0] - speed * i_q_mid", "emf[0] + speed * i_q_mid", SALIENT),
    ("coupling by the old current", "emf[1] - speed * i_d_mid", "emf[1] - speed * i[0]", SALIENT),
    ("back-EMF on d", "(v_d, v_q - omega_e * self._magnet())", "(v_d - omega_e * self._magnet(), v_q)", SALIENT),
    (
        "L_q relaxes d",
        'i_d = self._relax("D", i[0], emf[0] - speed * i_q_mid, T, par.L_d',
        'i_d = self._relax("D", i[0], emf[0] - speed * i_q_mid, T, par.L_q',
        SALIENT,
    ),
    ("half a sample too long", "emf[1] - speed * i[0], T / 2, par.L_q", "emf[1] - speed * i[0], T, par.L_q", SALIENT),
    (
        "reluctance torque reversed",
        "self._magnet() + self._saliency() * i_d) * i_q",
        "self._magnet() - self._saliency() * i_d) * i_q",
        SALIENT,
    ),
    ("saliency reversed", 'self.par.L_d - self.par.L_q, "L_d', 'self.par.L_q - self.par.L_d, "L_d', SALIENT),
    ("currents returned swapped", "middle.to_stator((i_d, i_q))", "middle.to_stator((i_q, i_d))", SALIENT),
    ("factor 1.5 lost", '1.5 * self.par.p, "1.5 p"', 'self.par.p, "1.5 p"', SALIENT),
    ("saliency of one sign", 'self.par.L_d - self.par.L_q, "', '-ca.fabs(self.par.L_d - self.par.L_q), "', BOTH_SIGNS),
    (
        "derivative: saliency of one sign",
        "coupling = self._saliency()",
        "coupling = -ca.fabs(self._saliency())",
        (f"{DRAWN} voltage",),
    ),
    (
        "derivative: coupling dropped",
        "return omega_e * coupling * i[1], omega_e",
        "return 0 * omega_e, omega_e",
        (ORDER, "pytest tests/model/test_machines.py"),
    ),
    ("derivative: L_d on q", "by_L_q * (v_q", "by_L_d * (v_q", (ORDER, "pytest tests/model/test_machines.py")),
)

FLUX_MUTANTS = _of(
    MACHINES + "salient_flux.py",
    ("L_d for L_q in h", '"INV_L_Q", 1 / self.par.L_q', '"INV_L_Q", 1 / self.par.L_d', FLUX),
    (
        "magnet's sign in h",
        "self._saliency() * psi_d - per_L_d * psi_m",
        "self._saliency() * psi_d + per_L_d * psi_m",
        FLUX,
    ),
    ("cosine for sine in h", "per_L_q * z[1] + rotor.sin * i_salient", "per_L_q * z[1] + rotor.cos * i_salient", FLUX),
    (
        "sign of the salient part",
        "per_L_q * z[0] + rotor.cos * i_salient",
        "per_L_q * z[0] - rotor.cos * i_salient",
        FLUX,
    ),
    ("saliency reversed", "1 / self.par.L_d - 1 / self.par.L_q", "1 / self.par.L_q - 1 / self.par.L_d", FLUX),
    ("magnet forgotten on d", 'self._change("D", psi_d - psi_m', 'self._change("D", psi_d', FLUX),
    ("magnet's turn dropped", "+ half_turn * (psi_m * omega_e)", "", FLUX),
    ("voltage of the other axis", 'self._change("Q", psi_q, v_q,', 'self._change("Q", psi_q, v_d,', FLUX),
    (
        "fluxes rotated back at the wrong angle",
        "z_next = middle.to_stator((psi_d_next",
        "z_next = Rotor.at(theta).to_stator((psi_d_next",
        FLUX,
    ),
    ("gain of loss reversed", "loss = share_lost(T * R / L)", "loss = 2 - share_lost(T * R / L)", FLUX),
    ("share left on q", "1 + ca.exp(-z) - 2 * share_lost(z) / z", "1 + ca.exp(-z) - share_lost(z) / z", FLUX),
    ("series of the share left", "/ math.factorial(k + 1)", "/ math.factorial(k + 2)", ("A-B ipmsm_flux",)),
    ("share left cancels", "float(z) < 1", "float(z) < 1e-4", (f"{DRAWN} constant",)),
    (
        "saliency of one sign",
        "1 / self.par.L_d - 1 / self.par.L_q",
        "ca.fabs(1 / self.par.L_d - 1 / self.par.L_q)",
        (f"{DRAWN} coenergy",),
    ),
    (
        "magnet turns the other way",
        "+ half_turn * (psi_m * omega_e)",
        "- half_turn * (psi_m * omega_e)",
        (f"{DRAWN} 'second_order'",),
    ),
    ("torque of the d axis", "* z_dq[0]) * z_dq[1]", "* z_dq[1]) * z_dq[1]", ADAPTIVE),
    ("reluctance torque reversed", "psi_m - (gain * self._saliency())", "psi_m + (gain * self._saliency())", ADAPTIVE),
    (
        "torque at the beginning",
        "(midpoint((psi_d, psi_q), (psi_d_next, psi_q_next)), middle)",
        "((psi_d, psi_q), middle)",
        ADAPTIVE,
    ),
    (
        "R of the state acts through another gain",
        "gain * v - (per_ohm * self.par.R) * chi",
        "gain * v - (per_ohm * R) * chi",
        ADAPTIVE,
    ),
    (
        "euler: resistance's drop added",
        "z[1] + drive[1] - RT * i[1]",
        "z[1] + drive[1] + RT * i[1]",
        ("pytest tests/model/test_equations.py -k 'sympy and euler and ipmsm_flux'",),
    ),
    ("currents back to fluxes", "self.par.L_d * i_d + self.par.psi_m, ", "self.par.L_d * i_d, ", ("data ipmsm_flux",)),
    ("derivative without R", "v[1] - self.par.R * i[1]", "v[1]", (ORDER,)),
)

BASE = _of(
    MACHINES + "base.py",
    ("Park turned the wrong way", "self.cos * ab[1] - self.sin * ab[0]", "self.cos * ab[1] + self.sin * ab[0]", FLUX),
    ("inverse Park's sign", "self.cos * dq[0] - self.sin * dq[1]", "self.cos * dq[0] + self.sin * dq[1]", FLUX),
    (
        "sine and cosine exchanged",
        "cls(theta, ca.sin(theta), ca.cos(theta))",
        "cls(theta, ca.cos(theta), ca.sin(theta))",
        PAPER,
    ),
    (
        "a whole sample to the middle",
        'self.par.T / 2, "T / 2, s") * omega_e',
        'self.par.T, "T / 2, s") * omega_e',
        TORQUE,
    ),
    ("what a decay loses cancels", "float(z) < 0.25", "float(z) < 1e-4", (f"{DRAWN} constant",)),
    ("Park of one sign", "self.sin * ab[1], self.cos", "ca.fabs(self.sin) * ab[1], self.cos", (f"{DRAWN} park",)),
    ("mean of one", "0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])", "0.5 * (a[0] + b[0]), b[1]", TORQUE),
    (
        "excess drop reversed",
        "(v[0] - dR * i[0], v[1] - dR * i[1])",
        "(v[0] + dR * i[0], v[1] + dR * i[1])",
        ("pytest tests/model/test_machines.py -k 'adaptive_resistance'",),
    ),
    (
        "midpoint rule of the first slope",
        "slope_mid = self.derivative(z_mid, v, omega_e, middle)",
        "slope_mid = self.derivative(z, v, omega_e, middle)",
        ("pytest tests/runtime/test_own_machine.py -k test_reference_and_class_agree",),
    ),
)

MECHANICS = _of(
    "model/machines/mechanics.py",
    ("pole pairs forgotten", 'self.constant("POLE_PAIRS", self.par.p, "p") * omega', "omega", PAPER),
    (
        "speed grows with friction",
        '1 - par.T * par.D / par.J, "1 - T D / J"',
        '1 + par.T * par.D / par.J, "1 - T D / J"',
        PAPER,
    ),
    ("decay without D", "ca.exp(-par.T * par.D / par.J)", "ca.exp(-par.T / par.J)", TORQUE),
    ("angle stands still", "x[1] + T * omega_e], {}", "x[1]], {}", PAPER),
    ("angle by half", 'settling, f"{text}, s")', '0.5 * settling, f"{text}, s")', FLUX),
    (
        "advance of the old speed",
        "par.T * (share_lost(z) / z)",
        "par.T * (2 - share_lost(z) / z)",
        ("pytest tests/model/test_equations.py -k 'second_order or (sympy and exact and paper)'",),
    ),
    (
        "settling by the trapezoid",
        "par.T * (share_lost(z) / z)",
        "par.T * (1 - share_lost(z) / 2)",
        (f"{DRAWN} 'held'",),
    ),
    (
        "friction and torque out of balance",
        "settling / self.par.J,",
        "settling / self.par.J * (1 + 1e-3 * settling * self.par.D / self.par.J),",
        (f"{DRAWN} 'settle'",),
    ),
    (
        "little friction is none",
        "if z.is_zero()",
        "if z.is_constant() and float(z) < 1e-3",
        (f"{DRAWN} 'held'",),
    ),
    (
        "load accelerates",
        "omega = decay * x[0] + gain * (T_e - x[2])",
        "omega = decay * x[0] + gain * (T_e + x[2])",
        TORQUE,
    ),
    ("load forgotten", "omega = decay * x[0] + gain * (T_e - x[2])", "omega = decay * x[0] + gain * T_e", TORQUE),
    ("inertia forgotten", "settling / self.par.J,", "settling,", TORQUE),
    (
        "angle by the old speed alone",
        "half * omega_e + half * self.electrical_speed(omega)",
        "half * omega_e + half * omega_e",
        TORQUE,
    ),
    ("load decays", "self.electrical_speed(omega), x[2]]", "self.electrical_speed(omega), decay * x[2]]", TORQUE),
    (
        "euler: load's sign",
        "x[0] + gain * (T_e - x[2]), x[1] + T * omega_e",
        "x[0] + gain * (T_e + x[2]), x[1] + T * omega_e",
        ("pytest tests/model/test_equations.py -k 'sympy and euler and load_torque'",),
    ),
)

STATES = _of(
    "model/machines/adaptive.py",
    ("slow states flee", "value + back * (own - value)", "value + back * (value - own)", ADAPTIVE),
    ("slow states stand", "after.append(value + back * (own - value))", "after.append(value)", ADAPTIVE),
    (
        "return to the other's value",
        "return getattr(self.motor, ADAPTIVE[word][1])",
        "return getattr(self.motor, ADAPTIVE[self.words[0]][1])",
        ADAPTIVE,
    ),
    ("R for psi_m", '"magnet flux linkage, wandering"), "psi_m")', '"magnet flux linkage, wandering"), "R")', ADAPTIVE),
) + _of(
    "model/machines/state_space.py",
    ("voltage axes exchanged", "(x[0], x[1]), (v[0], v[1]), omega_e", "(x[0], x[1]), (v[1], v[0]), omega_e", PAPER),
    ("mechanical for electrical speed", "omega_e = self.mechanics.electrical_speed(x[2])", "omega_e = x[2]", PAPER),
    (
        "euler for exact",
        'sample = machine.euler if self.discretization == "euler" else machine.exact',
        "sample = machine.euler",
        FLUX,
    ),
    (
        "measured at standstill's angle",
        "Rotor.at(x[3]))\n        return list(i), named",
        "Rotor.at(0 * x[3]))\n        return list(i), named",
        FLUX,
    ),
    (
        "slow states not put in",
        "return type(self.machine)(par, self._constants, self.machine.par)",
        "return self.machine",
        ADAPTIVE,
    ),
    (
        "H transposed in one entry",
        "return ca.jacobian(self.h, self.x)",
        "return ca.jacobian(self.h, self.x) * ca.SX([[1] * self.x.numel(), [-1] * self.x.numel()])",
        FLUX,
    ),
    (
        "start at the magnet's q axis",
        "Rotor.at(ca.SX(0)))\n    slow",
        "Rotor.at(ca.SX(1.5)))\n    slow",
        ("data ipmsm_flux",),
    ),
)

MODEL = (*SURFACE, *SALIENT_MUTANTS, *FLUX_MUTANTS, *BASE, *MECHANICS, *STATES)
