"""Field-oriented control as one symbolic block: estimate and currents in, duty cycles out.

Clarke -> (filter) -> Park -> speed PI -> current PI with decoupling -> inverse Park -> SVPWM. Gains are data
(:class:`Gains`), computed from motor data and the bandwidths a drive file states.

What the inverter takes from the voltage (:mod:`model.inverter`) is added to the duty cycles, with the same signs and,
where the model has it, by the same number V_d: the drive file's, or the filter's estimate of it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import casadi as ca

from model.alignment import ACROSS_SHARE, align_resistance
from model.filters.program import BlockBuilder
from model.inverter import SQRT_3, STATE, clarke, compensation_current, legs, lost_voltage, saturated, takes_voltage
from model.loop.references import current_reference, record, within_reach
from model.loop.weakening import room_left, weakening_gain
from model.machines.base import Pair, Rotor
from model.machines.lost_voltage import constant_voltage
from model.machines.state_space import StateSpaceModel
from model.quantities import Block, Constants
from model.schema import Drive

#: V: a DC link measured lower, or not a number, counts as this much; duty cycles and integrators stay finite.
LEAST_LINK = 1.0
#: rad: a sensed angle beyond is none; up to here the error of sine and cosine is proved.
SENSED_MAX = 1000.0
#: rad/s: the largest power is no limit of the torque of a rotor that is slower.
LEAST_SPEED = 1e-3


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
    weakening: float  # A/V^2 per sample
    max_torque: float | None = None  # N m, only where the drive file states one
    max_power: float | None = None  # W, mechanical, only where the drive file states one

    @property
    def values(self) -> tuple[float, ...]:
        """The gains in the order of the struct."""
        every = (getattr(self, field.name) for field in fields(self))
        return tuple(value for value in every if value is not None)

    @classmethod
    def of(cls, drive: Drive, values: list[Any]) -> Gains:
        """The gains of a drive, by name.

        Parameters
        ----------
        drive : Drive
        values : list
            In the order of the struct.
        """
        return cls(**dict(zip(cls._stated(drive), values, strict=True)))

    @classmethod
    def names(cls, drive: Drive | None = None) -> list[str]:
        """Return the gains' names in the order of the struct.

        Parameters
        ----------
        drive : Drive, optional
            Where its model has V_d, what stands in the place of ``dead_share`` is a share of that; limits of torque and
            power stand behind the others where it states them.
        """
        own = {"dead_share": "compensation"} if drive is not None and takes_voltage(drive) else {}
        return [own.get(name, name) for name in cls._stated(drive)]

    @classmethod
    def _stated(cls, drive: Drive | None) -> list[str]:
        """The fields that a drive has: what may be None only where its file states it."""
        stated = drive.control.model_dump(exclude_none=True) if drive is not None else {}
        return [field.name for field in fields(cls) if field.default is not None or field.name in stated]


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
        weakening=weakening_gain(drive),
        max_torque=c.max_torque,
        max_power=c.max_power,
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
    record(b, "", {**named, "i_alpha_believed": i[0], "i_beta_believed": i[1]})
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
    :class:`Gains`; ``integrator`` speed (N m), d and q current (V), weakening (A). Outputs: ``duty`` of phases a, b, c;
    ``v`` the voltage (V) the filter is told of: the one that arrives where the compensation is right or, where the
    model has V_d, the one the duty cycles command; ``integrator``.

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
    gain = Gains.of(drive, b.input("gain", [f"gain_{name}" for name in Gains.names(drive)]))
    z_speed, z_d, z_q, z_weak = b.input("integrator", [f"integral_{of}" for of in ("speed", "d", "q", "weakening")])
    L_d, L_q, psi_m, pole_pairs = _motor(drive, constants)
    i_d, i_q = Rotor.at(theta).to_rotor((i[0], i[1]))
    record(b, "Park", {"i_d": i_d, "i_q": i_q})
    error_omega = omega_ref - omega
    record(b, "speed PI", {"error_omega": error_omega})
    omega_e = pole_pairs * omega
    record(b, "", {"omega_e": omega_e})
    reach = within_reach(b, drive, constants, gain.max_current, z_weak, omega_e)
    limit = _stated_limit(b, constants, gain, reach.torque, omega)
    torque_ref, z_speed = _speed_regulator(b, gain, limit, error_omega, z_speed)
    i_d_ref, i_q_ref = current_reference(b, drive, constants, torque_ref, reach)
    feed_forward = (-omega_e * (L_q * i_q), omega_e * (L_d * i_d + psi_m))
    error = (i_d_ref - i_d, i_q_ref - i_q)
    record(b, "current PI with decoupling", {"error_d": error[0], "error_q": error[1]})
    v_d = gain.current_d_p * error[0] + z_d + feed_forward[0]
    v_q = gain.current_q_p * error[1] + z_q + feed_forward[1]
    record(b, "", {"v_d_wanted": v_d, "v_q_wanted": v_q})
    v_link = ca.fmax(v_dc, LEAST_LINK)
    v_d_lim, v_q_lim = _on_circle(b, v_d, v_q, v_link)
    weakening = room_left(constants, gain.weakening, v_link, v_d, v_q, z_weak, reach.deepest + gain.max_current)
    record(b, "field weakening by the voltage that is asked for", weakening)
    z_d = z_d + gain.current_i * error[0] + _back(gain.current_i, gain.current_d_p) * (v_d_lim - v_d)
    z_q = z_q + gain.current_i * error[1] + _back(gain.current_i, gain.current_q_p) * (v_q_lim - v_q)
    record(b, "anti-windup by back-calculation", {"integral_d_next": z_d, "integral_q_next": z_q})
    acting = theta + omega_e * gain.advance
    record(b, "inverse Park at the angle in the middle of the acting interval", {"theta_acting": acting})
    v = Rotor.at(acting).to_stator((v_d_lim, v_q_lim))
    record(b, "", {"v_alpha": v[0], "v_beta": v[1]})
    share = _lost_share(b, drive, constants, gain, estimated, v_link)
    duty = _svpwm(b, v, v_link, _dead_time(b, gain, share, i))
    b.output("duty", duty)
    b.output("v", list(_commanded(b, duty, v_link) if takes_voltage(drive) else v))
    b.output("integrator", [z_speed, z_d, z_q, weakening["integral_weakening_next"]])
    return b.build()


def align_block(drive: Drive, constants: Constants) -> Block:
    """A direct current along an axis, by which a rotor that stands is aligned (:mod:`model.alignment`).

    Along the axis the current is regulated as the d current is; across it the inverter is a resistance, up to a current
    beyond which it is stiff. Inputs: ``i`` alpha-beta currents (A); ``axis`` its cosine and sine, and the current that
    is wanted (A); ``link`` (V); ``gain`` and ``integrator`` as in :func:`control_block`. Outputs: as there.

    Parameters
    ----------
    drive : Drive
    constants : Constants
        Collects the numbers that keep a name in the generated code.
    """
    b = BlockBuilder("align_rotor", "A direct current along an axis, damped across it")
    i = b.input("i", ["i_alpha", "i_beta"])
    cosine, sine, wanted = b.input("axis", ["axis_cosine", "axis_sine", "i_wanted"])
    (v_dc,) = b.input("link", ["v_dc"])
    gain = Gains.of(drive, b.input("gain", [f"gain_{name}" for name in Gains.names(drive)]))
    z = b.input("integrator", [f"integral_{of}" for of in ("speed", "d", "q", "weakening")])
    soft = constants("ALIGN_RESISTANCE", ca.SX(align_resistance(drive)), "ohm, across the axis: damps a swing best")
    hold = constants("ALIGN_ACROSS", ca.SX(ACROSS_SHARE), "of the largest current, across, is left to the rotor")
    error = wanted - (cosine * i[0] + sine * i[1])
    across = cosine * i[1] - sine * i[0]
    most = hold * gain.max_current
    beyond = across - ca.fmax(-most, ca.fmin(most, across))
    v_along, v_across = gain.current_d_p * error + z[1], -(soft * across + gain.current_d_p * beyond)
    v_link = ca.fmax(v_dc, LEAST_LINK)
    along_lim, across_lim = _on_circle(b, v_along, v_across, v_link)
    stiff = gain.current_d_p
    z_along = z[1] + gain.current_i * error + _back(gain.current_i, stiff) * (along_lim - v_along)
    v = cosine * along_lim - sine * across_lim, sine * along_lim + cosine * across_lim
    named = {"error_along": error, "i_across": across, "i_beyond": beyond, "v_alpha": v[0], "v_beta": v[1]}
    record(b, "along the axis and across it", named)
    share = _lost_share(b, drive, constants, gain, [], v_link)
    duty = _svpwm(b, v, v_link, _dead_time(b, gain, share, i))
    b.output("duty", duty)
    b.output("v", list(_commanded(b, duty, v_link)) if takes_voltage(drive) else list(v))
    b.output("integrator", [z[0], z_along, z[2], z[3]])
    return b.build()


def _motor(drive: Drive, constants: Constants) -> tuple[Any, Any, Any, Any]:
    """L_d, L_q, psi_m and p, by name."""
    m = drive.motor
    return (
        constants("L_D", ca.SX(m.inductance_d), "L_d, H"),
        constants("L_Q", ca.SX(m.inductance_q), "L_q, H"),
        constants("PSI_M", ca.SX(m.magnet_flux), "magnet flux linkage, Wb"),
        constants("POLE_PAIRS", ca.SX(m.pole_pairs), "p"),
    )


def _on_circle(b: BlockBuilder, v_d: Any, v_q: Any, v_link: Any) -> Pair:
    """A voltage, shortened to what a turning one may be."""
    v_max = (1 / SQRT_3) * v_link
    shrink = v_max / ca.sqrt(ca.fmax(v_d * v_d + v_q * v_q, v_max * v_max))
    limited = shrink * v_d, shrink * v_q
    named = {"v_link": v_link, "v_max": v_max, "shrink": shrink, "v_d": limited[0], "v_q": limited[1]}
    record(b, "voltage hexagon's inner circle", named)
    return limited


def _stated_limit(b: BlockBuilder, constants: Constants, gain: Gains, within_reach: Any, omega: Any) -> Any:
    """The largest torque: what current and voltage make, or what the drive file states, or its power at this speed."""
    limits: dict[str, Any] = {}
    torque = within_reach
    if gain.max_torque is not None:
        limits["torque_allowed"] = torque = ca.fmin(torque, gain.max_torque)
    if gain.max_power is not None:
        least = constants("LEAST_SPEED", ca.SX(LEAST_SPEED), "rad/s: at a lower one the power is no limit")
        limits["speed"] = ca.fmax(ca.fmax(omega, -omega), least)
        limits["torque_of_power"] = ca.fmin(torque, gain.max_power / limits["speed"])
        torque = limits["torque_of_power"]
    if limits:
        record(b, "largest torque and power that are stated", limits)
    return torque


def _speed_regulator(b: BlockBuilder, gain: Any, limit: Any, error: Any, integral: Any) -> tuple[Any, Any]:
    """PI with back-calculation; the torque is limited to what maximum current and voltage make."""
    wanted = gain.speed_p * error + integral
    torque = ca.fmax(-limit, ca.fmin(limit, wanted))
    following = integral + gain.speed_i * error + _back(gain.speed_i, gain.speed_p) * (torque - wanted)
    named = {"torque_wanted": wanted, "torque_ref": torque, "integral_speed_next": following}
    record(b, "", named)
    return torque, following


def _back(integral: Any, proportional: Any) -> Any:
    """Share of what a limit took that is taken back from the integrator: that of the integral gain, at most all of it.

    More than twice all of it would make the integrator of a saturated regulator grow without bound, as a sample time
    beyond 2 L / R did.
    """
    return ca.fmin(integral / proportional, 1.0)


def _lost_share(
    b: BlockBuilder, drive: Drive, constants: Constants, gain: Any, estimated: list[Any], v_link: Any
) -> Any:
    """The share of a leg's duty cycle to make up for: as the gain says, of V_d where the model has it."""
    if not takes_voltage(drive):
        return gain.dead_share
    V_d = estimated[0] if estimated else constant_voltage(constants, ca.SX(lost_voltage(drive)))
    lost = gain.dead_share * V_d / v_link
    record(b, "share of a leg's duty cycle that the inverter takes", {"lost_share": lost})
    return lost


def _commanded(b: BlockBuilder, duty: list[Any], v_link: Any) -> Pair:
    """The voltage that duty cycles command."""
    record(b, "", dict(zip(("duty_a", "duty_b", "duty_c"), duty, strict=True)))
    v_alpha, v_beta = clarke(duty)
    v = v_link * v_alpha, v_link * v_beta
    record(b, "the voltage commanded", {"v_alpha_commanded": v[0], "v_beta_commanded": v[1]})
    return v


def _dead_time(b: BlockBuilder, gain: Any, lost: Any, i: list[Any]) -> list[Any]:
    """The part of each leg's duty cycle that the inverter takes, with the sign of the leg's current."""
    phases, parts = legs(i)
    names = ["i_a", "i_b", "i_c"]
    signs = [saturated(phase / gain.dead_current) for phase in phases]
    record(b, "dead-time compensation", parts)
    record(
        b, "", {**dict(zip(names, phases, strict=True)), **{f"sign_{n}": s for n, s in zip(names, signs, strict=True)}}
    )
    return [lost * sign for sign in signs]


def _svpwm(b: BlockBuilder, v: Pair, v_link: Any, lost: list[Any]) -> list[Any]:
    """Space-vector modulation as min-max injection, what dead time takes added; duty cycles in [0, 1]."""
    half, cross = -0.5 * v[0], (SQRT_3 / 2) * v[1]
    phases = [v[0], half + cross, half - cross]
    named = {"minus_half_v_alpha": half, "cross_v_beta": cross, "v_b": phases[1], "v_c": phases[2]}
    record(b, "SVPWM", named)
    highest = ca.fmax(phases[0], ca.fmax(phases[1], phases[2]))
    lowest = ca.fmin(phases[0], ca.fmin(phases[1], phases[2]))
    common = 0.5 * (highest + lowest)
    record(b, "", {"v_highest": highest, "v_lowest": lowest, "v_common": common})
    raw = [0.5 + (phase - common) / v_link + more for phase, more in zip(phases, lost, strict=True)]
    return [ca.fmin(ca.fmax(value, 0.0), 1.0) for value in raw]  # the second counts where they do not compare
