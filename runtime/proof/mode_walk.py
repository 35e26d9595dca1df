"""What the modes are proved on: a supervisor and a filter in many lanes, led about and set where it matters.

Inputs are drawn about the limits that the statement by hand knows (:mod:`runtime.proof.mode_numbers`), to the last bit,
and beyond all limits. In some lanes memory is set to what it may be: so that counts are where they end, without the
thousands of interrupts before.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.proof import mode_numbers as numbers
from runtime.proof.mode_numbers import Numbers

Array = NDArray[Any]

#: Share of lanes in which memory is set before an interrupt, and of its numbers that are, each.
SET_LANES, SET_FIELDS = 0.4, 0.35
#: How often a mode is set, where not once.
WEIGHTS = {"ALIGNING": 3.0, "RESTING": 0.5, "FAULT": 0.5, "CATCHING": 2.0, "RUNNING": 3.0, "STARTING": 4.0}
#: How far from a limit: to either side by relative parts.
NEAR = (1e-9, -1e-9, 1e-3, -1e-3, 0.02, -0.02, 0.3, -0.3)
#: Status bits of a step and how likely each is: rejected, not converged, command, repaired, diverged, restarted.
STATUS = ((1, 0.3), (2, 0.1), (4, 0.1), (8, 0.1), (16, 0.2), (32, 0.06))


def in_lanes(value: Any, lanes: int) -> Any:
    """The same number, or struct of them, in many lanes.

    Parameters
    ----------
    value : number, tuple or SimpleNamespace
    lanes : int
    """
    if isinstance(value, SimpleNamespace):
        return SimpleNamespace(**{name: in_lanes(own, lanes) for name, own in vars(value).items()})
    if isinstance(value, tuple):
        return tuple(in_lanes(own, lanes) for own in value)
    return np.full(lanes, value)


def lane_of(value: Any, lane: int) -> Any:
    """One lane of what :func:`in_lanes` makes.

    Parameters
    ----------
    value : ndarray, tuple or SimpleNamespace
    lane : int
    """
    if isinstance(value, SimpleNamespace):
        return SimpleNamespace(**{name: lane_of(own, lane) for name, own in vars(value).items()})
    return tuple(own[lane] for own in value) if isinstance(value, tuple) else value[lane]


class Walk:
    """Lanes of a generated module's supervisor ``s`` and filter ``f``, and what they are given next.

    Parameters
    ----------
    module : ModuleType
        The generated module.
    numbers : Numbers
        By hand.
    lanes : int
    dtype : type
        np.float64 or np.float32.
    seed : int
        Seed of what is random.
    """

    def __init__(self, module: ModuleType, known: Numbers, lanes: int, dtype: Any, seed: int) -> None:
        self.module, self.known, self.lanes, self.dtype = module, known, lanes, dtype
        self.rng = np.random.default_rng(seed)
        self.s = in_lanes(module.new_supervisor(dtype), lanes)
        self.f = in_lanes(module.new_filter(dtype), lanes)
        for one in self.filters:
            self._tune(one)

    @property
    def filters(self) -> list[SimpleNamespace]:
        """The filter, and its rival where there is one."""
        return [self.f, self.s.rival] if hasattr(self.s, "rival") else [self.f]

    def _tune(self, one: SimpleNamespace) -> None:
        """No two filters are tuned alike, so that whatever is forgotten shows."""
        for name in ("Q", "R", "P_0", "u_max", "y_max", "nis_max", "nis_weight", "tolerance"):
            if hasattr(one, name):
                setattr(one, name, self._scaled(getattr(one, name)))
        x_0 = list(one.x_0)
        x_0[3] = self._real(self.rng.uniform(-3, 3, self.lanes))
        one.x_0 = tuple(x_0)

    def _scaled(self, value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(self._scaled(own) for own in value)
        return self._real(value * self.rng.uniform(0.5, 2.0, self.lanes))

    def _real(self, values: Any) -> Array:
        return np.asarray(values, dtype=self.dtype)

    # --- one interrupt

    def draw(self) -> tuple[Array, tuple[Array, Array], Array]:
        """Set memory and estimates; returns status, phase and reference of the next interrupt."""
        self._set_modes(self.rng.random(self.lanes) < SET_LANES)
        self._set_counts()
        self._set_estimates()
        self._set_turning()
        self._set_silent()
        phase = self._phase(), self._phase()
        self._set_readings(phase)
        if self.known.aligns:
            phase = self._set_alignment(phase)
        rng, speed = self.rng, self.known.speed
        status = np.sum([np.where(rng.random(self.lanes) < odds, bit, 0) for bit, odds in STATUS], axis=0)
        reference = rng.choice([-speed, speed, -1e-30, 0.0, -0.0, np.nan, np.inf, -np.inf], self.lanes)
        slowest = self.known.slowest * rng.choice([-1.0, 1.0, -numbers.STILL, numbers.STILL], self.lanes)
        near = slowest * (1 + rng.choice(NEAR, self.lanes))
        return status, phase, self._real(np.where(rng.random(self.lanes) < 0.3, near, reference))

    def _phase(self) -> Array:
        """Currents, A: mostly none, else about a limit, to the last bit, and what is no current."""
        rng, most = self.rng, self.known.most
        limit = most * rng.choice([numbers.ZERO, numbers.SHOWS, numbers.TRIP], self.lanes)
        edge = self._real(limit)
        beside = np.nextafter(edge, self.dtype(np.inf)), np.nextafter(edge, self.dtype(0))
        kinds = [
            rng.uniform(-1, 1, self.lanes) * numbers.ZERO * most,
            limit * rng.uniform(0.5, 2.0, self.lanes),
            edge,
            *beside,
            rng.choice([np.nan, np.inf, -np.inf, 1e30, 1e-30], self.lanes),
        ]
        chosen = rng.choice(len(kinds), self.lanes, p=(0.55, 0.25, 0.05, 0.05, 0.05, 0.05))
        return self._real(np.choose(chosen, kinds) * rng.choice([-1.0, 1.0], self.lanes))

    def _set_modes(self, where: Array) -> None:
        """Another mode, with what it allows, and seldom a number that is none; another reason."""
        rng, s, names = self.rng, self.s, self.module.MODES
        self.where = where
        modes = rng.choice([*range(len(names)), -1, len(names), 32767], self.lanes, p=_odds(names))
        moved = where & (rng.random(self.lanes) < 0.6)
        s.mode = np.where(moved, modes, s.mode)
        for name, on in (("runs", ("CATCHING", "STARTING", "RUNNING")),):
            told = np.isin(s.mode, [k for k, mode in enumerate(names) if mode in on])
            odd = rng.random(self.lanes) < 0.05
            setattr(s, name, np.where(moved, (told ^ odd).astype(np.int64), getattr(s, name)))
        s.reason = np.where(where, rng.choice(len(self.module.REASONS), self.lanes), s.reason)
        s.acknowledged = rng.choice([0, 1, 2], self.lanes, p=(0.6, 0.3, 0.1))

    def _set_counts(self) -> None:
        """Counts where they end, or one or two before, or anywhere; the time in a mode about what ends it there."""
        rng = self.rng
        for name, limit in self._ends().items():
            self._set(self.s, name, self._about(np.full(self.lanes, limit)))
        fine = self.where & (rng.random(self.lanes) < 0.4)
        for name in ("excess", "rejected", "windows", "open"):  # or most attempts would end here
            if hasattr(self.s, name):
                setattr(self.s, name, np.where(fine, 0, getattr(self.s, name)))
        since = np.zeros(self.lanes, np.int64)
        for mode, name in enumerate(self.module.MODES):
            since = np.where(self.s.mode == mode, rng.choice(self._times(name), self.lanes), since)
        keep = self.where & (rng.random(self.lanes) < 0.7)
        self.s.since = np.where(keep, self._about(since), self.s.since)

    def _about(self, end: Array) -> Array:
        """A count that ends there, or will by the next interrupt or the one after, or anywhere before."""
        kinds = [end, np.maximum(end - 1, 0), np.maximum(end - 2, 0), self.rng.integers(0, end + 1)]
        return np.choose(self.rng.choice(len(kinds), self.lanes), kinds)

    def _times(self, mode: str) -> list[int]:
        n = self.known
        ends = {
            "RESTING": [n.samples(numbers.RESTLESS)],
            "PROBING": [n.samples(numbers.PROBE)],
            "WAITING": [n.samples(numbers.WAIT), n.gap],
            "CATCHING": [n.samples(numbers.CATCH), n.samples(numbers.SETTLE), n.samples(numbers.SETTLE, 2)],
            "ALIGNING": [n.align] if n.aligns else [],
            "STARTING": [n.window, n.window, n.samples(numbers.LOCKED)],
            "RUNNING": [n.samples(numbers.LOCKED)],
        }
        return ends.get(mode, [numbers.MOST])

    def _ends(self) -> Mapping[str, int]:
        n = self.known
        ends = {
            "quiet": n.samples(numbers.REST),
            "rejected": n.samples(numbers.BLIND),
            "diverged": n.samples(numbers.ADRIFT),
            "content": n.samples(numbers.LOCKED),
            "excess": numbers.EXCESS,
            "open": n.samples(numbers.OPEN),
            "failures": n.attempts,
            "steady": round(numbers.STEADY / numbers.LOCKED),
            "windows": numbers.WINDOWS,
            "readings": numbers.READINGS,
            **({"calm": n.calm} if n.aligns else {}),
            **dict.fromkeys(("good", "side", "mirrored", "fresh", "anew"), 1),
        }
        return {name: limit for name, limit in ends.items() if hasattr(self.s, name)}

    def _set(self, struct: SimpleNamespace, name: str, value: Array, share: float = SET_FIELDS) -> None:
        """Set a number, or an array of them, in some of the lanes in which memory is set."""
        where = self.where & (self.rng.random(self.lanes) < share)
        before = getattr(struct, name)
        if isinstance(before, tuple):
            setattr(struct, name, tuple(np.where(where, self._real(v), b) for v, b in zip(value, before, strict=True)))
        else:
            setattr(struct, name, np.where(where, np.asarray(value, before.dtype), before))

    def _set_turning(self) -> None:
        """Angles turned and stated about the limits, as they will be once this interrupt's are added."""
        rng, lanes = self.rng, self.lanes
        turned = rng.choice([numbers.TURN, numbers.MOTION, 0.02, 1.7], lanes) * (1 + rng.choice(NEAR, lanes))
        turned = np.where(rng.random(lanes) < 0.3, 0.02, turned)
        jolt = rng.choice([numbers.CATCH_JOLT, numbers.RUN_JOLT, 0.0], lanes)
        # |turned - stated| = sqrt(stated^2 / 4 + jolt^2), of which one root is taken
        edge = (turned - np.sqrt(np.maximum(turned**2 - 0.75 * (turned**2 - jolt**2), 0.0))) / 0.75
        stated = np.choose(rng.choice(4, lanes, p=(0.4, 0.4, 0.1, 0.1)), [edge, turned, 0 * turned, 2 * turned])
        stated = stated * (1 + rng.choice(NEAR, lanes))
        sign, before = rng.choice([-1.0, 1.0], lanes), rng.uniform(-3, 3, lanes)
        still = rng.random(lanes) < 0.7
        for one in self.filters:
            x = list(one.x)
            x[2] = np.where(self.where & still, self.dtype(0), x[2])
            x[3] = np.where(self.where & still, self._real(before), x[3])
            one.x = tuple(x)
        values = [sign * turned, sign * stated, before]
        turning = [np.where(self.where, self._real(v), b) for v, b in zip(values, self.s.turning, strict=False)]
        off = turning[0] - turning[1]
        self.s.turning = (*turning, self._real(off * off - 0.25 * turning[1] * turning[1]), self.s.turning[4])

    def _set_silent(self) -> None:
        """Half a turn without a current in a phase, or nearly; most phases are never silent so long."""
        rng, shape = self.rng, (3, self.lanes)
        silent = numbers.SILENT_TURN * (1 + rng.choice(NEAR, shape)) * rng.choice([-1.0, 1.0], shape)
        self._set(self.s, "silent", np.where(rng.random(shape) < 0.4, silent, 0.0))

    def _set_readings(self, phase: tuple[Array, Array]) -> None:
        """The first current's direction: anywhere, or where the sine from there to this one's is about what tells."""
        rng, lanes = self.rng, self.lanes
        i_a, i_b = (np.where(np.abs(i) < 1e6, i, 0.0) for i in phase)
        now = np.arctan2((i_a + 2.0 * i_b) / np.sqrt(3), i_a)
        sine = numbers.TELLS * (1 + rng.choice(NEAR, lanes)) * rng.choice([-1.0, -0.3, 0.3, 1.0], lanes)
        near = now - np.arcsin(sine)
        angles = np.where(rng.random(lanes) < 0.7, near, rng.uniform(-np.pi, np.pi, lanes))
        self._set(self.s, "first", np.array([np.cos(angles), np.sin(angles)]), share=0.9)
        self._set(self.s, "reading", np.array([np.cos(now), np.sin(now), sine, angles]))
        self._set(self.s, "probe", np.array([np.sign(sine), rng.integers(0, 60, lanes)]))
        last = 1.0 - 1.0 / self.known.ease
        self._set(self.s, "eased", rng.choice([0.0, 0.5, last, 0.999 * last, 1.0], (1, lanes)))

    def _set_alignment(self, phase: tuple[Array, Array]) -> tuple[Array, Array]:
        """How far an alignment is, about where that ends; and currents that point along its axis, or nearly."""
        rng, n, lanes = self.rng, self.known, self.lanes
        step = n.T / n.align_turn
        ends = rng.choice([0.5, 1.0, 2.0], lanes) - step * rng.choice([0.0, 1.0, 2.5], lanes)
        self._set(self.s, "aligning", np.maximum(ends, 0.0)[None], share=0.9)
        progress = np.minimum(self.s.aligning[0] + step, 2.0)
        way = np.exp(1j * (np.asarray(self.f.x_0[3], float) + np.pi / 2 * np.minimum(2.0 - progress, 1.0)))
        near = numbers.ZERO * n.most * rng.choice([0.0, 0.5, 1.0], (2, lanes)) * (1 + rng.choice(NEAR, (2, lanes)))
        near = near * rng.choice([-1.0, 1.0], (2, lanes))
        i = (n.align_current * np.minimum(progress, 1.0) + near[0] + 1j * near[1]) * way
        along = (self.s.mode == self.module.MODES.index("ALIGNING")) & (rng.random(lanes) < 0.8)
        pair = i.real, -0.5 * i.real + np.sqrt(3) / 2 * i.imag
        return self._real(np.where(along, pair[0], phase[0])), self._real(np.where(along, pair[1], phase[1]))

    def _set_estimates(self) -> None:
        """State, covariance and score of either filter; the rival's score about the one that makes it better."""
        rng, known, scores = self.rng, self.known, []
        for one in self.filters:
            x = np.array(one.x, dtype=np.float64) if one is self.f else rng.uniform(-1, 1, (len(one.x), self.lanes))
            x[:2] = rng.uniform(-1, 1, (2, self.lanes)) * known.most
            x[2] = known.speed * rng.uniform(-1, 1, self.lanes)
            far = self.where & (rng.random(self.lanes) < 0.3)
            most = numbers.RUNAWAY_SPEED * known.speed * np.copysign(1 + rng.choice(NEAR, self.lanes), x[2])
            x[2] = np.where(far, most, x[2])
            x[2, rng.random(self.lanes) < 0.01] = np.nan
            x[3] = np.where(rng.random(self.lanes) < 0.5, self.s.turning[2] + known.p * known.T * x[2], x[3])
            x[3] = np.clip(np.nan_to_num(x[3]), -3.1, 3.1)
            if known.loaded:
                x[4] = rng.uniform(-1.2, 1.2, self.lanes) * known.torque
            one.x = tuple(self._real(row) for row in x)
            words = getattr(one, self.module.COVARIANCE)
            drawn = tuple(self._real(rng.uniform(0.0, 1.0, self.lanes)) for _ in words)
            setattr(one, self.module.COVARIANCE, drawn)
            one.u_held = tuple(self._real(rng.uniform(-9, 9, self.lanes)) for _ in range(2))
            one.iterations = rng.integers(0, 5, self.lanes)
            if hasattr(one, "nis"):
                one.nis = self._real(rng.uniform(0, 4, self.lanes))
            scores.append(numbers.LOAD * (x[4] / known.torque) ** 2 if known.loaded else np.zeros(self.lanes))
        if len(scores) == 2:
            less = numbers.BETTER * (1 + rng.choice(NEAR, self.lanes))
            wanted = self.f.nis + scores[0] - scores[1] - less
            self.s.rival.nis = self._real(np.where(rng.random(self.lanes) < 0.4, wanted, 9.0))

    def step(self, status: Array, phase: tuple[Array, Array], reference: Array) -> Array:
        """One interrupt of all lanes; returns which transition each took, 0 for none.

        Parameters
        ----------
        status, reference : ndarray, (lanes,)
        phase : tuple of ndarray, (lanes,)
        """
        math = self.module.MATH[np.dtype(self.dtype).name]
        with np.errstate(all="ignore"):
            return np.broadcast_to(self.module.supervise(self.s, self.f, status, phase, reference, math), (self.lanes,))


def _odds(names: tuple[str, ...]) -> Array:
    """Odds of the modes, more for those that may end in many ways, and of three numbers that are none."""
    odds = np.array([*(WEIGHTS.get(name, 1.0) for name in names), 0.1, 0.1, 0.1])
    return np.asarray(odds / odds.sum())
