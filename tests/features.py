"""What a drive may be like, and the fewest shipped drives that are all of it: what most tests run on."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from itertools import combinations

from model.drives.load import load_drive, shipped_drives
from model.machines import find_machine
from model.schema import Drive
from runtime.folders.resolve import GENERATED

LOOP = "bounded loop"


def iteration(drive: Drive) -> str:
    """What its generated folder says of its ICKF: a loop, or why iterating is idle; nothing of a drive without one."""
    manifest = GENERATED / drive.name / "manifest.json"
    filters = json.loads(manifest.read_text())["filters"] if manifest.exists() else {}
    return str(filters["ickf"]["iteration"]) if "ickf" in filters else ""


def state_unit(drive: Drive) -> str:
    """Of the electrical states: A or Wb."""
    return find_machine(drive).states[0].unit


FEATURES: dict[str, Callable[[Drive], bool]] = {
    "round rotor": lambda drive: drive.motor.inductance_d == drive.motor.inductance_q,
    "salient rotor": lambda drive: drive.motor.inductance_d != drive.motor.inductance_q,
    "currents as states": lambda drive: state_unit(drive) == "A",
    "flux linkages as states": lambda drive: state_unit(drive) == "Wb",
    "constant speed": lambda drive: drive.model.mechanics == "constant_speed",
    "load torque": lambda drive: drive.model.mechanics == "load_torque",
    "euler": lambda drive: drive.model.discretization == "euler",
    "exact": lambda drive: drive.model.discretization == "exact",
    "adaptive": lambda drive: bool(drive.model.adaptive),
    "root order": lambda drive: drive.filter.root_order is not None,
    "iterating": lambda drive: iteration(drive) == LOOP,
    "idle": lambda drive: iteration(drive) not in {LOOP, ""},
}


def unmet(drives: Sequence[Drive], features: Mapping[str, Callable[[Drive], bool]] = FEATURES) -> list[str]:
    """Features that none of the drives has."""
    return [word for word, has in features.items() if not any(map(has, drives))]


def fewest(features: Mapping[str, Callable[[Drive], bool]] = FEATURES) -> tuple[str, ...]:
    """The fewest shipped drives that have all features between them; of as many the ones with fewer states.

    Raises
    ------
    ValueError
        No shipped drive has some feature.
    """
    drives = sorted(map(load_drive, shipped_drives()), key=lambda drive: len(drive.filter.process_noise))
    if unmet(drives, features):
        raise ValueError(f"no shipped drive has: {', '.join(unmet(drives, features))}.")
    sets = (some for size in range(1, len(drives) + 1) for some in combinations(drives, size))
    return tuple(drive.name for drive in next(some for some in sets if not unmet(some, features)))
