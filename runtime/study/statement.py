"""A study: drives, filters, and what varies how. Draws depend on the seed and the run's index alone."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.drive.fleet import Cases
from runtime.drive.motor import FACTOR_RANGE
from runtime.drive.scenario import Scenario
from runtime.system.errors import UserError
from runtime.system.values import MOST, nearest, read_number

Array = NDArray[Any]

#: The quantities that may vary: unit, the least and the most it may be. Motor data are factors on the drive file's.
VARIABLES: dict[str, tuple[str, float, float]] = {
    "noise": ("A rms", 0.0, MOST),
    "theta": ("deg", -MOST, MOST),
    "R": ("of the drive file's", *FACTOR_RANGE),
    "L": ("of the drive file's", *FACTOR_RANGE),
    "L_d": ("of the drive file's", *FACTOR_RANGE),
    "L_q": ("of the drive file's", *FACTOR_RANGE),
    "psi_m": ("of the drive file's", *FACTOR_RANGE),
    "J": ("of the drive file's", *FACTOR_RANGE),
    "load": ("N m", -MOST, MOST),
    "speed": ("r/min", -MOST, MOST),
}

#: Those that may be given as shares of what suits the drive: its sensors' noise, its rated torque and speed.
OF_RATED = ("noise", "load", "speed")

#: The default variation: a drive whose data are known to some per cent, its rotor roughly aligned.
USUAL = (
    "noise=0.4:2:rated",
    "theta=-30:30",
    "R=0.8:1.2",
    "L=0.9:1.1",
    "psi_m=0.95:1.05",
    "J=0.8:1.2",
    "load=0:1:rated",
)

#: The same of a drive with its supervisor, which starts from any angle.
ANYWHERE = tuple("theta=-180:180" if item.startswith("theta=") else item for item in USUAL)


@dataclass(frozen=True)
class Range:
    """A variable drawn evenly from ``low`` to ``high``, or evenly in its logarithm; fixed where the two are equal.

    ``rated``: in shares of what suits the drive.

    >>> parse_range("R=0.8:1.2")
    Range(name='R', low=0.8, high=1.2, log=False, rated=False)
    """

    name: str
    low: float
    high: float
    log: bool = False
    rated: bool = False

    @property
    def fixed(self) -> bool:
        """Whether it is a single value."""
        return self.low == self.high

    @property
    def unit(self) -> str:
        """The variable's unit; empty for a factor."""
        return "of rated" if self.rated else VARIABLES[self.name][0]

    def at(self, share: Array) -> Array:
        """Return the values at shares of the range.

        Parameters
        ----------
        share : ndarray
            0 .. 1.
        """
        if self.log:
            return np.asarray(self.low * (self.high / self.low) ** share)
        return np.asarray(self.low + (self.high - self.low) * share)

    def __str__(self) -> str:
        values = f"{self.low:g}" if self.fixed else f"{self.low:g}:{self.high:g}"
        return f"{self.name}={values}{':log' * self.log}{':rated' * self.rated}"


def parse_range(text: str) -> Range:
    """Parse ``name=value``, ``name=low:high`` or ``name=low:high:log``; ``:rated`` behind it for shares of the rated.

    Parameters
    ----------
    text : str

    Raises
    ------
    UserError
        With what is wrong with it.
    """
    name, equals, values = text.partition("=")
    name = name.strip()
    if not equals:
        raise UserError(f"--vary '{text}' is not NAME=LOW:HIGH, such as R=0.8:1.2.")
    if name not in VARIABLES:
        hint = nearest(name, VARIABLES) or f" There are: {', '.join(VARIABLES)}."
        raise UserError(f"--vary '{text}': nothing called '{name}' varies.{hint}")
    parts = values.split(":")
    rated = parts[-1] == "rated"
    if rated and name not in OF_RATED:
        raise UserError(f"--vary '{text}': no rated {name} is known; there are those of {', '.join(OF_RATED)}.")
    parts = parts[:-1] if rated else parts
    log = len(parts) == 3 and parts[2] == "log"
    unit, least, most = VARIABLES[name]
    numbers = [read_number(part, f"--vary '{text}':", high=most) for part in parts[: 2 if log else 3]]
    if len(numbers) not in (1, 2):
        raise UserError(f"--vary '{text}' is not {name}=LOW:HIGH, {name}=LOW:HIGH:log or {name}=VALUE.")
    low, high = numbers[0], numbers[-1]
    if low > high:
        raise UserError(f"--vary '{text}': {low:g} is more than {high:g}; write {name}={high:g}:{low:g}.")
    if low < least:
        raise UserError(f"--vary '{text}': {name} ({unit}) cannot be below {least:g}.")
    if log and low <= 0:
        raise UserError(f"--vary '{text}': a logarithmic range begins above 0.")
    return Range(name, low, high, log, rated)


def parse_ranges(texts: Iterable[str]) -> tuple[Range, ...]:
    """Parse several ranges, each name once.

    Parameters
    ----------
    texts : iterable of str

    Raises
    ------
    UserError
        A name stands twice, or a range is wrong.
    """
    ranges = tuple(parse_range(text) for text in texts)
    names = [item.name for item in ranges]
    for name in names:
        if names.count(name) > 1:
            raise UserError(f"--vary {name} is given twice.")
    if "L" in names and {"L_d", "L_q"} & set(names):
        raise UserError("--vary L varies both inductances; leave it out to vary L_d or L_q.")
    return ranges


@dataclass(frozen=True)
class Statement:
    """One study but for its number of runs: more runs only add to those that were made.

    ``subjects`` are the (drive, filter) pairs, ``digests`` what their generated code is known by, ``scenarios`` each
    one's task and ``rated`` the noise (A), load (N m) and speed (r/min) that suit it. ``supervised``: from power-up,
    with the modes around the controller.
    """

    subjects: tuple[tuple[str, str], ...]
    digests: tuple[str, ...]
    scenarios: tuple[Scenario, ...]
    rated: tuple[Mapping[str, float], ...]
    ranges: tuple[Range, ...]
    seed: int
    supervised: bool = False

    def draw(self, first: int, count: int) -> dict[str, Array]:
        """Draw values by variable, and each run's noise seed; angles in degrees, shares of the rated as such.

        Parameters
        ----------
        first, count : int
            Runs first .. first + count - 1.
        """
        columns = {item.name: item.at(_shares(self.seed, item.name, first, count)) for item in self.ranges}
        return columns | {"seed": _stream(self.seed, "noise of the sensors", first, count)}

    def cases(self, subject: int, first: int, count: int) -> Cases:
        """Draw as a fleet takes it.

        Parameters
        ----------
        subject : int
            Number of the drive and filter.
        first, count : int
            Runs first .. first + count - 1.
        """
        values: dict[str, Any] = self.draw(first, count)
        for item in self.ranges:
            if item.rated:
                values[item.name] = self.rated[subject][item.name] * values[item.name]
        if "L" in values:
            values["L_d"] = values["L_q"] = values.pop("L")
        if "theta" in values:
            values["theta"] = np.radians(values["theta"])
        return Cases(**values)

    def facts(self) -> dict[str, Any]:
        """Plain data, the same in every process."""
        return {
            "subjects": [
                f"{drive}/{kind} {digest[:16]}"
                for (drive, kind), digest in zip(self.subjects, self.digests, strict=True)
            ],
            "scenarios": [asdict(scenario) for scenario in self.scenarios],
            "rated": [dict(rated) for rated in self.rated],
            "vary": [str(item) for item in self.ranges],
            "seed": self.seed,
            "supervised": self.supervised,
        }

    @property
    def digest(self) -> str:
        """Hash of everything that decides the runs."""
        return hashlib.sha256(json.dumps(self.facts(), sort_keys=True).encode()).hexdigest()


def differences(here: Mapping[str, Any], there: Mapping[str, Any]) -> str:
    """Say in words the first thing that tells two statements' facts apart.

    Parameters
    ----------
    here, there : mapping of str to Any
    """
    key = next((key for key in here if here[key] != there.get(key)), "digest")
    return f"{key} there: {_words(there.get(key))}, now: {_words(here.get(key))}"


def _words(value: Any) -> str:
    return " ".join(str(item) for item in value) if isinstance(value, list) else str(value)


def _stream(seed: int, name: str, first: int, count: int) -> Array:
    """Words ``first`` .. of the stream that belongs to a seed and a name: Philox, so that any word can be had alone."""
    key = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "little")
    generator = np.random.Philox(key=np.array([seed, key], dtype=np.uint64))
    generator.advance(first // 4)  # a counter makes four words
    return np.asarray(generator.random_raw(first % 4 + count)[first % 4 :], dtype=np.uint64)


def _shares(seed: int, name: str, first: int, count: int) -> Array:
    """The same as numbers in [0, 1)."""
    return (_stream(seed, name, first, count) >> np.uint64(11)) * 2.0**-53
