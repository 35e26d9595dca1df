"""What a recording is of: a drive or a facts file, as the model to fit, the guesses, and the facts for design."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from model.drives.load import parse_drive, shipped_drives
from model.inverter import lost_voltage
from model.rating import rating
from model.schema import Drive, DriveError
from runtime.design.facts import Facts, read_facts
from runtime.design.known import is_salient
from runtime.design.rules import design
from runtime.folders.resolve import find_drive
from runtime.identify.unknowns import DATA, Datum
from runtime.system.errors import UserError
from runtime.system.values import nearest

#: Words of --free by default; L of a round rotor, L_d and L_q of a salient one.
USUAL = ("R", "L", "L_d", "L_q", "psi_m", "J", "V_dead")
#: beta is made of two phases, each with its sensor's noise: (1 + 4) / 3 of alpha's, and a part in common.
OF_PHASES = (1.6, 1.75)
#: Half-widths of data that a drive file says nothing of.
UNSTATED = {"d_R": 0.2, "d_L": 0.1, "d_psi": 0.05, "d_J": 0.2}


@dataclass(frozen=True)
class Subject:
    """A drive and what is known of it beforehand.

    ``drive``: its model; ``facts``: the same as facts; ``free``: what is asked for; ``noise``: variances of the
    measured currents, of alpha, between them, of beta, A^2. ``from_facts``: a facts file was given.
    """

    drive: Drive
    facts: Facts
    free: tuple[Datum, ...]
    noise: tuple[float, float, float]
    path: Path | None
    from_facts: bool

    @property
    def name(self) -> str:
        """The drive's."""
        return self.drive.name

    def guess(self, datum: Datum) -> float:
        """What the file says of a datum, SI.

        Parameters
        ----------
        datum : Datum
        """
        f = self.facts
        known = {"R": f.R, "L": (f.L_d + f.L_q) / 2, "L_d": f.L_d, "L_q": f.L_q, "psi_m": f.psi_m, "J": f.J, "D": f.D}
        return {**known, "V_dead": f.dc_link * f.dead_time / f.T}.get(datum.word, 0.0)


def read_subject(word: str, free: str | None) -> Subject:
    """Read DRIVE_OR_FACTS, and --free.

    Parameters
    ----------
    word : str
        A shipped name, a drive file, a generated folder, or a facts file.
    free : str or None
        Words of :data:`runtime.identify.unknowns.DATA` with commas between them; None: the usual ones.

    Raises
    ------
    UserError, DriveError
        A file that cannot be used, a word that is none, or one that the machine has not.
    """
    words = None if free is None else [part.strip() for part in free.split(",") if part.strip()]
    path = Path(word) if word not in shipped_drives() and Path(word).suffix == ".toml" else None
    if path is not None and is_facts(path):
        facts = read_facts(path)
        drive = _drive_of(facts, bool(words and {"L_d", "L_q"} & set(words)))
        s2 = facts.sigma**2
        return Subject(drive, facts, _asked(words, drive, facts), (s2, s2 / math.sqrt(3), 5 * s2 / 3), path, True)
    drive = find_drive(word).drive
    facts = facts_of(drive)
    alpha, beta = drive.filter.measurement_noise
    low, high = OF_PHASES
    cross = alpha / math.sqrt(3) if low < beta / alpha < high else 0.0
    return Subject(drive, facts, _asked(words, drive, facts), (alpha, cross, beta), path, False)


def is_facts(path: Path) -> bool:
    """Whether a TOML file is a facts file: it has no ``[model]``. What cannot be read is told by who reads it.

    Parameters
    ----------
    path : Path
    """
    try:
        return "model" not in tomllib.loads(path.read_bytes().decode("utf-8-sig"))
    except (OSError, ValueError, RecursionError):
        return False


def _drive_of(facts: Facts, salient: bool) -> Drive:
    """The drive that the rules make of facts; ``salient``: with two inductances, however equal they are stated."""
    tables = design(facts).tables()
    if salient and not is_salient(facts):
        tables["model"]["machine"] = "salient_flux"
    try:
        return parse_drive(tables, facts.name)
    except DriveError as error:
        raise UserError(f"these facts make a drive file that is refused: {error}") from None


def _asked(words: list[str] | None, drive: Drive, facts: Facts) -> tuple[Datum, ...]:
    round_rotor = drive.model.machine == "surface"
    others = {"L_d", "L_q"} if round_rotor else {"L"}
    if words is None:
        words = [word for word in USUAL if word not in others]
    if not words:
        raise UserError(f"--free names nothing; there are {', '.join(DATA)}.")
    for word in words:
        if word not in DATA:
            raise UserError(f"--free {word}: no such datum; there are {', '.join(DATA)}.{nearest(word, DATA)}")
        if word in others:
            of_model = "one inductance: L" if round_rotor else "two inductances: L_d,L_q"
            raise UserError(f"--free {word}: the machine '{drive.model.machine}' of '{drive.name}' has {of_model}.")
        if words.count(word) > 1:
            raise UserError(f"--free names {word} twice.")
    if "D" in words and not facts.D:
        raise UserError("--free D: the friction is stated as 0; state a guess above 0, of which the search can start.")
    return tuple(datum for word, datum in DATA.items() if word in words)


def facts_of(drive: Drive) -> Facts:
    """A drive file's data as facts.

    Parameters
    ----------
    drive : Drive
    """
    m, task, stated = drive.motor, rating(drive), drive.tolerance
    widths = dict(UNSTATED)
    if stated is not None:
        keys = {"d_R": stated.stator_resistance, "d_L": stated.inductance, "d_psi": stated.magnet_flux}
        widths |= {name: value for name, value in keys.items() if value}
    initial = drive.filter.initial_covariance[3]
    T = drive.model.sample_time
    return Facts(
        name=drive.name,
        R=m.stator_resistance,
        L_d=m.inductance_d,
        L_q=m.inductance_q,
        psi_m=m.magnet_flux,
        p=m.pole_pairs,
        J=m.inertia,
        D=m.friction,
        speed=task.speed,
        torque=task.torque,
        max_current=drive.control.max_current,
        **widths,
        dc_link=drive.control.dc_link,
        T=T,
        dead_time=lost_voltage(drive) * T / drive.control.dc_link,
        range=2.5 * drive.control.max_current,
        bits=16,
        noise=math.sqrt(drive.filter.measurement_noise[0]),
        angle=min(math.pi, math.sqrt(3 * initial)),
        step_every=0.3,
    )


def with_found(facts: Facts, found: dict[str, tuple[float, float]]) -> Facts:
    """Facts with what was found in them.

    Parameters
    ----------
    facts : Facts
    found : dict of str to (float, float)
        Value and relative half-width, by the words of --free.
    """
    changes: dict[str, Any] = {}
    for word, (value, width) in found.items():
        if word == "V_dead":
            changes["dead_time"] = min(max(value, 0.0) * facts.T / facts.dc_link, 0.2 * facts.T)
            continue
        names = {"L": ("L_d", "L_q")}.get(word, (word,))
        changes |= dict.fromkeys(names, value)
        kind = {"R": "d_R", "L": "d_L", "L_d": "d_L", "L_q": "d_L", "psi_m": "d_psi", "J": "d_J"}.get(word)
        if kind:
            changes[kind] = max(changes.get(kind, 0.0), width)
    known = {name: value for name, value in changes.items() if hasattr(facts, name)}
    return replace(facts, **known)
