"""Field-oriented control as one symbolic block: estimate and currents in, duty cycles out.

Clarke -> (filter) -> Park -> speed PI -> current PI with decoupling -> inverse Park -> SVPWM. Gains are data
(:class:`Gains`), computed from motor data and the bandwidths a drive file states.

What the inverter takes from the voltage (:mod:`model.inverter`) is added to the duty cycles, with the same signs and,
where the model has it, by the same number V_d: the drive file's, or the filter's estimate of it.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass, fields
from typing import Any

import casadi as ca

from model.filters.program import BlockBuilder
from model.inverter import SQRT_3, STATE, clarke, compensation_current, legs, lost_voltage, saturated, takes_voltage
from model.machines.base import Pair, Rotor
from model.machines.lost_voltage import constant_voltage
from model.machines.state_space import StateSpaceModel
from model.quantities import Block, Constants
from model.schema import Drive

#: V: a DC link measured lower, or not a number, counts as this much; duty cycles and integrators stay finite.
LEAST_LINK = 1.0
#: rad: a sensed angle beyond is none; up to here the error of sine and cosine is proved.
SENSED_MAX = 1000.0


@dataclass(frozen=True)
class Gains:
    """The controller's data, in the order of the generated struct's ``gain`` array.

    Integral gains are per sample. ``advance`` is the time from sampling to the middle of the interval in which
    the voltage acts: T / 2, plus T for each sample of computation delay.
    """

    speed_p: float  # N m s/rad
    speed_i: float  # N m/rad per sample
    current_d_p: float  # V/A
    current_q_p: float  # V/A
    current_i: float  # V/A per sample
    max_current: float  # A
    dead_share: float  # dead time over T, or (``compensation``) the share of V_d that is made up for; 0: none
    dead_current: float  # A: below it the compensation fades, as the sign of a noisy current is no sign
    advance: float  # s

    @property
    def values(self) -> tuple[float, ...]:
        """The gains in the order of the struct."""
        return astuple(self)

    @classmethod
    def names(cls, drive: Drive | None = None) -> list[str]:
        """Return the gains' names in the order of the struct.

        Parameters
        ----------
        drive : Drive, optional
            Where its model has V_d, what stands in the place of ``dead_share`` is a share of that.
        """
        own = {"dead_share": "compensation"} if drive is not None and takes_voltage(drive) else {}
        return [own.get(field.name, field.name) for field in fields(cls)]


def design(drive: Drive, delay: int = 0) -> Gains:
    """Pole placement: currents by internal model (alpha L, alpha R), speed with a double pole at its bandwidth.

    Parameters
    ----------
    drive : Drive
        The drive.
    delay : int, optional
        Samples from measuring to acting, 0 or 1.
    """
    m, c, T = drive.motor, drive.control, drive.model.sample_time
    return Gains(
        speed_p=2 * c.speed_bandwidth * m.inertia,
        speed_i=c.speed_bandwidth**2 * m.inertia * T,
        current_d_p=c.current_bandwidth * m.inductance_d,
        current_q_p=c.current_bandwidth * m.inductance_q,
        current_i=c.current_bandwidth * m.stator_resistance * T,
        max_current=c.max_current,
        dead_share=1.0 if takes_voltage(drive) else 0.0,
        dead_current=compensation_current(drive),
        advance=(0.5 + delay) * T,
    )


def command_limits(drive: Drive) -> tuple[float, float]:
    """Speed reference (rad/s) and DC link (V) beyond which a command is an error: twice what the drive is made for.

    Parameters
    ----------
    drive : Drive
        Its operating box gives the speed (mechanical rad/s), its control section the DC link (V).

    Returns
    -------
    tuple of two floats
        Of the speed reference's size, rad/s, and of the DC link, V.
    """
    return 2.0 * drive.operating_box.speed, 2.0 * drive.control.dc_link


def first_command(drive: Drive) -> tuple[float, float]:
    """The command in force until one is accepted: standstill, and the DC link of the drive file.

    Parameters
    ----------
    drive : Drive
        Its control section gives the DC link.

    Returns
    -------
    tuple of two floats
        Speed reference, rad/s, and DC link, V.
    """
    return 0.0, drive.control.dc_link


def believed_block(model: StateSpaceModel) -> Block:
    """h at the state: the currents a filter believes in, for a sample whose measured ones it rejected.

    Parameters
    ----------
    model : StateSpaceModel
        Gives h, eq. 5.

    Returns
    -------
    Block
        ``x`` (n) -> ``i`` (2, A).
    """
    b = BlockBuilder("believed_currents", "h, eq. 5: i_alpha, i_beta in A as the filter believes them")
    x = b.input("x", [state.name for state in model.states])
    i, named = model.measure(x)
    _record(b, "", {**named, "i_alpha_believed": i[0], "i_beta_believed": i[1]})
    b.output("i", i)
    return b.build()


def clarke_block() -> Block:
    """Two measured phase currents to alpha-beta, amplitude-invariant, star point open."""
    b = BlockBuilder("clarke", "Clarke: i_a, i_b in A -> i_alpha, i_beta in A")
    i_a, i_b = b.input("phase", ["i_a", "i_b"])
    b.output("i", [i_a, (1 / SQRT_3) * i_a + (2 / SQRT_3) * i_b])
    return b.build()


def control_block(drive: Drive, constants: Constants) -> Block:
    """The regulators and the modulator.

    Inputs: ``i`` alpha-beta currents (A); ``rotor`` speed (mechanical rad/s) and electrical angle (rad), estimated or
    sensed, and the V_d that is estimated, if it is; ``command`` speed reference (rad/s), DC link (V); ``gain`` as
    :class:`Gains`; ``integrator`` speed (N m), d and q current (V). Outputs: ``duty`` of phases a, b, c; ``v`` the
    voltage (V) the filter is told of: the one that arrives where the compensation is right or, where the model has V_d,
    the one the duty cycles command; ``integrator``.

    Parameters
    ----------
    drive : Drive
    constants : Constants
        Collects the motor's numbers that keep a name in the generated code.
    """
    b = BlockBuilder("control", "Field-oriented control")
    i = b.input("i", ["i_alpha", "i_beta"])
    omega, theta, *estimated = b.input("rotor", ["omega", "theta", *([STATE] if STATE in drive.model.adaptive else [])])
    omega_ref, v_dc = b.input("command", ["omega_ref", "v_dc"])
    gain = Gains(*b.input("gain", [f"gain_{name}" for name in Gains.names(drive)]))
    z_speed, z_d, z_q = b.input("integrator", ["integral_speed", "integral_d", "integral_q"])
    motor = drive.motor
    L_d = constants("L_D", ca.SX(motor.inductance_d), "L_d, H")
    L_q = constants("L_Q", ca.SX(motor.inductance_q), "L_q, H")
    psi_m = constants("PSI_M", ca.SX(motor.magnet_flux), "magnet flux linkage, Wb")
    pole_pairs = constants("POLE_PAIRS", ca.SX(motor.pole_pairs), "p")
    i_d, i_q = Rotor.at(theta).to_rotor((i[0], i[1]))
    _record(b, "Park", {"i_d": i_d, "i_q": i_q})
    error_omega = omega_ref - omega
    _record(b, "speed PI", {"error_omega": error_omega})
    torque_ref, z_speed = _speed_regulator(b, drive, constants, gain, error_omega, z_speed)
    i_d_ref, i_q_ref = _current_reference(b, drive, constants, torque_ref)
    omega_e = pole_pairs * omega
    feed_forward = (-omega_e * (L_q * i_q), omega_e * (L_d * i_d + psi_m))
    error = (i_d_ref - i_d, i_q_ref - i_q)
    _record(b, "current PI with decoupling", {"error_d": error[0], "error_q": error[1]})
    v_d = gain.current_d_p * error[0] + z_d + feed_forward[0]
    v_q = gain.current_q_p * error[1] + z_q + feed_forward[1]
    _record(b, "", {"omega_e": omega_e, "v_d_wanted": v_d, "v_q_wanted": v_q})
    v_link = ca.fmax(v_dc, LEAST_LINK)
    v_max = (1 / SQRT_3) * v_link
    shrink = v_max / ca.sqrt(ca.fmax(v_d * v_d + v_q * v_q, v_max * v_max))
    v_d_lim, v_q_lim = shrink * v_d, shrink * v_q
    named = {"v_link": v_link, "v_max": v_max, "shrink": shrink, "v_d": v_d_lim, "v_q": v_q_lim}
    _record(b, "voltage hexagon's inner circle", named)
    z_d = z_d + gain.current_i * error[0] + _back(gain.current_i, gain.current_d_p) * (v_d_lim - v_d)
    z_q = z_q + gain.current_i * error[1] + _back(gain.current_i, gain.current_q_p) * (v_q_lim - v_q)
    _record(b, "anti-windup by back-calculation", {"integral_d_next": z_d, "integral_q_next": z_q})
    acting = theta + omega_e * gain.advance
    _record(b, "inverse Park at the angle in the middle of the acting interval", {"theta_acting": acting})
    v = Rotor.at(acting).to_stator((v_d_lim, v_q_lim))
    _record(b, "", {"v_alpha": v[0], "v_beta": v[1]})
    share = _lost_share(b, drive, constants, gain, estimated, v_link)
    duty = _svpwm(b, v, v_link, _dead_time(b, gain, share, i))
    b.output("duty", duty)
    b.output("v", list(_commanded(b, duty, v_link) if takes_voltage(drive) else v))
    b.output("integrator", [z_speed, z_d, z_q])
    return b.build()


def _record(b: BlockBuilder, meaning: str, named: dict[str, Any]) -> None:
    b.stage(next(iter(named)), "", meaning, list(named.values()), list(named), scale="none")


def _speed_regulator(
    b: BlockBuilder, drive: Drive, constants: Constants, gain: Any, error: Any, integral: Any
) -> tuple[Any, Any]:
    """PI with back-calculation; the torque is limited to what the maximum current makes."""
    limit = _torque_limit(b, drive, constants, gain.max_current)
    wanted = gain.speed_p * error + integral
    torque = ca.fmax(-limit, ca.fmin(limit, wanted))
    following = integral + gain.speed_i * error + _back(gain.speed_i, gain.speed_p) * (torque - wanted)
    named = {"torque_wanted": wanted, "torque_ref": torque, "integral_speed_next": following}
    _record(b, "", named)
    return torque, following


def _back(integral: Any, proportional: Any) -> Any:
    """Share of what a limit took that is taken back from the integrator: that of the integral gain, at most all of it.

    More than twice all of it would make the integrator of a saturated regulator grow without bound, as a sample time
    beyond 2 L / R did.
    """
    return ca.fmin(integral / proportional, 1.0)


def _saliency(drive: Drive, constants: Constants) -> Any | None:
    """Return (L_q - L_d) / psi_m, 1/A, of either sign: what reluctance adds to the torque; None for a round rotor."""
    m = drive.motor
    difference = m.inductance_q - m.inductance_d
    if ca.SX(difference).is_zero():
        return None
    return constants("MTPA_RATIO", ca.SX(difference / m.magnet_flux), "(L_q - L_d) / psi_m, 1/A")


def _torque_limit(b: BlockBuilder, drive: Drive, constants: Constants, current: Any) -> Any:
    """Torque of the current on the curve of maximum torque per ampere (MTPA).

    With r = (L_q - L_d) / psi_m the torque is 1.5 p psi_m i_q (1 - r i_d), and least current makes it where
    i_d (1 - r i_d) = -r i_q^2. On the circle of radius I that is i_d = -2 I (r I) / (1 + sqrt(1 + 8 (r I)^2)): nothing
    cancels, whatever the sign and size of r.
    """
    per_ampere = 1.5 * drive.motor.pole_pairs * drive.motor.magnet_flux
    limit = constants("TORQUE_PER_A", ca.SX(per_ampere), "1.5 p psi_m, N m/A") * current
    ratio = _saliency(drive, constants)
    if ratio is not None:
        reluctance = ratio * current
        root = ca.sqrt(1 + 8 * (reluctance * reluctance))
        share = 2 * reluctance / (1 + root)  # -i_d / I, at most sqrt(1 / 2) of it
        limit = limit * ca.sqrt(1 - share * share) * (1 + reluctance * share)
        _record(b, "", {"reluctance_at_limit": reluctance, "root_at_limit": root, "d_share_at_limit": share})
    _record(b, "", {"torque_limit": limit})
    return limit


def _current_reference(b: BlockBuilder, drive: Drive, constants: Constants, torque: Any) -> Pair:
    """Currents that make a torque: i_d = 0, or where the axes differ maximum torque per ampere (MTPA).

    In units of 1 / r the curve is i_d = -i_q^2 / (1/2 + sqrt(1/4 + i_q^2)) and the torque i_q (1 - i_d). The i_q of a
    torque t is first taken as t / sqrt(3/4 + sqrt(1/16 + t^2)), which is right to third order for small and to first
    order for large t; then i_d follows, and i_q once more from the torque. The torque is exact; the current is at most
    0.26 % more than the least, since about the optimum it changes with the square of the error.
    """
    m = drive.motor
    inverse = constants("A_PER_TORQUE", ca.SX(1 / (1.5 * m.pole_pairs * m.magnet_flux)), "1 / (1.5 p psi_m), A/(N m)")
    i_d, i_q = ca.SX(0), inverse * torque
    ratio = _saliency(drive, constants)
    if ratio is None:
        _record(b, "current references", {"i_q_ref": i_q})
    else:
        _record(b, "current references", {"i_q_at_zero_i_d": i_q})
        t = ratio * i_q
        first = i_q / ca.sqrt(0.75 + ca.sqrt(0.0625 + t * t))
        reluctance = ratio * first
        root = ca.sqrt(0.25 + reluctance * reluctance)
        _record(b, "", {"reluctance_torque": t, "i_q_first": first, "reluctance": reluctance, "root_mtpa": root})
        against = first * reluctance / (0.5 + root)
        i_d, i_q = -against, i_q / (1 + ratio * against)
        _record(b, "", {"minus_i_d_ref": against, "i_q_ref": i_q})
    return i_d, i_q


def _lost_share(
    b: BlockBuilder, drive: Drive, constants: Constants, gain: Any, estimated: list[Any], v_link: Any
) -> Any:
    """The share of a leg's duty cycle to make up for: as the gain says, of V_d where the model has it."""
    if not takes_voltage(drive):
        return gain.dead_share
    V_d = estimated[0] if estimated else constant_voltage(constants, ca.SX(lost_voltage(drive)))
    lost = gain.dead_share * V_d / v_link
    _record(b, "share of a leg's duty cycle that the inverter takes", {"lost_share": lost})
    return lost


def _commanded(b: BlockBuilder, duty: list[Any], v_link: Any) -> Pair:
    """The voltage that duty cycles command."""
    v_alpha, v_beta = clarke(duty)
    v = v_link * v_alpha, v_link * v_beta
    _record(b, "the voltage commanded", {"v_alpha_commanded": v[0], "v_beta_commanded": v[1]})
    return v


def _dead_time(b: BlockBuilder, gain: Any, lost: Any, i: list[Any]) -> list[Any]:
    """The part of each leg's duty cycle that the inverter takes, with the sign of the leg's current."""
    phases, parts = legs(i)
    names = ["i_a", "i_b", "i_c"]
    signs = [saturated(phase / gain.dead_current) for phase in phases]
    _record(b, "dead-time compensation", parts)
    _record(
        b, "", {**dict(zip(names, phases, strict=True)), **{f"sign_{n}": s for n, s in zip(names, signs, strict=True)}}
    )
    return [lost * sign for sign in signs]


def _svpwm(b: BlockBuilder, v: Pair, v_link: Any, lost: list[Any]) -> list[Any]:
    """Space-vector modulation as min-max injection, what dead time takes added; duty cycles in [0, 1]."""
    half, cross = -0.5 * v[0], (SQRT_3 / 2) * v[1]
    phases = [v[0], half + cross, half - cross]
    named = {"minus_half_v_alpha": half, "cross_v_beta": cross, "v_b": phases[1], "v_c": phases[2]}
    _record(b, "SVPWM", named)
    highest = ca.fmax(phases[0], ca.fmax(phases[1], phases[2]))
    lowest = ca.fmin(phases[0], ca.fmin(phases[1], phases[2]))
    common = 0.5 * (highest + lowest)
    _record(b, "", {"v_highest": highest, "v_lowest": lowest, "v_common": common})
    raw = [0.5 + (phase - common) / v_link + more for phase, more in zip(phases, lost, strict=True)]
    return [ca.fmin(ca.fmax(value, 0.0), 1.0) for value in raw]  # the second counts where they do not compare
