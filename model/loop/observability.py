"""Whether the angle is seen: what P says of it and, of a round rotor, whether its back-EMF shows.

P is the filter's own word, and holds as far as its model does: at standstill the angle of a round rotor stays as well
known as the motor data say that it must, since nothing moves. Held at rest under half of rated torque, P said 52 to 77
degrees of one surface motor, 7 to 43 of two, and at most 7 of two more; with R 10 or 20 % off every one of them lost
its angle there in some run. What then decides is the voltage by which R is wrong, beside the back-EMF: a fifth of R at
a quarter of the largest current. With a back-EMF smaller than that a round rotor is not seen, whatever P says.
Measured at 0, 1, 2, 3, 5 and 10 % of rated speed: angles were lost up to 3 % (one of eight runs at 5) where this says
3.9, up to 1 where it says 1.7, and at rest alone where it says 1.3. A salient rotor shows its angle by the square wave
(:mod:`model.loop.injection`), and P, 0.7 to 2.5 degrees there, is asked alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from model.filters.program import BlockBuilder
from model.quantities import Block
from model.schema import Drive

#: rad: one sigma of P's angle beyond which it is not seen: an estimate further off counts as lost, too.
UNSEEN_ANGLE = math.radians(30.0)
#: Of the resistance's voltage at the largest current: R of a warm winding is a fifth off, a usual current a quarter.
UNKNOWN_VOLTAGE = 0.05


def most_variance() -> float:
    """P's variance of the angle beyond which it is not seen, rad^2."""
    return UNSEEN_ANGLE**2


def least_speed(drive: Drive) -> float:
    """Below this speed the back-EMF of a round rotor does not show where it is, rad/s mechanical; 0 for a salient one.

    Parameters
    ----------
    drive : Drive
    """
    m = drive.motor
    if m.inductance_d != m.inductance_q:
        return 0.0
    return UNKNOWN_VOLTAGE * m.stator_resistance * drive.control.max_current / (m.magnet_flux * m.pole_pairs)


def angle_block(words: Sequence[str], row: Sequence[int], pivots: Sequence[int]) -> Block:
    """The variance of the angle, rad^2, of a covariance that is carried as P, or as L D L^T.

    Parameters
    ----------
    words : sequence of str
        What its words are called.
    row : sequence of int
        Places of L in the angle's row, left of its diagonal; none where P is carried.
    pivots : sequence of int
        Places of D in the same columns, the angle's own last; of P its variance.
    """
    b = BlockBuilder("angle_variance", "How well the angle is known by P, rad^2")
    word = b.input("covariance", list(words))
    variance = word[pivots[-1]]
    for place, pivot in zip(row, pivots, strict=False):
        variance = variance + word[place] * word[place] * word[pivot]
    b.output("variance", [variance])
    return b.build()
