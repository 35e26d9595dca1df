"""The faults: what goes wrong, for how long, as rows of numbers that the loop reads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.faults.loop import CLIP, FAULT, HOLD_A, OPEN_A, POWER_OFF, REPLACE_A, REPLACE_B, STALL, SWAP
from runtime.system.values import read_words

Array = NDArray[Any]


@dataclass(frozen=True)
class Circumstances:
    """The scales of a fault.

    Sample time s, DC link V, amplitude of the phase currents A, converter's range A, largest torque N m.
    """

    T: float
    link: float
    amplitude: float
    range: float
    torque: float


@dataclass(frozen=True)
class Fault:
    """``rows`` makes a fault's samples, drawing what is random from a generator of its own.

    ``patience``: s beyond the usual that the run goes on, for what needs a start anew, under load. One that is
    ``lasting`` (s: the run goes on so long) may end in FAULT, inverter off; ``at_start``: it is there from power-up.
    """

    name: str
    title: str
    rows: Callable[[Circumstances, np.random.Generator], Array]
    lasting: float = 0.0
    patience: float = 0.0
    at_start: bool = False


def healthy(c: Circumstances, samples: int) -> Array:
    """Rows in which nothing is wrong yet.

    Parameters
    ----------
    c : Circumstances
        Circumstances of the drive: its speed, current and sample time.
    samples : int
        Number of draws.
    """
    rows = np.zeros(samples, dtype=FAULT)
    rows["gain"] = 1.0
    rows["link"] = rows["told"] = c.link
    return rows


def lost_samples(c: Circumstances, rng: np.random.Generator, samples: int) -> Array:
    """No current arrives: NaN.

    Parameters
    ----------
    c : Circumstances
        Circumstances of the drive: its speed, current and sample time.
    rng : np.random.Generator
        Source of what is random.
    samples : int
        Number of draws.
    """
    rows = healthy(c, samples)
    rows["what"] = REPLACE_A | REPLACE_B
    rows["phase"] = np.nan
    return rows


def stuck_sensor(c: Circumstances, rng: np.random.Generator, time: float) -> Array:
    """Phase a's sensor stays at its last value.

    Parameters
    ----------
    c : Circumstances
        Circumstances of the drive: its speed, current and sample time.
    rng : np.random.Generator
        Source of what is random.
    time : float
        Duration, s.
    """
    rows = healthy(c, round(time / c.T))
    rows["what"] = HOLD_A
    return rows


def clipped(c: Circumstances, rng: np.random.Generator, time: float, share: float) -> Array:
    """The converter is full at a share of the present amplitude.

    Parameters
    ----------
    c : Circumstances
        Circumstances of the drive: its speed, current and sample time.
    rng : np.random.Generator
        Source of what is random.
    time : float
        Duration, s.
    share : float
        A share, 0 .. 1.
    """
    rows = healthy(c, round(time / c.T))
    rows["what"] = CLIP
    rows["range"] = share * c.amplitude
    return rows


def sagging_link(c: Circumstances, rng: np.random.Generator, time: float, share: float, known: bool) -> Array:
    """The DC link falls to a share of its voltage; the controller measures it, or goes on believing in the old one.

    Parameters
    ----------
    c : Circumstances
        Circumstances of the drive: its speed, current and sample time.
    rng : np.random.Generator
        Source of what is random.
    time : float
        Duration, s.
    share : float
        A share, 0 .. 1.
    known : bool
    """
    rows = healthy(c, round(time / c.T))
    rows["link"] = share * c.link
    rows["told"] = share * c.link if known else c.link
    return rows


def garbage(c: Circumstances, rng: np.random.Generator, time: float) -> Array:
    """Random bits as currents, NaN, infinity and huge numbers among them; every other sample nonsense within range.

    Parameters
    ----------
    c : Circumstances
        Circumstances of the drive: its speed, current and sample time.
    rng : np.random.Generator
        Source of what is random.
    time : float
        Duration, s.
    """
    rows = healthy(c, round(time / c.T))
    rows["what"] = REPLACE_A | REPLACE_B
    bits = rng.integers(0, 2**32, (len(rows), 2), dtype=np.uint32).view(np.float32)
    within = rng.uniform(-c.range, c.range, (len(rows), 2)).astype(np.float32)
    rows["phase"] = np.where((rng.random(len(rows)) < 0.5)[:, None], bits, within)
    return rows


def power_cycle(c: Circumstances, rng: np.random.Generator, time: float) -> Array:
    """Processor and inverter without power; then the firmware starts anew, and the motor still turns.

    Parameters
    ----------
    c : Circumstances
        Circumstances of the drive: its speed, current and sample time.
    rng : np.random.Generator
        Source of what is random.
    time : float
        Duration, s.
    """
    rows = healthy(c, round(time / c.T))
    rows["what"] = POWER_OFF
    return rows


def wrong_gain(c: Circumstances, rng: np.random.Generator, time: float, gain: float) -> Array:
    """Phase a's sensor reads a multiple of the current.

    Parameters
    ----------
    c : Circumstances
        Circumstances of the drive: its speed, current and sample time.
    rng : np.random.Generator
        Source of what is random.
    time : float
        Duration, s.
    gain : float
    """
    rows = healthy(c, round(time / c.T))
    rows["gain"][:, 0] = gain
    return rows


def offset(c: Circumstances, rng: np.random.Generator, time: float, share: float) -> Array:
    """Phase a's sensor reads a share of the amplitude too much.

    Parameters
    ----------
    c : Circumstances
        Circumstances of the drive: its speed, current and sample time.
    rng : np.random.Generator
        Source of what is random.
    time : float
        Duration, s.
    share : float
        A share, 0 .. 1.
    """
    rows = healthy(c, round(time / c.T))
    rows["offset"][:, 0] = share * c.amplitude
    return rows


def drifting_offset(c: Circumstances, rng: np.random.Generator, time: float, share: float) -> Array:
    """Phase a's sensor reads more and more too much, up to a share of the amplitude.

    Parameters
    ----------
    c : Circumstances
        Circumstances of the drive: its speed, current and sample time.
    rng : np.random.Generator
        Source of what is random.
    time : float
        Duration, s.
    share : float
        A share, 0 .. 1.
    """
    rows = healthy(c, round(time / c.T))
    rows["offset"][:, 0] = share * c.amplitude * np.linspace(0.0, 1.0, len(rows))
    return rows


def marked(c: Circumstances, rng: np.random.Generator, time: float, what: int) -> Array:
    """What the loop knows by a bit: swapped sensors, an open phase, a rotor that is held.

    Parameters
    ----------
    c : Circumstances
        Circumstances of the drive: its speed, current and sample time.
    rng : np.random.Generator
        Source of what is random.
    time : float
        Duration, s.
    what : int
        The bit.
    """
    rows = healthy(c, round(time / c.T))
    rows["what"] = what
    return rows


def overload(c: Circumstances, rng: np.random.Generator, time: float, share: float) -> Array:
    """A load of so many times the largest torque, against the rotation.

    Parameters
    ----------
    c : Circumstances
        Circumstances of the drive: its speed, current and sample time.
    rng : np.random.Generator
        Source of what is random.
    time : float
        Duration, s.
    share : float
        Of the largest torque.
    """
    rows = healthy(c, round(time / c.T))
    rows["load"] = share * c.torque
    return rows


#: s: how long a run with a fault that stays is watched; ten attempts that fail end in FAULT.
LASTING = 6.0


def _fault(name: str, title: str, make: Callable[..., Array], *numbers: Any, **more: Any) -> Fault:
    return Fault(name, title, lambda c, rng: make(c, rng, *numbers), **more)


FAULTS = (
    _fault("lost_sample", "1 sample lost", lost_samples, 1),
    _fault("lost_burst", "10 samples lost", lost_samples, 10),
    _fault("stuck_5ms", "sensor stuck 5 ms", stuck_sensor, 5e-3),
    _fault("stuck_50ms", "sensor stuck 50 ms", stuck_sensor, 50e-3, patience=0.5),
    _fault("saturated", "converter full 20 ms", clipped, 20e-3, 0.5, patience=0.5),
    _fault("sag_known", "DC link 50 %, measured", sagging_link, 50e-3, 0.5, True),
    _fault("sag_unknown", "DC link 50 %, unknown", sagging_link, 50e-3, 0.5, False),
    _fault("garbage", "garbage 10 ms", garbage, 10e-3),
    _fault("power_cycle", "power cycle 5 ms", power_cycle, 5e-3),
    _fault("gain_jump", "sensor gain 1.5, 50 ms", wrong_gain, 50e-3, 1.5),
    _fault("offset_jump", "sensor offset 50 ms", offset, 50e-3, 0.5),
    _fault("offset_drift", "offset drifts 200 ms", drifting_offset, 200e-3, 0.5),
    _fault("stalled", "rotor held 100 ms", marked, 100e-3, STALL, patience=0.5),
    _fault("overload", "load 1.2 of most 50 ms", overload, 50e-3, 1.2, patience=0.5),
    _fault("phase_lost", "phase a open", marked, LASTING, OPEN_A, lasting=LASTING),
    _fault("swapped", "sensors swapped", marked, LASTING, SWAP, lasting=LASTING, at_start=True),
)


def find_faults(names: str | None) -> tuple[Fault, ...]:
    """Faults by their names, comma-separated; all of them for None.

    Parameters
    ----------
    names : str or None
        Names, in order.

    Raises
    ------
    UserError
        There is none of a name.
    """
    if names is None:
        return FAULTS
    known = {fault.name: fault for fault in FAULTS}
    return tuple(known[name] for name in read_words(names, "fault", known))
