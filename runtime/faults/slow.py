"""Slow starts: the drive is powered up long before motion is wanted, and then a crawl is wanted, not the rated speed.

Nothing tells the angle while nothing turns: the drive waits without a failure as long as no motion is asked for, turns
as fast as a start must, however little is asked for, and then crawls. Some references hesitate meanwhile: they go
back to zero, or to the other way, in the midst of the start. A salient rotor shows its angle at a crawl, too;
of a round one it is judged whether it turns as wanted once speed is wanted. Where there is no rival filter attempts
at a crawl may fail in a row, and end in FAULT with the reason said: firmware.md promises no more.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model.loop.injection import injected_voltage
from model.rating import rating
from model.schema import Drive
from model.supervisor.limits import has_rival
from runtime.drive.scenario import REACHED, Scenario
from runtime.faults.loop import FaultyRun, FoundMotor
from runtime.faults.standstill import BACK_TIME
from runtime.faults.starts import LOAD_SHARE, START_RAMP, Attempt, Start, Task, draw_factors, judge_start
from runtime.faults.survey import ANGLE_BAND
from runtime.recorded.units import RPM

Array = NDArray[np.float64]

#: s: no motion is asked for; a crawl is, of which the last part is judged; its reference rises in such a time.
WAIT, CRAWL, JUDGED, RISE = 0.15, 0.6, 0.2, 0.02
#: s: for so long a reference points as wanted, and then for so long it hesitates.
HESITATES = 0.005, 0.06
#: Shares of rated speed: the slowest crawl and the fastest.
SLOWEST, FASTEST = 0.002, 0.1


@dataclass(frozen=True)
class Crawl(Scenario):
    """Rest is wanted, then ``share`` of a speed, and in the end the speed.

    From ``WAIT + hesitates`` on ``meanwhile`` times the crawl is wanted, for another time ``hesitates``.
    """

    share: float = FASTEST
    meanwhile: float = 1.0
    hesitates: float = 0.0

    def speed_reference(self, t: Array) -> Array:
        """Mechanical rad/s at the times t.

        Parameters
        ----------
        t : ndarray
            Time, s.
        """
        crawl = self.share * np.clip((t - WAIT) / RISE, 0.0, 1.0)
        hesitant = (t >= WAIT + self.hesitates) & (t < WAIT + 2.0 * self.hesitates)
        crawl = np.where(hesitant, self.meanwhile, 1.0) * crawl
        rest = (1.0 - self.share) * np.clip((t - WAIT - CRAWL) / self.ramp, 0.0, 1.0)
        return np.asarray(self.speed / RPM * (crawl + rest))


@dataclass(frozen=True)
class Crawled(Attempt):
    """A crawl to master. ``shown``: the rotor shows its angle at a crawl. ``rival``: there is a second filter."""

    shown: bool = False
    rival: bool = True


def slow(drive: Drive, rng: np.random.Generator) -> Crawled:
    """A crawl after a wait, from rest at any angle, either way, against a load that comes when motion is wanted.

    A third of the references goes back to zero in the midst of the start, and a third turns round.

    Parameters
    ----------
    drive : Drive
    rng : numpy.random.Generator
    """
    task, sign = rating(drive), float(rng.choice((-1.0, 1.0)))
    ramp = task.ramp(drive.motor.inertia, START_RAMP)
    scenario = Crawl(
        "slow",
        sign * task.speed * RPM,
        ramp,
        sign * rng.uniform(0.0, LOAD_SHARE) * task.torque,
        load_at=WAIT,
        duration=WAIT + CRAWL + ramp + BACK_TIME,
        share=float(np.exp(rng.uniform(np.log(SLOWEST), np.log(FASTEST)))),
    )
    motor = FoundMotor(float(rng.uniform(-np.pi, np.pi)), 0.0, draw_factors(drive, rng))
    meanwhile, hesitates = float(rng.choice((1.0, 0.0, -1.0))), float(rng.uniform(*HESITATES))
    scenario = replace(scenario, meanwhile=meanwhile, hesitates=hesitates)
    least = (1.0 - REACHED) * task.speed
    shown, rival = injected_voltage(drive) > 0.0, has_rival(drive)
    return Crawled(scenario, motor, least=least, since=WAIT + CRAWL, shown=shown, rival=rival)


def judge_slow(run: FaultyRun, attempt: Crawled, max_current: float) -> Start:
    """How a crawl went: locked in the end and never in FAULT; where the rotor shows its angle locked at the crawl, too.

    Parameters
    ----------
    run : FaultyRun
    attempt : Crawled
        What it was to master.
    max_current : float
        The drive's, A.
    """
    found = judge_start(run, attempt, max_current)
    crawling = (run.t >= WAIT + CRAWL - JUDGED) & (run.t < WAIT + CRAWL)
    angle = float(np.max(np.abs(run.angle_error[crawling])))
    seen = bool(np.all(run.running[crawling])) and angle < ANGLE_BAND
    as_promised = bool(found.gave_up) and not attempt.rival
    good = as_promised or (found.locked and not found.gave_up and (seen or not attempt.shown))
    return replace(found, locked=good, time=found.time if good else float("nan"), angle=angle)


SLOW = Task("slow", "slow", slow, told=True, judge=judge_slow)
