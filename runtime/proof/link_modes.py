"""Link "supervisor": the modes by hand and generated, float64; then NumPy float32 and C, bit for bit.

Each interrupt is taken from the memory that the generated supervisor is in, so that a difference is that interrupt's
own. How often each transition was taken is a row of its own: what was never taken was not compared.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.estimator.folder import GeneratedFolder
from runtime.proof.inverter import lost_volts
from runtime.proof.mode_memory import CARRIES, Filter, Memory, Said
from runtime.proof.mode_walk import Walk
from runtime.proof.modes import Modes
from runtime.proof.motors import Plant
from runtime.proof.result import Link, Row

Array = NDArray[Any]

#: Float64, a few roundings, on the scale of the number or of 1.
ALLOWED = 1e-12
#: rad: the generated arc tangent is a polynomial, 0.004 off at the worst.
ANGLE_ALLOWED = 0.005
#: Of the largest current: a flux linkage is good to 1e-16 of itself, over an inductance of 1e-6 of psi_m by an ampere.
CURRENT_ALLOWED = 1e-9
#: Lanes and interrupts, and how often each transition must be taken at least.
LANES, INTERRUPTS, LEAST = 80, 70, 5
#: Fields of a filter that the statement by hand knows by name; the rest it carries along.
KNOWN = ("x", "x_0", "P_0", "nis")


@dataclass
class Findings:
    """The worst of every figure, and how often things happened."""

    worst: dict[str, float] = field(default_factory=dict)
    compared: Counter[str] = field(default_factory=Counter)
    events: Counter[str] = field(default_factory=Counter)
    numbers: dict[tuple[str, int], int] = field(default_factory=dict)

    def see(self, name: str, found: Any, wanted: Any, scale: float = 1.0) -> None:
        """Take a number's deviation in; what is no number in both is none.

        Parameters
        ----------
        name : str
        found, wanted : float
        scale : float, optional
        """
        self.compared[name] += 1
        if found == wanted or (found != found and wanted != wanted):
            return
        error = abs(float(found) - float(wanted)) / max(float(scale), abs(float(wanted)))
        self.worst[name] = max(self.worst.get(name, 0.0), error if error == error else np.inf)

    def row(self, name: str, meaning: str, allowed: float) -> Row:
        """A figure as a row.

        Parameters
        ----------
        name, meaning : str
        allowed : float
        """
        return Row("-", name, meaning, self.worst.get(name, 0.0), allowed, self.compared[name])


class Reader:
    """Lanes of generated structs as the statement by hand has them.

    Parameters
    ----------
    module : ModuleType
        The generated module.
    lanes : int
    """

    def __init__(self, module: ModuleType, lanes: int) -> None:
        self.module, self.lanes, self.words = module, lanes, module.COVARIANCE
        words = np.asarray(module.pack(np.diag(np.arange(1.0, 1.0 + len(module.DEFAULTS["x_0"])))))
        self.variances = [int(np.flatnonzero(words == 1.0 + k)[0]) for k in range(len(module.DEFAULTS["x_0"]))]
        self.beside = [k for k in range(len(words)) if k not in self.variances]

    def filters(self, one: SimpleNamespace) -> Iterator[Filter]:
        """Each lane's filter.

        Parameters
        ----------
        one : SimpleNamespace
        """
        plain = {name: _plain(value, self.lanes) for name, value in vars(one).items()}
        for lane in range(self.lanes):
            values: dict[str, Any] = {
                name: [row[lane] for row in value] if isinstance(value[0], list) else value[lane]
                for name, value in plain.items()
            }
            words = values.pop(self.words)
            variances, beside = ([words[k] for k in places] for places in (self.variances, self.beside))
            known: dict[str, Any] = {name: values.pop(name, 0.0) for name in KNOWN}
            yield Filter(known["x"], variances, beside, known["nis"], known["x_0"], known["P_0"], values)

    def memories(self, s: SimpleNamespace) -> Iterator[Memory]:
        """Each lane's machine.

        Parameters
        ----------
        s : SimpleNamespace
        """
        fields = dict(vars(s))
        rivals = list(self.filters(fields.pop("rival"))) if "rival" in fields else None
        plain = {name: _plain(value, self.lanes) for name, value in fields.items()}
        modes, reasons = self.module.MODES, self.module.REASONS
        for lane, (mode, reason) in enumerate(zip(plain.pop("mode"), plain.pop("reason"), strict=True)):
            m = Memory(_named(modes, mode), _named(reasons, reason), rivals[lane] if rivals else None)
            for name, value in plain.items():
                if isinstance(value[0], list):
                    m.arrays[name] = [row[lane] for row in value]
                else:
                    m.whole[name] = value[lane]
            yield m


def _named(names: tuple[str, ...], number: int) -> str:
    return names[number] if 0 <= number < len(names) else f"none {number}"


def _plain(value: Any, lanes: int) -> list[Any]:
    """A field as lists; one number is every lane's."""
    if isinstance(value, tuple):
        return [_plain(row, lanes) for row in value]
    return np.broadcast_to(np.asarray(value), (lanes,)).tolist()  # type: ignore[no-any-return]


def link_modes(
    folder: GeneratedFolder,
    kind: str,
    gain: str,
    parameters: Mapping[str, Any],
    motor: Plant,
    effort: tuple[int, int] = (LANES, INTERRUPTS),
) -> Link:
    """By hand against generated float64.

    Parameters
    ----------
    folder : GeneratedFolder
        The generated folder.
    kind : str
        Filter kind, such as "ickf".
    gain : str
        "cubature" or "jacobian"; matters to the ICKF alone.
    parameters : mapping of str to Any
        Sections of the drive file, parsed.
    motor : Plant
        The motor's data.
    effort : tuple of int, optional
        Lanes and interrupts.
    """
    module, (lanes, interrupts) = folder.module, effort
    hand = Modes(parameters, flux=folder.manifest["states"][0]["unit"] == "Wb")
    walk, reader = Walk(module, hand, lanes, np.float64, 0), Reader(folder.module, lanes)
    judge = Judge(hand, motor, parameters)
    for m in reader.memories(walk.s):
        judge.power_up(m)
    for _ in range(interrupts):
        status, phase, reference = walk.draw()
        wanted = list(zip(reader.memories(walk.s), reader.filters(walk.f), strict=True))
        taken = walk.step(status, phase, reference).tolist()
        found = zip(reader.memories(walk.s), reader.filters(walk.f), strict=True)
        for lane, ((m, f), (m_found, f_found)) in enumerate(zip(wanted, found, strict=True)):
            i, bits = (float(phase[0][lane]), float(phase[1][lane])), int(status[lane])
            said = Said(bool(bits & 1), bool(bits & 16), bool(bits & 32))
            with np.errstate(all="ignore"):
                event = hand.interrupt(m, f, said, i, float(reference[lane]))
            judge.events(event, taken[lane])
            judge.machine(m, m_found, i, event)
            judge.filter(f, f_found, i, event)
    data = f"{lanes} drives, {interrupts} interrupts, {sum(judge.found.events.values())} transitions"
    claim = "modes by hand = generated float64"
    return Link("supervisor", claim, folder.drive, kind, gain, data, tuple(judge.rows()))


class Judge:
    """Compares what was to happen with what happened.

    Parameters
    ----------
    hand : Modes
    motor : Plant
        Says which currents a state carries.
    parameters : mapping
        Sections of the drive file.
    """

    def __init__(self, hand: Modes, motor: Plant, parameters: Mapping[str, Any]) -> None:
        self.hand, self.motor, self.found = hand, motor, Findings()
        words = parameters["model"].get("adaptive") or ()
        nominal = [lost_volts(parameters) if w == "dead_time_voltage" else parameters["motor"][w] for w in words]
        self.slow = [*[0.0] * hand.loaded, *nominal]

    def power_up(self, m: Memory) -> None:
        """The machine at power-up: RESTING, and nothing counted.

        Parameters
        ----------
        m : Memory
        """
        zeros = [*m.whole.values(), *(v for values in m.arrays.values() for v in values)]
        self.found.see("power-up", float(any(zeros) or (m.mode, m.reason) != ("RESTING", "NONE")), 0.0)

    def events(self, event: str, taken: int) -> None:
        """Every transition has one number, and every number is one transition's.

        Parameters
        ----------
        event : str
            By hand; empty: none.
        taken : int
            Number that the generated table returned.
        """
        self.found.see("a transition or none", float(bool(event)), float(taken != 0))
        if event:
            self.found.events[event] += 1
            self.found.numbers[event, taken] = self.found.numbers.get((event, taken), 0) + 1

    def machine(self, wanted: Memory, found: Memory, i: tuple[float, float], event: str) -> None:
        """Mode, reason, counts and arrays after an interrupt.

        Parameters
        ----------
        wanted, found : Memory
        i : tuple of float
            Phase currents, A.
        event : str
            What happened.
        """
        see = self.found.see
        see("mode", float(found.mode != wanted.mode), 0.0)
        see("reason", float(found.reason != wanted.reason), 0.0)
        self.found.compared["counts and what is allowed"] += len(wanted.whole)
        if found.whole != wanted.whole:
            see("counts and what is allowed", 1.0, 0.0)
        for name, values in wanted.arrays.items():
            if name == "guess":
                self._state("guess", [*values, *self.slow], [*found.arrays[name], *self.slow], i, event)
                continue
            for value, own in zip(values, found.arrays[name], strict=True):
                see(f"{name}, s", own, value)
        if (wanted.rival is None) != (found.rival is None):
            see("rival or none", 1.0, 0.0)
        if wanted.rival is not None and found.rival is not None:
            self.filter(wanted.rival, found.rival, i, event)

    def filter(self, wanted: Filter, found: Filter, i: tuple[float, float], event: str) -> None:
        """A filter after an interrupt.

        Parameters
        ----------
        wanted, found : Filter
        i : tuple of float
            Phase currents, A.
        event : str
            What happened.
        """
        self._state("x", wanted.x, found.x, i, event)
        words = zip([*wanted.variances, *wanted.beside], [*found.variances, *found.beside], strict=True)
        for value, word in words:
            self.found.see("covariance", word, value)
        same = (wanted.rest, wanted.nis, wanted.x_0, wanted.P_0) == (found.rest, found.nis, found.x_0, found.P_0)
        self.found.see("tuning, score and what a reset clears", float(not same), 0.0)

    def _state(self, name: str, wanted: list[Any], found: list[float], i: tuple[float, float], event: str) -> None:
        """State or guess: what carries the currents is judged by the currents, an arc tangent by its own bound."""
        read = event == "PROBING: turned" and name == "guess"
        if wanted[0] is CARRIES:
            h = self.motor.h(np.array([*found[:4], *self.slow]))
            known, scale = bool(np.isfinite(i).all()), max(self.hand.most, abs(i[0]), abs(i[1]))
            for own, value in zip(h, self.currents(i), strict=True):
                if known or np.isfinite(own):
                    self.found.see(f"{name}'s currents", float(own), value, scale)
            wanted = [*found[:2], *wanted[2:]]
        for k, (value, own) in enumerate(zip(wanted, found, strict=True)):
            if k == 3 and value != value:  # of a speed that is no number: wrapped it is any
                continue
            turn = (own - value + np.pi) % (2 * np.pi) - np.pi if k == 3 else 0.0
            if k == 3 and read:
                self.found.see(f"{name}'s angle, as read", turn, 0.0)
            elif k == 3:
                self.found.see(f"{name}, where it begins", value + turn, value)
            else:
                self.found.see(f"{name}, where it begins", own, value)

    @staticmethod
    def currents(i: tuple[float, float]) -> tuple[float, float]:
        """Stator currents, A, of two phases.

        Parameters
        ----------
        i : tuple of float
        """
        return i[0], (i[0] + 2 * i[1]) / np.sqrt(3)

    def rows(self) -> Iterator[Row]:
        """All figures, then how often each transition was taken."""
        found = self.found
        for name in ("power-up", "a transition or none", "mode", "reason", "counts and what is allowed"):
            yield found.row(name, "interrupts that differ", 0.0)
        for name in sorted(name for name in found.compared if name.endswith(", s")):
            yield found.row(name, "on the number's scale", ALLOWED)
        yield found.row("guess's angle, as read", "rad", ANGLE_ALLOWED)
        for name in ("guess", "x"):
            yield found.row(f"{name}, where it begins", "on the number's scale", ALLOWED)
            yield found.row(f"{name}'s currents", "of the largest", CURRENT_ALLOWED)
        yield found.row("covariance", "on the number's scale", ALLOWED)
        yield found.row("tuning, score and what a reset clears", "interrupts that differ", 0.0)
        usual = {event: max((n, k) for (e, k), n in found.numbers.items() if e == event)[1] for event in found.events}
        odd = sum(n for (event, number), n in found.numbers.items() if number != usual[event])
        shared = len(usual) - len(set(usual.values()))
        yield Row("-", "each transition has a number", "that differ", float(odd + shared), 0.0, len(found.numbers))
        for event in dict.fromkeys([*self.hand.events, *found.events]):
            count = found.events[event]
            missing = max(0, LEAST - count) if event in self.hand.events else count
            yield Row("-", event, "times too seldom", float(missing), 0.0, count)
