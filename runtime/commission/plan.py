"""The plans of a commissioning, from facts that may be half or one and a half times the truth.

Electrical, at rest: the sensors' offsets with the gates off; then at three angles a third of a turn apart (each phase
carries the whole current once) three levels of regulated current, of which R and V_d follow, and square waves along and
across, on top of the largest level, of which L_d and L_q follow. All phase currents are so large there that their signs
stay: the dead time takes a constant voltage. Then, turning: a current vector that speeds up and slows down again
without load, of which J follows, with two currents between, of which psi_m follows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from runtime.commission.protocol import DRAIN, GATES_OFF, STIFF, Run, Segment
from runtime.design.facts import Facts

#: Levels of the current at rest, of the largest that may flow; the height of a square wave's current, of its level,
#: where the inductances are guessed and where they are known. A measured rotor is kept below a share of the current at
#: which it would leave its axis. Inductances that differ more than so often are doubted.
LEVELS = (0.2, 0.35, 0.5)
SQUARE, SQUARE_KNOWN = 0.2, 0.3
KEPT, STRONG = 0.7, 1.5
#: A square wave takes that share of the largest voltage at most, and its half that many samples.
SQUARE_VOLTAGE, HALVES = 0.3, (4, 6, 8, 12, 16)
#: Rows of a burst at most, and periods of the wave before it.
BURST, SETTLING_PERIODS = 320, 8
#: Angles at rest, a third of a turn apart.
ANGLES = 3
#: s: of the offsets, of a level's rows; a ramp of current at least, and a turn of the axis.
OFFSET_TIME, LEVEL_TIME, RAMP_TIME, TURN_TIME = 0.1, 0.12, 0.05, 0.3
#: While it turns: currents, of the largest that may flow, and of the current at which a strongly salient rotor leaves
#: its axis; their ratio; the sine of the angle by which a rotor that speeds up stays behind the current, and the
#: largest one, where it would not get to speed otherwise.
TURNING, OF_CRITICAL, SECOND, LAG, LARGEST_LAG = 0.35, 0.45, 0.75, 0.15, 0.35
#: Speed, of the rated one; the longest and the shortest ramp of it, s; how long it is held.
SPEED, SLOWEST, QUICKEST, HOLD = 0.4, 12.0, 0.15, 0.6
#: Of the smooth ramp in its middle: its slope. Sixths of a turn that a burst of rows sees at least.
STEEPEST, SIXTHS = 1.875, 12
#: Bandwidth of the current regulators at most, of a sample; the damping ratio that a swinging rotor is to have.
BANDWIDTH, DAMPING = 0.2, 0.3
#: What magnets hold a rotor at least, of their flux; a sign fades below that current at least, of the regulated one.
WEAKEST, FADE = 0.2, 0.02
#: s: a swing is given that long at most to die out.
LONGEST_SETTLING = 3.0


@dataclass(frozen=True)
class Limits:
    """What a plan keeps within: A of a phase, mechanical rad/s."""

    current: float
    speed: float


@dataclass(frozen=True)
class Bench:
    """What a plan is made for: facts as they are known by now, limits, samples of a row, rows that the board keeps.

    ``waves``: height of the square waves, of the usual one. ``seen``: R, inductances and dead time were measured
    already; ``known``: the other facts, too.
    """

    facts: Facts
    limits: Limits
    every: int
    rows: int
    waves: float = 1.0
    seen: bool = False
    known: bool = False

    def samples(self, seconds: float) -> int:
        """Samples of a time, one at least."""
        return max(1, round(seconds / self.facts.T))

    @property
    def critical(self) -> float:
        """The current at which a strongly salient rotor leaves the axis of the current, A."""
        f = self.facts
        return f.psi_m / (f.L_q - f.L_d) if f.L_q > f.L_d else math.inf

    @property
    def electrical_time(self) -> float:
        """The longer of the facts' L / R, s."""
        f = self.facts
        return max(f.L_d, f.L_q) / f.R

    def pull(self, current: float) -> float:
        """How a rotor is held on the axis of a current, as if by magnets alone of that flux, V s."""
        f = self.facts
        return max(WEAKEST * f.psi_m, f.psi_m + (f.L_d - f.L_q) * current)

    def swing(self, current: float) -> float:
        """Natural frequency of the rotor about a current vector, rad/s."""
        f = self.facts
        return math.sqrt(1.5 * f.p**2 * self.pull(current) * current / f.J)

    def damping(self, current: float, across: float) -> float:
        """Damping ratio of the rotor's swing behind a resistance across, ohm."""
        f = self.facts
        return 1.5 * (f.p * self.pull(current)) ** 2 / (2.0 * f.J * self.swing(current) * across)

    def gains(self, current: float, omega: float = 0.0) -> tuple[float, float, float, float]:
        """V/A and V/A a sample along the current, and across it, for speeds up to ``omega`` rad/s electrical.

        Along, the current is to be stiff. Across, the winding is to behave like a resistance: then a swinging rotor
        drives a current that takes its swing away. Only a slow integral keeps the mean at nothing. Where it turns, that
        resistance must not let the other axis drive much current.
        """
        f, swing = self.facts, self.swing(current)
        L = min(f.L_d, f.L_q)
        along = min(BANDWIDTH / f.T, max(3.0 * swing, 10.0 * f.R / L, 3.0 * omega))
        wanted = self.damping(current, 1.0) / DAMPING
        if omega:
            wanted = max(wanted, 0.5 * omega * L)
        across = max(f.R, min(wanted, along * L))
        return along * L, along * f.R * f.T, across - f.R, across * swing * f.T / 3.0

    def run(self, name: str, segments: list[Segment], current: float, omega: float = 0.0) -> Run:
        """A plan with the limits and the controller, for currents of about that size and speeds up to that.

        Signs of currents fade below their ripple at full speed.
        """
        f = self.facts
        link = (0.5 * f.dc_link, 1.25 * f.dc_link)
        lost = f.dc_link * f.dead_time / f.T if self.seen else 0.0
        fade = max(FADE * current, omega * f.psi_m * f.T / (8.0 * min(f.L_d, f.L_q)))
        gains = self.gains(current, omega)
        return Run(name, tuple(segments), self.limits.current, link, gains, f.psi_m, f.L_d, lost, fade)


def at_rest(bench: Bench) -> Run:
    """Offsets, levels of current, square waves.

    Parameters
    ----------
    bench : Bench
    """
    top = min(LEVELS[-1] * bench.limits.current, KEPT * bench.critical if bench.known else math.inf)
    levels = [share / LEVELS[-1] * top for share in LEVELS]
    swing = bench.swing(levels[0])
    turning = bench.samples(max(TURN_TIME, 20.0 / swing))
    segments = [_offset(bench), Segment("align", turning, levels[1], ramp=max(1, turning // 2), flags=STIFF)]
    for place in range(ANGLES):
        segments += _one_angle(bench, place, levels, turning)
        if not bench.known and place == 0:
            segments += [replace(s, what=f"low {s.what}") for s in _waves(bench, levels[0], place)]
            segments.append(Segment("drain", 1, levels[0], flags=DRAIN))
    segments.append(_down(bench))
    return bench.run("at rest", segments, levels[-1])


def _offset(bench: Bench) -> Segment:
    return Segment("offset", bench.samples(OFFSET_TIME), 0.0, every=bench.every, flags=GATES_OFF)


def _down(bench: Bench) -> Segment:
    ramp = bench.samples(RAMP_TIME)
    return Segment("down", ramp, 0.0, ramp=ramp, flags=DRAIN)


def _one_angle(bench: Bench, place: int, levels: list[float], turning: int) -> list[Segment]:
    ramp = bench.samples(RAMP_TIME)
    settle = bench.samples(max(RAMP_TIME, 6.0 * bench.electrical_time))
    shown = bench.samples(LEVEL_TIME)
    rows: dict[str, Any] = {"every": bench.every, "place": place}
    ratio = bench.damping(levels[0], bench.gains(levels[-1])[2] + bench.facts.R)
    calm = bench.samples(min(LONGEST_SETTLING, 4.0 / (min(ratio, 1.0) * bench.swing(levels[0]))))
    segments = [
        Segment("turn", turning, levels[0], ramp=turning, turn=2.0 * math.pi / ANGLES, flags=STIFF),
        Segment("level 0", calm + settle + shown, levels[0], **rows),
    ]
    for index, level in enumerate(levels[1:], 1):
        segments.append(Segment(f"level {index}", ramp + settle + shown, level, ramp=ramp, **rows))
    segments += _waves(bench, levels[-1], place)
    segments.append(Segment("drain", ramp, levels[0], ramp=ramp, flags=DRAIN))
    return segments


def _waves(bench: Bench, level: float, place: int) -> list[Segment]:
    """Square waves along, then across.

    Their rows fit into the board's memory together: nothing may come between them that lets a rotor leave its axis to
    the other side. Where it is known to keep its axis each may fill the memory.
    """
    segments: list[Segment] = []
    for word in ("along", "across"):
        half, volts = square_wave(bench, word, level)
        waves: dict[str, Any] = {word: volts, "half": half}
        rows = min(BURST, bench.rows - 2) // (1 if bench.known else 2)
        if bench.known and segments:
            segments.append(Segment("drain", 1, level, flags=DRAIN))
        segments.append(Segment("waves", 2 * half * SETTLING_PERIODS, level, **waves))
        segments.append(Segment(word, rows // (2 * half) * 2 * half, level, **waves, every=1, place=place))
    return segments


def square_wave(bench: Bench, word: str, level: float) -> tuple[int, float]:
    """Samples of half a wave, and its height in V.

    Where the facts say a strongly salient rotor, both waves are sized for the smaller inductance: nobody knows yet how
    it stands.

    Parameters
    ----------
    bench : Bench
    word : str
        "along" or "across".
    level : float
        The current that it is on top of, A.
    """
    f = bench.facts
    L, most = (f.L_d if word == "along" else f.L_q), SQUARE_VOLTAGE * f.voltage
    L = min(L, STRONG * min(f.L_d, f.L_q)) if not bench.known else L
    height = bench.waves * (SQUARE_KNOWN if bench.known else SQUARE) * level
    wanted = 2.0 * L * height / f.T
    half = next((half for half in HALVES if wanted / half <= most), HALVES[-1])
    return half, min(wanted / half, most)


def turning_current(bench: Bench) -> float:
    """The larger of the two currents while the rotor turns, A.

    Parameters
    ----------
    bench : Bench
    """
    return min(TURNING * bench.limits.current, OF_CRITICAL * bench.critical)


def turning(bench: Bench, lag: float = LAG) -> Run:
    """Up, two currents, down; then the same the other way round.

    Parameters
    ----------
    bench : Bench
    lag : float, optional
        Sine of the angle by which the rotor stays behind at the steepest.
    """
    f, current = bench.facts, turning_current(bench)
    second = SECOND * current
    pulled = 1.5 * f.p * bench.pull(current) * current / f.J / STEEPEST
    speed = min(SPEED * f.speed, bench.limits.speed)
    if bench.known and speed > SLOWEST * lag * pulled:
        lag = min(LARGEST_LAG, speed / (SLOWEST * pulled))
    acceleration = lag * pulled
    speed = min(speed, SLOWEST * acceleration)
    ramp = bench.samples(max(QUICKEST, speed / acceleration))
    swing = bench.swing(second)
    change = bench.samples(max(RAMP_TIME, 20.0 / swing))
    hold = bench.samples(HOLD) + change
    align = bench.samples(max(TURN_TIME, 20.0 / swing))
    segments = [_offset(bench), Segment("align", align, current, ramp=max(1, align // 2))]
    segments.append(Segment("turn", 2 * align, current, ramp=align, turn=2.0 * math.pi / 3))
    for place, sign in enumerate((1.0, -1.0)):
        omega = sign * f.p * speed
        rows: dict[str, Any] = {"every": bench.every, "place": place}
        fine: dict[str, Any] = {"every": fine_rows(bench, omega), "place": place}
        burst = fine["every"] * min(BURST, bench.rows - 2)
        segments.append(Segment("up", ramp, current, ramp=ramp, speed=omega, **rows))
        segments.append(Segment("hold 0", hold, current, speed=omega, **rows))
        segments.append(Segment("burst 0", burst, current, speed=omega, **fine))
        segments.append(Segment("drain", 1, current, speed=omega, flags=DRAIN))
        segments.append(Segment("hold 1", hold, second, ramp=change, speed=omega, **rows))
        segments.append(Segment("burst 1", burst, second, speed=omega, **fine))
        segments.append(Segment("drain", change, current, ramp=change, speed=omega, flags=DRAIN))
        segments.append(Segment("down", ramp, current, ramp=ramp, speed=0.0, **rows))
        segments.append(Segment("rest", change, current, **rows))
    segments.append(_down(bench))
    return bench.run("turning", segments, second, f.p * speed)


def fine_rows(bench: Bench, omega: float) -> int:
    """Samples of a row so that a burst of them sees a whole number of times what an inverter does six times a turn.

    Parameters
    ----------
    bench : Bench
    omega : float
        rad/s, electrical.
    """
    return max(1, math.ceil(SIXTHS * math.pi / 3.0 / (abs(omega) * bench.facts.T * BURST)))
