"""A truth of another convention: told from a lost rotor by speed, angle and innovations together."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.recorded.data import Recorded
from runtime.recorded.truth import LOST
from runtime.replay.statistics import Consistency

Array = NDArray[Any]

#: Rows that are compared at most, of the second half of a recording.
ROWS = 20_000
#: Two angles go together where the mean of exp(j difference) is so long.
TOGETHER = 0.99
#: A rotor whose own mean of exp(j theta) is longer has hardly turned: any convention would fit.
STANDS = 0.9
#: A ratio of speeds is one of the known ones within this, and the next one is twice as far.
CLOSE = 0.04
#: Speeds that differ by less agree, and those that differ by more in the course of time have no ratio.
DIFFERS = 0.1
#: An angle that is constant within so many degrees of the estimate's is the same.
SAME_DEGREES = 3.0


def conventions(recorded: Recorded, x: Array, consistency: Consistency | None, pole_pairs: int) -> dict[str, str]:
    """Say which convention of the truth makes it agree with an estimate that the innovations bear out.

    Parameters
    ----------
    recorded : Recorded
    x : ndarray, (N, n)
        Estimates; omega in column 2, rad/s mechanical, theta in column 3, rad electrical.
    consistency : Consistency or None
    pole_pairs : int

    Returns
    -------
    dict of str to str
        Quantity, and what is to be told of it; empty where the truth agrees, or no convention explains it.
    """
    if consistency is None or not consistency.fits:
        return {}
    rows = np.unique(np.linspace(len(x) // 2, len(x) - 1, ROWS).astype(int))
    found = {}
    for name, state, find in (("omega", 2, _speed), ("theta", 3, _angle)):
        if name in recorded.truth:
            truth, estimate = recorded.truth[name][rows], x[rows, state].astype(float)
            good = np.isfinite(truth) & np.isfinite(estimate)
            said = find(truth[good], estimate[good], pole_pairs) if good.sum() > 1 else None
            if said is not None:
                factor, offset, words = said
                found[name] = f"{words}; {_options(name, factor, offset, recorded.applied)}"
    return found


def _speed(truth: Array, estimate: Array, p: int) -> tuple[float, float, str] | None:
    power = float(truth @ truth)
    ratio = float(truth @ estimate) / power if power else 0.0
    rest = float(np.sqrt(np.mean((estimate - ratio * truth) ** 2)))
    if abs(ratio - 1.0) <= DIFFERS or not rest <= DIFFERS * float(np.sqrt(np.mean(estimate**2))):
        return None
    known = _speeds(p)
    near, next_one = sorted(known, key=lambda factor: abs(ratio / factor - 1.0))[:2]
    if abs(ratio / near - 1.0) > min(CLOSE, abs(ratio / next_one - 1.0) / 2):
        return None
    return near, 0.0, f"omega of the truth is {known[near]} as it seems: times {near:.6g} it is the estimated speed"


def _angle(truth: Array, estimate: Array, p: int) -> tuple[float, float, str] | None:
    if not len(estimate) or abs(np.mean(np.exp(1j * estimate))) > STANDS:
        return None
    known = _angles(p)
    means = {factor: complex(np.mean(np.exp(1j * (estimate - factor * truth)))) for factor in known}
    best = 1.0 if abs(means[1.0]) > TOGETHER else max(means, key=lambda factor: abs(means[factor]))
    offset = math.degrees(np.angle(means[best]))
    if abs(means[best]) <= TOGETHER or (best == 1.0 and abs(offset) <= LOST):
        return None
    parts = ([f"{known[best]}"] if best != 1.0 else []) + (
        [f"{-offset:+.1f} degrees from it"] if abs(offset) > SAME_DEGREES else []
    )
    words = (
        f"theta of the truth is not the rotor's electrical angle: it is {' and '.join(parts)} as it seems, "
        "for the innovations are as expected"
    )
    return best, offset if abs(offset) > SAME_DEGREES else 0.0, words


def _speeds(p: int) -> dict[float, str]:
    units = {
        1.0: "",
        math.pi / 30: "in r/min",
        math.pi / 180: "in deg/s",
        2 * math.pi: "in turns/s",
        30 / math.pi: "scaled twice",
    }
    return _signed({
        unit / pairs: " ".join(filter(None, (word, said))) or "right"
        for pairs, word in ((1, ""), (p, "electrical"))
        for unit, said in units.items()
    })  # fmt: skip


def _angles(p: int) -> dict[float, str]:
    units = {1.0: "", math.pi / 180: "in degrees", 2 * math.pi: "in turns"}
    return _signed({
        unit * pairs: " ".join(filter(None, (word, said))) or "right"
        for pairs, word in ((p, "mechanical"), (1, ""))
        for unit, said in units.items()
    })  # fmt: skip


def _signed(known: Mapping[float, str]) -> dict[float, str]:
    """Each factor, and the same with the direction reversed."""
    reversed_ = {-factor: "reversed" if said == "right" else f"{said}, reversed" for factor, said in known.items()}
    return {**known, **reversed_}


def _options(name: str, factor: float, offset: float, applied: Mapping[str, Sequence[float]]) -> str:
    """The options that bring a column to the estimate's convention, on top of those it was read with."""
    if name not in applied:
        return "it is made of cos and sin: exchange their columns or signs"
    scale, added = applied[name]
    added = factor * added + (math.radians(offset) if name == "theta" else 0.0)
    said = [f"--scale {name}={factor * scale:.6g}"] if factor != 1.0 else []
    return " ".join(said + ([f"--offset {name}={added:.4g}"] if added else []))
