"""A design tried: the closed loop with motors drawn within tolerance, behind a switching inverter, at five speeds.

Every draw starts at rest at an angle of its own, runs up to a share of rated speed and meets a step of rated torque.
The inverter switches with its dead time, duty cycles act a sample late, sensors have noise and a converter's steps:
the scalar simulator, run by run (:mod:`runtime.drive.simulation`), some 2 us a sample.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from codegen.generate import Package, generate_bare
from codegen.output.folder import write_folder
from model.drives.load import parse_drive
from model.rating import rating
from model.schema import Drive, DriveError
from runtime.design.facts import Facts
from runtime.design.known import is_salient
from runtime.design.rules import Design
from runtime.drive.scenario import Scenario, find_scenario
from runtime.drive.simulation import Conditions, Run, Simulator
from runtime.estimator.folder import GeneratedFolder
from runtime.estimator.threads import thread_count
from runtime.recorded.units import RPM
from runtime.system.errors import UserError, stop_if_interrupted

Array = NDArray[Any]
#: Called with the number of runs done and of all.
Progress = Callable[[int, int], None]

#: Shares of rated speed that are tried, and from which on a design must hold.
SPEEDS, MUST_HOLD = (0.01, 0.05, 0.1, 0.5, 1.0), 0.1
#: Share of the draws that must hold where a speed counts as held.
ENOUGH = 0.99
#: Shortest ramp: s, and in time constants of the speed loop.
RAMP = (0.02, 3.0)
#: A slow rotor is watched for half an electrical turn after the load step, but no longer than this, s.
LONGEST = 1.0
#: Share of the draws that did not hold which a fact known exactly must mend, where that fact is named; by how much
#: that is more than other noise mends; how many of the draws are looked at.
MENDED, LUCK, LOOKED_AT = 0.5, 0.3, 16
#: More facts than this are not to blame, each by itself.
SINGLE = 2


@dataclass(frozen=True)
class Draws:
    """Motors and starts: ``factors`` on the filter's data by name, and ``theta`` rad at the start; arrays (B,)."""

    factors: dict[str, Array]
    theta: Array

    @property
    def count(self) -> int:
        """How many."""
        return len(self.theta)

    def exactly(self, names: Sequence[str]) -> Draws:
        """The same draws, some of the data known exactly; "theta": the rotor at angle 0.

        Parameters
        ----------
        names : sequence of str
        """
        factors = {name: np.ones_like(f) if name in names else f for name, f in self.factors.items()}
        return Draws(factors, np.zeros_like(self.theta) if "theta" in names else self.theta)


@dataclass(frozen=True)
class Point:
    """A share of rated speed: which draws held, stayed locked and reached the speed (B,); their errors.

    ``angle``: largest from the load step on, degrees; ``speed_error``: of the estimate, largest from the load step on,
    r/min; ``honest``: share of the samples, start included, in which the angle is within three sigmas of P; (B,).
    """

    share: float
    speed: float
    locked: Array
    reached: Array
    angle: Array
    speed_error: Array
    honest: Array

    @property
    def held(self) -> Array:
        """Locked, and at the speed that is wanted."""
        return np.asarray(self.locked & self.reached)

    @property
    def holds(self) -> bool:
        """Whether enough of the draws held."""
        return bool(len(self.held)) and float(np.mean(self.held)) >= ENOUGH


@dataclass(frozen=True)
class Trial:
    """What was tried and found: ``hurts``, for a share of speed that does not hold, the facts to blame.

    ``adaptive``: the resistance is a state of the filter that was tried.
    """

    facts: Facts
    points: list[Point]
    hurts: dict[float, list[str]] = field(default_factory=dict)
    adaptive: bool = False

    @property
    def holds(self) -> bool:
        """Whether the design holds from :data:`MUST_HOLD` of rated speed on; not where nothing was tried."""
        must = [point.holds for point in self.points if point.share >= MUST_HOLD]
        return bool(must) and all(must)

    @property
    def success(self) -> float:
        """Share of the draws that held at every speed from :data:`MUST_HOLD` on."""
        held = [point.held for point in self.points if point.share >= MUST_HOLD]
        return float(np.mean(np.all(held, axis=0))) if held else 0.0


def draw(facts: Facts, count: int, seed: int) -> Draws:
    """Motors and starts, evenly within the tolerances.

    Parameters
    ----------
    facts : Facts
    count : int
    seed : int
    """
    rng = np.random.default_rng(seed)
    R, L_d, L_q, psi_m, J, theta = rng.uniform(-1.0, 1.0, (6, count))
    factors = {
        "R": 1 + facts.d_R * R,
        "L_d": 1 + facts.d_L * L_d,
        "L_q": 1 + facts.d_L * (L_q if is_salient(facts) else L_d),
        "psi_m": 1 + facts.d_psi * psi_m,
        "J": 1 + facts.d_J * J,
    }
    return Draws(factors, facts.angle * theta)


def package(design: Design) -> Package:
    """The design's generated code.

    Parameters
    ----------
    design : Design

    Raises
    ------
    UserError
        Facts whose drive file is refused.
    """
    try:
        return generate_bare(parse_drive(design.tables(), design.name))
    except DriveError as error:
        raise UserError(f"these facts make a drive file that is refused: {error}") from None


@contextmanager
def simulator(made: Package, kind: str) -> Iterator[Simulator]:
    """The closed loop of a package that lies in no folder yet.

    Parameters
    ----------
    made : Package
    kind : str
        Of the filter.
    """
    with tempfile.TemporaryDirectory(prefix="pmsm-ickf-") as place:
        path = Path(place) / made.drive.name
        write_folder(path, made.files, force=False)
        yield Simulator(GeneratedFolder(path), kind)


def try_out(
    facts: Facts,
    design: Design,
    made: Package,
    draws: int = 128,
    seed: int = 1,
    speeds: Sequence[float] = SPEEDS,
    progress: Progress = lambda done, of: None,
    blamed: bool = True,
) -> Trial:
    """Try a design at several speeds, and find out which fact is to blame where it does not hold.

    Parameters
    ----------
    facts : Facts
        What the design was made from; the draws are about it.
    design : Design
    made : Package
        Its generated code.
    draws : int
        Motors a speed.
    seed : int
        Of all that is drawn.
    speeds : sequence of float
        Shares of rated speed.
    progress : callable
        Called with runs done and all runs.
    blamed : bool
        Whether to look for the facts to blame.
    """
    motors = draw(facts, draws, seed)
    points: list[Point] = []
    hurts: dict[float, list[str]] = {}
    with simulator(made, design.kind) as loop:
        for k, share in enumerate(speeds):
            scenario = load_step(made.drive, share)

            def tell(done: int, before: int = k * draws) -> None:
                progress(before + done, draws * len(speeds))

            points.append(_point(loop, facts, scenario, share, motors, range(draws), tell))
        for point in points:
            if blamed and not point.holds:
                scenario = load_step(made.drive, point.share)
                hurts[point.share] = _to_blame(loop, facts, scenario, point, motors)
    return Trial(facts, points, hurts, "stator_resistance" in made.drive.model.adaptive)


def load_step(drive: Drive, share: float) -> Scenario:
    """Up to a share of rated speed, then rated torque at once: the drive's own scenario, as fast as suits the share.

    Half of the largest torque accelerates, as far as the speed regulator follows: a rotor that lingers at standstill
    cannot be seen there.

    Parameters
    ----------
    drive : Drive
    share : float
        Of rated speed.
    """
    task = rating(drive)
    speed = share * task.speed * RPM
    ramp = max(share * task.ramp(drive.motor.inertia, 0.0), RAMP[0], RAMP[1] / drive.control.speed_bandwidth)
    scenario = find_scenario("load_step", drive, speed=speed, ramp=ramp)
    half_turn = 30.0 / (drive.motor.pole_pairs * speed)
    return replace(scenario, duration=max(scenario.duration, scenario.load_at + min(LONGEST, half_turn)))


def _conditions(facts: Facts, motors: Draws, k: int, seeds: int) -> Conditions:
    return Conditions(
        inverter="pwm",
        dead_time=facts.dead_time,
        delay=1,
        noise=facts.noise,
        bits=facts.bits,
        range=facts.range,
        theta=float(motors.theta[k]),
        seed=seeds + k + 1,
        factors={name: float(factor[k]) for name, factor in motors.factors.items()},
    )


def _point(
    loop: Simulator,
    facts: Facts,
    scenario: Scenario,
    share: float,
    motors: Draws,
    which: Sequence[int],
    tell: Callable[[int], None] | None = None,
    seeds: int = 0,
) -> Point:
    """Some of the draws at one speed, on all cores: the loop in C holds no lock of Python's."""
    rows = np.zeros((5, len(which)))

    def one(place: int) -> None:
        run = loop.run(scenario, _conditions(facts, motors, which[place], seeds))
        rows[:, place] = judge(run)

    with ExitStack() as stack:
        pool = ThreadPoolExecutor(thread_count())
        stack.callback(pool.shutdown, cancel_futures=True)
        for done, future in enumerate(as_completed([pool.submit(one, k) for k in range(len(which))])):
            future.result()
            stop_if_interrupted()
            if tell is not None:
                tell(done + 1)
    return Point(share, scenario.speed, rows[0] > 0, rows[1] > 0, *rows[2:])


def judge(run: Run) -> tuple[float, float, float, float, float]:
    """Whether a run stayed locked and reached the speed (1 or 0); angle (degrees), speed error (r/min), honesty of P.

    Parameters
    ----------
    run : Run
    """
    after = run.t >= run.scenario.load_at
    errors = (float(np.max(np.abs(error[after]))) for error in (run.angle_error, run.speed_error))
    angle, speed_error = (error if math.isfinite(error) else math.inf for error in errors)
    return float(run.locked), float(run.reached), angle, speed_error, run.honest


#: What may be to blame: the draws' data that belong to it.
CAUSES = {
    "stator_resistance": ("R",),
    "inductance": ("L_d", "L_q"),
    "magnet_flux": ("psi_m",),
    "inertia": ("J",),
    "angle": ("theta",),
}


def _to_blame(loop: Simulator, facts: Facts, scenario: Scenario, point: Point, motors: Draws) -> list[str]:
    """The facts that, known exactly, would mend most of the draws that did not hold, and clearly more than luck."""
    failed = [int(k) for k in np.flatnonzero(~point.held)][:LOOKED_AT]

    def mended(again: Draws, seeds: int = 0) -> float:
        return float(np.mean(_point(loop, facts, scenario, point.share, again, failed, None, seeds).held))

    by_luck = mended(motors, seeds=10_000)  # the same motors under other noise
    found = {cause: mended(motors.exactly(names)) for cause, names in CAUSES.items()}
    best = max(found.values())
    named = [cause for cause, share in found.items() if share >= max(MENDED, by_luck + LUCK, best - LUCK / 2)]
    return named if len(named) <= SINGLE else []  # what any change mends is nobody's fault


def blame(trial: Trial) -> list[str]:
    """In words, which fact is not known well enough, and what would help: one line a fact.

    Parameters
    ----------
    trial : Trial
    """
    f = trial.facts
    words = {
        "stator_resistance": (
            f"stator_resistance within {f.d_R:.0%}",
            "identify it" if trial.adaptive else "identify it, or adapt it",
        ),
        "inductance": (f"inductance within {f.d_L:.0%}", "identify it"),
        "magnet_flux": (f"magnet_flux within {f.d_psi:.0%}", "identify it, or adapt it"),
        "inertia": (f"inertia within {f.d_J:.0%}", "identify it with the load coupled"),
        "angle": (f"a start within {math.degrees(f.angle):.0f} degrees", "align the rotor first"),
    }
    lines = []
    for cause, (what, help_) in words.items():
        speeds = [point.speed for point in trial.points if cause in trial.hurts.get(point.share, ())]
        if speeds:
            lines.append(f"{what} is not enough up to {max(speeds):.3g} r/min: {help_}.")
    unexplained = [point.speed for point in trial.points if trial.hurts.get(point.share) == []]
    if unexplained:
        speeds_text = ", ".join(f"{speed:.3g}" for speed in unexplained)
        lines.append(
            f"no single fact explains what is lost at {speeds_text} r/min: several together, or the load step."
        )
    return lines
