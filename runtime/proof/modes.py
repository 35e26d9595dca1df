"""The drive's modes by hand, in plain branches: what decides about the inverter. Imports nothing it is to check.

Written from what the header says of the modes, not from the table. Times are seconds until they are compared, currents
are magnitudes and phasors, angles come from an arc tangent. Modes and reasons are known by their names alone.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from copy import deepcopy

from runtime.proof.align import turn_axis
from runtime.proof.control import clarke
from runtime.proof.mode_memory import CARRIES, EVENTS, Filter, Memory, Said
from runtime.proof.mode_numbers import (
    ADRIFT,
    BETTER,
    BLIND,
    CATCH,
    CATCH_JOLT,
    EXCESS,
    FORGOTTEN,
    GOOD,
    HELD,
    LOAD,
    LOCKED,
    MIRROR_SPEED,
    MOST,
    MOTION,
    OPEN,
    PROBE,
    READ_ANGLE,
    READ_SPEED,
    READINGS,
    REST,
    RESTLESS,
    RUN_JOLT,
    RUNAWAY_SPEED,
    SETTLE,
    SHOWS,
    SILENT_TURN,
    START_ANGLE,
    STEADY,
    STILL,
    TELLS,
    TRIP,
    TURN,
    WAIT,
    WINDOWS,
    ZERO,
    Numbers,
)

#: What is off, what lets the filter run, what lets it make torque.
OFF = ("RESTING", "WAITING", "FAULT")
RUNNING, TORQUE = ("CATCHING", "STARTING", "RUNNING"), ("STARTING", "RUNNING")


class Modes(Numbers):
    """One drive's modes."""

    @property
    def events(self) -> list[str]:
        """All that may happen, with the mode in which it does."""
        modes = [m for m in EVENTS if {"STARTING": self.two, "ALIGNING": self.aligns}.get(m, True)]
        return [f"{mode}: {event}" for mode in modes for event in EVENTS[mode]]

    def interrupt(self, m: Memory, f: Filter, said: Said, phase: Sequence[float], reference: float) -> str:
        """What happens in one interrupt, with the mode in which it does; empty: the drive goes on as it did.

        Parameters
        ----------
        m : Memory
        f : Filter
            Changed, as ``m`` is.
        said : Said
        phase : sequence of float
            i_a, i_b, A.
        reference : float
            Speed, rad/s.
        """
        self._wanted = abs(reference) > STILL * self.slowest
        self._count(m, f, said, phase, reference)
        m.whole["fresh"] = m.whole["anew"] = 0
        where, branch = m.mode, getattr(self, f"_{m.mode.lower()}", None)
        event = branch(m, f, said, phase) if branch else self._go(m, "RESTING")  # a mode that is none
        for name, modes in (
            ("runs", RUNNING),
            ("torque", TORQUE),
            ("rivals", ("STARTING",)),
            ("aligns", ("ALIGNING",)),
        ):
            if name in m.whole:
                m.whole[name] = int(m.mode in modes)
        m.whole["inverter"] = int(m.mode not in OFF)
        return f"{where}: {event}" if event else ""

    def allowed_current(self, mode: str, eased: float) -> float:
        """The largest current that the controller may ask for, A.

        Parameters
        ----------
        mode : str
        eased : float
            Share of it that is there again after a rotor was caught.
        """
        return {"RUNNING": eased * self.most, "STARTING": self.share * self.most}.get(mode, 0.0)

    def _inside(self, phase: Sequence[float], share: float) -> bool:
        """Both currents are numbers within a share of the largest."""
        return bool(all(abs(i) <= share * self.most for i in phase))

    @staticmethod
    def _row(m: Memory, name: str, another: bool, most: int) -> None:
        """One more in a row, which ends otherwise."""
        before = m.whole[name]
        m.whole[name] = (before + 1 if before < most else before) if another else 0

    def _count(self, m: Memory, f: Filter, said: Said, phase: Sequence[float], reference: float) -> None:
        n = m.whole
        n["since"] += n["since"] < MOST
        zero_voltage = m.arrays["probe"][1] + 1.0 if m.mode == "PROBING" else 0.0
        pointing = reference if m.rival is None or self._wanted else m.arrays["probe"][0]
        m.arrays["probe"] = [-1.0 if pointing < 0 else 1.0, zero_voltage]
        if m.rival is not None:  # a start turns fast enough to be judged; what is no number stays
            least = math.copysign(self.slowest, m.arrays["probe"][0])
            m.arrays["asked"] = [least if abs(reference) < self.slowest else reference]
        if m.mode == "WAITING":  # the rotor turns on
            omega, theta = m.arrays["guess"][2:]
            m.arrays["guess"][3] = math.remainder(theta + self.p * omega * self.T, 2 * math.pi)
        share = 1.0 / self.ease
        eased = {"CATCHING": share, "RUNNING": m.arrays["eased"][0] + share}.get(m.mode, 1.0)
        m.arrays["eased"] = [eased if eased <= 1.0 else 1.0]
        if self.aligns:
            self._row(m, "calm", turn_axis(self, m, f.x_0[3], phase), self.calm)
        self._row(m, "quiet", m.mode == "RESTING" and self._inside(phase, ZERO), self.samples(REST))
        if m.mode != "FAULT":
            n["acknowledged"] = 0
        self._row(m, "excess", any(abs(i) > TRIP * self.most for i in phase), EXCESS)
        if n["runs"] != 1:
            return
        self._row(m, "rejected", said.rejected, self.samples(BLIND))
        self._row(m, "diverged", said.diverged, self.samples(ADRIFT))
        good = not (said.rejected or said.diverged or said.restarted)
        self._row(m, "content", good, self.samples(LOCKED))
        turned, stated, before = m.arrays["turning"][:3]
        omega, theta = f.x[2], f.x[3]
        now = self.p * omega * self.T
        turned, stated = turned + math.remainder(theta - before, 2 * math.pi), stated + now
        off, half = turned - stated, stated / 2
        m.arrays["turning"] = [turned, stated, theta, (off - half) * (off + half), now]
        i_a, i_b = phase
        if not abs(omega) > self.slowest:
            pass  # at rest a speed may be R's voltage
        elif any(abs(i) > SHOWS * self.most for i in phase):
            turns = zip((i_a, i_b, -i_a - i_b), m.arrays["silent"], strict=True)
            m.arrays["silent"] = [0.0 if abs(i) > ZERO * self.most else turn + now for i, turn in turns]
        else:  # no current anywhere tells the less, the farther the rotor turns
            m.arrays["silent"] = [s - now * FORGOTTEN if s * now > 0 else s for s in m.arrays["silent"]]
        self._row(m, "open", any(abs(turn) >= SILENT_TURN for turn in m.arrays["silent"]), self.samples(OPEN))

    @staticmethod
    def _as_stated(m: Memory, jolt: float) -> bool:
        """The angle turned as the speed says, but for half of that and a jolt."""
        turned, stated = m.arrays["turning"][:2]
        return bool(abs(turned - stated) <= math.hypot(stated / 2, jolt))

    @staticmethod
    def _go(m: Memory, mode: str) -> str:
        m.mode, m.whole["since"] = mode, 0
        return ""

    def _lost(self, m: Memory, reason: str) -> str:
        """The rotor is given up: the inverter goes off, and one more attempt has failed."""
        m.whole["failures"] = min(m.whole["failures"] + 1, self.attempts)
        m.reason = reason
        self._go(m, "RESTING")
        return f"lost, {reason}"

    @staticmethod
    def _window(m: Memory, f: Filter) -> None:
        m.arrays["turning"][:3] = [0.0, 0.0, f.x[3]]

    @staticmethod
    def _regulators_anew(m: Memory) -> None:
        for name in ("rejected", "diverged", "content"):
            m.whole[name] = 0
        m.whole["anew"] = 1

    def _resting(self, m: Memory, f: Filter, said: Said, phase: Sequence[float]) -> str:
        if m.whole["failures"] >= self.attempts:
            self._go(m, "FAULT")
            return "gave up"
        if m.whole["quiet"] < self.samples(REST):
            if m.whole["since"] < self.samples(RESTLESS):
                return ""
            m.reason = "CURRENT"
            self._go(m, "FAULT")
            return "restless"
        m.whole["readings"] = 0
        self._go(m, "PROBING")
        return "no current"

    def _probing(self, m: Memory, f: Filter, said: Said, phase: Sequence[float]) -> str:
        if not self._inside(phase, TRIP):
            return self._lost(m, "CURRENT")
        if self._inside(phase, SHOWS):
            if m.whole["since"] < self.samples(PROBE) or (m.rival is not None and not self._wanted):
                return ""
            m.whole["fresh"] = 1
            self._stands(m, f)
            self._regulators_anew(m)
            self._window(m, f)
            return "stands"
        i = clarke(phase)  # type: ignore[arg-type]
        first, way = complex(*m.arrays["first"]), i / abs(i)
        m.arrays["reading"] = [way.real, way.imag, abs(i), (first.conjugate() * way).imag]
        if not m.whole["readings"]:
            m.arrays["first"], m.whole["readings"] = [way.real, way.imag], 1
            self._go(m, "WAITING")
            return "turns"
        sine = m.arrays["reading"][3]
        tells = abs(sine) > TELLS
        direction = math.copysign(1.0, sine) if tells else m.arrays["probe"][0]
        # i = -(t / L_q) e, and e = j omega_e psi_m exp(j theta)
        theta = cmath.phase(direction * 1j * i)
        seconds = max(m.arrays["probe"][1], 1.0) * self.T
        e = abs(i) * self.motor["inductance_q"] / seconds  # V
        m.arrays["probe"][0] = direction
        m.whole["mirrored"] = int(tells)  # what the current tells is not turned round
        m.whole["readings"] = READINGS if tells else min(m.whole["readings"] + 1, READINGS)
        m.arrays["guess"][2:] = direction * e / (self.motor["magnet_flux"] * self.p), theta
        m.arrays["spread"] = [(READ_SPEED * self.speed) ** 2, READ_ANGLE]
        self._go(m, "WAITING")
        return "turned"

    def _stands(self, m: Memory, f: Filter) -> None:
        """Torque for a rotor that stands: with a rival where the angle is unknown, else as the drive file says."""
        if self.aligns:
            self._go(m, "ALIGNING")
            return
        if m.rival is None:
            f.begin()
            m.whole["steady"] = 0
            self._go(m, "RUNNING")
            return
        theta, spread = f.x_0[3], (self.unseen**2, START_ANGLE)
        self._begin(m, f, (0.0, theta), spread)
        m.rival = deepcopy(f)
        self._begin(m, m.rival, (0.0, theta + math.pi), spread)
        m.whole["windows"] = m.whole["good"] = 0
        self._go(m, "STARTING")

    def _begin(self, m: Memory, f: Filter, rotor: tuple[float, float], spread: tuple[float, float]) -> None:
        """A filter at speed and angle of a rotor, with their variances."""
        f.begin(rotor)
        f.variances[2:4] = spread
        if self.flux:
            f.variances[0] = f.variances[1] = spread[1] * self.motor["magnet_flux"] ** 2
        for k in self.slow:
            f.variances[k] = HELD * f.P_0[k]
        m.arrays["guess"], m.arrays["spread"] = [CARRIES, CARRIES, *rotor], list(spread)

    def _waiting(self, m: Memory, f: Filter, said: Said, phase: Sequence[float]) -> str:
        none, n = self._inside(phase, ZERO), m.whole
        last = n["readings"] >= READINGS
        if none and last:
            speed, angle = m.arrays["spread"]
            self._begin(m, f, tuple(m.arrays["guess"][2:]), (speed, angle))
            n["fresh"] = 1
            self._regulators_anew(m)
            self._go(m, "CATCHING")
            return "begins there"
        if none and n["since"] >= self.gap and not last:
            self._go(m, "PROBING")
            return "died out"
        return self._lost(m, "CURRENT") if m.whole["since"] >= self.samples(WAIT) else ""

    def _torque(self, m: Memory, f: Filter) -> str:
        """Torque is allowed, and slow states are learnt."""
        for k in self.slow:
            f.variances[k] = f.P_0[k]
        m.whole["steady"] = 0
        self._window(m, f)
        self._go(m, "RUNNING")
        return "found"

    def _catching(self, m: Memory, f: Filter, said: Said, phase: Sequence[float]) -> str:
        n = m.whole
        if n["excess"] >= EXCESS:
            return self._lost(m, "CURRENT")
        if n["since"] == self.samples(SETTLE):
            self._window(m, f)
            return "settled"
        if n["since"] >= self.samples(SETTLE, 2):
            as_stated = self._as_stated(m, CATCH_JOLT)
            if not as_stated and not n["mirrored"]:
                n["mirrored"] = 1
                rotor = -f.x[2], f.x[3] + math.pi
                self._begin(m, f, rotor, ((READ_SPEED * self.speed) ** 2, READ_ANGLE))
                self._regulators_anew(m)
                self._go(m, "CATCHING")
                return "turned round"
            if as_stated and n["content"] >= self.samples(LOCKED):
                return self._torque(m, f)
        return self._lost(m, "NOT_CAUGHT") if n["since"] >= self.samples(CATCH) else ""

    def _aligning(self, m: Memory, f: Filter, said: Said, phase: Sequence[float]) -> str:
        if not self._inside(phase, TRIP):
            return self._lost(m, "CURRENT")
        if m.whole["calm"] < self.calm:
            return self._lost(m, "NOT_ALIGNED") if m.whole["since"] >= self.align else ""
        self._begin(m, f, (0.0, f.x_0[3]), (self.unseen**2, START_ANGLE))
        self._torque(m, f)
        self._regulators_anew(m)
        return "aligned"

    def _score(self, f: Filter) -> float:
        return f.nis + (LOAD * (f.x[4] / self.torque) ** 2 if self.loaded else 0.0)

    def _starting(self, m: Memory, f: Filter, said: Said, phase: Sequence[float]) -> str:
        n, rival = m.whole, m.rival
        assert rival is not None
        for blame, lost in (
            ("CURRENT", n["excess"] >= EXCESS),
            ("BLIND", n["rejected"] >= self.samples(BLIND)),
            ("RESTARTED", said.restarted),
            ("NOT_STARTED", n["windows"] >= WINDOWS),
        ):
            if lost:
                return self._lost(m, blame)
        if self._score(f) > self._score(rival) + BETTER and n["since"] >= self.samples(LOCKED):
            own, theirs = deepcopy(f), deepcopy(rival)
            f.__dict__.update(theirs.__dict__)
            rival.__dict__.update(own.__dict__)
            n["good"], n["windows"] = 0, n["windows"] + 1
            self._regulators_anew(m)
            self._window(m, f)
            self._go(m, "STARTING")
            return "rival is better"
        turned = abs(m.arrays["turning"][0])
        far = turned >= TURN
        if not far and n["since"] < self.window:
            return ""
        stated = turned >= MOTION and self._as_stated(m, 0.0)
        if stated and n["good"] >= GOOD:
            return self._torque(m, f)
        n["good"] = n["good"] + 1 if stated else 0
        return self._next_window(m, f, stated, far)

    def _next_window(self, m: Memory, f: Filter, stated: bool, far: bool) -> str:
        """The rival begins half a turn from the filter, or a quarter where nothing turned."""
        n, omega, theta = m.whole, f.x[2], f.x[3]
        if stated or far:
            rotor, spread = (-omega, theta + math.pi), ((MIRROR_SPEED * self.speed) ** 2, START_ANGLE)
        else:
            rotor, spread = (0.0, theta + (-0.5 if n["side"] else 0.5) * math.pi), (self.unseen**2, START_ANGLE)
            n["side"] = 1 - n["side"]
        m.rival = deepcopy(f)
        self._begin(m, m.rival, rotor, spread)
        f.nis, n["windows"] = 0.0, n["windows"] + 1
        self._window(m, f)
        self._go(m, "STARTING")
        return "as stated" if stated else "not as stated" if far else "nothing turned"

    def _running(self, m: Memory, f: Filter, said: Said, phase: Sequence[float]) -> str:
        n = m.whole
        over = n["since"] >= self.samples(LOCKED)
        if n["excess"] < EXCESS and n["open"] >= self.samples(OPEN):
            m.reason = "PHASE"
            self._go(m, "FAULT")
            return "open"
        for blame, lost in (
            ("CURRENT", n["excess"] >= EXCESS),
            ("BLIND", n["rejected"] >= self.samples(BLIND)),
            ("RUNAWAY", abs(f.x[2]) > RUNAWAY_SPEED * self.speed),
            ("DIVERGED", n["diverged"] >= self.samples(ADRIFT)),
            ("RESTARTED", said.restarted),
            ("SLIPPED", over and not self._as_stated(m, RUN_JOLT)),
        ):
            if lost:
                return self._lost(m, blame)
        if not over:
            return ""
        n["steady"] = min(n["steady"] + 1, int(STEADY / LOCKED + 0.5))
        if n["steady"] == int(STEADY / LOCKED + 0.5):
            n["failures"] = 0
        self._window(m, f)
        self._go(m, "RUNNING")
        return "steady"

    def _fault(self, m: Memory, f: Filter, said: Said, phase: Sequence[float]) -> str:
        if m.whole["acknowledged"] != 1 or m.reason == "SELF_TEST":
            return ""
        m.whole["failures"] = m.whole["open"] = 0
        m.reason, m.arrays["silent"] = "NONE", [0.0, 0.0, 0.0]
        self._go(m, "RESTING")
        return "acknowledged"
