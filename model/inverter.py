"""What an inverter takes from the voltage that is commanded, as a term of the model.

A leg whose current flows out (i > 0) turns on late by the dead time t_d, so that it misses V_dc t_d once a switching
period; one whose current flows in turns off late and has as much too much. Whatever conducts, a switch or the diode
beside it, stands against the current: with a drop of its own the leg is lower by it where i > 0 and higher where
i < 0. Both act alike, so that one number tells them (Jeong and Park 1991; Choi and Sul 1996)::

    V_d = V_dc t_d f_sw + V_drop        v = v_commanded - V_d g(i)

g is the Clarke transform of the signs of the three legs' currents: the size of that vector is 4/3, and it jumps by
sixty degrees where a current passes zero. The sign of a current near zero is no sign: of the measured one noise makes
it, and the true one itself passes zero within a period. There g is linear, up to :func:`fading_current`.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

from model.quantities import Constant
from model.schema import Drive

SQRT_3 = math.sqrt(3.0)

#: Numbers of the transforms between three phases and two axes, by their names in generated text.
TRANSFORM = (
    Constant("ONE_BY_SQRT_3", 1 / SQRT_3, "1 / sqrt(3)", None),
    Constant("TWO_BY_SQRT_3", 2 / SQRT_3, "2 / sqrt(3)", None),
    Constant("SQRT_3_BY_2", SQRT_3 / 2, "sqrt(3) / 2", None),
)
#: Those of a voltage that is put together from three legs.
OF_LEGS = (*TRANSFORM, Constant("TWO_THIRDS", 2 / 3, "2 / 3", None))

#: The word of :attr:`model.schema.Model.adaptive` by which V_d is a state.
STATE = "dead_time_voltage"

#: A: below it the signs fade where nothing is said of the inverter: six sigmas of a current sensor with 0.05 A noise.
UNTOLD_CURRENT = 0.3
#: The signs fade below so many sigmas of the current sensor, and below this share of the largest current.
FADING_SIGMAS, FADING_SHARE = 3.0, 0.005
#: V_d as a state is not learnt from currents below this share of the largest.
SEEN_SHARE = 0.05


def lost_voltage(drive: Drive) -> float:
    """V_d: what the inverter takes from a leg that carries current, V; 0 without an ``[inverter]``.

    Parameters
    ----------
    drive : Drive
        Its DC link (V), dead time (s), switching frequency (Hz) and switch drop (V).
    """
    if drive.inverter is None:
        return 0.0
    return drive.control.dc_link * drive.inverter.dead_time * drive.switching_frequency + drive.inverter.switch_drop


def takes_voltage(drive: Drive) -> bool:
    """Whether the model has the term: a V_d is stated, or is to be estimated.

    Parameters
    ----------
    drive : Drive
    """
    return STATE in drive.model.adaptive or lost_voltage(drive) > 0.0


def fading_current(drive: Drive) -> float:
    """The current up to which a leg's sign is linear, A: as stated, else as sensor and largest current suggest.

    Parameters
    ----------
    drive : Drive
        R of its filter says the noise of phase a's sensor, which is that of alpha.
    """
    if not takes_voltage(drive):
        return UNTOLD_CURRENT
    if drive.inverter is not None and drive.inverter.fading_current is not None:
        return drive.inverter.fading_current
    sigma = math.sqrt(drive.filter.measurement_noise[0])
    return max(FADING_SIGMAS * sigma, FADING_SHARE * drive.control.max_current)


def compensation_current(drive: Drive) -> float:
    """The current up to which the controller's compensation is linear, A: as stated, else that of the model.

    Parameters
    ----------
    drive : Drive
    """
    stated = drive.inverter.compensation_current if drive.inverter is not None and takes_voltage(drive) else None
    return fading_current(drive) if stated is None else stated


def seeing_current(drive: Drive) -> float:
    """The current from which on what a leg loses shows, A; from sqrt(2) times it on in full.

    Of a current that passes zero within a period, or hangs there, a real inverter takes less than g says, and a filter
    that learnt from it would believe in a better inverter than it has.

    Parameters
    ----------
    drive : Drive
        Its control section gives the largest current, A.
    """
    return SEEN_SHARE * drive.control.max_current


def legs(vector: Any) -> tuple[list[Any], dict[str, Any]]:
    """The three phases of an alpha-beta vector, and what they are made of, by name.

    Parameters
    ----------
    vector : pair of SX
        Amplitude-invariant; the three add up to zero.
    """
    half, cross = -0.5 * vector[0], (SQRT_3 / 2) * vector[1]
    return [vector[0], half + cross, half - cross], {"minus_half_i_alpha": half, "cross_i_beta": cross}


def saturated(value: Any) -> Any:
    """A value, held within -1 .. 1.

    Parameters
    ----------
    value : SX
    """
    return ca.fmax(-1.0, ca.fmin(1.0, value))


def clarke(phases: list[Any]) -> tuple[Any, Any]:
    """Alpha and beta of three phases, amplitude-invariant; what they have in common drops out.

    Parameters
    ----------
    phases : list of SX, (3,)
    """
    a, b, c = phases
    return (2 / 3) * (a - 0.5 * (b + c)), (1 / SQRT_3) * (b - c)
