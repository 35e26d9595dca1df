"""Standstill under load: what a drive holds where its rotor shows its angle at rest, and what is promised elsewhere.

A salient rotor is held: its angle stays known, whatever the load, with motor data that are off. A round one shows
nothing at rest: it may slip, but is caught again and again, so that it never turns fast, and it comes back as soon as
speed is wanted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.loop.injection import injected_voltage, ripple_scale
from model.rating import rating
from model.schema import Drive
from model.supervisor.limits import has_rival
from runtime.drive.scenario import LATE, REACHED, Scenario
from runtime.faults.loop import FaultyRun, FoundMotor
from runtime.faults.starts import START_RAMP, Attempt, Start, Task, draw_factors, judge_start
from runtime.faults.survey import ANGLE_BAND
from runtime.recorded.units import RPM

Array = NDArray[Any]

#: Share of the rated speed to which it goes at first; s and shares of the time to rated speed, the least time for that.
#: In such times: it goes back, is at rest, is loaded, is held, and is wanted to turn again.
SLOW_SHARE, RISE, RISE_SHARE = 0.2, 0.05, 0.3
FALLS, RESTS, LOADED, HELD, AGAIN = 5.0, 7.0, 8.0, 9.0, 24.0
#: How far R and inductances of a salient drive may be off.
RESISTANCE_SHARE, INDUCTANCE_SHARE = 0.2, 0.1
#: What is promised of a round rotor: the share of rated speed beyond which it does not turn while rest is wanted, and
#: the time from the end of the reference's rise, s, after which it turns as it should.
SLIP_SHARE, BACK_TIME = 1.0, 0.35
#: s: over so long the injected current is averaged.
RIPPLE_TIME = 0.02


@dataclass(frozen=True)
class Standstill(Scenario):
    """To a fifth of a speed, back to rest, there a load, and then to that speed; ``rise`` s: to the fifth."""

    rise: float = RISE

    def speed_reference(self, t: Array) -> Array:
        """Mechanical rad/s at the times t.

        Parameters
        ----------
        t : ndarray
            Time, s.
        """
        passed = t / self.rise
        slow = SLOW_SHARE * np.clip(np.minimum(passed, (RESTS - passed) / (RESTS - FALLS)), 0.0, 1.0)
        return np.asarray(self.speed / RPM * (slow + np.clip((t - self.again) / self.ramp, 0.0, 1.0)))

    def load_torque(self, t: Array) -> Array:
        """N m at the times t.

        Parameters
        ----------
        t : ndarray
            Time, s.
        """
        return np.asarray(self.load * np.clip((t - self.load_at) / self.rise, 0.0, 1.0))

    @property
    def again(self) -> float:
        """When it is wanted to turn again, s."""
        return AGAIN * self.rise


@dataclass(frozen=True)
class Hold(Attempt):
    """A standstill to master.

    ``held`` s: from when to when it is judged. ``speed`` rad/s: the rated one. ``current`` A: the ripple is a share of
    it. ``shown``: the rotor shows its angle at rest. ``rival``: there is a second filter, so that attempts do not fail
    in a row.
    """

    held: tuple[float, float] = (0.0, 0.0)
    speed: float = 0.0
    current: float = 0.0
    shown: bool = False
    rival: bool = True


def standstill(drive: Drive, rng: np.random.Generator) -> Hold:
    """Rest after motion, from any angle, under a load of either sign up to the rated torque.

    Parameters
    ----------
    drive : Drive
        The motor data of a salient one are off by what is stated here, those of others within its ``[tolerance]``.
    rng : numpy.random.Generator
    """
    task, m = rating(drive), drive.motor
    shown = injected_voltage(drive) > 0.0
    ramp = task.ramp(m.inertia, START_RAMP)
    rise = max(RISE, RISE_SHARE * ramp)
    scenario = Standstill(
        "standstill",
        float(rng.choice((-1.0, 1.0))) * task.speed * RPM,
        ramp,
        rng.uniform(-1.0, 1.0) * task.torque,
        load_at=LOADED * rise,
        duration=AGAIN * rise + ramp + BACK_TIME + LATE,
        rise=rise,
    )
    widths = {"R": RESISTANCE_SHARE, "L_d": INDUCTANCE_SHARE, "L_q": INDUCTANCE_SHARE}
    off = {letter: 1.0 + width * rng.uniform(-1.0, 1.0) for letter, width in widths.items()}
    return Hold(
        scenario,
        FoundMotor(rng.uniform(-np.pi, np.pi), 0.0, off if shown else draw_factors(drive, rng)),
        least=(1.0 - REACHED) * task.speed,
        since=scenario.again,
        held=(HELD * rise, scenario.again),
        speed=task.speed,
        current=ripple_scale(drive),
        shown=shown,
        rival=has_rival(drive),
    )


def judge_standstill(run: FaultyRun, attempt: Hold, max_current: float) -> Start:
    """How a standstill went; ``locked``: as promised, ``wrong_way``: largest speed while rest was wanted.

    Parameters
    ----------
    run : FaultyRun
    attempt : Hold
        What it was to master.
    max_current : float
        The drive's, A.
    """
    back = judge_start(run, attempt, max_current)
    held = (run.t >= attempt.held[0]) & (run.t < attempt.held[1])
    if attempt.shown:
        angle = float(np.max(np.abs(run.angle_error[held])))
        kept = bool(np.all(run.running[held]))
        good = back.locked and kept and angle < ANGLE_BAND
        ripple = injected_current(run.phase[held], round(RIPPLE_TIME / (run.t[1] - run.t[0]))) / attempt.current
        back = replace(back, kept=kept, angle=angle, ripple=ripple)
    else:
        on = held & (run.mode != run.mode[-1]) if run.gave_up else held
        good = float(np.max(np.abs(run.omega[on]), initial=0.0)) <= SLIP_SHARE * attempt.speed
        good &= back.locked or (bool(run.gave_up) and not attempt.rival)
        back = replace(back, angle=float("nan"))
        held = on
    fastest = float(np.max(np.abs(run.omega[held]), initial=0.0)) * RPM
    return replace(back, locked=good, time=back.time if good else float("nan"), wrong_way=fastest)


def injected_current(phase: Array, window: int) -> float:
    """Amplitude of the current that changes its sign every sample, A: the median over windows of a steady rotor.

    Parameters
    ----------
    phase : ndarray, (N, 2)
        Currents of phases a and b, A.
    window : int
        Samples that are averaged: sensor noise averages out, and so does any current that is slow.
    """
    window += window % 2
    alpha, beta = phase[:, 0].astype(float), (phase[:, 0] + 2.0 * phase[:, 1]) / np.sqrt(3.0)
    turned = (alpha + 1j * beta) * (-1.0) ** np.arange(len(phase))
    whole = turned[: len(turned) // window * window].reshape(-1, window)
    return float(np.median(np.abs(whole.mean(axis=1))))


STANDSTILL = Task("still", "standstill", standstill, told=True, judge=judge_standstill)
