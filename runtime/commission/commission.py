"""The whole of a commissioning: runs of the board, each planned with what the runs before have shown.

At rest and turning with the facts as they are stated, to learn what they are; then both again with what was learnt, the
turning twice: those are what is told. A datum that a run does not show is not told, and the reason is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.commission.electrical import CHANGED, axes, d_is_smaller, inductances, levels
from runtime.commission.intervals import Told, of_values
from runtime.commission.line import Bench as Board
from runtime.commission.line import Ran
from runtime.commission.plan import Bench, Limits, at_rest, turning
from runtime.commission.protocol import BYTE_ARRIVED, DONE, Run, Segment
from runtime.commission.turning import Machine, Turned, turned
from runtime.design.facts import Facts

Array = NDArray[Any]

#: A run of which frames were lost is made again so often.
REPEATS = 2
#: Sines of the angle by which the rotor stays behind while it speeds up: where J is guessed, and where it is known.
LAG_GUESSED, LAG_KNOWN = 0.15, 0.25
#: How much of the dead time's voltage stays unknown where currents linger about zero.
BLURRED = 0.025
#: Runs that turn with what is known; the height of square waves where the usual one was too large.
TURNS, SMALLER = 2, 0.35
#: Words of :data:`runtime.identify.unknowns.DATA`, in the order in which they are found.
WORDS = ("R", "V_dead", "L", "L_d", "L_q", "psi_m", "J")

Tell = Callable[[str, float], None]


class EndedError(Exception):
    """A run did not come to its end; the text says why. ``stopped``: because the user wanted it so."""

    def __init__(self, text: str, stopped: bool) -> None:
        super().__init__(text)
        self.stopped = stopped


@dataclass
class Commissioned:
    """What was found: by word, a value with its interval, or why it is not told; and every run that was made."""

    facts: Facts
    limits: Limits
    told: dict[str, Told] = field(default_factory=dict)
    why: dict[str, str] = field(default_factory=dict)
    runs: list[Ran] = field(default_factory=list)
    ended: str = ""
    stopped: bool = False

    @property
    def words(self) -> tuple[str, ...]:
        """Those of this machine: one inductance of a round rotor, else two."""
        others = {"L_d", "L_q"} if "L" in self.told or "L" in self.why else {"L"}
        return tuple(word for word in WORDS if word not in others)


def commission(
    board: Board, facts: Facts, limits: Limits, stop: Callable[[], bool], tell: Tell, keep: Callable[[Ran], None]
) -> Commissioned:
    """Run everything; what was found so far is in the result, however it ends.

    Parameters
    ----------
    board : Board
    facts : Facts
        As they are stated: each half to one and a half times the truth.
    limits : Limits
    stop : callable
        Asked all the while; True ends it.
    tell : callable
        Told what runs and the share of it that is done.
    keep : callable
        Given every run when it ends.
    """
    found = Commissioned(facts, limits)
    work = _Work(board, found, stop, tell, keep)
    try:
        work.carry_out()
    except EndedError as error:
        found.ended, found.stopped = str(error), error.stopped
    for word in ("R", "V_dead", "L_d", "L_q", "psi_m", "J"):
        if word not in found.told and not (word in {"L_d", "L_q"} and ("L" in found.told or "L" in found.why)):
            found.why.setdefault(word, found.ended or "the runs before it did not show what it needs")
    return found


class _Work:
    """The runs one after the other, and what is known by now."""

    def __init__(
        self,
        board: Board,
        found: Commissioned,
        stop: Callable[[], bool],
        tell: Tell,
        keep: Callable[[Ran], None],
    ) -> None:
        self.board, self.found, self.stop, self.tell, self.keep = board, found, stop, tell, keep
        self.now = replace(found.facts, T=board.hello.period)
        self.smaller: bool | None = None
        self.L: tuple[Array, Array] = (np.zeros(0), np.zeros(0))
        self.across: Segment | None = None

    def carry_out(self) -> None:
        """All runs."""
        bench = Bench(self.now, self.found.limits, self.board.every(), self.board.hello.rows)
        if not self._rest(bench):
            return
        bench = replace(bench, facts=self.now, seen=True)
        first = self._turn(bench, LAG_GUESSED, "turning, to learn")
        if first is not None:
            self.now = replace(self.now, psi_m=float(first.psi_by_direction.mean()), J=float(first.J.mean()))
        bench = replace(bench, facts=self.now, known=first is not None)
        if not self._rest(bench) or first is None:
            return
        bench = replace(bench, facts=self.now)
        each = [self._turn(bench, LAG_KNOWN, f"turning, {k + 1} of {TURNS}") for k in range(TURNS)]
        whole = [one for one in each if one is not None]
        if len(whole) == TURNS:
            self._tell_turning(whole, bench)

    def _rest(self, bench: Bench) -> bool:
        """R, dead time and inductances; whether all are known."""
        ran = self._run(at_rest(bench), "at rest" if bench.known else "at rest, to learn")
        told, why = self.found.told, self.found.why
        level = levels(ran, self.now)
        if isinstance(level, str):
            for word in ("R", "V_dead"):
                told.pop(word, None)
                why[word] = level
            return False
        R, V_d = float(level.R.mean()), float(level.V_d.mean())
        dead_time = min(max(V_d, 0.0) * self.now.T / self.now.dc_link, 0.2 * self.now.T)
        self.now = replace(self.now, R=R, dead_time=dead_time)
        told |= {"R": of_values("R", level.R, level.bent), "V_dead": of_values("V_dead", level.V_d)}
        L = inductances(ran, R, self.now.sigma)
        if isinstance(L, str) and L == CHANGED and bench.waves == 1.0:
            return self._rest(replace(bench, waves=SMALLER))
        if not bench.known and not isinstance(L, str):
            low = inductances(ran, R, self.now.sigma, "low ")
            L = low if isinstance(low, str) else L
            self.smaller = None if isinstance(low, str) or isinstance(L, str) else d_is_smaller(L.mean(axis=0), low[0])
        if isinstance(L, str):
            for word in ("L", "L_d", "L_q"):
                told.pop(word, None)
            why |= {"L_d": L, "L_q": L}
            return False
        sorted_by = axes(L, self.smaller)
        self.now = replace(self.now, L_d=float(sorted_by.L_d.mean()), L_q=float(sorted_by.L_q.mean()))
        self.across = next(s for s in ran.run.segments if s.what == "across")
        self.L = (sorted_by.L_d, sorted_by.L_q)
        why.pop("L_d", None)
        why.pop("L_q", None)
        self._tell_inductances(sorted_by.L_d, sorted_by.L_q)
        return True

    def _tell_inductances(self, L_d: Array, L_q: Array) -> None:
        told = self.found.told
        for word in ("L", "L_d", "L_q"):
            told.pop(word, None)
        if self.smaller is None:
            told["L"] = of_values("L", np.concatenate([L_d, L_q]))
        else:
            told |= {"L_d": of_values("L_d", L_d), "L_q": of_values("L_q", L_q)}

    def _turn(self, bench: Bench, lag: float, name: str) -> Turned | None:
        ran = self._run(turning(bench, lag), name)
        f = self.now
        V_d = f.dc_link * f.dead_time / f.T
        result = turned(ran, Machine(f.R, f.L_d, f.L_q, V_d, f.p, f.psi_m, f.J, f.dc_link))
        if isinstance(result, str):
            self.found.why |= {"psi_m": result, "J": result}
            return None
        return result

    def _tell_turning(self, each: list[Turned], bench: Bench) -> None:
        """psi_m and J of all turns; and the inductance across, from which the moving rotor took a little."""
        psi = np.concatenate([one.psi_by_direction for one in each])
        J = np.concatenate([one.J for one in each])
        f = self.now
        unsure = max(self._width("L_d"), self._width("L")) * f.L_d * float(np.mean([one.current for one in each]))
        lost = f.dc_link * f.dead_time / f.T
        blurred = BLURRED * lost / float(np.mean([np.abs(one.speed) for one in each]))
        self.found.told |= {"psi_m": of_values("psi_m", psi, math.hypot(unsure, blurred)), "J": of_values("J", J)}
        self.now = replace(f, psi_m=float(psi.mean()), J=float(J.mean()))
        if self.across is None:
            return
        swing_flux = bench.pull(self.across.current)
        wave = np.pi / (self.across.half * f.T)
        moved = 1.5 * (f.p * swing_flux / wave) ** 2 / self.now.J
        self._tell_inductances(self.L[0], self.L[1] + moved)

    def _width(self, word: str) -> float:
        told = self.found.told.get(word)
        return told.width if told is not None else 0.0

    def _run(self, run: Run, name: str) -> Ran:
        """A run whose rows all arrived.

        Raises
        ------
        EndedError
            It did not come to its end, or frames were lost each time.
        """
        for _ in range(1 + REPEATS):
            ran = self.board.run(run, self.stop, lambda share: self.tell(name, min(share, 1.0)))
            self.found.runs.append(ran)
            self.keep(ran)
            if ran.state != DONE:
                stopped = self.stop()
                said = "stopped" if stopped else f"the board ended '{name}': {ran.why}"
                if ran.reason == BYTE_ARRIVED and not stopped:
                    said += "; what else is on this line?"
                raise EndedError(said, stopped)
            if ran.whole:
                return ran
        raise EndedError(f"'{name}': {ran.why}, {1 + REPEATS} times; is the line sound, at this --baud?", False)


def found_facts(found: Commissioned) -> Facts:
    """The stated facts with all that is told in them, tolerances too.

    Parameters
    ----------
    found : Commissioned
    """
    from runtime.identify.subject import with_found

    told: Mapping[str, Told] = found.told
    return with_found(found.facts, {word: (one.value, one.width) for word, one in told.items() if one.surely})
