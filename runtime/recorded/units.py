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
    "turn": Unit("angle", 2 * math.pi),
    "turn/s": Unit("speed", 2 * math.pi),
    **{name: Unit("torque", factor) for name, factor in {"Nm": 1.0, "mNm": 1e-3}.items()},
    "%": Unit("share", 1e-2),
}

#: The units a drive computes in.
SI = {
    "time": "s",
    "voltage": "V",
    "current": "A",
    "angle": "rad",
    "speed": "rad/s",
    "torque": "N m",
    "share": "parts of 1",
}

_SPELLINGS = {
    "rpm": "r/min",
    "1/min": "r/min",
    "min-1": "r/min",
    "rev": "turn",
    "turn": "turn",
    "rev/s": "turn/s",
    "turns/s": "turn/s",
    "percent": "%",
    "volt": "V",
    "ampere": "A",
    "amp": "A",
    "second": "s",
}


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
    lower = plain.lower()
    for spelling in (lower, lower.removesuffix("s") if len(lower) > 3 else lower):
        if spelling in _SPELLINGS:
            return UNITS[_SPELLINGS[spelling]]
    return UNITS.get(plain)


def is_unit(cell: str) -> bool:
    """Whether a header cell is a unit alone, bare or in brackets.

    Parameters
    ----------
    cell : str
    """
    return find_unit(cell.strip("()[] ")) is not None


def split_unit(cell: str) -> tuple[str, str]:
    """Split a header cell into name and unit; what stands behind a name and is no unit belongs to the name.

    Parameters
    ----------
    cell : str

    Examples
    --------
    >>> split_unit("Ia (A)"), split_unit("t [ms]"), split_unit("omega"), split_unit("V(ab)")
    (('Ia', 'A'), ('t', 'ms'), ('omega', ''), ('V(ab)', ''))
    >>> split_unit("I_a / mA"), split_unit("Zeit in s"), split_unit("Ua, V"), split_unit("theta_deg")
    (('I_a', 'mA'), ('Zeit', 's'), ('Ua', 'V'), ('theta', 'deg'))
    """
    cell = cell.strip()
    match = re.fullmatch(r"(.+?)\s*[(\[]([^()\[\]]*)[)\]]", cell)
    if match and is_unit(match[2]):
        return match[1], match[2].strip()
    # A single letter after an underscore is a phase as often as a unit, and as a unit it would change nothing.
    for mark in ("_", "/", ",", " in "):
        for at in (found.start() for found in re.finditer(re.escape(mark), cell)):
            name, unit = cell[:at].strip(), cell[at + len(mark) :].strip()
            if name and find_unit(unit) is not None and (mark != "_" or len(unit) > 1):
                return name, unit
    return cell, ""
