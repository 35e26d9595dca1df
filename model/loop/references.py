"""From torque to reference currents: what current and voltage allow, and the least current that makes a torque."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from model.filters.program import BlockBuilder
from model.loop.weakening import deepest, torque_share
from model.machines.base import Pair
from model.quantities import Constants
from model.schema import Drive

#: The curve of maximum torque per ampere takes at most so many times the least current.
CURVE_EXCESS = 1.003


def record(b: BlockBuilder, meaning: str, named: dict[str, Any]) -> None:
    """Give quantities of the controller their names, under a heading or none.

    Parameters
    ----------
    b : BlockBuilder
    meaning : str
    named : dict of str to SX
    """
    b.stage(next(iter(named)), "", meaning, list(named.values()), list(named), scale="none")


def _saliency(drive: Drive, constants: Constants) -> Any | None:
    """Return (L_q - L_d) / psi_m, 1/A, of either sign: what reluctance adds to the torque; None for a round rotor."""
    m = drive.motor
    difference = m.inductance_q - m.inductance_d
    if ca.SX(difference).is_zero():
        return None
    return constants("MTPA_RATIO", ca.SX(difference / m.magnet_flux), "(L_q - L_d) / psi_m, 1/A")


@dataclass(frozen=True)
class Reach:
    """What current (A) and voltage allow: torque, N m; the d current that weakens the field, at most so deep, A."""

    current: Any
    torque: Any
    weakening: Any
    deepest: Any


def within_reach(b: BlockBuilder, drive: Drive, constants: Constants, current: Any, z: Any, omega_e: Any) -> Reach:
    """The torque of the largest current: on the curve of maximum torque per ampere (MTPA), or with a weakened field.

    With r = (L_q - L_d) / psi_m the torque is 1.5 p psi_m i_q (1 - r i_d), and least current makes it where
    i_d (1 - r i_d) = -r i_q^2. On the circle of radius I that is i_d = -2 I (r I) / (1 + sqrt(1 + 8 (r I)^2)): nothing
    cancels, whatever the sign and size of r. Weakened by z (:mod:`model.loop.weakening`), i_d is that much more.

    Parameters
    ----------
    b : BlockBuilder
    drive : Drive
    constants : Constants
    current : SX
        The largest, A.
    z : SX
        What weakens the field, A; 0 or negative.
    omega_e : SX
        Electrical speed, rad/s.
    """
    per_ampere = 1.5 * drive.motor.pole_pairs * drive.motor.magnet_flux
    magnet = constants("TORQUE_PER_A", ca.SX(per_ampere), "1.5 p psi_m, N m/A")
    against = ca.SX(0)
    ratio = _saliency(drive, constants)
    if ratio is not None:
        reluctance = ratio * current
        root = ca.sqrt(1 + 8 * (reluctance * reluctance))
        share = 2 * reluctance / (1 + root)  # -i_d / I, at most sqrt(1 / 2) of it
        against = share * current
        named = {"reluctance_at_limit": reluctance, "root_at_limit": root, "d_share_at_limit": share}
        record(b, "", {**named, "d_against_at_limit": against})
    depth = deepest(drive, constants, current, against, omega_e)
    D = depth["d_deepest"]
    asked = z - against
    i_d = ca.fmax(asked, -D)
    beyond = i_d - asked
    left = ca.fmax(_left_of(current, i_d) - beyond, 0.0)
    named = {"d_asked_at_limit": asked, **depth, "d_at_limit": i_d, "beyond_deepest": beyond, "q_left": left}
    record(b, "what current and voltage allow", named)
    torque = magnet * left
    if ratio is not None:
        torque = torque * torque_share(constants, ratio, i_d)
    record(b, "", {"torque_limit": torque})
    return Reach(current, torque, z, D)


def _left_of(current: Any, i_d: Any) -> Any:
    """What a d current leaves of a circle of currents."""
    return ca.sqrt(ca.fmax(current * current - i_d * i_d, 0.0))


def current_reference(b: BlockBuilder, drive: Drive, constants: Constants, torque: Any, reach: Reach) -> Pair:
    """Currents that make a torque: i_d = 0, or where the axes differ maximum torque per ampere (MTPA); weakened by z.

    In units of 1 / r the curve is i_d = -i_q^2 / (1/2 + sqrt(1/4 + i_q^2)) and the torque i_q (1 - i_d). The i_q of a
    torque t is first taken as t / sqrt(3/4 + sqrt(1/16 + t^2)), which is right to third order for small and to first
    order for large t; then i_d follows, and i_q once more from the torque. The torque is exact; the current is at most
    0.26 % more than the least, since about the optimum it changes with the square of the error.

    Parameters
    ----------
    b : BlockBuilder
    drive : Drive
    constants : Constants
    torque : SX
        N m, within reach.
    reach : Reach
    """
    m = drive.motor
    inverse = constants("A_PER_TORQUE", ca.SX(1 / (1.5 * m.pole_pairs * m.magnet_flux)), "1 / (1.5 p psi_m), A/(N m)")
    i_d, i_q = reach.weakening, inverse * torque
    ratio = _saliency(drive, constants)
    if ratio is None:
        i_d = ca.fmax(i_d, -reach.deepest)
        record(b, "current references", {"i_d_ref": i_d, "i_q_ref": i_q})
        return i_d, i_q
    record(b, "current references", {"i_q_at_zero_i_d": i_q})
    t = ratio * i_q
    first = i_q / ca.sqrt(0.75 + ca.sqrt(0.0625 + t * t))
    reluctance = ratio * first
    root = ca.sqrt(0.25 + reluctance * reluctance)
    record(b, "", {"reluctance_torque": t, "i_q_first": first, "reluctance": reluctance, "root_mtpa": root})
    against = first * reluctance / (0.5 + root)
    i_d = ca.fmax(i_d - against, -reach.deepest)
    wanted = i_q / torque_share(constants, ratio, i_d)
    allowed = constants("CURVE_EXCESS", ca.SX(CURVE_EXCESS), "of the least current, which the curve may take")
    left = _left_of(allowed * reach.current, i_d)
    i_q = ca.fmax(-left, ca.fmin(left, wanted))
    named = {"d_against": against, "i_d_ref": i_d, "i_q_wanted": wanted, "q_left_at_ref": left, "i_q_ref": i_q}
    record(b, "", named)
    return i_d, i_q
