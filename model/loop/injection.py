"""A known square wave on the rotor's estimated d axis, by which a salient machine shows its angle at standstill.

At rest there is no back-EMF, and what is left of the voltage says as much of a wrong resistance as of a wrong angle. A
voltage that changes its sign every sample makes a ripple i_d = V T / (2 L_d) on its axis and, where the true axis is
delta from there, one of V T / 4 (1/L_d - 1/L_q) sin(2 delta) across it (square wave at half the sampling frequency:
Yoon, Sul, Morimoto and Ide, IEEE Trans. Ind. Appl. 47, 2011). Resistance has no part in it, and no second observer is
needed: the filter knows the voltage and expects the ripple, through its own equations.

The voltage fades with speed, where the back-EMF tells more, and is never more than the duty cycles have room for, so
that what the filter is told is what arrives. Room is what the hexagon has in the direction of the pulse, beside the
voltage that is there already: no two legs come further apart than a whole period. At rest that is the link over sqrt(3)
to two thirds of it; with the wave in them the largest and the smallest duty cycle lie about one half alike again, as
space-vector modulation has it. The current regulator answers the ripple, too: with a sample of delay it takes a part of
the wave away, without it adds to it; the amplitude has that in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from model.filters.program import BlockBuilder
from model.inverter import SQRT_3, TRANSFORM, lost_voltage
from model.loop.controller import LEAST_LINK
from model.machines.base import Rotor
from model.quantities import Block, Constant
from model.rating import rating
from model.schema import Drive

#: Amplitude that the ripple may have, of the current that rated torque takes, or of the largest where none is stated;
#: speed beyond which there is none, of the rated one.
RIPPLE, FADED = 0.048, 0.2
#: How far a d inductance may be off of which the drive file states nothing.
UNSTATED = 0.1
#: The compensation of a leg whose current is about zero follows the sign that the ripple had a whole period before: it
#: adds to the square wave, a single leg two thirds of V_d and two of them more, 0.87 of it in the worst run.
OF_LEGS = 1.0
#: Share of the wave that is left in any case, where V_d is as large as the wave itself.
LEAST_LEFT = 0.5
#: Legs of a unit pulse that differ by less hold no pulse back.
LEAST_APART = 1e-3


def ripple_scale(drive: Drive) -> float:
    """The current of which the ripple is a share, A: what rated torque takes, or the largest where none is stated.

    Parameters
    ----------
    drive : Drive
    """
    return rating(drive).current if drive.rated else drive.control.max_current


def injected_voltage(drive: Drive, delay: int = 1) -> float:
    """Amplitude of the square wave, V; 0 for a round rotor, which shows nothing.

    The ripple is held with the smallest d inductance within tolerance, and with what the compensation adds.

    Parameters
    ----------
    drive : Drive
        Its rated or largest current, d inductance, sample time, current regulator, and V_d.
    delay : int, optional
        Samples from measuring to acting, 0 or 1: how the regulator answers.
    """
    m = drive.motor
    if m.inductance_d == m.inductance_q:
        return 0.0
    off = drive.tolerance.inductance if drive.tolerance else 0.0
    least = m.inductance_d * (1.0 - (off or UNSTATED))
    answer = drive.control.current_bandwidth * m.inductance_d  # V/A
    per_ampere = 2.0 * least / drive.model.sample_time + (answer if delay else -answer)
    allowed = RIPPLE * ripple_scale(drive) * per_ampere
    return max(allowed - OF_LEGS * lost_voltage(drive), LEAST_LEFT * allowed)


def faded(drive: Drive) -> float:
    """One over the speed beyond which no voltage is injected, s/rad.

    Parameters
    ----------
    drive : Drive
    """
    return 1.0 / (FADED * rating(drive).speed)


def faded_constant(drive: Drive) -> Constant:
    """The same, by its name in generated text.

    Parameters
    ----------
    drive : Drive
    """
    return Constant("PER_FADED_SPEED", faded(drive), "1 / (0.2 of rated speed), s/rad", None)


def injection_constants(drive: Drive) -> tuple[Constant, ...]:
    """The numbers of the block that have a name in generated text.

    Parameters
    ----------
    drive : Drive
    """
    apart = Constant("LEAST_APART", LEAST_APART, "legs of a unit pulse that differ by less hold it back no more", None)
    return *TRANSFORM, faded_constant(drive), apart


def left_of_wave(drive: Drive, omega: Any) -> Any:
    """Share of the wave that speed has left.

    Parameters
    ----------
    drive : Drive
    omega : object
        Estimated speed, rad/s mechanical.
    """
    return ca.fmax(1.0 - ca.fmax(omega, -omega) * faded(drive), 0.0)


def injection_block(drive: Drive) -> Block:
    """Duty cycles and voltage with the square wave added, and the sign that it has next.

    Inputs: ``rotor`` estimated speed (rad/s, mechanical) and angle (rad); ``duty`` of phases a, b, c; ``v`` (V) as the
    controller told it; ``link`` (V); ``injection`` amplitude (V) and sign. Outputs: ``duty``, ``v``, ``injection``.

    Parameters
    ----------
    drive : Drive
        Its rated speed.
    """
    b = BlockBuilder("inject", "A square wave on the estimated d axis")
    omega, theta = b.input("rotor", ["omega", "theta"])
    duty = b.input("duty", ["duty_a", "duty_b", "duty_c"])
    v = b.input("v", ["v_alpha", "v_beta"])
    (v_dc,) = b.input("link", ["v_dc"])
    amplitude, sign = b.input("injection", ["amplitude", "sign"])
    left = left_of_wave(drive, omega)
    v_link = ca.fmax(v_dc, LEAST_LINK)
    pulse = _legs(Rotor.at(theta).to_stator((sign, 0.0)))
    room, named = _room(duty, pulse)
    size = ca.fmin(ca.fmax(amplitude * left, 0.0), v_link * room)  # of what is no number none
    share = size / v_link
    added = Rotor.at(theta).to_stator((sign * size, 0.0))
    waved = [d + share * leg for d, leg in zip(duty, pulse, strict=True)]
    lowest, highest = _ends(waved)
    centre = 0.5 - 0.5 * (lowest + highest)
    named |= {"left": left, "v_link": v_link, "room": room, "size": size, "share": share}
    named |= {f"waved_{leg}": value for leg, value in zip("abc", waved, strict=True)} | {"centre": centre}
    named |= {"added_alpha": added[0], "added_beta": added[1]}
    b.stage("left", "", "", list(named.values()), list(named), scale="none")
    b.output("duty", [value + centre for value in waved])
    b.output("v", [v[0] + added[0], v[1] + added[1]])
    b.output("injection", [amplitude, -sign])
    return b.build()


def _legs(vector: Sequence[Any]) -> list[Any]:
    """What a vector is on the axes of the three phases."""
    half, cross = -0.5 * vector[0], (SQRT_3 / 2) * vector[1]
    return [vector[0], half + cross, half - cross]


def _room(duty: Sequence[Any], pulse: Sequence[Any]) -> tuple[Any, dict[str, Any]]:
    """How much of a unit pulse the duty cycles have room for, of the link; and what it is made of.

    No two legs come further apart than 1. They are apart by d, and the pulse parts them by s more: there is room for
    (1 - sign(s) d) / abs(s) of it, which is (abs(s) - s d) / s^2.
    """
    named: dict[str, Any] = {f"pulse_{leg}": value for leg, value in zip("abc", pulse, strict=True)}
    rooms = []
    for one, other in ("ab", "bc", "ca"):
        d, s = (own["abc".index(one)] - own["abc".index(other)] for own in (duty, pulse))
        span = ca.fmax(ca.fmax(s, -s), LEAST_APART)
        rooms.append(ca.fmax(span - s * d, 0.0) / (span * span))
        pair = one + other
        named |= {f"duty_{pair}": d, f"pulse_{pair}": s, f"span_{pair}": span, f"room_{pair}": rooms[-1]}
    return ca.fmin(rooms[0], ca.fmin(rooms[1], rooms[2])), named


def _ends(duty: Sequence[Any]) -> tuple[Any, Any]:
    """The smallest and the largest of three duty cycles."""
    return ca.fmin(duty[0], ca.fmin(duty[1], duty[2])), ca.fmax(duty[0], ca.fmax(duty[1], duty[2]))
