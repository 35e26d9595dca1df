"""The plans of a commissioning, from facts that may be half or one and a half times the truth.

Electrical, at rest: the sensors' offsets with the gates off; then at three angles a third of a turn apart (each phase
carries the whole current once) three levels of regulated current, of which R and V_d follow, and square waves along and
across, on top of the largest level, of which L_d and L_q follow. All phase currents are so large there that their signs
stay: the dead time takes a constant voltage. Then, turning: a current vector that speeds up and slows down again
without load, of which J follows, with two currents between, of which psi_m follows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from runtime.commission.protocol import DRAIN, GATES_OFF, Run, Segment
from runtime.design.facts import Facts

#: Levels of the current at rest, of the largest that may flow; the height of a square wave's current.
LEVELS = (0.2, 0.35, 0.5)
SQUARE = 0.08
#: A square wave takes that share of the largest voltage at most, and its half that many samples.
SQUARE_VOLTAGE, HALVES = 0.3, (4, 6, 8, 12, 16)
#: Rows of a burst at most, and periods of the wave before it.
BURST, SETTLING_PERIODS = 320, 8
#: Angles at rest, a third of a turn apart.
ANGLES = 3
#: s: of the offsets, of a level's rows; a ramp of current at least, and a turn of the axis.
OFFSET_TIME, LEVEL_TIME, RAMP_TIME, TURN_TIME = 0.1, 0.12, 0.05, 0.3
#: While it turns: currents, of the largest that may flow, and of the current at which a strongly salient rotor leaves
#: its axis; their ratio; the sine of the angle by which a rotor that speeds up stays behind the current.
TURNING, OF_CRITICAL, SECOND, LAG = 0.35, 0.4, 0.6, 0.15
#: Speed, of the rated one; the longest and the shortest ramp of it, s; how long it is held.
SPEED, SLOWEST, QUICKEST, HOLD = 0.4, 6.0, 0.3, 0.4
#: Of the smooth ramp in its middle: its slope. Sixths of a turn that a burst of rows sees at least.
STEEPEST, SIXTHS = 1.875, 12
#: Bandwidth of the current regulators at most, of a sample.
BANDWIDTH = 0.1


@dataclass(frozen=True)
class Limits:
    """What a plan keeps within: A of a phase, mechanical rad/s."""

    current: float
    speed: float


@dataclass(frozen=True)
class Bench:
    """What a plan is made for: facts as they are known by now, limits, samples of a row, rows that the board keeps."""

    facts: Facts
    limits: Limits
    every: int
    rows: int

    def samples(self, seconds: float) -> int:
        """Samples of a time, one at least."""
        return max(1, round(seconds / self.facts.T))

    @property
    def electrical_time(self) -> float:
        """The longer of the facts' L / R, s."""
        f = self.facts
        return max(f.L_d, f.L_q) / f.R

    def swing(self, current: float) -> float:
        """Natural frequency of the rotor about a current vector, rad/s."""
        f = self.facts
        return math.sqrt(1.5 * f.p**2 * f.psi_m * current / f.J)

    def controller(self, current: float) -> tuple[float, float, float]:
        """k_p V/A, k_i V/A a sample, and the flux V s of the voltage across.

        So slow that a swinging rotor drives a current, which takes its swing away.
        """
        f = self.facts
        L = min(f.L_d, f.L_q)
        bandwidth = min(BANDWIDTH / f.T, max(3.0 * self.swing(current), 3.0 * f.R / L))
        return bandwidth * L, bandwidth * f.R * f.T, f.psi_m

    def run(self, name: str, segments: list[Segment], current: float) -> Run:
        """A plan with the limits and the controller."""
        link = (0.5 * self.facts.dc_link, 1.25 * self.facts.dc_link)
        return Run(name, tuple(segments), self.limits.current, link, *self.controller(current))


def at_rest(bench: Bench) -> Run:
    """Offsets, levels of current, square waves.

    Parameters
    ----------
    bench : Bench
    """
    levels = [share * bench.limits.current for share in LEVELS]
    swing = bench.swing(levels[0])
    turning = bench.samples(max(TURN_TIME, 20.0 / swing))
    segments = [_offset(bench), Segment("align", turning, levels[1], ramp=max(1, turning // 2))]
    for place in range(ANGLES):
        segments += _one_angle(bench, place, levels, turning)
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
    rows = {"every": bench.every, "place": place}
    segments = [
        Segment("level 0", turning + settle + shown, levels[0], ramp=turning, turn=2.0 * math.pi / ANGLES, **rows)
    ]
    for index, level in enumerate(levels[1:], 1):
        segments.append(Segment(f"level {index}", ramp + settle + shown, level, ramp=ramp, **rows))
    for word in ("along", "across"):
        half, volts = square_wave(bench, word)
        waves = {word: volts, "half": half}
        before = 2 * half * max(SETTLING_PERIODS, math.ceil((ramp + settle) / (2 * half)) if word == "across" else 0)
        count = 2 * half * min((bench.rows - 2) // (2 * half), BURST // (2 * half))
        segments.append(Segment("waves", before, levels[-1], ramp=min(ramp, before), **waves))
        segments.append(Segment(word, count, levels[-1], **waves, every=1, place=place))
        segments.append(Segment("drain", ramp, levels[0], ramp=ramp, flags=DRAIN))
    return segments


def square_wave(bench: Bench, word: str) -> tuple[int, float]:
    """Samples of half a wave, and its height in V.

    Parameters
    ----------
    bench : Bench
    word : str
        "along" or "across".
    """
    f = bench.facts
    L, most = (f.L_d if word == "along" else f.L_q), SQUARE_VOLTAGE * f.voltage
    wanted = 2.0 * L * SQUARE * bench.limits.current / f.T
    half = next((half for half in HALVES if wanted / half <= most), HALVES[-1])
    return half, min(wanted / half, most)


def turning_current(bench: Bench) -> float:
    """The larger of the two currents while the rotor turns, A.

    Parameters
    ----------
    bench : Bench
    """
    f = bench.facts
    critical = f.psi_m / abs(f.L_q - f.L_d) if f.L_q != f.L_d else math.inf
    return min(TURNING * bench.limits.current, OF_CRITICAL * critical)


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
    acceleration = lag * 1.5 * f.p * f.psi_m * current / f.J / STEEPEST
    speed = min(SPEED * f.speed, bench.limits.speed, SLOWEST * acceleration)
    ramp = bench.samples(max(QUICKEST, speed / acceleration))
    swing = bench.swing(second)
    change = bench.samples(max(RAMP_TIME, 20.0 / swing))
    hold = bench.samples(HOLD) + change
    align = bench.samples(max(TURN_TIME, 20.0 / swing))
    segments = [_offset(bench), Segment("align", align, current, ramp=max(1, align // 2))]
    segments.append(Segment("turn", 2 * align, current, ramp=align, turn=2.0 * math.pi / 3))
    for place, sign in enumerate((1.0, -1.0)):
        omega = sign * f.p * speed
        rows: dict[str, int] = {"every": bench.every, "place": place}
        fine = {"every": fine_rows(bench, omega), "place": place}
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
    return bench.run("turning", segments, current)


def fine_rows(bench: Bench, omega: float) -> int:
    """Samples of a row so that a burst of them sees a whole number of times what an inverter does six times a turn.

    Parameters
    ----------
    bench : Bench
    omega : float
        rad/s, electrical.
    """
    return max(1, math.ceil(SIXTHS * math.pi / 3.0 / (abs(omega) * bench.facts.T * BURST)))
