"""A target by its name: the file of that name in :mod:`codegen.targets.chips`. There is no list to keep."""

from __future__ import annotations

import difflib
import importlib
import pkgutil

from codegen.targets.description import Target
from model.schema import DEFAULT_TARGET, DriveError

CHIPS = "codegen.targets.chips"


def target_names() -> list[str]:
    """Names of all targets, in alphabetical order."""
    return sorted(found.name for found in pkgutil.iter_modules(importlib.import_module(CHIPS).__path__))


def find_target(name: str) -> Target:
    """The description of a target.

    Parameters
    ----------
    name : str

    Raises
    ------
    DriveError
        There is none of that name.

    >>> find_target("f28335").title
    'TI TMS320F28335'
    """
    names = target_names()
    if name not in names:
        near = difflib.get_close_matches(name, names, 1)
        advice = f"Did you mean '{near[0]}'?" if near else f"There are: {', '.join(names)}."
        raise DriveError(f"no target '{name}'. {advice}")
    target: Target = importlib.import_module(f"{CHIPS}.{name}").TARGET
    return target


def default_target() -> Target:
    """The target of a drive file that names none."""
    return find_target(DEFAULT_TARGET)
