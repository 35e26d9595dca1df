"""Beyond the voltage limit: a negative current along the rotor's axis takes flux away, and torque what is left.

The speed at which the back-EMF takes the whole voltage is not the last one. A current z <= 0, added to that of maximum
torque per ampere, weakens the field; an integrator finds it from the voltage that the current regulators ask for. It is
zero, to the bit, as long as they leave a twentieth of the largest voltage. In A a sample::

    z' = z + k clamp(V^2 - v^2),   V = 0.95 v_max,   within -V^2 .. V^2,   and z within -(D + I) .. 0,

squares, so that no root is taken. D is as far as the field is weakened: 0.95 of the largest current I, so that torque
is left, or that at which a turning motor without torque takes the least voltage,

    psi_m / L_d  omega_e^2 / (omega_e^2 + (R / L_d)^2),

where |R i_d + j omega_e (psi_m + L_d i_d)| has its minimum (with reluctance, as much more as the curve of maximum
torque per ampere has). At speed it is the current psi_m / L_d that cancels the magnet, maximum torque per volt of a
round rotor; further down more d current would ask for more voltage, not less, and would never be taken back. What z
asks for beyond D is taken off the torque's current. I stays the limit of both together::

    i_d >= -D,    |i_q| <= sqrt(I^2 - i_d^2) - what z is beyond D.

Bandwidth: a tenth of the current regulators' at base speed, where d|v|/di_d is about omega_e L_d.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

from model.quantities import Constants
from model.schema import Drive

#: Share of the largest voltage that the regulators may ask for before the field is weakened.
ROOM = 0.95
#: Bandwidth, of the current regulators'; deepest weakening, of the largest current.
WEAKENING_TO_CURRENT, DEEPEST = 0.1, 0.95
#: Share of i_d at the largest torque that the curve of maximum torque per ampere may go beyond it: it is approximate.
CURVE = 1.1
#: Least share of the magnet's torque per ampere that a weakened field is reckoned with: reluctance against the magnet
#: (L_q < L_d) may take all of it.
LEAST_FLUX = 0.05


def weakening_gain(drive: Drive) -> float:
    """k, A/V^2 a sample: WEAKENING_TO_CURRENT of the current bandwidth where the flux linkage takes V at base speed.

    Parameters
    ----------
    drive : Drive
        Its flux linkage at base speed is taken with the largest current across the rotor's axis.
    """
    m, c = drive.motor, drive.control
    flux = math.hypot(m.magnet_flux, m.inductance_q * c.max_current)
    V = ROOM * c.dc_link / math.sqrt(3)
    per_volt = flux / (m.inductance_d * V)  # A/V: 1 / (omega_e L_d)
    return WEAKENING_TO_CURRENT * c.current_bandwidth * drive.model.sample_time * per_volt / (2 * V)


def deepest(drive: Drive, constants: Constants, current: Any, at_limit: Any, omega_e: Any) -> dict[str, Any]:
    """D, A, last, and what it is made of, by name.

    Parameters
    ----------
    drive : Drive
    constants : Constants
    current : SX
        The largest, A.
    at_limit : SX
        -i_d of the largest torque on the curve of maximum torque per ampere, A.
    omega_e : SX
        Electrical speed, rad/s.
    """
    m = drive.motor
    cancelling = constants("CANCELLING_CURRENT", ca.SX(m.magnet_flux / m.inductance_d), "psi_m / L_d, A")
    corner = constants("CORNER_SQUARED", ca.SX((m.stator_resistance / m.inductance_d) ** 2), "(R / L_d)^2, (rad/s)^2")
    curve = constants("CURVE_DEPTH", ca.SX(CURVE), "of -i_d at the largest torque, which the curve may take")
    turning = omega_e * omega_e
    least_voltage = cancelling * turning / (turning + corner) + curve * ca.fmax(at_limit, 0.0)
    share = constants("DEEPEST", ca.SX(DEEPEST), "of the largest current, may weaken the field")
    D = ca.fmin(share * current, least_voltage)
    return {"omega_e_squared": turning, "d_least_voltage": least_voltage, "d_deepest": D}


def room_left(constants: Constants, gain: Any, v_link: Any, v_d: Any, v_q: Any, z: Any, most: Any) -> dict[str, Any]:
    """The weakening current's next value, and what it is made of, by name.

    Parameters
    ----------
    constants : Constants
    gain : SX
        k, A/V^2.
    v_link : SX
        DC link, V.
    v_d, v_q : SX
        What the regulators ask for, V.
    z : SX
        A, 0 or negative.
    most : SX
        Its largest size, A.
    """
    per_link = constants(
        "ROOM_PER_LINK", ca.SX(ROOM / math.sqrt(3)), f"{ROOM:g} / sqrt(3), beyond which it is weakened"
    )
    room = per_link * v_link
    room_squared, wanted_squared = room * room, v_d * v_d + v_q * v_q
    left = ca.fmax(room_squared - wanted_squared, -room_squared)  # what is no number counts as too much
    following = ca.fmax(ca.fmin(z + gain * left, 0.0), -most)
    return {
        "v_room": room,
        "v_room_squared": room_squared,
        "v_wanted_squared": wanted_squared,
        "v_squared_left": left,
        "integral_weakening_next": following,
    }


def torque_share(constants: Constants, ratio: Any, i_d: Any) -> Any:
    """Torque per ampere of i_q, of the magnet's: 1 - r i_d; some is left where reluctance is against the magnet.

    Parameters
    ----------
    constants : Constants
    ratio : SX
        r = (L_q - L_d) / psi_m, 1/A.
    i_d : SX
        A.
    """
    least = constants("LEAST_FLUX", ca.SX(LEAST_FLUX), "of the magnet's torque per ampere is left at least")
    return ca.fmax(1 - ratio * i_d, least)
