"""Alignment: a direct current along a fixed axis turns a rotor that stands to a known angle; its numbers.

The current points a quarter of a turn beside the axis first and is turned to it after: a rotor that stands opposite to
either stands across the other. A rotor about an axis swings, and a current that is regulated stiffly does not damp it.
So the current is regulated along the axis alone; across it the inverter is a resistance R_e, in which the back-EMF of a
rotor that swings makes a current that brakes it. For small angles, with I the current, psi_I = psi_m + L_d I and
k = 1.5 p^2 (psi_m - (L_q - L_d) I) / J::

    L_q s^3 + R_e s^2 + k psi_I s + k R_e I = 0

No resistance damps at all, nor does an infinite one. With w = sqrt(k I), a = psi_I / (L_q I) and
R_e = L_q w (a + 1) / 2 one root is -w, and the two others have the sum -w (a - 1) / 2: a swing dies down with
w (a - 1) / 4, or w where that is less. Up to a = 5 no resistance damps better.
"""

from __future__ import annotations

import math

import numpy as np

from model.rating import inverter_voltage
from model.schema import Drive

#: Of the largest current: what aligns, and what a rotor that swings may make across before it is regulated stiffly.
ALIGN_SHARE, ACROSS_SHARE = 0.8, 0.5
#: The resistance across the axis is at most so much of what the current regulator is.
SOFT_SHARE = 0.5
#: Decays: in which the current rises, and in which it is turned to the axis; that the rotor has after it. s: the least
#: of either of the first two.
TURN_DECAYS, LONGEST_DECAYS, LEAST_TURN = 1.0, 7.0, 20e-3


def aligns(drive: Drive) -> bool:
    """Whether a start begins with an alignment.

    Parameters
    ----------
    drive : Drive
        Its ``[start]`` says so.
    """
    return drive.start is not None and drive.start.method == "align"


def align_current(drive: Drive) -> float:
    """The current that aligns, A: as stated, else what turns a rotor best.

    Reluctance turns a rotor across the current: with psi_m / (2 |L_q - L_d|) the axis holds it best.

    Parameters
    ----------
    drive : Drive
    """
    if drive.start is not None and drive.start.align_current is not None:
        return drive.start.align_current
    m, most = drive.motor, ALIGN_SHARE * drive.control.max_current
    difference = abs(m.inductance_q - m.inductance_d)
    most = min(most, 0.5 * inverter_voltage(drive) / m.stator_resistance)
    return min(most, 0.5 * m.magnet_flux / difference) if difference else most


def swing(drive: Drive) -> float:
    """w, rad/s: how fast the aligned rotor swings about its axis.

    Parameters
    ----------
    drive : Drive
    """
    return math.sqrt(_stiffness(drive) * align_current(drive))


def _stiffness(drive: Drive) -> float:
    """k, rad/s^2 per A."""
    m = drive.motor
    flux = m.magnet_flux - (m.inductance_q - m.inductance_d) * align_current(drive)
    return 1.5 * m.pole_pairs**2 * flux / m.inertia


def align_resistance(drive: Drive) -> float:
    """What the inverter adds to R across the axis, ohm.

    Parameters
    ----------
    drive : Drive
    """
    m, current = drive.motor, align_current(drive)
    ratio = (m.magnet_flux + m.inductance_d * current) / (m.inductance_q * current)
    best = m.inductance_q * swing(drive) * (ratio + 1.0) / 2.0
    stiff = drive.control.current_bandwidth * min(m.inductance_d, m.inductance_q)
    return min(max(best - m.stator_resistance, 0.0), SOFT_SHARE * stiff)


def decay_time(drive: Drive) -> float:
    """In which a swing about the axis dies down to 1 / e, s.

    Parameters
    ----------
    drive : Drive
    """
    m, current, k = drive.motor, align_current(drive), _stiffness(drive)
    resistance = m.stator_resistance + align_resistance(drive)
    cubic = [m.inductance_q, resistance, k * (m.magnet_flux + m.inductance_d * current), k * resistance * current]
    times = np.roots(cubic[::-1])  # 1 / s: of numbers far apart the largest is found well, and s has its least there
    return float(-1.0 / np.max((1.0 / times).real))


def turn_time(drive: Drive) -> float:
    """In which the current rises, and once more in which it is turned to the axis, s.

    Parameters
    ----------
    drive : Drive
    """
    return max(TURN_DECAYS * decay_time(drive), LEAST_TURN)


def align_time(drive: Drive) -> float:
    """How long an alignment may last, s.

    Parameters
    ----------
    drive : Drive
    """
    return 2.0 * turn_time(drive) + LONGEST_DECAYS * decay_time(drive) + calm_time(drive)


def calm_time(drive: Drive) -> float:
    """Half a swing, s: for so long a rotor that stands makes no current across its axis.

    Parameters
    ----------
    drive : Drive
    """
    return math.pi / swing(drive)
