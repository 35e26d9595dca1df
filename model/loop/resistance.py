"""What the winding's resistance is beyond the motor data, learnt at standstill from the ripple of the square wave.

At rest a voltage that is not accounted for looks like speed. Under load the largest is that of a resistance that is
off: the filter takes it for motion, moves its angle until the ripple across its d axis speaks against as much, and
stays there, some degrees aside, while the rotor creeps. The filter's own noise cannot tell the two apart, as it is
white and that voltage is not; but the ripple can, because resistance has no part in it (:mod:`model.loop.injection`).
Its residual across the axis, times the wave's sign, is proportional to the angle error; it is integrated into a
resistance, and the filter is told the voltage less what that takes:

    r <- r - k (s a) (i - h(x))_q i_q,    u = v - r h(x),

s sign of the last pulse, a its amplitude with what is faded of it. With the angle's own correction by the filter this
is a proportional and an integral part, so that no constant voltage along the current leaves an error. In proportion to
the current, because so is the voltage that r is to explain, and what it can be seen by. k is that of a loop of
LEARNING times the speed loop's bandwidth under rated torque, for

    delta' = p omega - ... - (R - R_0 - r) i_q / psi_m,    (i - h(x))_q = s V T / 2 (1 / L_d - 1 / L_q) delta.

What is learnt stays within what the drive file says of the resistance, and begins anew with every start. It is all of
the voltage along the current that the filter does not know of: at rest what an inverter takes and no compensation has
is in it, too. Where the axes differ by less than what tolerance leaves of them, the ripple says little, and k is less.
A wave that someone made larger teaches no faster than the drive's own.
"""

from __future__ import annotations

import math

import casadi as ca

from model.filters.program import BlockBuilder
from model.inverter import SQRT_3, TRANSFORM
from model.loop.injection import UNSTATED as UNSTATED_INDUCTANCE
from model.loop.injection import faded_constant, injected_voltage, left_of_wave
from model.loop.references import record
from model.machines.base import Rotor
from model.machines.state_space import StateSpaceModel
from model.quantities import Block, Constant
from model.rating import mtpa_currents, rating
from model.schema import Drive

#: Bandwidth of the learning under rated torque, of the speed loop's: within a load's rise, and no faster than noise of
#: the ripple's residual allows. Half and twice of it serve nearly as well.
LEARNING = 0.6
#: How far a resistance may be off of which the drive file states nothing: copper that warms up by 50 K.
UNSTATED = 0.2


def most_resistance(drive: Drive) -> float:
    """How far the resistance may be off, ohm.

    Parameters
    ----------
    drive : Drive
        ``stator_resistance`` of its ``[tolerance]``, where that states one.
    """
    share = drive.tolerance.stator_resistance if drive.tolerance else 0.0
    return (share or UNSTATED) * drive.motor.stator_resistance


def learning_gain(drive: Drive) -> float:
    """The gain k, ohm / (V A^2) a sample; of the sign of L_q - L_d.

    Parameters
    ----------
    drive : Drive
        A salient one: its motor data, rated torque, speed bandwidth, and the square wave.
    """
    m, voltage = drive.motor, injected_voltage(drive)
    bandwidth = LEARNING * drive.control.speed_bandwidth
    _, current = mtpa_currents(drive, rating(drive).current)
    shown = 0.5 * voltage * (1.0 / m.inductance_d - 1.0 / m.inductance_q)  # A/s per radian
    return _trusted(drive) * bandwidth**2 * m.magnet_flux / (shown * voltage * current**2)


def _trusted(drive: Drive) -> float:
    """Share of the gain: the square of the saliency over that which tolerance makes of none, where it is less.

    Without it k would go to infinity where the axes become alike, and carry the noise of the currents with it.

    Parameters
    ----------
    drive : Drive
        Its inductances, and how far they may be off.
    """
    m = drive.motor
    off = (drive.tolerance.inductance if drive.tolerance else 0.0) or UNSTATED_INDUCTANCE
    salient = 1.0 / m.inductance_d - 1.0 / m.inductance_q
    unsure = off * math.hypot(1.0 / m.inductance_d, 1.0 / m.inductance_q)
    return float(min(1.0, (salient / unsure) ** 2))


def learning_constants(drive: Drive) -> tuple[Constant, ...]:
    """The numbers of the block that have a name in generated text, besides the machine's.

    Parameters
    ----------
    drive : Drive
    """
    return (
        *TRANSFORM,
        faded_constant(drive),
        Constant("LEARNING_GAIN", learning_gain(drive), "ohm / (V A^2), of one sample", None),
        Constant("MOST_HEARD", injected_voltage(drive), "V: a larger wave teaches no faster", None),
        Constant("MOST_RESISTANCE", most_resistance(drive), "ohm: so far the resistance may be larger", None),
        Constant("LEAST_RESISTANCE", -most_resistance(drive), "ohm: or smaller", None),
    )


def learning_block(drive: Drive, model: StateSpaceModel) -> Block:
    """The resistance beyond the motor data, and the voltage that acts now less what it takes.

    Inputs: ``x`` the estimate; ``phase`` currents (A); ``pulse``: the wave's amplitude (V) and the sign that it had in
    the interval that ended; ``resistance`` (ohm) so far; ``v`` (V) of the interval that begins. Outputs:
    ``resistance``, ``v``.

    Parameters
    ----------
    drive : Drive
    model : StateSpaceModel
        Of its filter.
    """
    b = BlockBuilder("learn_resistance", "What the ripple says of the resistance, and the voltage less what that takes")
    x = b.input("x", [state.name for state in model.states])
    i_a, i_b = b.input("phase", ["i_a", "i_b"])
    amplitude, sign = b.input("pulse", ["amplitude", "sign"])
    (before,) = b.input("resistance", ["resistance_before"])
    v = b.input("v", ["v_alpha", "v_beta"])
    omega, theta = (x[[state.name for state in model.states].index(name)] for name in ("omega", "theta"))
    believed, named = model.measure(x)
    i = (i_a, (1 / SQRT_3) * i_a + (2 / SQRT_3) * i_b)
    rotor = Rotor.at(theta)
    _, across = rotor.to_rotor((i[0] - believed[0], i[1] - believed[1]))
    _, i_q = rotor.to_rotor((believed[0], believed[1]))
    left = left_of_wave(drive, omega)
    heard = ca.fmin(ca.fmax(amplitude, 0.0), injected_voltage(drive))  # of what is no number nothing
    shown = sign * heard * left * across * i_q
    most = most_resistance(drive)
    resistance = ca.fmax(ca.fmin(before - learning_gain(drive) * shown, most), -most)
    record(
        b,
        "",
        {
            **named,
            "i_alpha_believed": believed[0],
            "i_beta_believed": believed[1],
            "i_beta": i[1],
            "across": across,
            "i_q": i_q,
            "left": left,
            "heard": heard,
            "learnt": resistance,
        },
    )
    b.output("resistance", [resistance])
    b.output("v", [v[k] - resistance * believed[k] for k in range(2)])
    return b.build()
