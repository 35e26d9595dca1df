"""What is found from recordings: motor data by their names in drive and facts files, and what is fitted beside them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


@dataclass(frozen=True)
class Datum:
    """A quantity that can be found: the model's letters, its names in files, its unit, and which run would show it."""

    word: str
    keys: tuple[str, ...]
    letters: tuple[str, ...]
    unit: str
    run: str
    positive: bool = True


#: By the words of --free.
DATA = {
    datum.word: datum
    for datum in (
        Datum("R", ("stator_resistance",), ("R",), "ohm", "run slowly with a large current, and with a small one"),
        Datum("L", ("inductance_d", "inductance_q"), ("L_d", "L_q"), "H", "run at speed under load, with load steps"),
        Datum("L_d", ("inductance_d",), ("L_d",), "H", "run with i_d other than 0"),
        Datum("L_q", ("inductance_q",), ("L_q",), "H", "run at speed under load, with load steps"),
        Datum("psi_m", ("magnet_flux",), ("psi_m",), "Wb", "let the rotor turn, faster"),
        Datum("J", ("inertia",), ("J",), "kg m^2", "accelerate and brake, better without load"),
        Datum(
            "D",
            ("friction",),
            ("D",),
            "N m s / rad",
            "run at several speeds under one load, or let it coast",
        ),
        Datum("V_dead", ("dead_time_voltage",), ("V_d",), "V", "run slowly with two different currents", False),
        Datum("i_alpha_offset", ("offset_alpha",), ("offset_alpha",), "A", "let the rotor turn several times", False),
        Datum("i_beta_offset", ("offset_beta",), ("offset_beta",), "A", "let the rotor turn several times", False),
    )
}


@dataclass(frozen=True)
class Unknown:
    """An entry of the search vector q: a positive quantity exp(q), or a signed one, ``size`` q.

    ``prior``: standard deviation of q about its guess. It is so wide that data which say anything overrule it, and
    leaves what they say nothing of at its guess. ``recording``: of which it is, where it belongs to one.
    """

    name: str
    guess: float
    prior: float
    positive: bool = True
    size: float = 1.0
    recording: int | None = None
    datum: Datum | None = None

    @property
    def start(self) -> float:
        """The guess as a search value."""
        return float(np.log(self.guess)) if self.positive else self.guess / self.size

    def value(self, q: Any) -> Any:
        """The quantity of search values.

        Parameters
        ----------
        q : float or ndarray
        """
        return np.exp(q) if self.positive else self.size * q
