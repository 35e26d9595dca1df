"""A known square wave on the rotor's estimated d axis, by which a salient machine shows its angle at standstill.

At rest there is no back-EMF, and what is left of the voltage says as much of a wrong resistance as of a wrong angle. A
voltage that changes its sign every sample makes a ripple i_d = V T / (2 L_d) on its axis and, where the true axis is
delta from there, one of V T / 4 (1/L_d - 1/L_q) sin(2 delta) across it (square wave at half the sampling frequency:
Yoon, Sul, Morimoto and Ide, IEEE Trans. Ind. Appl. 47, 2011). Resistance has no part in it, and no second observer is
needed: the filter knows the voltage and expects the ripple, through its own equations.

The voltage fades with speed, where the back-EMF tells more, and is never more than the duty cycles have room for, so
that what the filter is told is what arrives. Room is what the inverter has in every direction, at rest the link over
sqrt(3): with the wave in them the largest and the smallest duty cycle lie about one half alike again, as space-vector
modulation has it. On top of duty cycles that stay where they are there is room for half of the link.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from model.filters.program import BlockBuilder
from model.inverter import SQRT_3, lost_voltage
from model.loop.controller import LEAST_LINK
from model.machines.base import Rotor
from model.quantities import Block
from model.rating import rating
from model.schema import Drive

#: Amplitude that the ripple may have, of the current that rated torque takes, or of the largest where none is stated;
#: speed beyond which there is none, of the rated one.
RIPPLE, FADED = 0.048, 0.2
#: Length of what a single leg's V_d makes of the voltage vector. The compensation of a leg whose current is about zero
#: follows the sign that the ripple had a whole period before: it adds so much of V_d to the square wave.
OF_A_LEG = 2.0 / 3.0
#: Share of the wave that is left in any case, where V_d is as large as the wave itself.
LEAST_LEFT = 0.5


def ripple_scale(drive: Drive) -> float:
    """The current of which the ripple is a share, A: what rated torque takes, or the largest where none is stated.

    Parameters
    ----------
    drive : Drive
    """
    return rating(drive).current if drive.rated else drive.control.max_current


def injected_voltage(drive: Drive) -> float:
    """Amplitude of the square wave, V; 0 for a round rotor, which shows nothing.

    The ripple is held with the smallest d inductance within tolerance, and with what the compensation adds.

    Parameters
    ----------
    drive : Drive
        Its rated or largest current, d inductance, sample time, and V_d.
    """
    m = drive.motor
    if m.inductance_d == m.inductance_q:
        return 0.0
    least = m.inductance_d * (1.0 - (drive.tolerance.inductance if drive.tolerance else 0.0))
    allowed = 2.0 * RIPPLE * ripple_scale(drive) * least / drive.model.sample_time
    return max(allowed - OF_A_LEG * lost_voltage(drive), LEAST_LEFT * allowed)


def faded(drive: Drive) -> float:
    """One over the speed beyond which no voltage is injected, s/rad.

    Parameters
    ----------
    drive : Drive
    """
    return 1.0 / (FADED * rating(drive).speed)


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
    speed = ca.fmax(omega, -omega)
    left = ca.fmax(1.0 - speed * faded(drive), 0.0)
    v_link = ca.fmax(v_dc, LEAST_LINK)
    lowest, highest = _ends(duty)
    room = (v_link * (1.0 / SQRT_3)) * ca.fmax(1.0 - (highest - lowest), 0.0)
    size = sign * ca.fmin(amplitude * left, room)
    added = Rotor.at(theta).to_stator((size, 0.0))
    half, cross = -0.5 * added[0], (SQRT_3 / 2) * added[1]
    legs = [added[0], half + cross, half - cross]
    waved = [d + leg / v_link for d, leg in zip(duty, legs, strict=True)]
    bottom, top = _ends(waved)
    centre = 0.5 - 0.5 * (bottom + top)
    named: dict[str, Any] = {"left": left, "v_link": v_link, "room": room, "size": size}
    named |= {"added_alpha": added[0], "added_beta": added[1], "half": half, "cross": cross}
    named |= {f"waved_{leg}": value for leg, value in zip("abc", waved, strict=True)} | {"centre": centre}
    b.stage("left", "", "", list(named.values()), list(named), scale="none")
    b.output("duty", [value + centre for value in waved])
    b.output("v", [v[0] + added[0], v[1] + added[1]])
    b.output("injection", [amplitude, -sign])
    return b.build()


def _ends(duty: Sequence[Any]) -> tuple[Any, Any]:
    """The smallest and the largest of three duty cycles."""
    return ca.fmin(duty[0], ca.fmin(duty[1], duty[2])), ca.fmax(duty[0], ca.fmax(duty[1], duty[2]))
