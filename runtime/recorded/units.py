"""Units as people write them beside a column's name, and what they are in SI."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

#: r/min in a rad/s.
RPM = 30 / math.pi


@dataclass(frozen=True)
class Unit:
    """``factor`` times a value in it is the value in SI."""

    quantity: str
    factor: float


_TURN = math.pi / 180

UNITS = {
    **{
        name: Unit("time", factor)
        for name, factor in {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}.items()
    },
    **{name: Unit("voltage", factor) for name, factor in {"V": 1.0, "mV": 1e-3, "kV": 1e3}.items()},
    **{name: Unit("current", factor) for name, factor in {"A": 1.0, "mA": 1e-3, "kA": 1e3}.items()},
    **{name: Unit("angle", factor) for name, factor in {"rad": 1.0, "deg": _TURN, "°": _TURN}.items()},
    **{name: Unit("speed", factor) for name, factor in {"rad/s": 1.0, "deg/s": _TURN, "r/min": math.pi / 30}.items()},
    **{name: Unit("torque", factor) for name, factor in {"Nm": 1.0, "mNm": 1e-3}.items()},
}

#: The units a drive computes in.
SI = {"time": "s", "voltage": "V", "current": "A", "angle": "rad", "speed": "rad/s", "torque": "N m"}

_SPELLINGS = {"rpm": "r/min", "1/min": "r/min", "min-1": "r/min", "volt": "V", "ampere": "A", "amp": "A", "second": "s"}


def find_unit(text: str) -> Unit | None:
    """Find a unit as written in a header: "ms", "µs", "N*m", "rpm"; None if it is none that is known.

    Parameters
    ----------
    text : str

    Examples
    --------
    >>> find_unit("N m")
    Unit(quantity='torque', factor=1.0)
    """
    plain = re.sub(r"(?<=N)[ *.·](?=m$)", "", text.strip()).replace("µ", "u").replace("μ", "u")
    return UNITS.get(_SPELLINGS.get(plain.lower().removesuffix("s") if len(plain) > 3 else plain.lower(), plain))


def is_unit(cell: str) -> bool:
    """Whether a header cell is a unit alone, bare or in brackets.

    Parameters
    ----------
    cell : str
    """
    return find_unit(cell.strip("()[] ")) is not None


def split_unit(cell: str) -> tuple[str, str]:
    """Split a header cell into name and unit.

    Parameters
    ----------
    cell : str

    Examples
    --------
    >>> split_unit("Ia (A)"), split_unit("t [ms]"), split_unit("omega")
    (('Ia', 'A'), ('t', 'ms'), ('omega', ''))
    """
    match = re.fullmatch(r"(.+?)\s*[(\[]([^)\]]*)[)\]]", cell)
    return (match[1], match[2].strip()) if match else (cell, "")
