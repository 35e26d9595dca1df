"""The search: from several guesses, each annealed on the innovations' spread, then by Fisher scoring.

At first the filter doubts every volt (kappa a tenth of the largest voltage) and so follows the recording with wrong
motor data; as kappa falls, the data take over what it doubted. Then the likelihood itself is climbed, its variances
unknowns among the others. Both stages take Levenberg's steps, eight of them tried side by side.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.identify.likelihood import Slope, slope, values
from runtime.identify.load_steps import with_next_step
from runtime.identify.problem import SIMPLIFIED, SWITCHING, Problem, Stage
from runtime.system.errors import UserError, take_interrupt

Array = NDArray[Any]
#: Told what is being done, and how much of all, 0 .. 1.
Progress = Callable[[str, float], None]

KAPPAS = (0.1, 0.03, 0.01, 0.003, 0.001, 0.0003)
#: Data that are let go from the first kappa on, and from which kappa on the others are: while the filter doubts most of
#: the voltage an inductance only shapes how much, and wanders off.
EARLY, TRUSTED = ("R", "psi_m", "J"), 0.01
#: Steps of a stage at most, and the decrease of the objective that ends it.
ANNEALING, CLIMBING, ENOUGH = 12, 40, 0.02
#: Damping that is tried at once; the largest step of a datum, and of the other unknowns.
DAMPING = (0.0, 1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0, 1000.0)
LARGEST, LARGEST_OTHER = 0.4, 1.2
#: First angles of the rotor that are tried, and on how many rows.
ANGLES, LOOK = 12, 3000
#: Starts, and how far the others are from the guesses, in logarithms.
STARTS, SPREAD = 3, 0.3
#: By how much, in logarithms, L_d and L_q are pushed apart, either way: which is larger a guess may have wrong, and no
#: step of a search passes a round rotor, which is blind to the angle at rest.
SALIENCY = 0.5
#: The inverter's loss as each start has it.
SHAPES = (SWITCHING, SIMPLIFIED, SWITCHING)
#: Noise of the voltage and of the load torque that is tried first, times their guesses.
VOLTAGES, WALKS = (1e-3, 1e-2, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0), (1e-2, 0.1, 1.0, 10.0)
#: Two ends of a search are one where their objectives differ by less.
SAME = 1.0


@dataclass(frozen=True)
class Found:
    """The best of the search: the problem with the inverter's shape that suits it, its vector (m,), the slope there.

    The slope is by the entries ``free``.

    ``ends``: the objective of each start that was climbed to the end. ``interrupted``: Ctrl-C came before.
    """

    problem: Problem
    q: Array
    free: list[int]
    slope: Slope
    ends: tuple[float, ...]
    interrupted: bool

    @property
    def agreeing(self) -> int:
        """How many starts ended at the best."""
        return sum(end - min(self.ends) < SAME for end in self.ends)


class _Search:
    """One search, which remembers the best so far."""

    def __init__(self, problem: Problem, progress: Progress) -> None:
        self.problem, self.tell = problem, progress
        self.problems = tuple(problem.changed(shape) for shape in SHAPES)
        self.done, self.of = 0, STARTS * (len(KAPPAS) + 3)
        self.best: tuple[float, Array, Problem] | None = None
        self.annealed: list[Array] = []
        self.ends: list[float] = []

    def told(self, text: str) -> None:
        """Report."""
        self.done += 1
        self.tell(text, min(self.done / self.of, 1.0))

    def run(self) -> None:
        """All starts."""
        for start in range(STARTS):
            self.problem = self.problems[start]
            self.annealed.append(self.anneal(self.begin(start), start))
            self.ends.append(self.climb(self.annealed[-1], f"start {start + 1} of {STARTS}, likelihood"))
        self.load_steps()

    def load_steps(self) -> None:
        """From the best, the steps of the load, one after another."""
        before = None
        while self.best is not None and self.best is not before:
            before = self.best
            if (found := with_next_step(before[2], before[1])) is not None:
                self.problem, q = found
                self.climb(q, "load steps", quieten=False)

    def so_far(self) -> tuple[float, Array, Problem] | None:
        """The best of what there is; where no likelihood was climbed yet, what was annealed."""
        if self.best is None and self.annealed:
            q = self.quieten(self.annealed[-1])
            value = float(values(self.problem, q[:, None], Stage())[0])
            return (value, q, self.problem) if np.isfinite(value) else None
        return self.best

    def begin(self, start: int) -> Array:
        """The guesses, or others about them, with the first angle and speed that suit each recording best."""
        problem = self.problem
        q = problem.guess
        if start:
            draws = np.random.default_rng(start).uniform(-SPREAD, SPREAD, len(problem.data))
            signed = [not problem.unknowns[k].positive for k in problem.data]
            q[problem.data] += np.where(signed, 0.0, draws)
            for name, towards in (("L_d", -SALIENCY), ("L_q", SALIENCY)):
                if name in {problem.unknowns[k].name for k in problem.data}:
                    q[problem.index(name)] = problem.guess[problem.index(name)] + towards * (1 if start == 1 else -1)
        for recording, rows in enumerate(problem.recordings):
            theta, omega = problem.index(f"theta {recording}"), problem.index(f"omega {recording}")
            size, p = problem.unknowns[omega].size, problem.subject.facts.p
            angles = 2 * np.pi * np.arange(ANGLES) / ANGLES - np.pi
            Q = np.repeat(q[:, None], 2 * ANGLES, axis=1)
            Q[theta], Q[omega, ANGLES:] = np.tile(angles, 2), rows.omega_e / p / size
            found = values(problem, Q, Stage(KAPPAS[0], 0.3, 0.1), LOOK, (recording,))
            if not np.any(np.isfinite(found)):
                raise UserError(f"'{rows.recorded.path}': the filter follows it from no angle; are u in V and i in A?")
            q = Q[:, int(np.argmin(found))]
        return q

    def anneal(self, q: Array, start: int) -> Array:
        """The data, the starts of the recordings with them, as kappa falls."""
        own = [k for k, unknown in enumerate(self.problem.unknowns) if unknown.recording is not None]
        for kappa in KAPPAS:
            self.told(f"start {start + 1} of {STARTS}, doubting {kappa:.1%} of the voltage")
            stage = Stage(kappa, 0.1, 0.1)
            early = start == 1 and kappa > TRUSTED
            data = [k for k in self.problem.data if not early or self.problem.unknowns[k].name in EARLY]
            for _ in range(ANNEALING):
                q, gain, _ = self.step(q, [*data, *own], stage)
                if gain < ENOUGH:
                    break
        return q

    def climb(self, q: Array, text: str, quieten: bool = True) -> float:
        """The likelihood, all unknowns free."""
        free = list(range(len(self.problem.unknowns)))
        q, small = self.quieten(q) if quieten else q, 0
        value = np.inf
        for count in range(CLIMBING):
            if count % 10 == 0:
                self.told(text)
            q, gain, value = self.step(q, free, Stage())
            if np.isfinite(value) and (self.best is None or value < self.best[0]):
                self.best = value, q, self.problem
            small = small + 1 if gain < ENOUGH else 0
            if small == 2 or gain <= 0:
                break
        return value

    def quieten(self, q: Array) -> Array:
        """The noise of voltage and load that suits the data best, from a grid: what is too large hides wrong data."""
        places = [self.problem.index(name) for name in ("s_v", "s_d", "s_T")]
        grid = [(v, v, T) for v in VOLTAGES for T in WALKS]
        Q = np.repeat(q[:, None], len(grid), axis=1)
        Q[places] = self.problem.guess[places, None] + np.log(np.array(grid).T)
        found = values(self.problem, Q, Stage())
        return np.asarray(Q[:, int(np.argmin(found))]) if np.any(np.isfinite(found)) else q

    def step(self, q: Array, free: list[int], stage: Stage) -> tuple[Array, float, float]:
        """The best of several steps of Levenberg; by how much it is better, and what it is."""
        self.tell("", min(self.done / self.of, 1.0))
        at = slope(self.problem, q, free, stage)
        if not np.isfinite(at.value):
            return q, 0.0, np.inf
        Q = np.repeat(q[:, None], len(DAMPING), axis=1)
        is_datum = np.array([self.problem.unknowns[k].datum is not None for k in free])
        for k, damping in enumerate(DAMPING):
            damped = at.information + damping * np.diag(np.diag(at.information))
            move = -np.linalg.solve(damped, at.gradient)
            largest = float(np.max(np.abs(move[is_datum]), initial=0.0))
            move *= min(1.0, LARGEST / largest) if largest else 1.0
            Q[free, k] += np.clip(move, -LARGEST_OTHER, LARGEST_OTHER)
        tried = values(self.problem, Q, stage)
        k = int(np.argmin(tried))
        if not tried[k] < at.value:
            return q, 0.0, at.value
        return Q[:, k], at.value - float(tried[k]), float(tried[k])


@np.errstate(all="ignore")  # a filter that diverges is one that no search takes
def search(problem: Problem, progress: Progress = lambda text, share: None) -> Found:
    """Find the search vector of the largest likelihood. Ctrl-C ends the search with the best so far.

    Parameters
    ----------
    problem : Problem
    progress : callable, optional

    Raises
    ------
    UserError
        No filter follows the recordings.
    KeyboardInterrupt
        Ctrl-C before there was anything to keep.
    """
    work, interrupted = _Search(problem, progress), False
    try:
        work.run()
    except KeyboardInterrupt:
        if not work.annealed:
            raise
        take_interrupt()
        interrupted = True
    best = work.so_far()
    if best is None:
        raise UserError("the likelihood of these recordings is no number from any start; are u in V and i in A?")
    value, q, problem = best
    free = list(range(len(problem.unknowns)))
    return Found(problem, q, free, slope(problem, q, free, Stage()), tuple(work.ends or [value]), interrupted)
