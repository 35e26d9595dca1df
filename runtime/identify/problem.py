"""A likelihood to maximise: a subject, its recordings, and the search vector in which their innovations are taken."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.rating import rating
from runtime.identify.equations import TUNING, Equations
from runtime.identify.kernel import Kernel
from runtime.identify.rows import Rows
from runtime.identify.subject import Subject
from runtime.identify.unknowns import Datum, Unknown

Array = NDArray[Any]

#: Rows taken at once: their innovations for some forty sets stay below 20 MB.
BLOCK = 8192
#: Standard deviations of the prior: of a logarithm, guesses half or twice the truth are likely; of what a signed datum
#: is in its size; of the other unknowns.
PRIOR, SIGNED, NUISANCE = 1.0, 10.0, 3.0
#: What no fact says of the voltage, and what an unsure sign does, as shares of the largest voltage, to start from.
VOLTAGE_SHARE = 0.003
#: A sign fades below what V_d drives through the inductance in so many samples, and below six sigmas.
FADING_SAMPLES, FADING_SIGMAS = 1.5, 6.0
#: What shapes an inverter's loss can have: the ripple's factor, and by how much of a sample the currents whose signs
#: count are earlier than the edges. Of legs that switch, and of an inverter whose sign is looked at twice a sample.
SWITCHING, SIMPLIFIED = (1.0, 0.0), (0.0, 0.25)
#: Standard deviations about them. A free instant lets a wrong L and V_d explain a switching inverter better than the
#: true ones (L 20 %, V_d 4 % off on ``spmsm_load_torque`` behind PWM), so it is all but given.
ABOUT_RIPPLE, ABOUT_LEAD = {SWITCHING: 0.2, SIMPLIFIED: 0.02}, 0.005


@dataclass(frozen=True)
class Stage:
    """How the filter is tuned while one searches.

    ``kappa``: what no fact says of the voltage, a share of the largest, white; None: as the search vector says.
    """

    kappa: float | None = None
    angle_sigma: float = 0.03
    speed_share: float = 0.01


@dataclass(frozen=True)
class Problem:
    """The unknowns of a subject and its recordings, and what the filter makes of any of their values."""

    subject: Subject
    recordings: tuple[Rows, ...]
    shape: tuple[float, float] = SWITCHING

    @cached_property
    def kernel(self) -> Kernel:
        """The compiled step."""
        asked = {datum.word for datum in self.subject.free}
        idle = set() if "D" in asked or self.subject.facts.D else {"D"}
        return Kernel(Equations(self.subject.drive, frozenset(idle | {"I_1"})))

    def changed(self, shape: tuple[float, float] | None = None, recordings: tuple[Rows, ...] | None = None) -> Problem:
        """The same with another shape of the inverter's loss, or other rows, by the same compiled step.

        Parameters
        ----------
        shape : tuple of float, optional
        recordings : tuple of Rows, optional
        """
        other = Problem(self.subject, recordings or self.recordings, shape or self.shape)
        other.__dict__["kernel"] = self.kernel
        return other

    @cached_property
    def unknowns(self) -> tuple[Unknown, ...]:
        """The search vector's entries: data that are asked for, the filter's noise, the start of each recording."""
        s, f = self.subject, self.subject.facts
        data = [self._datum(datum) for datum in s.free]
        volts, drop = VOLTAGE_SHARE * f.voltage, self._loss
        walk = 0.1 * self._torque_walk
        noise = [Unknown("s_v", volts, NUISANCE), Unknown("s_T", walk, NUISANCE), Unknown("s_d", volts, NUISANCE)]
        noise += [Unknown("fading", 0.05, PRIOR), Unknown("noise", 1.0, 0.5 * PRIOR)]
        if drop or any(datum.word == "V_dead" for datum in s.free):
            sigma, L = math.sqrt(s.noise[0]), min(f.L_d, f.L_q)
            below = max(FADING_SIGMAS * sigma, FADING_SAMPLES * drop * f.T / L)
            noise += [Unknown("s_z", max(volts, 0.1 * drop), NUISANCE), Unknown("I_0", below, PRIOR)]
            noise += [Unknown("lead", self.shape[1], ABOUT_LEAD, positive=False)]
            noise += [Unknown("ripple", self.shape[0], ABOUT_RIPPLE[self.shape], positive=False)]
        starts = []
        for k in range(len(self.recordings)):
            starts.append(Unknown(f"theta {k}", 0.0, NUISANCE, positive=False, recording=k))
            starts.append(Unknown(f"omega {k}", 0.0, SIGNED, positive=False, size=0.1 * f.speed, recording=k))
        return (*data, *noise, *starts)

    def _datum(self, datum: Datum) -> Unknown:
        """A datum as an unknown."""
        s, guess = self.subject, self.subject.guess(datum)
        if datum.positive:
            return Unknown(datum.word, guess, PRIOR, datum=datum)
        size = VOLTAGE_SHARE * s.facts.voltage if datum.unit == "V" else math.sqrt(s.noise[0])
        return Unknown(datum.word, guess, max(SIGNED, guess / size), False, size, datum=datum)

    @property
    def _loss(self) -> float:
        """V_d as the file has it, V."""
        return self.subject.facts.dc_link * self.subject.facts.dead_time / self.subject.facts.T

    @property
    def _torque_walk(self) -> float:
        """What the load torque wanders in a sample, N m, where it steps by the rated torque."""
        f = self.subject.facts
        return f.torque * math.sqrt(5 * f.T / f.step_every)

    def index(self, name: str) -> int:
        """Place of an unknown in the search vector.

        Parameters
        ----------
        name : str
        """
        return [unknown.name for unknown in self.unknowns].index(name)

    @property
    def guess(self) -> Array:
        """The search vector of the guesses, (m,)."""
        return np.array([unknown.start for unknown in self.unknowns])

    @property
    def prior(self) -> Array:
        """Standard deviations about it, (m,)."""
        return np.array([unknown.prior for unknown in self.unknowns])

    @property
    def data(self) -> list[int]:
        """Places of the data that are asked for."""
        return [k for k, unknown in enumerate(self.unknowns) if unknown.datum is not None]

    def own(self, recording: int) -> list[int]:
        """Places of what the innovations of a recording hang on.

        Parameters
        ----------
        recording : int
        """
        return [k for k, unknown in enumerate(self.unknowns) if unknown.recording in {None, recording}]

    def innovations(
        self, Q: Array, recording: int, stage: Stage, most: int | None = None
    ) -> Iterator[tuple[Array, Array]]:
        """Which rows were measured, (N,), and their innovations with covariances, (N, 5, B), block by block.

        Parameters
        ----------
        Q : (m, B)
            A column a search vector.
        recording : int
        stage : Stage
        most : int, optional
            Rows at most.
        """
        rows = self.recordings[recording]
        parameters, state = self._lanes(Q, recording, stage)
        table = rows.table[1:][:most]
        for first in range(0, len(table), BLOCK):
            part = table[first : first + BLOCK]
            told = self.kernel.run(part, parameters, state)
            yield part[:, 4] > 0, told

    def _lanes(self, Q: Array, recording: int, stage: Stage) -> tuple[Array, Array]:
        """Parameters (P, B) and first states (S, B) of search vectors."""
        equations, f, sets = self.kernel.equations, self.subject.facts, Q.shape[1]
        values = {unknown.name: unknown.value(Q[k]) for k, unknown in enumerate(self.unknowns)}
        letters = {"R": f.R, "L_d": f.L_d, "L_q": f.L_q, "psi_m": f.psi_m, "p": f.p, "J": f.J, "D": f.D, "T": f.T}
        letters |= {"V_d": self._loss, "I_0": values.get("I_0", 1.0), "offset_alpha": 0.0, "offset_beta": 0.0}
        for datum in self.subject.free:
            letters |= dict.fromkeys(datum.letters, values[datum.word])
        given = np.array([np.broadcast_to(letters[name], (sets,)) for name in equations.names])
        made = np.array(equations.constants(given)).reshape(-1, sets)
        tuning = self._tuning(values, stage)
        offsets = (letters["offset_alpha"], letters["offset_beta"])
        tuned = np.array([np.broadcast_to(v, (sets,)) for v in (*(tuning[n] for n in TUNING), *offsets)])
        first = self.recordings[recording].table[0, 2:4]
        i = np.array([np.broadcast_to(a - b, (sets,)) for a, b in zip(first, offsets, strict=True)])
        R = tuned[[TUNING.index(name) for name in ("R_alpha", "R_cross", "R_beta")]]
        start: tuple[Any, ...] = (values[f"theta {recording}"], values[f"omega {recording}"], 0.0, stage.angle_sigma**2)
        start += ((stage.speed_share * f.speed) ** 2, f.torque**2, tuning["drift_noise"])
        begin = np.array([np.broadcast_to(value, (sets,)) for value in start])
        state = np.array(equations.start(given, begin, i, R)).reshape(-1, sets)
        return np.concatenate([given, made, tuned]), state

    def _tuning(self, values: dict[str, Any], stage: Stage) -> dict[str, Any]:
        s, f = self.subject, self.subject.facts
        alpha, cross, beta = s.noise
        kept = np.exp(-values["fading"])
        if stage.kappa is not None:
            push = 0.03 * rating(s.drive).largest_torque * f.T / f.J
            tuning = {"v_noise": (stage.kappa * f.voltage) ** 2, "v_unsure": 0.0, "drift_noise": 0.0}
            tuning |= {"omega_noise": push**2, "theta_noise": 1e-8, "torque_noise": self._torque_walk**2}
            scale: Any = 1.0
        else:
            tuning = {"v_noise": values["s_v"] ** 2, "v_unsure": values.get("s_z", 0.0) ** 2}
            tuning |= {"drift_noise": values["s_d"] ** 2, "omega_noise": 0.0, "theta_noise": 1e-12}
            tuning |= {"torque_noise": values["s_T"] ** 2}
            scale = values["noise"] ** 2
        tuning |= {"R_alpha": alpha * scale, "R_beta": beta * scale, "R_cross": cross * scale, "drift_kept": kept}
        return {**tuning, "ripple": values.get("ripple", 0.0), "lead": values.get("lead", 0.0)}
