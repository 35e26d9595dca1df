"""A drive's filter for a billion steps: float32 beside float64, hours of drive time in minutes.

The journey of :mod:`runtime.endurance.journey` over and over, with sensor noise that never repeats, and currents that
are lost for a while every million steps. Held to: what 100 000 steps show as link C-D runs them, times a factor with a
reason; no growth from decade to decade; no status without a reason in the journey; the lock kept all along.
"""

from __future__ import annotations

import ctypes
import math
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from model.machines.adaptive import ADAPTIVE
from runtime.drive.fleet import HERE as DRIVE_ROOM
from runtime.endurance.journey import Journey, make_journey
from runtime.estimator.compiler import build_library
from runtime.estimator.estimator import load_folder
from runtime.estimator.folder import GeneratedFolder
from runtime.estimator.lanes import OPTIMISATION
from runtime.estimator.threads import thread_count
from runtime.folders.resolve import drive_folder
from runtime.folders.stated import stated_drive
from runtime.proof.link_cd import ALLOWED, drift
from runtime.proof.own_trajectory import motion_of, trajectory_of
from runtime.system.errors import UserError

SOURCE = Path(__file__).with_name("soak.c")

#: A rms of each of two phase-current sensors.
NOISE = 0.05
#: Steps from one loss of currents to the next: a prime, so that it strikes everywhere in the period; and how many.
LOST_EVERY, LOST_FOR = 1_000_003, 50
#: The bound on a state's deviation, over that of 100 000 steps at the proof's speed or at the slowest speed that is not
#: called slow, whichever shows more: the journey's speeds are up to 2.7 times that, which costs two bits of a
#: float32 speed, and the extremes of 10^9 draws are 1.4 times those of 10^5. At the slow end the back-EMF that shows
#: the angle is a tenth, and what rounding does to an angle lasts as much longer.
WITHIN = 10.0
#: The bound on a later decade's largest deviation over that of the decade to 10^6 steps, which is five periods or more:
#: extremes of noise over a thousand times the steps are 1.3 times as large, and deviations go with their products.
GROWTH = 3.0
#: Where motor data are states, a share of sigma instead. At one speed, as link C-D runs, motor data move along the line
#: R i_q + omega_e psi_m and leave the angle alone; on the journey they do not. As noise a tenth would add a hundredth
#: to the variance.
SHARE_ADAPTIVE = 0.1
#: Of base speed: below it no current shows the angle. There, and while currents are lost, when the model alone makes
#: them of angle and speed (66 A/rad on the paper's motor), states are held to a share of sigma alone.
SLOW = 0.05
#: rad: an angle further off is no lock.
LOCKED = math.pi / 4
#: rad: what wrapping in double may cost the truth's angle in 10^9 steps.
TURNED = 1e-9
#: Steps of one call into C, a second or less: Ctrl-C is heard between two.
CHUNK = 500_000
#: Steps of the reference run, as in link C-D at the proof's speed; a second one is at the slow end.
REFERENCE = 100_000

#: Called with drive, steps more.
Progress = Callable[[str, int], None]


class _Journey(ctypes.Structure):
    _fields_ = [
        ("steps", ctypes.c_int),
        *((name, ctypes.c_void_p) for name in ("u", "i", "theta", "omega")),
        ("noise", ctypes.c_double),
        ("lost_every", ctypes.c_int64),
        ("lost_for", ctypes.c_int),
        ("slow", ctypes.c_double),
    ]


def _figures_type(n: int) -> type[ctypes.Structure]:
    class Figures(ctypes.Structure):
        _fields_ = [
            ("deviation", ctypes.c_double * n),
            ("slow", ctypes.c_double * n),
            ("share", ctypes.c_double * n),
            *((name, ctypes.c_double) for name in ("covariance", "angle", "speed")),
            *((name, ctypes.c_int64) for name in ("rejected", "not_converged", "unexpected", "first_unexpected")),
            ("bits", ctypes.c_int),
            ("not_finite", ctypes.c_int64),
        ]

    return Figures


@dataclass(frozen=True)
class Decade:
    """The steps up to ``until``, from the decade before on: largest ones, and counts of steps.

    ``deviation`` (n,) |float32 - float64| at speed in the states' units, ``slow`` (n,) the same near standstill and
    while currents are lost and found again;
    ``share`` (n,) of both over sigma, ``covariance`` over sigma sigma; ``angle`` rad and ``speed`` rad/s off the truth.
    """

    until: int
    deviation: tuple[float, ...]
    slow: tuple[float, ...]
    share: tuple[float, ...]
    covariance: float
    angle: float
    speed: float
    rejected: int
    not_converged: int
    unexpected: int
    first_unexpected: int
    bits: int
    not_finite: int


@dataclass
class Soak:
    """One filter's run.

    ``reference`` (n + 1,): deviation of 100 000 steps at two speeds, the larger one, and P's;
    ``turned`` rad: error of the truth's own angle after all periods.
    """

    drive: str
    kind: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    sample_time: float
    reference: tuple[float, ...]
    decades: list[Decade] = field(default_factory=list)
    seconds: float = 0.0
    turned: float = 0.0

    @property
    def steps(self) -> int:
        """Steps taken."""
        return self.decades[-1].until if self.decades else 0

    def failures(self) -> list[str]:
        """The failures, a line each."""
        label, lines = f"{self.drive}/{self.kind}", []
        if not self.decades:
            lines.append(f"{label}: no step was compared")
        for decade in self.decades:
            where = f"{label}, up to step {decade.until:.0e}"
            lines += [f"{where}: {line}" for line in self._apart(decade)]
            if decade.unexpected:
                lines.append(
                    f"{where}: status without a reason in {decade.unexpected} steps (bits {decade.bits:#x}), "
                    f"first at step {decade.first_unexpected}"
                )
            if decade.not_finite:
                lines.append(f"{where}: {decade.not_finite} steps after which a number is none")
            if not decade.angle <= LOCKED:
                lines.append(f"{where}: the lock was lost, theta off by {math.degrees(decade.angle):.0f} degrees")
        return lines + self._grown(label) + self._counted(label)

    def _apart(self, decade: Decade) -> list[str]:
        """Where float32 and float64 are further apart than allowed."""
        lines = []
        adaptive = bool(set(self.names) & set(ADAPTIVE))
        share = SHARE_ADAPTIVE if adaptive else ALLOWED
        for k, (name, unit) in enumerate(zip(self.names, self.units, strict=True)):
            if not decade.share[k] <= share:
                lines.append(f"float32 and float64 differ in {name} by {decade.share[k]:.2g} sigma, allowed {share:g}")
            if not adaptive and not decade.deviation[k] <= WITHIN * self.reference[k]:
                lines.append(
                    f"float32 and float64 differ in {name} by {decade.deviation[k]:.2g} {unit}, allowed "
                    f"{WITHIN * self.reference[k]:.2g}"
                )
        if not decade.covariance <= ALLOWED:
            lines.append(f"float32 and float64 differ in P by {decade.covariance:.2g}, allowed {ALLOWED:g}")
        return lines

    def _grown(self, label: str) -> list[str]:
        lines = []
        early = next((decade for decade in self.decades if decade.until == 10**6), None)
        for decade in self.decades:
            if early is None or decade.until <= 10**6:
                continue
            for name, now, then in zip(self.names, decade.deviation, early.deviation, strict=True):
                if not now <= GROWTH * then:
                    lines.append(
                        f"{label}: the deviation of {name} grew {now / then:.1f} times up to step {decade.until:.0e}"
                    )
        return lines

    def _counted(self, label: str) -> list[str]:
        lines = []
        whole, rest = divmod(self.steps, LOST_EVERY)
        lost = whole * LOST_FOR + max(0, rest - (LOST_EVERY - LOST_FOR))
        said = sum(decade.rejected for decade in self.decades)
        if said != lost:
            lines.append(f"{label}: {lost} steps had no currents, {said} said so")
        if not self.turned <= TURNED:
            lines.append(f"{label}: the truth's own angle is off by {self.turned:.1g} rad, allowed {TURNED:g}")
        return lines

    def to_json(self) -> dict[str, Any]:
        """Every figure, for machines."""
        facts = {name: getattr(self, name) for name in ("drive", "kind", "names", "units", "sample_time", "reference")}
        facts |= {"seconds": self.seconds, "turned": self.turned, "failures": self.failures()}
        return {**facts, "decades": [vars(decade) for decade in self.decades]}


class Soaker:
    """A filter compiled in both precisions, and its journey."""

    def __init__(self, folder: GeneratedFolder, kind: str, seed: int = 1) -> None:
        folder.require(kind)
        self.folder, self.kind = folder, kind
        states = folder.manifest["states"]
        self.names = tuple(str(state["name"]) for state in states)
        self.units = tuple(str(state["unit"]) for state in states)
        self._library = self._build()
        self._type = _figures_type(len(states))
        self._state = ctypes.create_string_buffer(self._library.soak_size())
        self._library.soak_begin(self._state, ctypes.c_uint64(seed))
        self._at = 0

    def _build(self) -> Any:
        prefix = f"{self.folder.drive}_{self.kind}"
        names = ["pmsm_port.h", *(f"{stem}{end}" for stem in (prefix, f"host/{prefix}_f64") for end in (".h", ".c"))]
        sources = {Path(name).name: self.folder.text(name) for name in names}
        for path in (SOURCE, DRIVE_ROOM / "sensor_noise.h"):
            sources[path.name] = path.read_text(encoding="utf-8")
        defines = {"FILTER": prefix, "HEADER": f'"{prefix}.h"', "HEADER_64": f'"{prefix}_f64.h"'}
        defines |= {"N_STATES": str(len(self.names)), "THETA": str(self.names.index("theta"))}
        defines |= {"ORDER": ",".join(str(k) for k in self.folder.module.ORDER)}
        defines |= {"OMEGA": str(self.names.index("omega"))}
        library = ctypes.CDLL(str(build_library(sources, defines, OPTIMISATION)))
        library.soak_run.restype = ctypes.c_double
        return library

    @cached_property
    def journey(self) -> Journey:
        """The period that is driven again and again."""
        try:
            return make_journey(self.folder.manifest["parameters"])
        except KeyError as error:
            raise UserError(
                f"drive '{self.folder.drive}': no journey is known for a machine without {error}."
            ) from None

    @cached_property
    def _period(self) -> tuple[_Journey, list[Any]]:
        """The journey as C wants it, and the arrays it points into."""
        j = self.journey
        arrays = [np.ascontiguousarray(a).view(np.float64) for a in (j.u, j.i, j.theta, j.omega)]
        return _Journey(len(j.u), *(a.ctypes.data for a in arrays), NOISE, LOST_EVERY, LOST_FOR, SLOW * j.base), arrays

    def run(self, until: int, progress: Callable[[int], None], over: threading.Event) -> tuple[Decade, float]:
        """Go on to step ``until``: the stretch's figures, and the truth's angle error at its end (rad)."""
        period, _ = self._period
        figures = self._type()
        turned = 0.0
        while self._at < until and not over.is_set():
            more = min(CHUNK, until - self._at)
            turned = self._library.soak_run(
                ctypes.byref(period), self._state, ctypes.c_int64(more), ctypes.byref(figures)
            )
            self._at += more
            progress(more)
        values = {name: getattr(figures, name) for name, *_ in self._type._fields_}
        values |= {name: tuple(values[name]) for name in ("deviation", "slow", "share")}
        return Decade(self._at, **values), self._off(turned)

    def _off(self, turned: float) -> float:
        """The periods' angle as C carries it and by exact arithmetic, rad."""
        periods = self._at // len(self.journey.u)
        circle = Fraction(TWO_PI_DIGITS)
        exact = Fraction(float(self.journey.theta[-1])) * periods % circle
        return abs(math.remainder(turned - float(exact), math.tau))


#: 2 pi to 50 digits.
TWO_PI_DIGITS = "6.28318530717958647692528676655900576839433879875021"


def reference_deviation(folder: GeneratedFolder, kind: str, slow: float, steps: int = REFERENCE) -> tuple[float, ...]:
    """Largest |float32 - float64| of each state, then of P over sigma sigma: of so many steps at either speed.

    ``slow``: the second speed, rad/s.

    Parameters
    ----------
    folder : GeneratedFolder
        The generated folder.
    kind : str
        Filter kind, such as "ickf".
    slow : float
    steps : int, optional
        Number of steps.
    """
    drive = stated_drive(folder)
    settled, motion = round(0.3 / drive.model.sample_time), motion_of(drive)
    found = []
    for speed in (motion.speed, slow):
        data = trajectory_of(drive, settled + steps, motion=replace(motion, speed=speed))
        single, double = (load_folder(folder, kind, "c", dtype) for dtype in ("float32", "float64"))
        apart = drift(single, double, data.u, data.y)
        found.append([*apart.x[settled:].max(axis=0), apart.P[settled:].max()])
    return tuple(float(v) for v in np.max(found, axis=0))


def soak(runs: Sequence[tuple[str, int]], kind: str | None, progress: Progress = lambda name, more: None) -> list[Soak]:
    """Run every (drive, steps), as many at once as there are cores.

    Parameters
    ----------
    runs : Sequence[tuple[str, int]]
        The runs.
    kind : str or None
        Filter kind, such as "ickf".
    progress : Progress, optional
        Told how far the work is.

    Raises
    ------
    UserError
        An unknown drive or filter, or no compiler.
    """
    soakers = [
        (Soaker(folder, folder.chosen(kind)), steps) for drive, steps in runs for folder in (drive_folder(drive),)
    ]
    over = threading.Event()
    with ThreadPoolExecutor(min(thread_count(), len(runs))) as pool:
        futures = [pool.submit(_soak, soaker, steps, progress, over) for soaker, steps in soakers]
        try:
            return [future.result() for future in futures]
        except BaseException:
            over.set()
            pool.shutdown(cancel_futures=True)
            raise


def _soak(soaker: Soaker, steps: int, progress: Progress, over: threading.Event) -> Soak:
    folder, begun = soaker.folder, time.perf_counter()
    T = float(folder.manifest["parameters"]["model"]["sample_time"])
    reference = reference_deviation(folder, soaker.kind, SLOW * soaker.journey.base)
    result = Soak(folder.drive, soaker.kind, soaker.names, soaker.units, T, reference)
    for until in _decades(steps):
        decade, result.turned = soaker.run(until, lambda more: progress(folder.drive, more), over)
        result.decades.append(decade)
        if over.is_set():
            break
    result.seconds = time.perf_counter() - begun
    return result


def _decades(steps: int) -> list[int]:
    """10^5, 10^6, ... and the last step."""
    return [10**k for k in range(5, 30) if 10**k < steps] + [steps]
