"""The numbers of a drive's modes by hand: times in seconds, currents in shares of the largest, what a start needs.

Imports nothing it is to check.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from runtime.proof.control import best_currents, of_current, torque_of

#: s: currents must read zero; zero voltage is tried; a first current dies out; the filter locks; its angle settles; it
#: is content, a rival the better one, or a window lasts; blind; beside the motor's data; steady.
REST, RESTLESS, PROBE, WAIT, CATCH, SETTLE, LOCKED = 2e-3, 0.5, 2e-3, 2e-3, 10e-3, 1e-3, 3e-3
BLIND, ADRIFT, STEADY = 2e-3, 100e-3, 100e-3
#: The torque of a rotor that was caught comes in within the longer of: s, and of L_d / R.
EASE, EASE_WINDINGS = 10e-3, 3.0
#: Shares of the largest current: reads as zero, shows a rotor that turns, is too much.
ZERO, SHOWS, TRIP = 0.05, 0.1, 1.5
#: Samples beyond the trip; attempts, and those of a drive that finds its angle by nothing else; windows of a start, and
#: those that must have been good before the last.
EXCESS, ATTEMPTS, ATTEMPTS_ALONE, WINDOWS, GOOD = 3, 10, 20, 20, 1
#: Between two readings: s, and rad electrical at the box's speed. Sine of the angle that tells the direction; readings
#: at most, after which the reference tells it.
GAP, GAP_TURN, TELLS, READINGS = 0.5e-3, 1.2, 0.1, 8
#: rad: what a jolt may make, beside half of what is stated: while the rotor is looked for, and in a window.
CATCH_JOLT, RUN_JOLT = 0.1, 0.3
#: rad, without a current in one phase; s, for which that goes on. Of the box's speed: more is no estimate.
SILENT_TURN, OPEN, RUNAWAY_SPEED = 3.0, 100e-3, 3.0
#: Of a turn without any current: so much less silent is a phase.
FORGOTTEN = 0.1
#: A start: share of the largest current, s, rad, rad of motion enough; by so much better; the largest torque's cost.
SHARE, WINDOW, TURN, MOTION, BETTER, LOAD = 0.8, 20e-3, 1.0, 0.5, 0.05, 0.3
#: Of the speed that a start goes for at least: what is no more asks for no motion.
STILL = 0.01
#: An alignment: of the largest current; s, in which the current rises at least; of the swing's decay, what it may take
#: after it rose and turned; of the current regulator, the resistance across the axis.
ALIGN_SHARE, ALIGN_TURN, ALIGN_DECAYS, SOFT = 0.8, 20e-3, 7.0, 0.5
#: rad^2: the angle's variance after two readings, and at a start. Of the box's speed: its spread after either, and
#: of half a turn on. Of P_0: what slow states keep.
READ_ANGLE, START_ANGLE, READ_SPEED, MIRROR_SPEED, HELD = 0.01, 0.09, 0.5, 0.25, 1e-3
#: s: from this sample time on there is room for a second filter. Samples: no count goes further.
ROOM, MOST = 50e-6, 32000
#: Shares of the nominal DC link: torque comes in from here to there; torque that brakes goes out. Of the box's speed,
#: squared: (omega - reference) omega counts as braking in full.
LINK_LOW, LINK_HIGH, BRAKES = (0.5, 0.7), (1.15, 1.25), 0.02
#: Degrees of P's sigma; of the largest current, the voltage on R that may be wrong.
UNSEEN, DROP_WRONG = 30.0, 0.05


class Numbers:
    """What the modes of one drive ask for.

    Parameters
    ----------
    parameters : mapping of str to Any
        Sections of the drive file, parsed.
    flux : bool
        The first two states are flux linkages, Wb; else currents, A.
    """

    def __init__(self, parameters: Mapping[str, Any], flux: bool) -> None:
        self.motor, model = parameters["motor"], parameters["model"]
        self.T: float = model["sample_time"]
        self.p: int = self.motor["pole_pairs"]
        self.most: float = parameters["control"]["max_current"]
        self.link: float = parameters["control"]["dc_link"]
        self.speed: float = parameters["operating_box"]["speed"]
        self.flux, self.loaded = flux, model["mechanics"] == "load_torque"
        first = 4 + self.loaded
        self.slow = range(first, first + len(model.get("adaptive") or ()))
        self.two = _two_filters(parameters)
        start = parameters.get("start") or {}
        self.aligns = start.get("method") == "align"
        self.attempts = ATTEMPTS if self.two or self.aligns else ATTEMPTS_ALONE
        ratio = abs(self.motor["inductance_q"] - self.motor["inductance_d"])
        #: Share of the largest current: where reluctance could take all of the magnet's torque it may take half.
        self.share = min(SHARE, self.motor["magnet_flux"] / ratio / self.most) if ratio else SHARE
        by_current = torque_of(self.motor, best_currents(self.motor, self.share * self.most, of_current))
        stated = parameters["control"].get("max_torque")
        self.parameters = parameters
        self.align_current = self._align_current(start.get("align_current"))
        self.torque = by_current if stated is None or stated > by_current else stated

    def samples(self, seconds: float, times: int = 1) -> int:
        """Seconds as samples, the nearest number, one at least; ``times`` as many.

        Parameters
        ----------
        seconds : float
        times : int, optional
        """
        return times * min(max(int(seconds / self.T + 0.5), 1), MOST // times)

    def _align_current(self, stated: float | None) -> float:
        """The current of an alignment, A: less where R takes half the voltage by it, or reluctance half the magnet."""
        m, voltage = self.motor, min(self.link / math.sqrt(3), self.parameters["operating_box"]["voltage"])
        saliency = abs(m["inductance_q"] - m["inductance_d"])
        limits = [ALIGN_SHARE * self.most, voltage / 2 / m["stator_resistance"]]
        return stated or min([*limits, m["magnet_flux"] / 2 / saliency] if saliency else limits)

    @property
    def pull(self) -> float:
        """rad/s^2 electrical per rad: what the aligning current makes of a small angle from its axis."""
        m, i = self.motor, self.align_current
        flux = m["magnet_flux"] + (m["inductance_d"] - m["inductance_q"]) * i
        return float(1.5 * self.p * flux * i / m["inertia"] * self.p)

    @property
    def across(self) -> float:
        """What the inverter is across the axis of an alignment beside R, ohm."""
        m, swing = self.motor, math.sqrt(self.pull)
        flux = (m["magnet_flux"] + m["inductance_d"] * self.align_current) / self.align_current  # H
        best = (flux + m["inductance_q"]) * swing / 2
        stiff = self.parameters["control"]["current_bandwidth"] * min(m["inductance_d"], m["inductance_q"])
        return float(min(max(0.0, best - m["stator_resistance"]), SOFT * stiff))

    @property
    def decay(self) -> float:
        """s, in which a swing dies down: of the angle, its speed and the current across, as they move each other."""
        m, i = self.motor, self.align_current
        R, L = m["stator_resistance"] + self.across, m["inductance_q"]
        moves = [
            [0.0, 1.0, 0.0],
            [0.0, 0.0, self.pull / i],
            [-R * i / L, -(m["magnet_flux"] + m["inductance_d"] * i) / L, -R / L],
        ]
        return float(-1.0 / np.linalg.eigvals(np.array(moves)).real.max())

    @property
    def align_turn(self) -> float:
        """s, in which the current of an alignment rises, and is turned to its axis."""
        return max(ALIGN_TURN, self.decay)

    @property
    def align(self) -> int:
        """Samples that an alignment may take."""
        half_a_swing = math.pi / math.sqrt(self.pull)
        return self.samples(2 * self.align_turn + ALIGN_DECAYS * self.decay + half_a_swing)

    @property
    def calm(self) -> int:
        """Samples of half a swing."""
        return self.samples(math.pi / math.sqrt(self.pull))

    def allowed_by_link(self, link: float, reference: float, omega: float) -> float:
        """The share of the largest current that the DC link leaves.

        Parameters
        ----------
        link : float
            As measured, V; NaN leaves none.
        reference, omega : float
            Speed, rad/s; what is no number brakes.
        """
        if math.isnan(link):
            return 0.0
        driving, of_braking = (_between(link / self.link, *limits) for limits in (LINK_LOW, LINK_HIGH))
        brakes = (omega / self.speed) ** 2 - omega / self.speed * (reference / self.speed)
        brakes = 1.0 if math.isnan(brakes) else min(max(brakes, 0.0), BRAKES**2) / BRAKES**2
        return driving - brakes * driving * of_braking

    def sees(self, sigma: float, omega: float) -> bool:
        """The angle is seen: by P, and where reluctance does not show it by a back-EMF beside the resistance's voltage.

        Parameters
        ----------
        sigma : float
            Of the angle by P, rad; NaN: it is not.
        omega : float
            Speed, rad/s.
        """
        m = self.motor
        back_emf, unknown = abs(omega) * self.p * m["magnet_flux"], DROP_WRONG * self.most * m["stator_resistance"]
        return bool(math.degrees(sigma) <= UNSEEN and (m["inductance_d"] != m["inductance_q"] or back_emf >= unknown))

    @property
    def window_time(self) -> float:
        """A window of STARTING, s: a rotor without load, pushed from rest, turns by a radian electrical."""
        angular = self.p * self.torque / self.motor["inertia"]  # rad/s^2 electrical
        return max(WINDOW, math.sqrt(2.0 / angular))

    @property
    def window(self) -> int:
        """Samples of a window of STARTING."""
        return self.samples(self.window_time)

    @property
    def slowest(self) -> float:
        """What a start goes for at least, rad/s: a window turns by TURN."""
        return TURN / self.window_time / self.p

    @property
    def ease(self) -> int:
        """Samples in which the torque of a rotor that was caught comes in."""
        return self.samples(max(EASE, EASE_WINDINGS * self.motor["inductance_d"] / self.motor["stator_resistance"]))

    @property
    def gap(self) -> int:
        """Samples between two readings, at least."""
        return self.samples(min(GAP, GAP_TURN / (self.p * self.speed)))

    @property
    def longest(self) -> dict[str, int]:
        """Samples that a mode which must end may last, one rotor's attempt.

        The rotor may be looked for twice, at either guess; a start has its windows, and gives up a sample later.
        """
        rest = {"RESTING": self.samples(RESTLESS)}
        twice = {"PROBING": self.samples(PROBE), "WAITING": self.samples(WAIT), "CATCHING": 2 * self.samples(CATCH)}
        starts = {"STARTING": WINDOWS * self.window + 1} if self.two else {}
        return rest | twice | starts | ({"ALIGNING": self.align} if self.aligns else {})

    @property
    def unseen(self) -> float:
        """The speed, rad/s, whose current is not seen within PROBE: i = e / R (1 - exp(-t R / L))."""
        R, L = self.motor["stator_resistance"], self.motor["inductance_q"]
        impedance = R / -math.expm1(-PROBE * R / L)  # V/A
        flux: float = self.motor["magnet_flux"]
        return float(SHOWS * self.most * impedance / (flux * self.p))


def _between(value: float, first: float, last: float) -> float:
    """How far a value is from the first to the last, 0 .. 1."""
    if value <= first:
        return 0.0
    return 1.0 if value >= last else (value - first) / (last - first)


def _two_filters(parameters: Mapping[str, Any]) -> bool:
    """A drive says how many filters its start has, or how well its angle is known; else its sample time has room."""
    start = parameters.get("start") or {}
    if start.get("method"):
        return False
    if start.get("filters"):
        return bool(start["filters"] == 2)
    return bool(start.get("angle", "unknown") == "unknown" and parameters["model"]["sample_time"] >= ROOM)
