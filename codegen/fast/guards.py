"""The guards of a fast filter as nodes of its step, and their limits."""

from __future__ import annotations

import math
from collections.abc import Sequence

from codegen.ir.covariance import place
from model.filters.conditions import All, Compare, Either, Entry, Name, Not, Number, Operation, Reported, total
from model.filters.program import Count, If, Report, Restart, Seldom, Set, Size
from model.machines.state_space import StateSpaceModel

#: The step restarts where a state, a word of the covariance or the monitor's mean is beyond the sane limit: this, or so
#: many times the largest variance that the drive file states. Its square is far from the largest float, and a motor's
#: states in SI units are far from it; the sine of an angle turned so fast is a number.
SANE_LIMIT, ABOVE_VARIANCES = 1e9, 1e4

#: The divergence monitor as shipped: normalised innovation squared (two measurements: 2 expected), mean over 64 steps,
#: from innovations ten times as large as the filter expects. Dead time or R 30 % off make up to 175 of it, a lost rotor
#: thousands.
NIS_MAX, NIS_WEIGHT = 200.0, 1.0 / 64.0

_CHECK, _MEAN = Entry("check", 0), Entry("nis")
_CALM = Compare("<", _MEAN, Entry("nis_max"))
_REPAIRED, _RESTARTED, _DIVERGED = "COVARIANCE_REPAIRED", "RESTARTED", "DIVERGED"


def sane_limit(P_0: Sequence[float], Q: Sequence[float]) -> float:
    """Beyond it nothing in a drive's filter is sane: :data:`SANE_LIMIT`, or a power of two, whose square float32 holds.

    The load torque of a ship's motor has a variance of 1e10 (N m)^2.

    Parameters
    ----------
    P_0, Q : sequence of float
        The diagonals that the drive file states.

    >>> sane_limit([0.1, 0.1, 50.0], [0.01, 0.02, 0.24]), sane_limit([0.1, 6.4e9], [0.01, 2e9])
    (1000000000.0, 70368744177664.0)
    """
    return max(SANE_LIMIT, 2.0 ** math.ceil(math.log2(ABOVE_VARIANCES * max(*P_0, *Q))))


def watch_pivots(model: StateSpaceModel) -> Report:
    """After the time update: says where a pivot of P_pred was raised to its floor."""
    above = (Compare(">", Entry("LD_pred", place(k, k)), Entry("Q", state)) for k, state in enumerate(model.order))
    note = "Exact arithmetic never has a pivot of P at its bound; where one is, it was raised."
    return Report(_REPAIRED, All(tuple(above)), note)


def average() -> Set:
    """After a measurement: the mean of the normalised innovation squared over the monitor's window."""
    change = Operation("-", Entry("nis", 0), _MEAN)
    return Set(_MEAN, Operation("+", _MEAN, Operation("*", Entry("nis_weight"), change)))


def look_at_result(model: StateSpaceModel) -> tuple[Set, Seldom]:
    """Last of a step: reports what was not ordinary, and restarts from what is no number or absurdly large."""
    states = (Entry("x", k) for k, state in enumerate(model.states) if state.name != "theta")  # it is wrapped: a number
    note = "The sum of pivots, mean and states is no number if one of them is none; theta, wrapped, is always one."
    limit = Name("SANE_LIMIT")
    sane = Compare("<=", Operation("*", _CHECK, _CHECK), Operation("*", limit, limit))
    unusual = (Not(sane), Not(_CALM), Reported((_REPAIRED,)))
    body = (
        Report(_RESTARTED, Compare("<=", Name("worst"), Number(1.0))),
        Report(_DIVERGED, _CALM),
        If(Reported((_REPAIRED, _RESTARTED)), (Count("repairs", "MOST_REPAIRS"),)),
        If(Reported((_RESTARTED,)), (Restart(),)),
    )
    size = Size("worst", (_CHECK, _MEAN), "LD", "PER_SANE_LIMIT")
    summed = Set(_CHECK, total(_CHECK, _MEAN, *states), note)
    return summed, Seldom("set_status_bits", Either(unusual), size, body)
