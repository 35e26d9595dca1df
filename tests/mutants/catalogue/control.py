"""A wrong controller, a wrong motor to simulate with."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

LIMITED = ("pytest tests/runtime/test_torque_limits.py -k both",)
SURFACE, SALIENT = ("controller paper_spmsm",), ("controller ipmsm_flux",)
FINITE = ("pytest tests/model/test_controller.py -k finite",)
OPTIMUM = ("pytest tests/model/test_controller.py -k least_current",)
PLANT = ("regenerated paper_spmsm tests/runtime/test_simulation.py -k 'dop853 and paper_spmsm'",)

_ROWS = (
    ("speed error reversed", "error_omega = omega_ref - omega", "error_omega = omega - omega_ref", SURFACE),
    ("decoupling's sign", "(-omega_e * (L_q * i_q),", "(omega_e * (L_q * i_q),", SURFACE),
    ("L_d for L_q", "(-omega_e * (L_q * i_q),", "(-omega_e * (L_d * i_q),", SALIENT),
    ("back-EMF not fed forward", "omega_e * (L_d * i_d + psi_m)", "omega_e * (L_d * i_d)", SURFACE),
    ("decoupling with mechanical speed", "omega_e = pole_pairs * omega", "omega_e = omega", SURFACE),
    ("gains of d and q exchanged", "v_d = gain.current_d_p * error[0]", "v_d = gain.current_q_p * error[0]", SALIENT),
    ("d integrator forgotten", "* error[0] + z_d + feed_forward[0]", "* error[0] + feed_forward[0]", SURFACE),
    ("circle too large", "v_max = (1 / SQRT_3) * v_link", "v_max = (2 / 3) * v_link", SURFACE),
    (
        "limited at twice the circle",
        "ca.fmax(v_d * v_d + v_q * v_q, v_max * v_max)",
        "ca.fmax(0.25 * (v_d * v_d + v_q * v_q), v_max * v_max)",
        SURFACE,
    ),
    (
        "one axis limited",
        "limited = shrink * v_d, shrink * v_q",
        "limited = shrink * v_d, v_q",
        SURFACE,
    ),
    (
        "no anti-windup on q",
        "error[1] + _back(gain.current_i, gain.current_q_p) * (v_q_lim - v_q)",
        "error[1]",
        SURFACE,
    ),
    ("anti-windup's sign on d", "current_d_p) * (v_d_lim - v_d)", "current_d_p) * (v_d - v_d_lim)", SURFACE),
    ("anti-windup of d by q's gain", "gain.current_i, gain.current_d_p)", "gain.current_i, gain.current_q_p)", SALIENT),
    ("anti-windup without bound", "ca.fmin(integral / proportional, 1.0)", "integral / proportional", FINITE),
    ("angle not advanced", "acting = theta + omega_e * gain.advance", "acting = theta", SURFACE),
    ("torque unlimited above", "ca.fmax(-limit, ca.fmin(limit, wanted))", "ca.fmax(-limit, wanted)", SURFACE),
    ("no anti-windup of speed", "error + _back(gain.speed_i, gain.speed_p) * (torque - wanted)", "error", SURFACE),
    (
        "phases b and c exchanged",
        "half, cross = -0.5 * v[0], (SQRT_3 / 2) * v[1]",
        "half, cross = -0.5 * v[0], -(SQRT_3 / 2) * v[1]",
        SURFACE,
    ),
    ("common mode's factor", "common = 0.5 * (highest + lowest)", "common = highest + lowest", SURFACE),
    (
        "duty not cut above",
        "[ca.fmin(ca.fmax(value, 0.0), 1.0) for value in raw]",
        "[ca.fmax(value, 0.0) for value in raw]",
        SURFACE,
    ),
    (
        "dead time reversed",
        "return [lost * sign for sign in signs]",
        "return [-lost * sign for sign in signs]",
        SURFACE,
    ),
    (
        "dead time of any current",
        "saturated(phase / gain.dead_current)",
        "phase / gain.dead_current",
        SURFACE,
    ),
    ("Clarke's factor", "(1 / SQRT_3) * i_a + (2 / SQRT_3) * i_b", "(1 / SQRT_3) * i_a + (1 / SQRT_3) * i_b", SURFACE),
    ("link's floor", "LEAST_LINK = 1.0", "LEAST_LINK = 10.0", SURFACE),
    (
        "limits of commands",
        "2.0 * drive.operating_box.speed, 2.0 * drive",
        "1.0 * drive.operating_box.speed, 2.0 * drive",
        SURFACE,
    ),
    ("first DC link", "return 0.0, drive.control.dc_link", "return 0.0, 0.5 * drive.control.dc_link", SURFACE),
    ("speed gain without the factor 2", "2 * c.speed_bandwidth * m.inertia", "c.speed_bandwidth * m.inertia", SURFACE),
    (
        "integral gain without T",
        "current_i=c.current_bandwidth * m.stator_resistance * T",
        "current_i=c.current_bandwidth * m.stator_resistance",
        SURFACE,
    ),
    ("delay not designed for", "advance=(0.5 + delay) * T", "advance=0.5 * T", SURFACE),
    (
        "believed at another angle",
        "i, named = model.measure(x)",
        "i, named = model.measure([*x[:3], -x[3], *x[4:]])",
        SALIENT,
    ),
    ("sensed angle of less", "SENSED_MAX = 1000.0", "SENSED_MAX = 100.0", SURFACE),
)

_REFERENCES = (
    ("factor 1.5 lost", "per_ampere = 1.5 * drive", "per_ampere = drive", SURFACE),
    ("MTPA's sign", "against = first * reluctance", "against = -first * reluctance", SALIENT),
    ("MTPA: torque of i_d forgotten", "wanted = i_q / torque_share(constants, ratio, i_d)", "wanted = i_q", SALIENT),
    ("MTPA: saliency's factor", "ca.SX(difference / m.magnet_flux)", "ca.SX(2 * difference / m.magnet_flux)", SALIENT),
    ("MTPA: axes exchanged", "m.inductance_q - m.inductance_d", "m.inductance_d - m.inductance_q", SALIENT),
    ("MTPA: first i_q as of a round rotor", "first = i_q / ca.sqrt(0.75", "first = i_q / (1 + 0 * 0.75", OPTIMUM),
    ("MTPA: root", "root = ca.sqrt(0.25 + reluctance", "root = ca.sqrt(0.5 + reluctance", OPTIMUM),
    ("torque limit: root", "ca.sqrt(1 + 8 * (reluctance", "ca.sqrt(1 + 4 * (reluctance", SALIENT),
    ("torque limit of the magnet alone", "torque = torque * torque_share(constants, ratio, i_d)", "pass", SALIENT),
    ("beyond the deepest torque goes on", "_left_of(current, i_d) - beyond", "_left_of(current, i_d)", SURFACE),
    ("not held at the deepest", "i_d = ca.fmax(i_d - against, -reach.deepest)", "i_d = i_d - against", SALIENT),
    ("a round rotor is not held", "i_d = ca.fmax(i_d, -reach.deepest)", "i_d = ca.SX(0)", SURFACE),
    (
        "the curve may take ten times as much more",
        "CURVE_EXCESS = 1.003",
        "CURVE_EXCESS = 1.03",
        ("pytest tests/model/test_weakening.py -k within_the_largest",),
    ),
)

_WEAKENING = (
    ("room of the whole voltage", "ROOM / math.sqrt(3)), f", "1 / math.sqrt(3)), f", SURFACE),
    ("voltage of one axis", "v_d * v_d + v_q * v_q", "v_q * v_q", SURFACE),
    ("strengthened", "z + gain * left", "z - gain * left", SURFACE),
    ("above zero", "ca.fmin(z + gain * left, 0.0)", "z + gain * left", SURFACE),
    ("without end", "ca.fmax(ca.fmin(z + gain * left, 0.0), -most)", "ca.fmin(z + gain * left, 0.0)", ("pytest tests/model/test_weakening.py -k integrator",)),
    ("a burst counts in full", "ca.fmax(room_squared - wanted_squared, -room_squared)", "room_squared - wanted_squared", SURFACE),
    ("resistance forgotten", "/ (turning + corner)", "/ (turning + 1e-9)", SURFACE),
    ("corner of the other axis", "(m.stator_resistance / m.inductance_d) ** 2", "(m.stator_resistance / m.inductance_q) ** 2", SALIENT),
    ("cancelled by the other axis", "ca.SX(m.magnet_flux / m.inductance_d)", "ca.SX(m.magnet_flux / m.inductance_q)", SALIENT),
    ("all of the current", "DEEPEST = 0.1, 0.95", "DEEPEST = 0.1, 1.0", SALIENT),
    ("reluctance goes no further", " + curve * ca.fmax(at_limit, 0.0)", "", SALIENT),
    ("gain by the back-EMF alone", "math.hypot(m.magnet_flux, m.inductance_q * c.max_current)", "m.magnet_flux", SALIENT),
    ("gain of another voltage", "per_volt / (2 * V)", "per_volt / V", SURFACE),
    ("torque left: reluctance's sign", "ca.fmax(1 - ratio * i_d, least)", "ca.fmax(1 + ratio * i_d, least)", SALIENT),
)  # fmt: skip

_LIMITS = (
    ("any torque", "torque = ca.fmin(torque, gain.max_torque)", "torque = torque + 0.0 * gain.max_torque", LIMITED),
    ("any power", "ca.fmin(torque, gain.max_power / limits", "ca.fmin(torque, 1e9 * gain.max_power / limits", LIMITED),
    ("power of a rotor that turns back", "ca.fmax(ca.fmax(omega, -omega), least)", "ca.fmax(omega, least)", LIMITED),
    ("power by electrical speed", "reach.torque, omega)", "reach.torque, omega_e)", LIMITED),
    ("torque for power", "max_torque=c.max_torque", "max_torque=c.max_power", LIMITED),
)

_PLANT = (
    ("weights of RK4", "k1[j] + 2 * (k2[j] + k3[j]) + k4[j]", "k1[j] + (k2[j] + k3[j]) + k4[j]", PLANT),
    ("reach of the third slope", "enumerate((0.0, 0.5, 0.5, 1.0))", "enumerate((0.0, 0.5, 1.0, 1.0))", PLANT),
    ("load accelerates", "machine.torque(z, rotor) - load - par.D", "machine.torque(z, rotor) + load - par.D", PLANT),
    ("friction's sign", "- load - par.D * omega", "- load + par.D * omega", PLANT),
    (
        "rotor's phasor turns back",
        "-omega_e * rotor.sin, omega_e * rotor.cos]",
        "omega_e * rotor.sin, omega_e * rotor.cos]",
        PLANT,
    ),
    ("theta by mechanical speed", "return [*dz, d_omega, omega_e,", "return [*dz, d_omega, omega,", PLANT),
    ("inertia for its reciprocal", "J=1 / per_J", "J=per_J", PLANT),
    ("last slope at the first point", "sixth * (k1[j]", "sixth * (k2[j]", PLANT),
)


def _of(kind: str, file: str, rows: tuple[tuple[str, str, str, tuple[str, ...]], ...]) -> tuple[Mutant, ...]:
    return tuple(Mutant(kind, f"{file}: {name}", checks, file, old, new) for name, old, new, checks in rows)


CONTROL = (
    *_of("controller", "model/loop/controller.py", _ROWS),
    *_of("controller", "model/loop/controller.py", _LIMITS),
    *_of("controller", "model/loop/references.py", _REFERENCES),
    *_of("controller", "model/loop/weakening.py", _WEAKENING),
    *_of("plant", "model/loop/plant.py", _PLANT),
)
